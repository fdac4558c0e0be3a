"""The law of diagnostics: their texts are for people. Programs ask for codes, subjects and places.

Like the import law, it is read from the syntax trees of the package.
"""

import ast
from pathlib import Path

import pytest

import halpipe

SOURCE = Path(halpipe.__file__).parent
TREES = {path.relative_to(SOURCE).as_posix(): ast.parse(path.read_bytes()) for path in sorted(SOURCE.rglob("*.py"))}

TEXTS = {"message", "help"}
READING = {"search", "match", "fullmatch", "findall", "finditer", "split", "sub"}

# Messages of libxml2 and xmlschema, which say in words only what they found.
OF_OTHERS = {"schemas/__init__.py": 2, "core/files/xml.py": 1}


def is_text(node):
    return isinstance(node, ast.Attribute) and node.attr in TEXTS


def readings(tree):
    """The lines where the text of a diagnostic is compared, searched, cut up or used as a key."""
    for node in ast.walk(tree):
        read = []
        if isinstance(node, ast.Compare):
            read = [node.left, *node.comparators]
        elif isinstance(node, ast.Attribute):
            read = [node.value]  # a method of the text
        elif isinstance(node, ast.Subscript):
            read = [node.value, node.slice]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in READING:
            read = node.args
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith(("Counter", "groupby", "set", "fromkeys")):
            read = [
                inner.elt for arg in node.args for inner in ast.walk(arg) if isinstance(inner, ast.GeneratorExp)
            ] + [inner.body for arg in node.args for inner in ast.walk(arg) if isinstance(inner, ast.Lambda)]
        elif isinstance(node, ast.SetComp):
            read = [node.elt]
        elif isinstance(node, ast.DictComp):
            read = [node.key]
        elif isinstance(node, ast.Dict):
            read = [key for key in node.keys if key is not None]
        yield from (part.lineno for part in read if is_text(part))


@pytest.mark.parametrize("path", TREES)
def test_nobody_reads_the_text_of_a_diagnostic(path):
    assert len(list(readings(TREES[path]))) == OF_OTHERS.get(path, 0)


@pytest.mark.parametrize(
    ("text", "is_allowed"),
    [
        ("re.findall('x', d.message)", False),
        ("d.message.startswith('no')", False),
        ("'task' in d.help", False),
        ("counts[d.message]", False),
        ("{d.message for d in found}", False),
        ("Counter(d.message for d in found)", False),
        ("groupby(found, lambda d: d.message)", False),
        ("{d.message: d}", False),
        ("print(d.message)", True),
        ("', '.join(d.message for d in found)", True),
        ("f'{d.path}: {d.message}'", True),
        ("{'message': d.message}", True),
        ("code(d.message, help=d.help)", True),
    ],
)
def test_the_law_itself(text, is_allowed):
    assert (list(readings(ast.parse(text))) == []) is is_allowed
