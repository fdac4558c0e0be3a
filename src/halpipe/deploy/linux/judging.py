"""Judgement of a recorded run: every job once, with its data, in order, apart from what excludes it, in time."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.deploy.linux import codes
from halpipe.models.trace import Execution, Trace
from halpipe.pipeline.compare import CompareOptions, compare
from halpipe.pipeline.compare.codes import CHAIN_EXCEEDED, Kind
from halpipe.pipeline.compare.judging import Scope

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Schedule, TaskModel
    from halpipe.pipeline.compare.chains import ChainRow

_COLUMNS = ("task", "job", "mode", "cycle", "start", "end", "units", "busy", "planned", "data")

MOST_CYCLES = 10_000_000
"""A year of cycles of 3 s."""

_ORDER = {
    Kind.UNKNOWN_TABLE: codes.FOREIGN_JOB,
    Kind.SEQUENCE: codes.FOREIGN_JOB,
    Kind.UNKNOWN_TASK: codes.FOREIGN_JOB,
    Kind.EXTRA: codes.FOREIGN_JOB,
    Kind.PLAN: codes.FOREIGN_JOB,
    Kind.MISSING: codes.MISSING_JOB,
    Kind.PAUSE: codes.MISSING_JOB,
    Kind.EARLY: codes.EARLY_JOB,
    Kind.ORDER: codes.WRONG_ORDER,
    Kind.NO_DATA: codes.NO_DATA,
    Kind.ENDLESS: codes.ENDLESS_JOB,
}
_TIMED = {
    **_ORDER,
    Kind.OVERLAP: codes.OVERLAP,
    Kind.EXCLUSION: codes.OVERLAP,
    Kind.LATE_END: codes.LATE_JOB,
}


@record
class Judgement:
    """What was found; `start_errors` are the median, the 99th percentile and the maximum.

    `missing` and `disordered` count jobs that did not run, and that started out of order.
    """

    diagnostics: tuple[Diagnostic, ...]
    jobs: int
    missing: int
    disordered: int
    tables: int
    switches: int
    start_errors: tuple[Duration, Duration, Duration]
    chains: tuple[ChainRow, ...]


def read_recording(data: bytes) -> list[Execution]:
    """Read what the dispatcher recorded, from the first instant on; raise `HalpipeError` for another form."""
    try:
        rows = list(csv.reader(io.StringIO(data.decode(), newline="")))
        if tuple(rows[0]) != _COLUMNS:
            raise ValueError("other columns")
        found = [_execution(row) for row in rows[1:]]
    except (ValueError, IndexError, csv.Error) as failure:
        text = f"the recording cannot be read: {failure}"
        raise HalpipeError(codes.NOT_RUN(text, help="export the bundle again")) from None
    if not found:
        raise HalpipeError(codes.NOT_RUN("nothing was recorded", help="let it run longer: --cycles"))
    return sorted(found, key=lambda e: (e.start.ns, e.task))


def _execution(row: Sequence[str]) -> Execution:
    if not 0 <= (cycle := int(row[3])) < MOST_CYCLES:
        raise ValueError(f"there is no cycle {cycle}")
    return Execution(
        task=row[0],
        job=int(row[1]),
        table=row[2],
        cycle=cycle,
        start=Duration(int(row[4])),
        end=Duration(int(row[5])) if row[5] else None,
        units=tuple(row[6].split()[:1]),  # the program of a gang runs on its first unit
        busy=Duration(int(row[7])) if row[7] else None,
        has_data=row[9] != "0",
        planned=Duration(int(row[8])),
    )


def judge(model: TaskModel, schedule: Schedule, recording: Sequence[Execution], *, is_timed: bool) -> Judgement:
    """Judge a recording; without `is_timed`, only whether every job ran once and in the order of its unit."""
    # A table or job whose instant is no whole number of nanoseconds begins at the nanosecond before it.
    instants = [mode.hyperperiod for mode in schedule.modes] + [table.length for table in schedule.transitions]
    instants += [job.start for mode in schedule.modes for job in mode.jobs]
    instants += [job.start for table in schedule.transitions for job in table.jobs]
    whole = all(instant.fraction.denominator == 1 for instant in instants)
    options = CompareOptions(origin=ZERO, tolerance=ZERO if whole else Duration(2))
    trace = Trace(name="", executions=tuple(recording))
    found = compare(schedule, trace, options, model, Scope(codes=_TIMED if is_timed else _ORDER, is_whole=True))
    last = len(found.starts) - 1
    p50, p99, most = (found.starts[min(at, last)] for at in (last // 2, -(-len(found.starts) * 99 // 100) - 1, last))
    # Starts are a little late, so that chains exceed their verified worst cases; what counts is the limit of the model.
    kept = (d for d in found.diagnostics if d.code != CHAIN_EXCEEDED.id or (is_timed and d.is_error))
    return Judgement(
        tuple(kept),
        len(recording),
        found.counts[Kind.MISSING],
        found.counts[Kind.ORDER],
        len(found.played),
        sum("->" in name for name in found.played.values()),
        (p50, p99, most),
        found.chains,
    )
