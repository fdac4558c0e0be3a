"""Conditions of the two checkers that the self-test does not see: each is switched off or bent, one at a time.

Usage: python benchmarks/conditions.py [verify|second|rules] [--mutants 20000] [--seed 1] [--only FILE[:LINE]]
[--sample N]

Faults: a comparison that takes in its limit or not, a limit that is a tick off, a condition without one of its terms or
none at all, the first in the place of any, all, every or the most. A fault is noticed when the self-test would end with
1: on the edge of a rule or on a mutant the checkers disagree, or one ends in an error or does not end. Those that
change no verdict are listed with the reason in `equivalent_mutants.py`.
With `rules`, each rule of verify as a whole is off in turn: the first edge and the first mutant that show it.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import signal
import sys
import tempfile
import types
from dataclasses import replace
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import SourceFileLoader
from importlib.util import spec_from_file_location
from itertools import starmap
from pathlib import Path
from typing import TYPE_CHECKING

from equivalent_mutants import CONDITIONS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.selftest.run import Case

ROOT = Path(__file__).parents[1]
VERIFY = ROOT / "src" / "halpipe" / "pipeline" / "verify"
SECOND = ROOT / "docs" / "safety" / "second_checker.py"
PACKAGE = "halpipe.pipeline.verify"
WITHOUT = {"codes.py", "__init__.py", "modelfaults.py"}
"""Files of verify without a condition on schedules; those of models, most of which no file breaks, have unit tests."""

TEXTS = {"text", "help", "path", "available", "known", "names", "took", "rules"}
"""Variables that hold words of findings."""

UNJUDGED = {("preemption.py", name) for name in ("check_priorities", "_unrolled", "_note", "_in_gaps", "_circle")}
UNJUDGED |= {("second_checker.py", name) for name in ("root_of", "main")}
"""Functions of the rule that reports priorities and rejects nothing, and those that read files and print; tests/unit
has their tests."""

PATIENCE = 5
"""Seconds of the processor for one verdict."""

LIMITS = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
OUTWARDS = {ast.Lt: ast.Sub, ast.LtE: ast.Add, ast.Gt: ast.Add, ast.GtE: ast.Sub}
QUANTIFIERS = {"any": "False", "all": "True"}
EXTREMES = {"min": "max", "max": "min"}


# ------------------------------------------------------------------------------------------------ faults


class Fault:
    """One fault in a file: its line, the statement with it, and the source."""

    def __init__(self, path: Path, kind: str, node: ast.AST, tree: ast.Module) -> None:
        self.path, self.line = path, getattr(node, "lineno", None) or node.target.lineno
        statement = _statement(tree, node)
        is_switched = kind in ("never", "always") and isinstance(node, ast.If)
        original = path.read_text().splitlines()[self.line - 1].strip()
        self.changed = path.name, f"{kind}: {original}" if is_switched else ast.unparse(statement).splitlines()[0]
        self.place = f"{path.name}:{self.line} [{kind}]  {self.changed[1][:170]}"
        self.source = ast.unparse(tree)

    def is_known(self) -> bool:
        """Whether it is listed as one that changes no verdict."""
        return self.changed in CONDITIONS


def _statement(tree: ast.Module, node: ast.AST) -> ast.AST:
    around = [s for s in ast.walk(tree) if isinstance(s, ast.stmt) and any(n is node for n in ast.walk(s))]
    return max(around, key=lambda s: (s.lineno, -(s.end_lineno or 0)), default=node)


class RuleOff:
    """A rule of verify that finds nothing."""

    def __init__(self, name: str) -> None:
        self.name = name

    def switch_off(self, verify: types.ModuleType) -> None:
        """Take the check from the rule, in the package just imported."""

        def off(rule):
            return replace(rule, check=lambda _: ()) if rule.name == self.name else rule

        for group in ("MODE_RULES", "SWITCH_RULES"):
            setattr(verify, group, tuple(map(off, getattr(verify, group))))
        for single in ("FIGURES", "SYSTEM_BINDING", "HEALTH"):
            setattr(verify, single, off(getattr(verify, single)))


Place = tuple[Path, int, str, int]
"""A file, the number of a node in it, the kind of the fault, and the line."""


def places(path: Path) -> Iterator[Place]:
    """Yield the place of every fault of a file, but those of the words of findings."""
    whole = ast.parse(path.read_text())
    words = {id(part) for node in ast.walk(whole) if _is_text(node) for part in ast.walk(node)}
    unjudged = (f for f in whole.body if isinstance(f, ast.FunctionDef) and (path.name, f.name) in UNJUDGED)
    words |= {id(part) for function in unjudged for part in ast.walk(function)}
    for number, node in enumerate(ast.walk(whole)):
        for kind in _kinds(node) if id(node) not in words else ():
            yield path, number, kind, getattr(node, "lineno", None) or node.target.lineno


def fault_at(path: Path, number: int, kind: str, _line: int) -> Fault:
    """Put a fault into a file."""
    tree = ast.parse(path.read_text())
    changed = list(ast.walk(tree))[number]
    _change(changed, kind)
    return Fault(path, kind, changed, ast.fix_missing_locations(tree))


def _is_text(node: ast.AST) -> bool:
    """Tell whether it makes words, which decide nothing: a function that returns a string, or an assignment of one."""
    if isinstance(node, ast.FunctionDef):
        return isinstance(node.returns, ast.Name) and node.returns.id in ("str", "Path", "Diagnostic")
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AugAssign) else []
    names = {part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)}
    return bool(names) and names <= TEXTS


def _kinds(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Compare):
        limits = [n for n, op in enumerate(node.ops) if type(op) in LIMITS]
        return [f"{what} {n}" for what in ("limit", "tick") for n in limits]
    if isinstance(node, ast.BoolOp):
        return [f"without {n}" for n in range(len(node.values))]
    if isinstance(node, ast.If | ast.IfExp) and not (
        isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
    ):
        return ["never", "always"]
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in (*QUANTIFIERS, *EXTREMES):
        return ["first"] if len(node.args) == 1 or node.func.id in EXTREMES else []
    if isinstance(node, ast.For):
        return ["first of for"]
    return [f"unless {n}" for n in range(len(node.ifs))] if isinstance(node, ast.comprehension) else []


def _change(node: ast.AST, kind: str) -> None:
    kind, _, number = kind.partition(" ")
    if kind == "limit":
        node.ops[int(number)] = LIMITS[type(node.ops[int(number)])]()
    elif kind == "tick":
        by = OUTWARDS[type(node.ops[int(number)])]()
        node.comparators[int(number)] = ast.BinOp(node.comparators[int(number)], by, ast.Constant(1))
    elif kind == "without":
        del node.values[int(number)]
    elif kind in ("never", "always"):
        node.test = ast.Constant(kind == "always")
    elif kind == "unless":
        del node.ifs[int(number)]
    elif isinstance(node, ast.For):
        node.iter = ast.parse(f"list({ast.unparse(node.iter)})[:1]", mode="eval").body
    elif node.func.id in QUANTIFIERS:
        within = ast.unparse(node.args[0])
        first = within if isinstance(node.args[0], ast.GeneratorExp) else f"list({within})"
        made = f"next(iter({first}), {QUANTIFIERS[node.func.id]})"
        node.func, node.args = _parts(made)
    else:
        node.func.id = EXTREMES[node.func.id]


def _parts(text: str) -> tuple[ast.expr, list[ast.expr]]:
    call = ast.parse(text, mode="eval").body
    return call.func, call.args


# ------------------------------------------------------------------------------------------------ verdicts


class Changed(MetaPathFinder):
    """Imports one module of verify with a fault in it."""

    def __init__(self, fault: Fault) -> None:
        self._fault = fault
        self._name = f"{PACKAGE}.{fault.path.stem}"

    def find_spec(self, name, path=None, target=None):
        """Find the changed module, and no other."""
        if name != self._name:
            return None
        loader = SourceFileLoader(name, str(self._fault.path))
        loader.get_code = lambda _: compile(self._fault.source, str(self._fault.path), "exec")
        return spec_from_file_location(name, str(self._fault.path), loader=loader)


def judge_by_verify(
    fault: Fault | RuleOff | None, corpus: Sequence[tuple[Case, object, object]]
) -> Iterator[frozenset[str]]:
    """Yield the rules that verify finds broken, with the fault in it."""
    for name in [name for name in sys.modules if name.startswith(PACKAGE)]:
        del sys.modules[name]
    if isinstance(fault, Fault):
        sys.meta_path.insert(0, Changed(fault))
    verify = import_module(PACKAGE)
    if isinstance(fault, RuleOff):
        fault.switch_off(verify)
    for _, model, schedule in corpus:
        if isinstance(model, str):
            yield frozenset(("reading",))
        else:
            yield verify.broken_rules(model, schedule)


def judge_by_second(fault: Fault | None, corpus: Sequence[tuple[Case, str, str]]) -> Iterator[frozenset[str]]:
    """Yield whether the second checker finds the files broken, with the fault in it."""
    module = types.ModuleType("second_checker_changed")
    sys.modules[module.__name__] = module
    exec(compile(fault.source if fault else SECOND.read_text(), str(SECOND), "exec"), module.__dict__)
    for _, model, schedule in corpus:
        try:
            yield frozenset(found[0] for found in module.judge(model, schedule))
        except module.UnreadableError:
            yield frozenset(("file",))


def is_shown(case: Case, found: frozenset[str], expected: frozenset[str], *, by_verify: bool) -> bool:
    """Tell whether the self-test would count the verdict on a case as a disagreement."""
    return bool(found) != bool(expected) or (by_verify and case.broken not in (None, found))


def is_noticed(fault: Fault, judge, corpus, expected: Sequence[frozenset[str]]) -> int | None:
    """Return the number of the first case that shows the fault, in a process of its own; None without one."""
    reading, writing = os.pipe()
    child = os.fork()
    if child:
        os.close(writing)
        with os.fdopen(reading) as answer:
            said = answer.read()
        os.waitpid(child, 0)
        return None if said == "unnoticed" else int(said or -1)
    number = -1
    try:
        os.close(reading)
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, 10 * PATIENCE)
        said = ""
        for number, found in enumerate(judge(fault, corpus)):
            case = corpus[number][0]
            if is_shown(case, found, expected[number], by_verify=judge is judge_by_verify):
                said = str(number)
                break
            signal.setitimer(signal.ITIMER_PROF, PATIENCE)
        os.write(writing, (said or "unnoticed").encode())
    except BaseException:  # noqa: BLE001 - the self-test would end with it
        os.write(writing, str(number + 1).encode())
    finally:
        os._exit(0)


# ------------------------------------------------------------------------------------------------ the count


def made(mutants: int, seed: int, folder: Path, *, as_files: bool) -> list[tuple[Case, object, object]]:
    """Return the edges and the mutants, as files or as read."""
    from halpipe.core.diagnostics import HalpipeError
    from halpipe.importers.native import parse_model, parse_schedule
    from halpipe.selftest.run import cases

    corpus, models = [], {}
    for number, case in enumerate(cases(mutants, seed)):
        if as_files and not case.by_second:
            continue
        try:
            if case.model not in models:
                models[case.model] = parse_model(case.model, "m") if not as_files else str(folder / f"m{number}.xml")
                if as_files:
                    (folder / f"m{number}.xml").write_bytes(case.model)
            if as_files:
                (folder / f"s{number}.xml").write_bytes(case.schedule)
                corpus.append((case, models[case.model], str(folder / f"s{number}.xml")))
            else:
                corpus.append((case, models[case.model], parse_schedule(case.schedule, "s")))
        except HalpipeError:
            corpus.append((case, "", ""))
    return corpus


def count_rules(corpus: Sequence[tuple[Case, object, object]], expected: Sequence[frozenset[str]]) -> int:
    """Switch each rule of verify off in turn; print what shows it first among the edges, and among the mutants."""
    verify = import_module(PACKAGE)
    names = [rule.name for rule in verify.RULES if rule is not verify.PRIORITY_RULE]
    edges = sum(case.name == "edge" for case, *_ in corpus)
    unnoticed = {"edges": 0, "mutants": 0}
    for name in names:
        said = []
        for part, begin, end in (("edges", 0, edges), ("mutants", edges, len(corpus))):
            judged = enumerate(judge_by_verify(RuleOff(name), corpus[begin:end]), begin)
            seen = (n - begin for n, found in judged if is_shown(corpus[n][0], found, expected[n], by_verify=True))
            first = next(seen, None)
            unnoticed[part] += first is None
            said.append(f"{part} {'do not show it' if first is None else f'show it at {first}'}")
        print(f"rule {name} off: {', '.join(said)}", flush=True)
    print(f"{len(names)} rules of verify, one off at a time: {unnoticed['edges']} unnoticed by {edges} edges, "
          f"{unnoticed['mutants']} by {len(corpus) - edges} mutants alone")  # fmt: skip
    return 1 if unnoticed["edges"] else 0


def main() -> int:
    """Try all faults, or a sample."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checker", nargs="?", choices=("verify", "second", "rules"), default="verify")
    parser.add_argument("--mutants", type=int, default=20_000, help="of the self-test")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="a file, or one line of it: tables.py:120")
    parser.add_argument("--sample", type=int, default=0, help="how many faults; without it, all")
    options = parser.parse_args()
    name, _, line = options.only.partition(":")
    paths = (
        [SECOND] if options.checker == "second" else [p for p in sorted(VERIFY.glob("*.py")) if p.name not in WITHOUT]
    )
    chosen = [p for path in paths if name in ("", path.name) for p in places(path) if not line or p[3] == int(line)]
    if options.sample:
        chosen = random.Random(options.seed).sample(chosen, min(options.sample, len(chosen)))
    judge = judge_by_second if options.checker == "second" else judge_by_verify
    with tempfile.TemporaryDirectory(prefix="halpipe-conditions-") as place:
        corpus = made(options.mutants, options.seed, Path(place), as_files=judge is judge_by_second)
        expected = list(judge(None, corpus))
        if options.checker == "rules":
            return count_rules(corpus, expected)
        unnoticed, latest = [], 0
        for fault in starmap(fault_at, chosen):
            seen = is_noticed(fault, judge, corpus, expected)
            latest = max(latest, seen or 0)
            if seen is None:
                unnoticed.append(fault)
                print(f"{'equivalent' if fault.is_known() else 'unnoticed'}: {fault.place}", flush=True)
    real = [fault for fault in unnoticed if not fault.is_known()]
    print(f"{len(chosen)} faults in {options.checker}, {len(unnoticed)} unnoticed by {len(corpus)} schedules, "
          f"{len(unnoticed) - len(real)} of them change no verdict; the last one was noticed at {latest}")  # fmt: skip
    return 1 if real else 0


if __name__ == "__main__":
    sys.exit(main())
