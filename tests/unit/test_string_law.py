"""The law of strings: text from files is data, never a format, a command, a program or markup.

Like the import law, it is read from the syntax trees of the package.
"""

import ast
from pathlib import Path

import pytest

import halpipe

SOURCE = Path(halpipe.__file__).parent
TREES = {path.relative_to(SOURCE).as_posix(): ast.parse(path.read_bytes()) for path in sorted(SOURCE.rglob("*.py"))}

FORBIDDEN = {
    "eval",
    "exec",
    "os.system",
    "os.popen",
    "pickle.loads",
    "pickle.load",
    "marshal.loads",
    "yaml.load",
    "input",
}
FORBIDDEN |= {"input", "yaml.unsafe_load", "yaml.full_load", "string.Template", "Template"}

# The names of fields in classes of the package become a function; nothing that is read does.
EXCEPTIONS = {("core/records.py", "exec")}


def calls(tree):
    return [(node, ast.unparse(node.func)) for node in ast.walk(tree) if isinstance(node, ast.Call)]


def is_text(node):
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))


def formats_of_others(tree):
    """Texts that are used as formats, though they do not stand in the program: `x.format(y)`, `x % y`."""
    for node, name in calls(tree):
        own = (
            isinstance(node.func, ast.Attribute) and ast.unparse(node.func.value).isupper()
        )  # a constant of the module
        if name.endswith(".format") and not is_text(node.func.value) and not own:
            yield node.lineno
        if name.endswith((".format_map", "vformat")):
            yield node.lineno
        if name.endswith(".format") and isinstance(node.func.value, ast.JoinedStr):
            yield node.lineno  # braces of a value would be fields
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mod) and isinstance(node.left, ast.JoinedStr):
            yield node.lineno


@pytest.mark.parametrize("path", TREES)
def test_no_text_from_elsewhere_is_a_format(path):
    assert list(formats_of_others(TREES[path])) == []


@pytest.mark.parametrize("path", TREES)
def test_no_text_is_a_program_or_a_shell_command(path):
    for node, name in calls(TREES[path]):
        assert name not in FORBIDDEN or (path, name) in EXCEPTIONS, (node.lineno, name)
        for option in node.keywords:
            is_off = isinstance(option.value, ast.Constant) and option.value.value is False
            assert option.arg != "shell" or is_off, node.lineno


@pytest.mark.parametrize("path", TREES)
def test_templates_say_how_they_escape_and_know_all_their_names(path):
    for node, name in calls(TREES[path]):
        if name.endswith("jinja2.Environment") or name == "Environment":
            stated = {option.arg: ast.unparse(option.value) for option in node.keywords}
            assert "autoescape" in stated, node.lineno
            assert stated.get("undefined", "").endswith("StrictUndefined"), node.lineno


@pytest.mark.parametrize("path", TREES)
def test_documents_are_parsed_behind_the_hardened_doors_only(path):
    """XML and YAML from outside come through `halpipe.core.files`; the schemas of the package are its own."""
    if path.startswith("core/files/"):
        return
    for node, name in calls(TREES[path]):
        is_parser = name.endswith(("etree.parse", "etree.fromstring", "etree.XML", "etree.iterparse", "yaml.compose"))
        assert not is_parser or path in OWN_DOCUMENTS, (node.lineno, name)


READERS = {
    "json": {"load", "loads", "JSONDecoder"},
    "yaml": {"load", "load_all", "safe_load", "safe_load_all", "compose", "compose_all", "parse", "scan", "SafeLoader"},
}
"""Names that read JSON or YAML, of which the libraries keep the last of repeated keys."""


def reads_json_or_yaml(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.attr in READERS.get(node.value.id, ()):
                yield node.lineno
        elif isinstance(node, ast.ImportFrom) and READERS.get(node.module or "", set()) & {n.name for n in node.names}:
            yield node.lineno


def test_one_module_reads_json_and_yaml():
    """Every reader refuses repeated keys, because there is one."""
    assert [path for path, tree in TREES.items() if any(reads_json_or_yaml(tree))] == ["core/files/yaml.py"]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("json.loads(a)", 1),
        ("from json import loads", 1),
        ("each = yaml.safe_load", 1),
        ("json.JSONDecoder(parse_float=f)", 1),
        ("json.dumps(a); yaml.safe_dump(b); from json import dumps", 0),
    ],
)
def test_a_reader_of_its_own_is_seen(text, found):
    assert len(list(reads_json_or_yaml(ast.parse(text)))) == found


OWN_DOCUMENTS = {"schemas/__init__.py"}
"""Modules that parse documents of the package itself, or such as were parsed and written by it."""


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("path.format(name)", 1),
        ("f'{a} {{}}'.format(name)", 1),
        ("'{} {}'.format(a, b)", 0),
        ("f'{a}' % b", 1),
        ("template.format_map(x)", 1),
        ("a % b", 0),
    ],
)
def test_the_law_knows_formats(text, found):
    assert len(list(formats_of_others(ast.parse(text)))) == found
