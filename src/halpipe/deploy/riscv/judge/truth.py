"""Records of the runtime compared with the simulator's observations: a board has nothing else than these records."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, seconds
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.judge.conditions import REPORT, tick_of
from halpipe.deploy.riscv.judge.figures import due_of
from halpipe.deploy.riscv.judge.records import OUTCOMES, observations, strangers
from halpipe.deploy.riscv.run.observation import Execution, Outcome
from halpipe.deploy.riscv.run.recording import Flag, Kind, Word

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.deploy.riscv.judge.tables import Tables
    from halpipe.deploy.riscv.run.cosimulation import Run
    from halpipe.deploy.riscv.run.recording import Record
    from halpipe.deploy.riscv.run.sequence import Played

_CORE, _CHECK = "the management core", 0
"""Where operations take place, and the order of checks."""

_TAIL = 200
"""Instructions of a monitor from the end of a function to where it waits for the next, at most."""

_LAST, _RELEASED = 1 << 32, 1
"""The place of the table behind all slots, and the order in which it releases jobs."""

_WAKING, _LOADS = 60, 8
"""Instructions, and accesses to devices, from where the management core wakes up to where it looks at the clock."""


def tells_the_truth(run: Run, tables: Tables, played: Sequence[Played]) -> Iterator[Diagnostic]:
    """Yield where records and observations differ: a recorded instant lies between two that were seen."""
    if run.zero is None:
        return
    if run.word(Word.TRACED) != len(run.recorder.traced):
        yield _differs(f"it counts {run.word(Word.TRACED)} records, {len(run.recorder.traced)} were written")
        return
    if run.recording.lost:
        return  # what was overwritten cannot be compared
    unknown = [*strangers(run, tables)]
    if unknown:
        yield from unknown
        return
    yield from ends_in_time(run)
    recorded, seen = observations(run.recording, tables), run.recorder
    yield from _executions(run, recorded.executions)
    calls = [[(call.function, call.data, call.size) for call in each.calls] for each in (seen, recorded)]
    yield from _differing("calls of drivers", *calls)
    # What the management core copies itself, it begins to copy when it has nothing else to do.
    if run.site.dma.kind != "copy":
        moved = [t for t in seen.transfers if t.begin >= run.zero]
        yield from _differing(
            "transfers", *([(t.source, t.target, t.size) for t in e] for e in (moved, recorded.transfers))
        )
    records = run.recording.records
    begun = [(r.begin, r.end, r.table) for r in records if r.kind == Kind.TABLE and not r.flags]
    yield from _differing("tables", [*_begun(run)], begun)
    if any((r.release, r.program, r.operation, r.hart) != (0, 0, 0, 1) for r in records if r.kind == Kind.TABLE):
        yield _differs("the record of a table names a job, which it has not")
    if run.word(Word.PLAYED) not in (len(run.tables), len(run.tables) - 1):
        yield _differs(f"it counts {run.word(Word.PLAYED)} tables, {len(run.tables)} were seen to begin")
    yield from _instants(run)
    yield from _delayed(run, tables, played)


def ends_in_time(run: Run) -> Iterator[Diagnostic]:
    """Yield the first execution that keeps its core longer than its function, or, if modelled, not up to its margin."""
    site = run.site
    spare = seconds(_TAIL * max([site.cpi * run.slowness, *site.classes.values()]) / site.clock)
    margin = -(-2 * site.timebase // 10**6)
    for execution in run.executions:
        due = max(execution.left, (execution.deadline - margin) * run.tick if run.is_modelled else 0)
        waits = run.length(execution.end - due)
        if execution.outcome is Outcome.RETURNED and execution.end and not ZERO <= waits <= spare:
            message = f"{site.unit_of(execution.hart).name} is free at {run.since(execution.end)} after an execution "
            yield _differs(f"{message}that is over at {run.since(due)}", "mailbox")
            return


def _begun(run: Run) -> Iterator[tuple[int, int, int]]:
    """Yield begin, end and number of the tables that were seen to begin."""
    numbers = {table.name: number for number, table in enumerate(run.site.tables)}
    for table in run.tables:
        begin, number = int(table.start / run.site.tick), numbers[table.name]
        yield begin, begin + run.site.tables[number].length, number


def _executions(run: Run, recorded: Sequence[Execution]) -> Iterator[Diagnostic]:
    """Yield the first execution whose outcome or instants are recorded otherwise than they were seen."""
    stated = {outcome: int(flags) for flags, outcome in OUTCOMES.items()}
    for execution in run.executions:
        if execution.end and execution.status != stated.get(execution.outcome, 0):
            message = f"the monitor of {run.site.unit_of(execution.hart).name} says {execution.status} of an execution "
            message += f"that {execution.outcome} at {run.since(execution.left)}"
            yield _differs(message, "mailbox")
            break
    seen = [e for e in run.executions if e.end]
    yield from _differing(
        "executions", *([(e.hart, e.function, str(e.outcome)) for e in each] for each in (seen, recorded))
    )
    ended = [[e for e in each if e.outcome is Outcome.RETURNED] for each in (seen, recorded)]
    returned = [sorted(each, key=lambda e: (e.hart, e.begin)) for each in ended]
    for one, other in zip(*returned, strict=False):
        low, high = tick_of(run, one.begin), tick_of(run, one.entered)
        first, last = tick_of(run, one.left), tick_of(run, one.end)
        if not (low <= other.begin <= high and first <= other.left <= last):
            where = f"it records an execution at tick {other.begin} to {other.left}"
            yield _differs(f"{where} where {low} to {first} was seen")
            return


def _differing(what: str, seen: Sequence[object], recorded: Sequence[object]) -> Iterator[Diagnostic]:
    """Yield that records have not the same entries as observations, each as often."""
    if Counter(seen) != Counter(recorded):
        message = f"it records {len(recorded)} {what}, {len(seen)} were seen"
        other = next(iter((Counter(recorded) - Counter(seen)) or (Counter(seen) - Counter(recorded))))
        yield _differs(f"{message}; the first that only one side has is {other}")


def _instants(run: Run) -> Iterator[Diagnostic]:
    """Yield the first record whose instant is not between those at which the one before and itself were written.

    Records that have neither begin nor end state zeros.
    """
    seen, records = run.recorder.traced, run.recording.records
    before = seen[0][0] if seen else 0
    for (now, woken), entry in zip(seen, records, strict=True):
        low, high = tick_of(run, max(before, woken)), tick_of(run, now)
        high = max(high, 0)  # the first table is begun before the run, and recorded at its instant
        if entry.kind != Kind.HEALTH and not min(low, high) <= entry.time <= high:
            yield _differs(f"it records an operation at tick {entry.time} that was begun from {low} to {high}")
            return
        if entry.kind not in (Kind.TABLE, Kind.STOP, Kind.HEALTH) and (entry.begin or entry.end):
            yield _differs(f"the record of an operation at tick {entry.time} has a begin and an end, which it has not")
            return
        if entry.kind != Kind.HEALTH:  # what a rule does is a part of the operation that is recorded next
            before = now


def _delayed(run: Run, tables: Tables, played: Sequence[Played]) -> Iterator[Diagnostic]:
    """Yield the first operation that the management core sleeps or waits through, or that follows one due later.

    Of those that are due together slots go in their order, then comes the table. Transfers may have waited for others.
    Checks are the first of their tick, so that nothing delays them.
    """
    site, starts = run.site, [int(table.start / run.site.tick) for table in played]
    ends = sorted(transfer.end for transfer in run.recorder.transfers)
    awake = seconds(_WAKING * site.management_cpi * run.slowness / site.clock)
    spare = int((awake + site.latency * _LOADS) / site.tick)
    before, last = (0, 0, 0), 0
    for (now, woken), entry in [*zip(run.recorder.traced, run.recording.records, strict=False)][1:]:
        if entry.kind == Kind.HEALTH or entry.flags & Flag.REFUSED or entry.cycle >= len(starts):
            continue
        due, wake = due_of(tables, entry, starts), tick_of(run, woken)
        if entry.kind == Kind.COPY and entry.flags & Flag.LATE:  # it has waited up to a check at the end of its phase
            due = due[0] + tables.operations(entry.program)[entry.operation].limit, _CHECK
        place = (*due, _slot(tables, entry, before[-1]))
        tick, is_first, last = due[0], woken != last, woken
        if entry.kind == Kind.COPY:
            arrived = ends[: bisect_right(ends, now)][-1:]  # it may have ended after the core woke up for it
            tick = max([tick, *(-(-(end - (run.zero or 0)) // run.tick) for end in arrived)])
            tick = max(tick, wake) if entry.flags or site.dma.kind == "copy" else tick
        message = f"the management core sleeps from before {site.tick * tick} to {site.tick * wake}, though it is due"
        if tick >= wake:
            message = f"begins after what is due at {site.tick * before[0]}, slot {before[-1]}"
            message = "" if place >= before else message
            if is_first and due == (wake, _CHECK) and entry.time > tick + spare:
                message = f"begins at {site.tick * entry.time}, though the management core woke for it"
            if entry.kind == Kind.COPY and entry.time > due[0]:
                continue
        if message:
            yield codes.SLOW_DISPATCH(f"{message}: an operation of {site.tick * due[0]}", path=_CORE, help=REPORT)
            return
        before = place


def _slot(tables: Tables, entry: Record, other: int) -> int:
    """Return the slot of an operation, behind all for a table; the `other` where it is one of two, or was free."""
    if entry.kind == Kind.TABLE:
        return _LAST
    slot, operation = tables.slot(entry.program), tables.operations(entry.program)[entry.operation]
    is_fresh = not operation.at and operation.order <= _RELEASED
    return other if slot is None or is_fresh else slot


def _differs(message: str, path: str = "trace") -> Diagnostic:
    return codes.TRACE_DISAGREES(message, path=path, help=REPORT)
