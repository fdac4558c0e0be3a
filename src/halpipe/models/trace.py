"""Recorded executions of a simulation, a board or a Linux system."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import NOWHERE, Location
from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.durations import Duration


@record(kw_only=True)
class Execution:
    """One job as it was seen: from the first instant at which it ran to the last, on the clock of the trace.

    `busy` is the time in which it really ran, less than `end` - `start` where it was preempted. `end` and `busy` are
    None for what still ran when the trace ended. `table` (a mode, or ``a->b`` for the switch), `cycle` (tables
    played, from 0) and `job` (index in the table) are stated by some traces; empty or None by the others. `stretches`
    are the intervals in which it ran, of a job that paused, where the trace tells. `has_data` is false for a job for
    which there was no message, None where the trace does not tell. `planned` is the instant at which the recorder
    states that the job is due.
    """

    task: str
    units: tuple[str, ...] = ()
    start: Duration
    end: Duration | None
    busy: Duration | None = None
    table: str = ""
    cycle: int | None = None
    job: int | None = None
    stretches: tuple[tuple[Duration, Duration], ...] = ()
    has_data: bool | None = None
    planned: Duration | None = None
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@record(kw_only=True)
class Trace:
    """The executions on one line of time, by start; `name` tells the lines of one recording apart.

    `is_shared`: it shows all programs of a computer, of which the schedule has some.
    """

    name: str
    executions: Sequence[Execution]
    is_shared: bool = False
