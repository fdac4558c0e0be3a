"""Records of the runtime compared with what the simulator saw: a board has nothing else than these records."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.judge.conditions import REPORT, tick_of
from halpipe.deploy.riscv.judge.figures import due_of
from halpipe.deploy.riscv.run.observation import Outcome
from halpipe.deploy.riscv.run.recording import Flag, Kind, Word

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.deploy.riscv.judge.tables import Tables
    from halpipe.deploy.riscv.run.cosimulation import Run
    from halpipe.deploy.riscv.run.recording import Abandoned, Record
    from halpipe.deploy.riscv.run.sequence import Played

_Bounds = tuple[tuple[int, int], ...]
"""Between which ticks each instant of a record lies."""


def tells_the_truth(run: Run, tables: Tables, played: Sequence[Played]) -> Iterator[Diagnostic]:
    """Yield where the runtime's record differs from what the simulator saw: an instant lies between two that were."""
    records = run.recording.records
    if run.recording.lost or run.zero is None:
        return  # what was overwritten cannot be compared
    stops = [(r.begin, r.end) for r in records if r.kind == Kind.STOP and not r.flags]
    returned = [e for e in run.executions if e.outcome is Outcome.RETURNED and e.end]
    spans = [_ticks(run, (e.begin, e.entered), (e.left, e.end)) for e in returned]
    yield from _pairs("executions", sorted(spans), sorted(stops))
    copies = [r for r in records if r.kind == Kind.COPY and not r.flags]
    transfers = sum(t.begin >= run.zero for t in run.recorder.transfers)
    # What the management core copies itself, it begins to copy when it has nothing else to do.
    if run.site.dma.kind != "copy" and transfers != len(copies):
        yield _differs(f"it records {len(copies)} transfers, {transfers} were seen")
    calls = [r for r in records if r.kind in (Kind.INPUT, Kind.OUTPUT) and not r.flags]
    if len(calls) != len(run.recorder.calls):
        yield _differs(f"it records {len(calls)} calls of drivers, {len(run.recorder.calls)} were seen")
    begun = [(r.begin,) for r in records if r.kind == Kind.TABLE and not r.flags & Flag.REFUSED]
    starts = [int(table.start / run.site.tick) for table in run.tables]
    yield from _pairs("tables", [((start, start),) for start in starts], begun)
    if run.word(Word.PLAYED) not in (len(run.tables), len(run.tables) - 1):
        yield _differs(f"it counts {run.word(Word.PLAYED)} tables, {len(run.tables)} were seen to begin")
    yield from _abnormal(run, records)
    strangers = [*_names(run, tables, records)]
    yield from strangers or _late(run, tables, records, played)


def _abnormal(run: Run, records: Sequence[Record]) -> Iterator[Diagnostic]:
    outcomes = {Flag.FAULT: Outcome.FAULT, Flag.OVERRUN: Outcome.OVERRUN}
    stated = {Outcome.RETURNED: 0, Outcome.FAULT: Flag.FAULT, Outcome.OVERRUN: Flag.OVERRUN}
    for execution in run.executions:
        if execution.end and execution.status != stated.get(execution.outcome, 0):
            message = f"the monitor of {run.site.unit_of(execution.hart).name} says {execution.status} of an execution "
            message += f"that {execution.outcome} at {run.since(execution.left)}"
            yield _differs(message, "mailbox")
            break
    for flag, outcome in outcomes.items():
        seen = sum(e.outcome is outcome for e in run.executions)
        recorded = sum(bool(r.flags & flag) for r in records if r.kind == Kind.STOP)
        if seen != recorded:
            yield _differs(f"it records {recorded} executions that ended by {outcome}, {seen} were seen")


def _stranger(run: Run, tables: Tables, entries: Sequence[Record | Abandoned]) -> str:
    order = [table.name for table in run.site.tables]
    known = {cycle: order.index(table.name) for cycle, table in enumerate(run.tables)}
    for i, entry in enumerate(entries):
        if entry.kind != Kind.TABLE and (known.get(entry.cycle) != entry.table or not tables.has(entry)):
            message = f"record {i} names operation {entry.operation} of program {entry.program}, released by row "
            return message + f"{entry.release} of table {entry.table} in cycle {entry.cycle}; there is none"
    return ""


def _names(run: Run, tables: Tables, records: Sequence[Record]) -> Iterator[Diagnostic]:
    """Yield the first record that names no operation of a job, and failures that only one of both rings has."""
    in_trace, in_faults = _stranger(run, tables, records), _stranger(run, tables, run.recording.abandoned)
    if in_trace or in_faults:
        yield _differs(in_trace or in_faults, "trace" if in_trace else "faults")
        return

    def who(entry: Record | Abandoned) -> tuple[int, ...]:
        return entry.cycle, entry.release, entry.operation, entry.kind, int(entry.flags)

    failed = Counter(who(r) for r in records if r.flags & ~(Flag.SKIPPED | Flag.REFUSED))
    abandoned = Counter(who(r) for r in run.recording.abandoned)
    if failed != abandoned:
        cycle, row, operation, *_ = min((failed - abandoned) + (abandoned - failed))
        message = f"only one ring has the failure of operation {operation} of row {row} in cycle {cycle}"
        yield _differs(message, "faults")


def _late(run: Run, tables: Tables, records: Sequence[Record], played: Sequence[Played]) -> Iterator[Diagnostic]:
    yield from _instants(run, records)
    yield from _slept(run, tables, played)


def _instants(run: Run, records: Sequence[Record]) -> Iterator[Diagnostic]:
    """Yield the first record whose instant is not between those at which the one before and itself were written."""
    seen = run.recorder.traced
    if len(seen) != len(records):
        yield _differs(f"it counts {len(seen)} records, {len(records)} are there")
        return
    before = seen[0][0] if seen else 0
    for (now, woken), entry in zip(seen, records, strict=True):
        low, high = tick_of(run, max(before, woken)), tick_of(run, now)
        if entry.kind not in (Kind.TABLE, Kind.HEALTH) and not min(low, high) <= entry.time <= high:
            yield _differs(f"it records an operation at tick {entry.time} that was begun from {low} to {high}")
            return
        if entry.kind != Kind.HEALTH:  # what a rule does is a part of the operation that is recorded next
            before = now


def _slept(run: Run, tables: Tables, played: Sequence[Played]) -> Iterator[Diagnostic]:
    """Yield the first operation at whose instant the management core slept; transfers may have to wait."""
    starts = [int(table.start / run.site.tick) for table in played]
    for (_, woken), entry in [*zip(run.recorder.traced, run.recording.records, strict=False)][1:]:
        waits = entry.kind in (Kind.COPY, Kind.HEALTH) or entry.flags & Flag.REFUSED or entry.cycle >= len(starts)
        wake = tick_of(run, woken)
        if not waits and due_of(tables, entry, starts)[0] < wake:
            due = run.site.tick * due_of(tables, entry, starts)[0]
            message = f"the management core sleeps from before {due}, when it has something to do, until "
            yield codes.SLOW_DISPATCH(f"{message}{run.site.tick * wake}", path="the management core", help=REPORT)
            return


def _pairs(what: str, bounds: Sequence[_Bounds], recorded: Sequence[tuple[int, ...]]) -> Iterator[Diagnostic]:
    if len(bounds) != len(recorded):
        yield _differs(f"it records {len(recorded)} {what}, {len(bounds)} were seen")
        return
    for spans, ticks in zip(bounds, recorded, strict=True):
        if any(not low <= tick <= high for (low, high), tick in zip(spans, ticks, strict=True)):
            seen = " to ".join(str(low) for low, _ in spans)
            yield _differs(f"it records {what} at tick {' to '.join(map(str, ticks))} where {seen} was seen")
            return


def _ticks(run: Run, *spans: tuple[int, int]) -> _Bounds:
    return tuple((tick_of(run, low), tick_of(run, high)) for low, high in spans)


def _differs(message: str, path: str = "trace") -> Diagnostic:
    return codes.TRACE_DISAGREES(message, path=path, help=REPORT)
