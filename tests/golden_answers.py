"""Answers in plain text, for golden files: what a search found, the tables of its switches, and the work that it took.

`assert_answers` takes the name of a system and its verbs: functions that return an answer as lines. A verb that raises
`HalpipeError` is answered by its findings and its exit code.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from dataclasses import replace
from itertools import groupby
from typing import TYPE_CHECKING
from unittest.mock import patch

from golden_file import assert_golden
from halpipe.core.diagnostics import HalpipeError, render_text
from halpipe.pipeline.checked import explain_failure, schedule_model
from halpipe.pipeline.explain.explanation import ExplainOptions, explain
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve import exact, exact_goals, exactlengths, exactmodel, exactunits
from halpipe.pipeline.solve.one_mode import CONSTRUCTING
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.transitions import tables
from halpipe.pipeline.transitions.search import Blocked, Table
from halpipe.pipeline.validate import validate
from halpipe.pipeline.verify import verify_switches

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Job, ModeSchedule, Schedule, TaskModel, TransitionTable
    from halpipe.pipeline.solve.exact import Effort
    from halpipe.pipeline.solve.exactmodel import Program

FOLDER = "searches"

SHOWN = 12
"""Tries that are shown of a switch; of more, the number and a word for all."""

MOST_QUESTIONS = 300
"""Questions whether to go on after which the answer is no."""


def assert_answers(name: str, verbs: Mapping[str, Callable[[], Iterable[str]]], folder: str = FOLDER) -> None:
    """Compare the answers of some verbs, by what they are called, with the golden file of a system."""
    lines = [line for verb, answer in verbs.items() for line in (f"--- {verb}", *answered(answer))]
    assert_golden(f"{name}.txt", "\n".join(lines) + "\n", folder)


def assert_seeds(name: str, texts: Iterable[tuple[int, Sequence[str]]], none: str, folder: str = FOLDER) -> None:
    """Compare what comes of each seed; those of which nothing comes are listed as `none`."""
    made = list(texts)
    answers = {f"seed {seed}": (lambda text=text: text) for seed, text in made if text}
    empty = ", ".join(str(seed) for seed, text in made if not text)
    assert_answers(name, answers | {none: lambda: [empty]}, folder)


def answered(answer: Callable[[], Iterable[str]]) -> list[str]:
    """Return the lines of an answer, or what was raised in its place."""
    try:
        return list(answer())
    except HalpipeError as failure:
        return [f"exit {int(failure.exit)}", *findings(failure.diagnostics)]


def findings(diagnostics: Iterable[Diagnostic]) -> list[str]:
    """Return the text of findings, with help and places."""
    return [line for each in diagnostics for line in render_text(each).splitlines()]


def searched(model: TaskModel, stop: int = 0, **options: object) -> list[str]:
    """Search a schedule; return it with its figures and switches, and the count of the work by mode.

    With `stop`, a report of that number ends the search.
    """
    work = Work(stop)
    better: Counter[str] = Counter()
    chosen = SearchOptions(on_better=lambda mode, text: better.update([f"better: {mode}, {text}"]), **options)
    found = schedule_model(model, chosen, work.on_progress)
    ended = "complete" if found.is_complete else "stopped" if found.stopped else "not found"
    ended += " and improved no further" if found.unimproved else ""
    lines = [f"{ended}, {found.moves} moves, {found.schedule.solver}, tick {found.schedule.tick}"]
    lines += plan_lines(found.schedule)
    lines += [f"reached: {row.mode}, {row}" for row in found.reached]
    lines += [f"{text} ({count} times)" for text, count in better.items()]
    lines += work.lines()
    known = list(validate(model))
    lines += findings(each for each in found.diagnostics if each not in known)
    return lines if found.is_complete else lines + findings(explain_failure(model, found, interrupted=found.stopped))


def explained(system: TaskModel, **options: object) -> list[str]:
    """Return the exit code, the verdicts and findings of an explanation, and how often it asks to go on."""
    asked = [0]

    def go_on() -> bool:
        asked[0] += 1
        return asked[0] < MOST_QUESTIONS

    found = explain(system, ExplainOptions(exact=False, **options), go_on, budget=20)
    verdicts = ", ".join(f"{name} {verdict}" for name, verdict in found.verdicts)
    lines = [f"exit {int(found.exit)}: {verdicts}; asked {asked[0]} times"]
    lines += [f"no table: {pair}{' for certain' if pair in found.hopeless else ''}" for pair in found.switches]
    return lines + findings(found.diagnostics)


class Work:
    """What a search says of its progress, as numbers: reports, moves and best cost, by mode.

    The last word of a line stands for all the reports, so that another way to the same answer is seen as well.
    """

    def __init__(self, stop: int = 0) -> None:
        self._stop = stop
        self._reports: dict[str, list[tuple[int, int, int]]] = {}

    def on_progress(self, mode: str, moves: int, allowed: int, cost: int) -> bool:
        """Note a report; return False for the last one that is wanted.

        While CP-SAT runs, a clock repeats what was reported last.
        """
        reports = self._reports.setdefault(mode, [])
        if cost != CONSTRUCTING and (moves, allowed, cost) not in reports[-1:]:
            reports.append((moves, allowed, cost))
        return not self._stop or sum(map(len, self._reports.values())) < self._stop

    def lines(self) -> Iterator[str]:
        """Yield a line for each mode, in the order of their names."""
        for mode, reports in sorted(each for each in self._reports.items() if each[1]):
            moves, allowed, cost = reports[-1]
            yield f"work: {mode}, {len(reports)} reports, last {moves} of {allowed}, cost {cost}, all {sign(reports)}"


def plan_lines(plan: Schedule) -> Iterator[str]:
    """Yield the modes of a schedule with their figures, then the switches and the reactions."""
    for mode in plan.modes:
        yield from mode_lines(mode)
    for table in plan.transitions:
        yield from table_lines(table)
    for row in plan.reactions:
        rule = f"{row.task} {row.event} {row.count} of {row.cycles}"
        yield f"reaction: {row.mode}, {rule}, {row.action} {row.target or 'all'} within {row.within}"


def mode_lines(mode: ModeSchedule) -> Iterator[str]:
    """Yield the figures of a mode, and its jobs by task."""
    yield f"mode {mode.name}: {mode.status}, {mode.hyperperiod}, margin {mode.margin} of {mode.margin_bound}"
    yield from job_lines(mode.jobs)
    if mode.cost is not None:
        names = ("overlap", "access", "precedence", "unit", "occupancy", "timeliness")
        terms = (f"{name} {value}" for name in names if (value := getattr(mode.cost, name)))
        yield f"  cost {mode.cost.total}: {', '.join(terms)}"
    yield from (f"  chain {c.name}: reaction {c.reaction}, age {c.age}, latency {c.latency}" for c in mode.chains)


def table_lines(table: TransitionTable) -> Iterator[str]:
    """Yield the facts of a table between two modes, and its jobs by task."""
    yield f"switch {table.name}: {table.status}, {table.length}, worst latency {table.worst_latency}"
    yield from job_lines(table.jobs)


def job_lines(jobs: Sequence[Job]) -> Iterator[str]:
    """Yield a line for each task and version: its starts by units, with the parts of jobs that have some."""
    rows: dict[tuple[str, str, str], list[str]] = {}
    for job in jobs:
        parts = "".join(f" [{part.start}, {part.end})" for part in job.parts)
        rows.setdefault((job.task, job.version, "+".join(job.units)), []).append(f"{job.index} at {job.start}{parts}")
    for (task, version, units), starts in rows.items():
        yield f"  {task} {version} on {units}: {', '.join(starts)}"


# ------------------------------------------------------------------------------------------------ switches


def switched(model: TaskModel, plan: Schedule) -> Iterator[str]:
    """Yield the tables between the modes of a schedule, with the lengths that come into question and those tried."""
    tries: list[str] = []

    def fill(table: Table) -> object:
        found = plain_fill(table)
        text = f"{found.task} {found.rule} ({found.progress})" if isinstance(found, Blocked) else f"{len(found)} jobs"
        tries.append(f"try {table.length}: {text}, {table.work} placed")
        return found

    def possible(search: object) -> list[int]:
        lengths = plain_possible(search)
        some = " ".join(map(str, lengths[:12]))
        tries.append(f"pair: {len(lengths)} lengths, {some}, all {sign(lengths)}")
        return lengths

    plain_fill, plain_possible = Table.fill, tables._Search.possible
    with patch.object(Table, "fill", fill), patch.object(tables._Search, "possible", possible):
        found = tables.switch_tables(model, plan, is_sound_switch)
    for table in found.tables:
        yield from table_lines(table)
    yield from tries[:SHOWN]
    if len(tries) > SHOWN:
        yield f"and {len(tries) - SHOWN} more, all {sign(tries)}; at last {tries[-1]}"
    yield from findings(found.diagnostics)


def is_sound_switch(model: TaskModel, plan: Schedule, table: TransitionTable) -> bool:
    """Whether verify accepts a table between modes that it accepts."""
    return not any(found.is_error for found in verify_switches(model, replace(plan, transitions=(table,))))


# ------------------------------------------------------------------------------------------------ programs of CP-SAT


def solved(model: TaskModel, **options: object) -> list[str]:
    """Search; return the answer, and for each program that CP-SAT gets its kinds of constraints."""
    asked: list[str] = []

    def run(program: Program, effort: Effort) -> object:
        lines = program_lines(program)
        kinds = Counter(line.split()[0] for line in lines)
        sizes = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))
        asked.append(f"program: {sizes}; work {effort.work:.4g}, seed {effort.seed % 2**31}, all {sign(lines)}")
        return plain(program, effort)

    plain = exact.run
    with patch.object(exact, "run", run), patch.object(exact_goals, "run", run):
        return answered(lambda: searched(model, **options)) + asked


def programs(model: TaskModel) -> Iterator[str]:
    """Yield the programs of the modes of a model, in each form."""
    for mode in model.modes:
        expansion = exactlengths.inflated(model, expand(model, mode))
        for text, _ in exact.unknown_to_exact(model, expansion):
            yield f"{mode.name}: {text}"
        for form in exactunits.forms_of(expansion, model.units):
            program = exactmodel.build(expansion, model, model.chains, form)
            yield f"{mode.name}, {form.__name__}, tick {program.tick}"
            yield from (f"  {line}" for line in program_lines(program))


def program_lines(program: Program) -> list[str]:
    """Return the variables and constraints of a program, a line each; equal variables that follow each other share one.

    Only the text of the protocol buffer is read, which is the same in all versions of OR-Tools.
    """
    rows = [(kind, _flat(body)) for kind, body in _ENTRIES.findall(str(program.cp.proto))]
    lines, place = [], 0
    for domain, group in groupby(row for kind, row in rows if kind == "variables"):
        count = len(list(group))
        lines.append(f"variables {place}..{place + count - 1}: {domain}")
        place += count
    return lines + [row if kind == "constraints" else f"{kind} {row}" for kind, row in rows if kind != "variables"]


_ENTRIES = re.compile(r"^(\w+) \{\n(.*?)^\}", re.MULTILINE | re.DOTALL)
"""An entry of the program: its kind, and the lines inside its braces."""


def _flat(body: str) -> str:
    """Return the lines of an entry as one: ``linear vars 1 2 coeffs 1 -1 domain 0 5``."""
    words: list[str] = []
    last = ""
    for line in body.replace("}", "").replace(str(-(2**63)), "-inf").replace(str(2**63 - 1), "inf").splitlines():
        name, _, value = line.strip().partition(": ")
        words += [value] if name == last else [name.removesuffix(" {"), value]
        last = name
    return " ".join(filter(None, words))


def sign(value: object) -> str:
    """Return a short word that stands for a value."""
    return hashlib.sha256(repr(value).encode()).hexdigest()[:8]
