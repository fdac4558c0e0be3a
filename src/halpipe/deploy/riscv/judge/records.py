"""Observations by the runtime's records alone, which are all that a board or QEMU leaves of a run."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.board.devices import Transfer
from halpipe.deploy.riscv.judge.conditions import REPORT
from halpipe.deploy.riscv.run.drivers import Call
from halpipe.deploy.riscv.run.observation import Execution, Observations, Outcome, Trap
from halpipe.deploy.riscv.run.recording import Abandoned, Flag, Kind, Record, Recording

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.deploy.riscv.judge.tables import Tables
    from halpipe.deploy.riscv.run.cosimulation import Run

OUTCOMES = {Flag(0): Outcome.RETURNED, Flag.FAULT: Outcome.FAULT, Flag.OVERRUN: Outcome.OVERRUN}


def observations(recording: Recording, tables: Tables) -> Observations:
    """Return what the records of operations that were not skipped say, in ticks; `tables` say what these are.

    The end of a transfer is not recorded. Records of no operation are left out; see `strangers`.
    """
    starts = {r.cycle: r.begin for r in recording.records if r.kind == Kind.TABLE and not r.flags & Flag.REFUSED}
    causes = {(a.cycle, a.release, a.operation): a for a in recording.abandoned}
    seen = Observations()
    for r in recording.records:
        if r.kind in (Kind.TABLE, Kind.HEALTH) or r.flags & Flag.SKIPPED or r.cycle not in starts or not tables.has(r):
            continue
        operation = tables.operations(r.program)[r.operation]
        if r.kind == Kind.STOP:
            execution = _execution(r, tables, starts)
            seen.executions.append(execution)
            cause = causes.get((r.cycle, r.release, r.operation))
            if execution.outcome is Outcome.FAULT and cause is not None:
                seen.traps.append(Trap(r.hart, cause.cause, cause.epc, cause.tval, execution.left, execution))
        elif r.kind == Kind.COPY and not r.flags:
            size = operation.size
            seen.transfers.append(Transfer(operation.channel, operation.source, operation.target, size, r.time, r.time))
        elif r.kind in (Kind.INPUT, Kind.OUTPUT) and not r.flags:
            seen.calls.append(Call(tables.driver(operation.source), operation.target, operation.size, r.time))
    return seen


def _execution(record: Record, tables: Tables, starts: Mapping[int, int]) -> Execution:
    """Return the execution that a record ends; one that was never stopped began when it was due, as far as is known."""
    operations = tables.operations(record.program)[: record.operation]
    run = next(o for o in reversed(operations) if o.kind == Kind.RUN and o.hart == record.hart)
    due = starts[record.cycle] + tables.releases(record.table)[record.release][0] + run.at
    begin, left = (record.begin, record.end) if record.end else (due, record.time)
    outcome = OUTCOMES.get(record.flags, Outcome.OPEN)
    return Execution(record.hart, run.source, None, begin, begin, 0, left, left, outcome, due=due)


def strangers(run: Run, tables: Tables) -> Iterator[Diagnostic]:
    """Yield the first record that names no operation of a job, and failures that only one of both rings has."""
    recording = run.recording
    for ring, entries in (("trace", recording.records), ("faults", recording.abandoned)):
        message = _stranger(run, tables, entries)
        if message:
            yield codes.TRACE_DISAGREES(message, path=ring, help=REPORT)
            return

    def who(entry: Record | Abandoned) -> tuple[int, ...]:
        return entry.cycle, entry.release, entry.operation, entry.kind, int(entry.flags)

    failed = Counter(who(r) for r in recording.records if r.flags & ~(Flag.SKIPPED | Flag.REFUSED))
    abandoned = Counter(who(r) for r in recording.abandoned)
    if failed != abandoned:
        cycle, row, operation, *_ = min((failed - abandoned) + (abandoned - failed))
        message = f"only one ring has the failure of operation {operation} of row {row} in cycle {cycle}"
        yield codes.TRACE_DISAGREES(message, path="faults", help=REPORT)


def _stranger(run: Run, tables: Tables, entries: Sequence[Record | Abandoned]) -> str:
    order = [table.name for table in run.site.tables]
    known = {cycle: order.index(table.name) for cycle, table in enumerate(run.tables)}
    for i, entry in enumerate(entries):
        if entry.kind != Kind.TABLE and (known.get(entry.cycle) != entry.table or not tables.has(entry)):
            message = f"record {i} names operation {entry.operation} of program {entry.program}, released by row "
            return message + f"{entry.release} of table {entry.table} in cycle {entry.cycle}; there is none"
    return ""
