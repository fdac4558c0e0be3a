"""No module needs, even late, one that needs it: what imports each other in a circle is one room with two doors.

The package itself is left out: its door opens `api` when somebody asks, and everything may ask it for its version.
"""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import halpipe

SOURCE = Path(halpipe.__file__).parent


def name_of(path, root):
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(("halpipe", *(parts[:-1] if parts[-1] == "__init__" else parts)))


def imports(node):
    """The import statements of a module, also those inside functions, but for what only types need."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
            yield from (found for other in child.orelse for found in imports(other))
        elif isinstance(child, ast.Import | ast.ImportFrom):
            yield child
        else:
            yield from imports(child)


def needs(root):
    """The modules of the package that each of them imports."""
    modules = {name_of(path, root): path for path in root.rglob("*.py")}
    found = {}
    for name, path in modules.items():
        targets = set()
        for statement in imports(ast.parse(path.read_bytes())):
            if isinstance(statement, ast.Import):
                targets |= {alias.name for alias in statement.names}
            else:
                whole = {f"{statement.module}.{alias.name}" for alias in statement.names}
                targets |= {target if target in modules else statement.module for target in whole}
        found[name] = (targets & modules.keys()) - {name, "halpipe"}
    return found


def circle(graph):
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def test_no_modules_import_each_other_in_a_circle():
    graph = needs(SOURCE)
    assert len(graph) > 400
    assert circle(graph) == []


@pytest.mark.parametrize(
    ("first", "is_allowed"),
    [
        ("import halpipe.b", False),
        ("from halpipe import b", False),
        ("from halpipe.b import x", False),
        ("def f():\n    from halpipe.b import x", False),
        ("if TYPE_CHECKING:\n    from halpipe.b import x", True),
        ("import os", True),
        ("from halpipe import __version__", True),
    ],
)
def test_the_law_itself(tmp_path, first, is_allowed):
    for name, text in {"__init__": "", "a": first, "b": "from halpipe.a import y"}.items():
        (tmp_path / f"{name}.py").write_text(text)
    assert (circle(needs(tmp_path)) == []) is is_allowed
