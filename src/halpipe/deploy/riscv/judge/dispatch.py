"""Service time of the management core for each operation, compared with the reserve of its profile.

The export computes how late operations can be as if each took the same time, `service`. So what counts of a run is the
least such time that explains all of it: since the core woke up, it has done so many operations by each of its records.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration, seconds
from halpipe.core.quantities import format_rational
from halpipe.core.records import record
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.judge.tables import PER_SLOT, Tables
from halpipe.deploy.riscv.run.recording import Flag, Kind
from halpipe.deploy.riscv.run.sequence import DECISION

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.deploy.riscv.board.elf import Program
    from halpipe.deploy.riscv.run.cosimulation import Run
    from halpipe.deploy.riscv.run.recording import Record
    from halpipe.deploy.riscv.run.sequence import Played
    from halpipe.deploy.riscv.target import Site
    from halpipe.models import TaskModel

_ORDER = {
    **dict.fromkeys((Kind.DONE, Kind.STOP, Kind.OUTPUT), 0),
    **dict.fromkeys((Kind.TABLE, Kind.RUN), 1),
    **dict.fromkeys((Kind.COPY, Kind.INPUT), 2),
}
_RELEASE, _DECIDE = 1, 3


@record
class Dispatch:
    """The worst time of an operation in a run, and what the profile reserves for it; `at` since the run's beginning."""

    worst: Duration = ZERO
    reserved: Duration = ZERO
    at: Duration = ZERO


def measured(run: Run, program: Program, model: TaskModel, played: Sequence[Played]) -> Dispatch:
    """Return the worst operation of a run; zero if records were overwritten, or the run was not over in order."""
    tables = Tables(program, model)
    reserved = run.site.service + seconds(
        Fraction(PER_SLOT * tables.further_slots(run.site)) * run.site.cpi / run.site.clock
    )
    records, seen = run.recording.records, run.recorder.traced
    if run.recording.lost or len(records) != len(seen) or run.zero is None:
        return Dispatch(reserved=reserved)
    site, zero = run.site, run.zero
    starts = [int(table.start / site.tick) for table in played]
    others = sorted(_unrecorded(site, tables, played, starts))
    # Who waits for a late transfer looks again and again, between the operations of others.
    polling = {woken for entry, (_, woken) in zip(records, seen, strict=True) if _is_held(entry)}
    worst, at = Fraction(0), 0
    since = first = extra = 0
    is_waiting = False
    for i, (entry, (now, woken)) in enumerate(zip(records, seen, strict=True)):
        if woken != since:
            since, first, extra, is_waiting = woken, i, 0, woken in polling
        if i == 0 or entry.kind == Kind.HEALTH or entry.flags & Flag.REFUSED or entry.cycle >= len(starts):
            extra += 1  # a part of the operation that is recorded next, or before
            continue
        due, wake = _due(tables, entry, starts), (woken - zero) // run.tick
        is_waiting = is_waiting or _waits(tables, entry, due[0])
        if is_waiting or due[0] < wake:
            continue
        number = i - first + 1 - extra + bisect_right(others, due) - bisect_left(others, (wake, -1))
        taken = Fraction(now - woken, max(number, 1))
        if taken > worst:
            worst, at = taken, now
    return Dispatch(seconds(worst / run.rate), reserved, run.since(at))


def _due(tables: Tables, record: Record, starts: Sequence[int]) -> tuple[int, int]:
    order = _ORDER[Kind(record.kind)]
    if record.kind == Kind.TABLE:
        return starts[record.cycle], order
    at = tables.operations(record.program)[record.operation].at
    return starts[record.cycle] + tables.releases(record.table)[record.release] + at, order


def _is_held(record: Record) -> bool:
    return record.kind == Kind.COPY and bool(record.flags & Flag.LATE)


def _waits(tables: Tables, record: Record, due: int) -> bool:
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
        yield from ((start + time, _RELEASE) for time in tables.releases(index[table.name]))
        if not table.is_transition:
            yield start + int(table.length / site.tick) - DECISION, _DECIDE


def findings(found: Sequence[Dispatch]) -> Iterator[Diagnostic]:
    """Yield where an operation took longer than is reserved for it."""
    worst = max(found, key=lambda dispatch: dispatch.worst, default=Dispatch())
    if worst.worst > worst.reserved:
        message = f"took {_rounded(worst.worst)} for an operation at {worst.at}, {worst.reserved} are reserved for each"
        help = 'raise "service" of the profile, and export again: transfers may begin too late for their phases'
        yield codes.SLOW_DISPATCH(message, path="the management core", help=help)


def lines(found: Sequence[Dispatch], cpi: Fraction) -> Iterator[str]:
    """Yield what was measured, and up to how many cycles an instruction that is enough."""
    worst = max(found, key=lambda dispatch: dispatch.worst, default=Dispatch())
    if worst.worst:
        most = format_rational(Fraction(int(cpi * (worst.reserved / worst.worst) * 100), 100))
        yield (
            f"the management core takes at most {_rounded(worst.worst)} for an operation; {worst.reserved} are "
            f"reserved, enough up to {most} cycles an instruction"
        )


def _rounded(duration: Duration) -> str:
    return format_rational(Fraction(round(duration.in_unit("us") * 1000), 1000)) + "us"
