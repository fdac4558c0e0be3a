"""Mutation score of a room: the share of the faults put into its source that its tests notice.

Usage: python benchmarks/mutation_score.py [ROOM] [--mutants N] [--seed 1] [--only FILE[:LINE]] [--list]

A copy of the package is changed in one place at a time: comparisons, operators, constants, conditions, and which
extreme is taken. A mutant is killed when a test fails, ends in an error, or needs far more time or memory than the
tests do. Without --mutants all of them are tried; the seed decides a sample. Survivors are printed with their place:
they are either equivalent, or a test is missing. Those known to be equivalent are listed with the reason in
equivalent_mutants.py; they are tried as well, and count as survivors in the first of the two scores.

The tests are run once with a trace of the lines that each executes in the files of the sample. A mutant is then given
to the tests that reach it, the quickest first, each time in a process forked off one that has loaded their libraries.
The score is that of the tests in `ROOMS` alone: those of other rooms and the slow ones may notice more.
"""

from __future__ import annotations

import argparse
import ast
import gc
import json
import os
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import lxml.etree  # noqa: F401  loaded once for all forks
import numpy as np  # noqa: F401
import pytest
import yaml  # noqa: F401
from hypothesis.internal.conjecture.engine import ConjectureRunner

from equivalent_mutants import EQUIVALENT

ROOT = Path(__file__).parents[1]
PACKAGE = Path("src", "halpipe")
NEEDED = ("src", "tests", "docs", "examples", "benchmarks", "pyproject.toml", "build_native.py", "hatch_build.py")
ROOMS = {
    "verify": (
        "pipeline/verify",
        "unit/pipeline/test_verify_* unit/pipeline/test_health* properties/test_verify_* unit/test_second_checker*",
    ),
    "core": (
        "core",
        "unit/core/* unit/test_options* properties/test_durations* unit/importers/test_overlay_r*",
    ),
    "flow": (
        "flow",
        (
            "unit/test_flow* unit/test_formats_* unit/pipeline/test_plan* unit/test_options* cli/test_cli_fleet* "
            "unit/exporters/test_report_beside* unit/deploy/test_check_*"
        ),
    ),
    "cli": (
        "cli",
        (
            "unit/cli/* cli/test_cli_verbs* cli/test_cli_mistakes* cli/test_cli_help* cli/test_cli_whatif* "
            "cli/test_cli_explain* cli/test_cli_fleet* cli/test_cli_generate* cli/test_cli_completion* "
            "cli/test_cli_golden* cli/test_cli_ros* cli/test_cli_arxml* cli/test_cli_verify* cli/test_cli_regulator* "
            "cli/test_cli_new* cli/test_cli_serve* cli/test_cli_faults* cli/test_cli_limits* cli/test_cli_own_files* "
            "cli/test_cli_trouble* cli/test_cli_programs* cli/test_cli_selftest* "
            "unit/deploy/test_check_onto* unit/importers/test_arxml_[ov]* unit/pipeline/test_budget* "
            "unit/pipeline/test_plan* unit/core/test_libraries* unit/test_formats_and_checked* unit/test_options* "
            "unit/test_docs_generated*"
        ),
    ),
    "models": (
        "models",
        "unit/test_models* unit/importers/test_native_* unit/pipeline/test_expand* unit/exporters/test_native_*",
    ),
    "schemas": ("schemas", "unit/test_schemas* unit/importers/test_native_*"),
    "selftest": ("selftest", "unit/selftest/test_[bs]* cli/test_cli_selftest*"),
    "workbench": ("workbench", "unit/workbench/* cli/test_cli_serve*"),
    "importers/native": ("importers/native", "unit/importers/test_native_* unit/exporters/test_native_*"),
    "importers/overlay": ("importers/overlay", "unit/importers/test_overlay_*"),
    "importers/table": ("importers/table", "unit/importers/test_table* properties/test_table*"),
    "importers/traces": (
        "importers/traces",
        "unit/importers/test_trace* unit/importers/test_ctf* unit/importers/test_ros_traced*",
    ),
    "importers/ros": ("importers/ros", "unit/importers/test_ros_*"),
    "importers/amalthea": ("importers/amalthea", "unit/importers/amalthea/*"),
    "importers/arxml": (
        "importers/arxml",
        "unit/importers/test_arxml_[!s]* unit/importers/test_arxml_s[!i]*",
    ),
    "importers/common": (
        "importers/common",
        (
            "unit/importers/test_importers_common* unit/importers/test_polling* unit/importers/test_damage* "
            "unit/importers/test_arxml_preemption*"
        ),
    ),
    "exporters/common": ("exporters/common", "unit/exporters/test_*"),
    "exporters/native": ("exporters/native", "unit/exporters/test_native_*"),
    "exporters/arxml": (
        "exporters/arxml",
        (
            "unit/exporters/test_arxml_* unit/importers/test_arxml_onto* unit/importers/test_arxml_definitions* "
            "unit/importers/test_arxml_embedded* unit/importers/test_arxml_played* unit/importers/test_arxml_xdm* "
            "unit/importers/test_arxml_releases* unit/importers/test_arxml_slim*"
        ),
    ),
    "exporters/amalthea": ("exporters/amalthea", "unit/exporters/test_amalthea_* properties/test_amalthea_roundtrip*"),
    "exporters/btf": ("exporters/btf", "unit/exporters/test_btf*"),
    "exporters/trace": ("exporters/trace", "unit/exporters/test_trace*"),
    "exporters/graph": ("exporters/graph", "unit/exporters/test_graph*"),
    "exporters/report": (
        "exporters/report",
        (
            "unit/exporters/test_report* unit/exporters/test_parts_shown* unit/exporters/test_split_switches_shown* "
            "unit/exporters/test_selection* unit/exporters/test_exporters_total* unit/workbench/*"
        ),
    ),
    "exporters/ros": ("exporters/ros", "unit/exporters/test_ros_* linux/test_ros_package* linux/test_ros_waits*"),
    "exporters/linux": ("exporters/linux", "linux/test_linux_bundle* linux/test_linux_let*"),
    "exporters/regulator": ("exporters/regulator", "unit/exporters/regulator/test_regulator_[!s]*"),
    "exporters/riscv": (
        "exporters/riscv",
        "unit/exporters/riscv/* riscv/export/test_riscv_[bp]* riscv/export/test_riscv_re* properties/test_riscv_ph*",
    ),
    "deploy/regulator": ("deploy/regulator", "unit/deploy/regulator/*"),
    "deploy/riscv": ("deploy/riscv", "unit/deploy/riscv/*"),
    "deploy/linux": ("deploy/linux", "linux/test_linux_check* linux/test_linux_recordings*"),
    "validate": (
        "pipeline/validate",
        "unit/pipeline/test_validate_[!s]* unit/pipeline/test_validate_s[tp][!e]* properties/test_validate_answers*",
    ),
    "compare": (
        "pipeline/compare",
        (
            "unit/pipeline/test_compare* unit/pipeline/test_learning* unit/exporters/test_parts_shown* "
            "unit/exporters/test_split_switches_shown*"
        ),
    ),
    "explain": (
        "pipeline/explain",
        (
            "unit/pipeline/test_explain* properties/test_explain_* properties/test_exact_and_witnesses* "
            "properties/test_blocking* properties/test_split_exhaustive*"
        ),
    ),
    "generate": ("pipeline/generate", "unit/pipeline/test_generate* properties/test_generate_[aw]*"),
    "measure": (
        "pipeline/measure",
        (
            "unit/pipeline/test_cost* unit/pipeline/test_latency* unit/pipeline/test_metrics* "
            "unit/pipeline/test_circle* unit/pipeline/test_splitting* unit/pipeline/test_margin* "
            "unit/pipeline/test_objectives* properties/test_cost_verify* properties/test_cost_refined* "
            "properties/test_margin_bounds* properties/test_measure_answers*"
        ),
    ),
    "transitions": (
        "pipeline/transitions",
        "unit/pipeline/test_transitions* properties/test_switch_tables* properties/test_search_golden*",
    ),
    "whatif": (
        "pipeline/whatif",
        (
            "unit/pipeline/test_whatif_* cli/test_cli_whatif* properties/test_whatif_* properties/test_growth_* "
            "properties/test_cost_verify_split* unit/workbench/test_session* unit/test_options*"
        ),
    ),
    "solve": (
        "pipeline/solve",
        (
            "unit/pipeline/test_[bfimnopqru]* unit/pipeline/test_c[lr]* unit/pipeline/test_cons* "
            "unit/pipeline/test_ed* unit/pipeline/test_exa* unit/pipeline/test_groups* unit/pipeline/test_li* "
            "unit/pipeline/test_s[!c]* unit/pipeline/test_turns* unit/pipeline/test_workers* "
            "properties/test_kernel_cost* properties/test_search_* properties/test_exact_* "
            "properties/test_improving* properties/test_split_search* properties/test_edf_reference* "
            "properties/test_refined_search* properties/test_freeze_split* cli/test_cli_resume*"
        ),
    ),
    "pipeline": (
        "pipeline",
        (
            "unit/pipeline/test_health* unit/pipeline/test_stable* unit/pipeline/test_freeze* "
            "unit/pipeline/test_parts* unit/pipeline/test_splitting* unit/pipeline/test_expand* "
            "unit/pipeline/test_diff* unit/pipeline/test_latency* unit/pipeline/test_cost* "
            "unit/pipeline/test_bound_modes* unit/pipeline/test_crowded* unit/pipeline/test_plan* "
            "unit/pipeline/test_checked* unit/pipeline/test_transitions* unit/pipeline/test_reserved* "
            "unit/pipeline/test_quantise* unit/pipeline/test_search* unit/pipeline/test_explain_on_grid* "
            "unit/test_formats_and_checked* unit/cli/test_shown* unit/workbench/test_reached* "
            "properties/test_cost_verify_split* properties/test_cost_refined* properties/test_search_golden*"
        ),
    ),
}
"""The folder of each room in the package, without those of rooms inside it, and its tests."""

OPTIONS = ["-x", "-q", "-p", "no:xdist", "-p", "no:cacheprovider", "-m", "not slow", "--tb=no", "-o", "timeout=0"]
MEMORY = 3 << 30
"""What a mutant may use; the tests need a tenth of it."""

PATIENCE = 4
"""Seconds of the processor that a test may take with a mutant, and five times what it takes with a trace.

It may take five times as long by the clock, so that one that waits for ever ends, too.
"""

SWAPS = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.FloorDiv, ast.FloorDiv: ast.Mult, ast.Mod: ast.FloorDiv,
}  # fmt: skip
DECIDE_NOTHING = {"slots", "frozen", "kw_only", "strict", "maxsize"}
"""Options of classes, of `zip` over what is of one length, and of caches."""

LIMIT = re.compile(r"_?(?:MOST|MAX|LONGEST)[A-Z_]* = \d+")
"""Assignments of limits, of which one more is as good; tests/unit/test_limit_constants* try each on both sides."""

CACHES = {"cache", "lru_cache"}
"""Decorators of functions whose lines only the first test executes that calls them."""

NAMES = {"min": "max", "max": "min", "any": "all", "all": "any", "floor": "ceil", "ceil": "floor"}


# ------------------------------------------------------------------------------------------------ mutants


def places(tree: ast.AST) -> list[tuple[ast.AST, str]]:
    """Return what can be changed: a node, and which of its fields."""
    found: list[tuple[ast.AST, str]] = []
    keywords = (node for node in ast.walk(tree) if isinstance(node, ast.keyword))
    undecided = {id(node.value) for node in keywords if node.arg in DECIDE_NOTHING}
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            found += [(node, f"ops {n}") for n, op in enumerate(node.ops) if type(op) in SWAPS]
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
    kind, _, number = field.partition(" ")
    if kind == "ops":
        node.ops[int(number)] = SWAPS[type(node.ops[int(number)])]()
    elif kind == "op":
        node.op = SWAPS[type(node.op)]()
    elif kind == "not":
        node.operand = ast.UnaryOp(ast.Not(), node.operand)
    elif kind == "call":
        node.func.id = NAMES[node.func.id]
    else:
        node.value = (not node.value) if isinstance(node.value, bool) else node.value + 1


class Mutant:
    """One fault: its file, number of its place, and what the tests have to reach to notice it."""

    def __init__(self, path: Path, number: int) -> None:
        self.path = path
        self._tree = ast.parse(path.read_text())
        node, field = places(self._tree)[number]
        self.line = node.lineno
        self.lines = self._reached_by(node)
        statement = self._statement(node)
        whole = ast.unparse(statement).splitlines()[0]
        before = ast.unparse(node)
        change(node, field)
        self.changed = path.name, ast.unparse(statement).splitlines()[0]
        self.place = f"{path.name}:{self.line}: {before}  ->  {ast.unparse(node)}   in   {whole}"
        self.source = ast.unparse(ast.fix_missing_locations(self._tree))
        del self._tree

    def _statement(self, node: ast.AST) -> ast.stmt:
        around = [s for s in ast.walk(self._tree) if isinstance(s, ast.stmt) and any(n is node for n in ast.walk(s))]
        return max(around, key=lambda s: (s.lineno, -(s.end_lineno or 0)))

    def _reached_by(self, node: ast.AST) -> range | None:
        """Return the lines of the expression's statement; None for what is decided at import, or kept by a cache."""
        functions = (f for f in ast.walk(self._tree) if isinstance(f, ast.FunctionDef))
        bodies = [s for f in functions if not CACHES & {*map(ast.unparse, f.decorator_list)} for s in f.body]
        if not any(n is node for body in bodies for n in ast.walk(body)):
            return None
        statement = self._statement(node)
        heads = [s.lineno for s in ast.walk(statement) if isinstance(s, ast.stmt) and s is not statement]
        return range(statement.lineno, max(min(heads, default=(statement.end_lineno or 0) + 1), statement.lineno + 1))

    def is_known(self) -> bool:
        """Whether it changes nothing: it is listed, or makes a limit that was chosen one larger."""
        return self.changed in EQUIVALENT or LIMIT.fullmatch(self.changed[1]) is not None


# ------------------------------------------------------------------------------------------------ tests


class Trace:
    """Lines of some files that each test executes, and the time that it takes."""

    def __init__(self, files: set[str]) -> None:
        self._files, self.lines, self.seconds, self._now = files, {}, {}, set()
        self._shared: set[tuple[str, int]] = set()

    def _enter(self, frame, event, argument):
        name = frame.f_code.co_filename
        if name not in self._files:
            return None
        now = self._now

        def step(frame, _event, _argument):
            now.add((name, frame.f_lineno))
            return step

        return step(frame, event, argument)

    @contextmanager
    def _tracing(self):
        self._now = set()
        threading.settrace(self._enter)  # a server answers in threads of its own
        sys.settrace(self._enter)
        try:
            yield
        finally:
            sys.settrace(None)
            threading.settrace(None)  # type: ignore[arg-type]

    @pytest.hookimpl(wrapper=True)
    def pytest_collection(self):
        """Let every test of the file reach what is executed while modules are imported."""
        with self._tracing():
            found = yield
        self._shared |= self._now
        return found

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item):
        begin = time.perf_counter()
        try:
            with self._tracing():
                return (yield)
        finally:
            self.lines[item.nodeid], self.seconds[item.nodeid] = sorted(self._now), time.perf_counter() - begin

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef):
        before, self._now = self._now, set()
        try:
            return (yield)
        finally:
            self._shared |= self._now if fixturedef.scope != "function" else set()
            self._now |= before

    def pytest_sessionfinish(self):
        """Let every test of the file reach what a fixture executed for all of them, while the first one ran."""
        self.lines = {name: sorted({*lines} | self._shared) for name, lines in self.lines.items()}


class Chosen:
    """Runs some tests only, the quickest first, and ends the process where one does not end."""

    def __init__(self, seconds: dict[str, float]) -> None:
        self._seconds = seconds

    def pytest_collection_modifyitems(self, items):
        items[:] = sorted((i for i in items if i.nodeid in self._seconds), key=lambda i: self._seconds[i.nodeid])

    def pytest_runtest_setup(self, item):
        seconds = PATIENCE + 5 * self._seconds[item.nodeid]
        signal.setitimer(signal.ITIMER_PROF, seconds)  # nothing answers SIGPROF or SIGALRM
        signal.setitimer(signal.ITIMER_REAL, 5 * seconds)  # a reader of an empty pipe takes no processor


class Tests:
    """The tests of a copy of the project."""

    def __init__(self, place: Path, patterns: str) -> None:
        self.place = place
        found = {path for pattern in patterns.split() for path in place.glob(f"tests/{pattern}.py")}
        self.files = sorted(str(path.relative_to(place)) for path in found if path.name.startswith("test_"))
        self._lines: dict[str, set[tuple[str, int]]] = {}
        self._seconds: dict[str, float] = {}

    def trace(self, files: set[str]) -> None:
        """Run each file of tests by itself, with a trace of some files of the source."""
        noted = self.place / "trace.json"
        for name in self.files:
            tracer = Trace(files)
            if not self._passes([name], tracer, noted):
                sys.exit(f"the tests of {name} fail without a fault")
            lines, seconds = json.loads(noted.read_text())
            self._lines.update({test: {(f, n) for f, n in found} for test, found in lines.items()})
            self._seconds.update(seconds)

    def notice(self, mutant: Mutant) -> bool:
        """Return whether one of the tests that reach the mutant fails."""
        tests = list(self._lines)
        if mutant.lines is not None:
            wanted = {(str(mutant.path), line) for line in mutant.lines}
            tests = [test for test, lines in self._lines.items() if wanted & lines]
        if not tests:
            return False
        files = sorted({test.split("::")[0] for test in tests})
        return not self._passes(files, Chosen({test: self._seconds[test] for test in tests}))

    def pass_all(self) -> bool:
        """Return whether all succeed."""
        return self._passes(self.files, Chosen(self._seconds))

    def _passes(self, files, plugin, noted: Path | None = None) -> bool:
        child = os.fork()
        if child:
            return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
        code = 99
        try:
            nothing = os.open(os.devnull, os.O_RDWR)
            for stream in (0, 1, 2):
                os.dup2(nothing, stream)
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            os.chdir(self.place)
            sys.path.insert(0, str(self.place / "src"))
            os.environ["PYTHONPATH"] = str(self.place / "src")
            ConjectureRunner.shrink_interesting_examples = lambda _: None  # whether there is one is all that counts
            code = int(pytest.main([*OPTIONS, *files], plugins=[plugin]))
            if noted:
                noted.write_text(json.dumps([plugin.lines, plugin.seconds]))
        finally:
            os._exit(code)


# ------------------------------------------------------------------------------------------------ the score


def copied(place: Path) -> None:
    """Copy what the tests need."""
    for name in NEEDED:  # the tests look for the package beside them
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, place / name, ignore=shutil.ignore_patterns("__pycache__", "out"))
        else:
            shutil.copy(ROOT / name, place)


def mutants(package: Path, room: str, only: str) -> list[tuple[Path, int]]:
    """Return the places of all of them, or those of one file or line; rooms inside the room have their own."""
    name, _, line = only.partition(":")
    folders = {package / folder: room for room, (folder, _) in ROOMS.items()}
    found = []
    for path in sorted((package / ROOMS[room][0]).rglob("*.py")):
        innermost = next(folders[folder] for folder in path.parents if folder in folders)
        if innermost == room and path.name != "codes.py" and name in ("", path.name):
            found += [(path, number) for number in range(len(places(ast.parse(path.read_text()))))]
    return [place for place in found if not line or Mutant(*place).line == int(line)]


def prepared(chosen: list[Mutant], tests: Tests) -> None:
    """Check that the tests succeed without a fault, and fail with one."""
    sys.dont_write_bytecode = False
    tests.trace({str(mutant.path) for mutant in chosen})
    sys.dont_write_bytecode = True  # what is not changed stays compiled
    for folder in {mutant.path.parent for mutant in chosen}:
        shutil.rmtree(folder / "__pycache__", ignore_errors=True)
    sources = {mutant.path: mutant.path.read_text() for mutant in chosen}
    for path in sources:
        path.write_text("raise ImportError\n")
    if tests.pass_all():
        sys.exit("the tests do not see the copy that is changed")
    for path, source in sources.items():
        path.write_text(source)
    if not tests.pass_all():
        sys.exit("the tests fail without a fault")


def tried(chosen: list[Mutant], tests: Tests) -> list[Mutant]:
    """Try them all, and return the survivors."""
    survivors = []
    gc.freeze()  # what is loaded is nothing to look at for the forks
    for count, mutant in enumerate(chosen, 1):
        original = mutant.path.read_text()
        mutant.path.write_text(mutant.source)
        if not tests.notice(mutant):
            survivors.append(mutant)
            print(f"{'equivalent' if mutant.is_known() else 'survived'}: {mutant.place}", flush=True)
        mutant.path.write_text(original)
        if count % 50 == 0:
            print(f"{count - len(survivors)} of {count} killed", flush=True)
    return survivors


def main() -> int:
    """Try all mutants, or a sample."""
    parser = argparse.ArgumentParser()
    parser.add_argument("room", nargs="?", default="verify", choices=ROOMS, metavar="ROOM", help=", ".join(ROOMS))
    parser.add_argument("--mutants", type=int, default=0, help="how many; without it, all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="a file of the room, or one line of it: tables.py:120")
    parser.add_argument("--list", action="store_true", help="print them and try none")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="halpipe-mutants-") as name:
        place = Path(name).resolve()
        patterns = ROOMS[options.room][1] + " unit/test_limit_constants*"  # the limits of all rooms
        copied(place)
        found = mutants(place / PACKAGE, options.room, options.only)
        print(f"{len(found)} places", flush=True)
        if options.mutants:
            found = random.Random(options.seed).sample(found, min(options.mutants, len(found)))
        chosen = [Mutant(*each) for each in found]
        if options.list:
            print(*(mutant.place for mutant in chosen), sep="\n")
            return 0
        tests = Tests(place, patterns)
        prepared(chosen, tests)
        survivors = tried(chosen, tests)
    killed, real = len(chosen) - len(survivors), [mutant for mutant in survivors if not mutant.is_known()]
    seed = f", seed {options.seed}" if options.mutants else ""
    print(f"{options.room}: {killed} of {len(chosen)} killed, {100 * killed / len(chosen):.1f} %{seed}; "
          f"{len(survivors) - len(real)} of the survivors change nothing, so {len(real)} count")  # fmt: skip
    return 1 if real else 0


if __name__ == "__main__":
    sys.exit(main())
