"""Answers in plain text, for golden files: what a search found, the tables of its switches, and the work that it took.

`assert_answers` takes the name of a system and its verbs: functions that return an answer as lines. A verb that raises
`HalpipeError` is answered by its findings and its exit code.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from typing import TYPE_CHECKING

from golden_file import assert_golden
from halpipe.core.diagnostics import HalpipeError, render_text
from halpipe.pipeline.checked import explain_failure, schedule_model
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.validate import validate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Job, ModeSchedule, Schedule, TaskModel, TransitionTable

FOLDER = "searches"


def assert_answers(name: str, verbs: Mapping[str, Callable[[], Iterable[str]]], folder: str = FOLDER) -> None:
    """Compare the answers of some verbs, by what they are called, with the golden file of a system."""
    lines = [line for verb, answer in verbs.items() for line in (f"--- {verb}", *answered(answer))]
    assert_golden(f"{name}.txt", "\n".join(lines) + "\n", folder)


def answered(answer: Callable[[], Iterable[str]]) -> list[str]:
    """Return the lines of an answer, or what was raised in its place."""
    try:
        return list(answer())
    except HalpipeError as failure:
        return [f"exit {int(failure.exit)}", *findings(failure.diagnostics)]


def findings(diagnostics: Iterable[Diagnostic]) -> list[str]:
    """Return the text of findings, with help and places."""
    return [line for each in diagnostics for line in render_text(each).splitlines()]


def searched(model: TaskModel, **options: object) -> list[str]:
    """Search a schedule; return it with its figures and switches, and the count of the work by mode."""
    work = Work()
    better: Counter[str] = Counter()
    chosen = SearchOptions(on_better=lambda mode, text: better.update([f"better: {mode}, {text}"]), **options)
    found = schedule_model(model, chosen, work.on_progress)
    ended = "complete" if found.is_complete else "not found"
    lines = [f"{ended}, {found.moves} moves, {found.schedule.solver}, tick {found.schedule.tick}"]
    lines += plan_lines(found.schedule)
    lines += [f"reached: {row.mode}, {row}" for row in found.reached]
    lines += [f"{text} ({count} times)" for text, count in better.items()]
    lines += work.lines()
    known = list(validate(model))
    lines += findings(each for each in found.diagnostics if each not in known)
    return lines if found.is_complete else lines + findings(explain_failure(model, found, interrupted=False))


class Work:
    """What a search says of its progress, as numbers: reports, moves and best cost, by mode.

    The last word of a line stands for all the reports, so that another way to the same answer is seen as well.
    """

    def __init__(self) -> None:
        self._reports: dict[str, list[tuple[int, int, int]]] = {}

    def on_progress(self, mode: str, moves: int, allowed: int, cost: int) -> bool:
        """Note a report."""
        self._reports.setdefault(mode, []).append((moves, allowed, cost))
        return True

    def lines(self) -> Iterator[str]:
        """Yield a line for each mode, in the order of their names."""
        for mode, reports in sorted(self._reports.items()):
            moves, allowed, cost = reports[-1]
            sign = hashlib.sha256(repr(reports).encode()).hexdigest()[:8]
            yield f"work: {mode}, {len(reports)} reports, last {moves} of {allowed}, cost {cost}, all {sign}"


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
