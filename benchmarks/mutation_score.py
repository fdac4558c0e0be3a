"""How many faults put into verify's own source are noticed by its tests: the mutation score.

Usage: python benchmarks/mutation_score.py [--mutants 200] [--seed 1]. A copy of the package is changed in one place at
a time: comparisons, operators, constants, conditions, and which extreme is taken. A mutant is killed when a test fails.
Survivors are printed with their place: they are either equivalent, or a test is missing.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
VERIFY = Path("halpipe", "pipeline", "verify")
TESTS = ("tests/unit/pipeline", "-k", "verify")
MORE = ("tests/properties/test_verify_mutations.py", "tests/properties/test_verify_split_mutations.py")
LAST = ("tests/unit/test_second_checker.py",)
NEEDED = ("src", "tests", "docs", "examples", "pyproject.toml", "build_native.py", "hatch_build.py")
PATIENCE = 120

SWAPS = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.FloorDiv, ast.FloorDiv: ast.Mult, ast.Mod: ast.FloorDiv,
}  # fmt: skip
DECIDE_NOTHING = {"slots", "frozen", "kw_only", "strict"}
"""Options of classes, and of `zip` over what is of one length."""

NAMES = {"min": "max", "max": "min", "any": "all", "all": "any", "floor": "ceil", "ceil": "floor"}


def places(tree: ast.AST) -> list[tuple[ast.AST, str]]:
    """Return what can be changed: a node, and which of its fields."""
    found: list[tuple[ast.AST, str]] = []
    undecided = {id(node) for node in ast.walk(tree) if isinstance(node, ast.keyword) and node.arg in DECIDE_NOTHING}
    for node in ast.walk(tree):
        if id(node) in undecided:
            undecided.add(id(node.value))  # comes later in the walk
        if isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPS:
            found.append((node, "ops"))
        elif isinstance(node, ast.BinOp | ast.BoolOp) and type(node.op) in SWAPS and not _is_text(node):
            found.append((node, "op"))
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            found.append((node, "not"))
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in NAMES:
            found.append((node, "call"))
        elif isinstance(node, ast.Constant) and type(node.value) in (int, bool) and id(node) not in undecided:
            found.append((node, "constant"))
    return found


def _is_text(node: ast.AST) -> bool:
    """Whether it joins texts or types, which decide nothing."""
    return any(isinstance(n, ast.JoinedStr) or (isinstance(n, ast.Constant) and isinstance(n.value, str))
               for n in ast.walk(node))  # fmt: skip


def change(node: ast.AST, field: str) -> None:
    """Put one fault into the tree."""
    if field == "ops":
        node.ops[0] = SWAPS[type(node.ops[0])]()
    elif field == "op":
        node.op = SWAPS[type(node.op)]()
    elif field == "not":
        node.operand = ast.UnaryOp(ast.Not(), node.operand)
    elif field == "call":
        node.func.id = NAMES[node.func.id]
    else:
        node.value = (not node.value) if isinstance(node.value, bool) else node.value + 1


def killed(source: Path) -> bool:
    """Return whether a test fails with the package in `source`; the quickest are asked first."""
    for tests in (TESTS, MORE, LAST):
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:xdist", "-p", "no:cacheprovider"]
        command += ["-m", "not slow", *tests]
        environment = {**os.environ, "PYTHONPATH": str(source), "PYTHONDONTWRITEBYTECODE": "1"}
        try:
            done = subprocess.run(
                command, cwd=source.parent, env=environment, capture_output=True, timeout=PATIENCE, check=False
            )
        except subprocess.TimeoutExpired:
            return True
        if done.returncode not in (0, 5):
            return True
    return False


def main() -> int:
    """Try a sample of all mutants."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--mutants", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="halpipe-mutants-") as place:
        source = Path(place, "src")
        for name in NEEDED:  # the tests look for the package beside them
            if (ROOT / name).is_dir():
                shutil.copytree(ROOT / name, Path(place, name), ignore=shutil.ignore_patterns("__pycache__", "out"))
            else:
                shutil.copy(ROOT / name, place)
        sites = []
        for path in sorted((source / VERIFY).glob("*.py")):
            if path.name not in ("codes.py", "__init__.py"):
                sites += [(path, number) for number in range(len(places(ast.parse(path.read_text()))))]
        print(f"{len(sites)} places", flush=True)
        if killed(source):
            sys.exit("the tests fail without a fault")
        heart = source / VERIFY / "tables.py"
        whole = heart.read_text()
        heart.write_text("raise ImportError\n")
        if not killed(source):
            sys.exit("the tests do not see the copy that is changed")
        heart.write_text(whole)
        chosen = random.Random(options.seed).sample(sites, min(options.mutants, len(sites)))
        survived = 0
        for count, (path, number) in enumerate(chosen, 1):
            original = path.read_text()
            tree = ast.parse(original)
            node, field = places(tree)[number]
            before = ast.unparse(node)
            change(node, field)
            path.write_text(ast.unparse(ast.fix_missing_locations(tree)))
            if not killed(source):
                survived += 1
                print(f"survived: {path.name}:{node.lineno}: {before}  ->  {ast.unparse(node)}", flush=True)
            path.write_text(original)
            if count % 10 == 0:
                print(f"{count - survived} of {count} killed", flush=True)
        print(f"score {100 * (len(chosen) - survived) / len(chosen):.1f} % of {len(chosen)}, seed {options.seed}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
