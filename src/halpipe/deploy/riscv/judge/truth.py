"""Records of the runtime compared with the simulator's observations: a board has nothing else than these records."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from typing import TYPE_CHECKING

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
    from halpipe.deploy.riscv.run.sequence import Played


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
    begun = [r.begin for r in records if r.kind == Kind.TABLE and not r.flags & Flag.REFUSED]
    yield from _differing("tables", [int(table.start / run.site.tick) for table in run.tables], begun)
    if run.word(Word.PLAYED) not in (len(run.tables), len(run.tables) - 1):
        yield _differs(f"it counts {run.word(Word.PLAYED)} tables, {len(run.tables)} were seen to begin")
    yield from _instants(run)
    yield from _slept(run, tables, played)


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


def _slept(run: Run, tables: Tables, played: Sequence[Played]) -> Iterator[Diagnostic]:
    """Yield the first operation at whose instant the management core slept; a transfer may have waited for others."""
    starts = [int(table.start / run.site.tick) for table in played]
    ends = sorted(transfer.end for transfer in run.recorder.transfers)
    for (now, woken), entry in [*zip(run.recorder.traced, run.recording.records, strict=False)][1:]:
        is_none = entry.kind == Kind.HEALTH or entry.flags & Flag.REFUSED or entry.cycle >= len(starts)
        if is_none or (entry.kind == Kind.COPY and (entry.flags or run.site.dma.kind == "copy")):
            continue
        tick, wake = due_of(tables, entry, starts)[0], tick_of(run, woken)
        if entry.kind == Kind.COPY:
            last = ends[: bisect_right(ends, now)][-1:]  # it may have ended after the core woke up for it
            tick = max([tick, *(-(-(end - (run.zero or 0)) // run.tick) for end in last)])
        if tick < wake:
            due = run.site.tick * tick
            message = f"the management core sleeps from before {due}, when it has something to do, until "
            yield codes.SLOW_DISPATCH(f"{message}{run.site.tick * wake}", path="the management core", help=REPORT)
            return


def _differs(message: str, path: str = "trace") -> Diagnostic:
    return codes.TRACE_DISAGREES(message, path=path, help=REPORT)
