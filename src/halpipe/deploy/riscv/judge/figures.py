"""Figures of a check: the summary for people, the trace for tools, and the service time of the management core."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration, seconds
from halpipe.core.quantities import format_rational
from halpipe.core.records import record
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.judge.tables import PER_SLOT, Tables
from halpipe.deploy.riscv.run.drivers import recorded_inputs
from halpipe.deploy.riscv.run.recording import Flag, Kind, Record
from halpipe.deploy.riscv.target import DECISION, Site
from halpipe.models import AccessKind

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.deploy.base import Target
    from halpipe.deploy.riscv.judge.check import Outcome
    from halpipe.deploy.riscv.judge.comparison import Seen
    from halpipe.deploy.riscv.run.cosimulation import Run
    from halpipe.deploy.riscv.run.sequence import Played

_HEADER = ("table", "played", "jobs", "worst start", "worst execution", "of its time", "DMA busy")


@dataclass(slots=True)
class Figures:
    """Measurements of one table over all times that it was played."""

    played: int = 0
    jobs: int = 0
    lateness: Duration = ZERO
    execution: Duration = ZERO
    share: Fraction = Fraction(0)
    length: Duration = ZERO
    moving: Duration = ZERO


def summary_lines(target: Target, outcomes: Sequence[Outcome], tolerance: Duration) -> tuple[str, ...]:
    """Return what was played and measured, a table with one row for each table of the schedule."""
    rows = [_HEADER, *(_row(name, figures) for name, figures in figures_of(outcomes).items())]
    widths = [max(len(row[i]) for row in rows) for i in range(len(_HEADER))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    runs = len(outcomes)
    tables = sum(len(outcome.tables) for outcome in outcomes)
    jobs = sum(len(outcome.jobs) for outcome in outcomes)
    lasted = sum((outcome.run.duration for outcome in outcomes), ZERO)
    plural = "s" if runs > 1 else ""
    lines.append(
        f"co-simulation of {target.bundle.path}: {tables} tables and {jobs} jobs in {runs} run{plural}, "
        f"{_short(lasted)} of the board's time"
    )
    lines.append(f"starts may be late by {tolerance}, the time that the management core has for its operations")
    if (dog := outcomes[0].run.site.watchdog) is not None:
        lines.append(f"the watchdog resets the board {dog.timeout} after hart 0 has begun its last table")
    lines += _margins(target, outcomes)
    lines += _calls(outcomes)
    return tuple(lines)


def _margins(target: Target, outcomes: Sequence[Outcome]) -> Iterator[str]:
    """Yield how many cycles an instruction may take until executions no longer fit in their time."""
    shares = [(figures.share, name) for name, figures in figures_of(outcomes).items() if figures.share]
    if shares and not any(outcome.run.is_modelled for outcome in outcomes):
        share, name = max(shares)
        most = format_rational(Fraction(int(100 / share), 100))  # rounded down
        inputs = recorded_inputs(target.bundle, outcomes[0].run.site)
        data = f"recorded inputs of {', '.join(inputs)}" if inputs else "empty buffers"
        yield f'with {data}, executions fit up to {most} cycles an instruction ("{name}" is the first);'
        accesses = [a for task in target.model.tasks for version in task.versions for a in version.accesses]
        buffers = {kind: {t.buffer for a in accesses if a.kind is kind for t in a.transfers} for kind in AccessKind}
        lacking = sorted(buffers[AccessKind.READ] - buffers[AccessKind.WRITE] - set(inputs))
        if not inputs:
            yield "the bundle carries no recorded inputs: jobs that compute more with data than without are not tried"
        elif lacking:
            yield f"no inputs are recorded for {', '.join(lacking)}, which are empty"


def _calls(outcomes: Sequence[Outcome]) -> Iterator[str]:
    """Yield how often drivers were called, and what tasks asked for."""
    calls = sum(len(outcome.run.recorder.calls) for outcome in outcomes)
    if calls:
        yield f"drivers were called {calls} times; they returned at once, for their devices are not here"
    heard = [outcome for outcome in outcomes if outcome.hears]
    if heard:
        asked = sum(len(outcome.run.requests) for outcome in heard)
        switches = sum(table.is_transition for outcome in heard for table in outcome.tables)
        yield f"in {len(heard)} run, tasks asked {asked} times for a mode, which led to {switches} switches"


def figures_of(outcomes: Sequence[Outcome]) -> dict[str, Figures]:
    """Return the figures of every table that was played, in the order of the schedule's first playing."""
    found: dict[str, Figures] = {}
    for outcome in outcomes:
        for table in outcome.tables:
            figures = found.setdefault(table.name, Figures())
            figures.played += 1
            figures.length += table.length
        for seen in outcome.jobs:
            _measure(outcome, seen, found[seen.planned.table.name])
    return found


def _measure(outcome: Outcome, seen: Seen, figures: Figures) -> None:
    run = outcome.run
    zero = run.zero or 0
    figures.jobs += 1
    if seen.begin is not None:
        figures.lateness = max(figures.lateness, run.since(seen.begin - seen.planned.begin * run.tick))
    for planned, execution in zip(seen.planned.executions, seen.executions, strict=True):
        if execution is not None:
            length = run.since(zero + execution.left - execution.begin)
            figures.execution = max(figures.execution, length)
            figures.share = max(figures.share, length / (run.site.tick * (planned.end - planned.begin)))
    for transfer in seen.transfers:
        if transfer is not None:
            figures.moving += run.since(zero + transfer.end - transfer.begin)


def _row(name: str, figures: Figures) -> tuple[str, ...]:
    busy = _percent(figures.moving / figures.length) if figures.length else "-"
    return (
        name,
        str(figures.played),
        str(figures.jobs),
        _short(figures.lateness) if figures.jobs else "-",
        _short(figures.execution) if figures.jobs else "-",
        _percent(figures.share) if figures.jobs else "-",
        busy,
    )


def _percent(share: Fraction) -> str:
    return format_rational(Fraction(round(share * 1000), 10)) + " %"


def _short(duration: Duration) -> str:
    """Return a duration in microseconds or milliseconds with at most three decimals."""
    unit = "ms" if duration >= Duration(10**6) else "us"
    return format_rational(Fraction(round(duration.in_unit(unit) * 1000), 1000)) + unit


Row = tuple[Duration, Duration, int, str, str, int, tuple[str, ...]]
"""A job that was seen: start and end from the run's beginning, number and name of its table, task, index, units."""


def csv_of(rows: Iterable[Row]) -> bytes:
    """Return jobs that were seen as CSV, in exact nanoseconds and in the order of starts."""
    lines = ["cycle,mode,task,job,units,start,end"]
    for start, end, cycle, table, task, index, units in sorted(rows):
        times = (format_rational(each.fraction) for each in (start, end))
        lines.append(",".join((str(cycle), table, task, str(index), " ".join(units), *times)))
    return ("\n".join(lines) + "\n").encode()


def rows_of(outcome: Outcome) -> Iterator[Row]:
    """Yield the jobs that were seen in a run."""
    for seen in outcome.jobs:
        if seen.begin is not None and seen.end is not None:
            table, job = seen.planned.table, seen.planned.job
            start, end = outcome.run.since(seen.begin), outcome.run.since(seen.end)
            yield start, end, table.cycle, table.name, job.task, job.index, job.units


_RELEASE, _DECIDE = 1, 3


@record
class Dispatch:
    """The worst time of an operation in a run, and what the profile reserves for it; `at` since the run's beginning."""

    worst: Duration = ZERO
    reserved: Duration = ZERO
    at: Duration = ZERO


def measured(run: Run, tables: Tables, played: Sequence[Played]) -> Dispatch:
    """Return the worst operation of a run; zero if records were overwritten, or the run was not over in order."""
    reserved = run.site.service + seconds(
        Fraction(PER_SLOT * tables.further_slots(run.site)) * run.site.management_cpi / run.site.clock
    )
    records, seen = run.recording.records, run.recorder.traced
    if run.recording.lost or len(records) != len(seen) or run.zero is None:
        return Dispatch(reserved=reserved)
    site, zero = run.site, run.zero
    starts = [int(table.start / site.tick) for table in played]
    others = sorted(_unrecorded(site, tables, played, starts))
    # Who waits for a late transfer looks again and again, between the operations of others.
    held = (entry.kind == Kind.COPY and bool(entry.flags & Flag.LATE) for entry in records)
    polling = {woken for is_held, (_, woken) in zip(held, seen, strict=True) if is_held}
    worst, at = Fraction(0), 0
    since = first = extra = 0
    is_waiting = False
    for i, (entry, (now, woken)) in enumerate(zip(records, seen, strict=True)):
        if woken != since:
            since, first, extra, is_waiting = woken, i, 0, woken in polling
        if i == 0 or entry.kind == Kind.HEALTH or entry.flags & Flag.REFUSED or entry.cycle >= len(starts):
            extra += 1  # a part of the operation that is recorded next, or before
            continue
        due, wake = due_of(tables, entry, starts), (woken - zero) // run.tick
        is_waiting = is_waiting or waits(tables, entry, due[0])
        if is_waiting or due[0] < wake:
            continue
        number = i - first + 1 - extra + bisect_right(others, due) - bisect_left(others, (wake, -1))
        taken = Fraction(now - woken, max(number, 1))
        if taken > worst:
            worst, at = taken, now
    return Dispatch(seconds(worst / run.rate), reserved, run.since(at))


def due_of(tables: Tables, record: Record, starts: Sequence[int] | Mapping[int, int]) -> tuple[int, int]:
    """Return the tick and the order of an operation that is recorded, by the starts of tables."""
    if record.kind == Kind.TABLE:
        return starts[record.cycle], _RELEASE
    if not tables.has(record):
        raise LookupError("a record names no operation of its job")
    operation = tables.operations(record.program)[record.operation]
    return starts[record.cycle] + tables.releases(record.table)[record.release][0] + operation.at, operation.order


def waits(tables: Tables, record: Record, due: int) -> bool:
    """Whether the core may have waited for another transfer before this one: that is no work of its own."""
    if record.kind != Kind.COPY or record.operation == 0 or record.time <= due:
        return False
    return tables.operations(record.program)[record.operation - 1].kind == Kind.COPY


def _unrecorded(
    site: Site, tables: Tables, played: Sequence[Played], starts: Sequence[int]
) -> Iterator[tuple[int, int]]:
    """Yield instants and orders of what leaves no record: releases, and looks at the mailbox."""
    index = {table.name: i for i, table in enumerate(site.tables)}
    for table, start in zip(played, starts, strict=True):
        yield from ((start + time, _RELEASE) for time, _ in tables.releases(index[table.name]))
        if not table.is_transition:
            yield start + int(table.length / site.tick) - DECISION, _DECIDE


def slow_dispatch(found: Sequence[Dispatch]) -> Iterator[Diagnostic]:
    """Yield where an operation took longer than is reserved for it."""
    worst = max(found, key=lambda dispatch: dispatch.worst, default=Dispatch())
    if worst.worst > worst.reserved:
        message = f"took {_short(worst.worst)} for an operation at {worst.at}, {worst.reserved} are reserved for each"
        help = 'raise "service" of the profile, and export again: transfers may begin too late for their phases'
        yield codes.SLOW_DISPATCH(message, path="the management core", help=help)


def dispatch_lines(found: Sequence[Dispatch], cpi: Fraction) -> Iterator[str]:
    """Yield what was measured, and up to how many cycles an instruction that is enough."""
    worst = max(found, key=lambda dispatch: dispatch.worst, default=Dispatch())
    if worst.worst:
        most = format_rational(Fraction(int(cpi * (worst.reserved / worst.worst) * 100), 100))
        yield (
            f"the management core takes at most {_short(worst.worst)} for an operation; {worst.reserved} are "
            f"reserved, enough up to {most} cycles an instruction"
        )
