"""Every diagnostic code is documented, and some test is about it."""

import ast
import importlib
import pkgutil
import re
from collections import Counter, defaultdict
from functools import cache
from pathlib import Path

import pytest

import halpipe
from halpipe.core.diagnostics import REGISTER

TESTS = Path(__file__).parents[1]
SOURCE = Path(halpipe.__file__).parent
MAKERS = {"error", "warning", "note"}

for module in pkgutil.walk_packages(halpipe.__path__, "halpipe."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)


@cache
def constants():
    """Every code by the module and the name of the constant that holds it."""
    found = {}
    for path in sorted(SOURCE.rglob("*.py")):
        module = ".".join(("halpipe", *path.relative_to(SOURCE).with_suffix("").parts)).removesuffix(".__init__")
        for node in ast.parse(path.read_bytes()).body:
            match node:
                case ast.Assign(
                    targets=[ast.Name(id=name)],
                    value=ast.Call(func=ast.Name(id=maker), args=[ast.Constant(value=id), *_]),
                ) if maker in MAKERS:
                    found[module, name] = id
    return found


def modules_used(tree):
    """What a test file imports: names of modules, and names in modules."""
    modules, names = set(), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            modules |= {f"{node.module}.{alias.name}" for alias in node.names}
            names |= {(node.module, alias.name) for alias in node.names}
    return modules, names


@cache
def handed_on():
    """The codes that packages import from their modules for others, in the same form."""
    found = {}
    for path in sorted(SOURCE.rglob("__init__.py")):
        package = ".".join(("halpipe", *path.parent.relative_to(SOURCE).parts))
        _, names = modules_used(ast.parse(path.read_bytes()))
        found |= {(package, name): constants()[module, name] for module, name in names if (module, name) in constants()}
    return found


@cache
def mentioned():
    """The ids that test files (of any kind) spell out, or reach by a constant they import."""
    by_module = defaultdict(dict)
    for (module, name), id in constants().items():
        by_module[module][name] = id
    for (package, name), id in handed_on().items():
        by_module[package][name] = id
    reached = constants() | handed_on()
    found = set()
    for path in sorted(TESTS.rglob("*")):
        if not path.is_file() or path == Path(__file__) or path.suffix == ".pyc":
            continue
        found |= set(re.findall(r"HAL\d{4}", path.name + path.read_bytes().decode("utf-8", "replace")))
        if path.suffix == ".py":
            tree = ast.parse(path.read_bytes())
            modules, names = modules_used(tree)
            found |= {reached[pair] for pair in names if pair in reached}
            attributes = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
            for module in modules & by_module.keys():
                found |= {id for name, id in by_module[module].items() if name in attributes}
    return found


def test_every_code_is_a_constant_of_some_module():
    assert sorted(constants().values()) == sorted(REGISTER)


@pytest.mark.parametrize("id", sorted(REGISTER))
def test_code_is_well_formed(id):
    code = REGISTER[id]
    assert re.fullmatch(r"HAL\d{4}", id)
    assert code.title
    assert not code.title.endswith(".")
    assert code.explanation.endswith(".")


def test_titles_are_unique():
    titles = Counter(code.title for code in REGISTER.values())
    assert [title for title, count in titles.items() if count > 1] == []


def test_every_code_is_the_subject_of_a_test():
    missing = sorted(REGISTER.keys() - mentioned())
    names = {id: f"{module}.{name}" for (module, name), id in constants().items()}
    assert not missing, "no test mentions " + ", ".join(f"{id} ({names[id]})" for id in missing)


def test_no_test_is_about_a_code_that_does_not_exist():
    unknown = mentioned() - REGISTER.keys()
    assert not unknown, f"tests mention {', '.join(sorted(unknown))}"
