"""From the jobs of a mode to timers: one for a task that recurs evenly, otherwise one for each of its jobs.

A ROS timer has a period in whole nanoseconds. Where the hyperperiod is none, as 100/3 ms, the timers repeat with the
smallest multiple of it that is, so that nothing drifts however long the system runs.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, about
from halpipe.core.records import record
from halpipe.exporters.ros.codes import TOO_FINE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.durations import Duration
    from halpipe.models import Job, ModeSchedule, Task, TaskModel

MOST_TIMERS = 100_000


@record(kw_only=True)
class Timer:
    """Starts `version` of `task` on the first of `units` at `offset` + k * `period`, in whole nanoseconds.

    `job` is the index of the job in the table; None where the timer starts all jobs of the task.
    """

    task: str
    job: int | None
    version: str
    units: tuple[str, ...]
    period: int
    offset: int
    budget: int


def cycle_of(table: ModeSchedule) -> Duration:
    """Return the smallest multiple of the hyperperiod that is a whole number of nanoseconds.

    Raise `HalpipeError` if too many jobs would have to be written for it.
    """
    repeats = table.hyperperiod.fraction.denominator
    if repeats * len(table.jobs) > MOST_TIMERS:
        raise HalpipeError(
            TOO_FINE(
                f"hyperperiod {table.hyperperiod} repeats within whole nanoseconds only after {repeats} times, with "
                f"{repeats * len(table.jobs)} jobs",
                at=table.at,
                path=about(mode=table.name),
                help=f"choose periods for which at most {MOST_TIMERS} jobs come of it",
            )
        )
    return table.hyperperiod * repeats


def is_exact(table: ModeSchedule) -> bool:
    """Return whether every job starts at a whole nanosecond."""
    return all(job.start.fraction.denominator == 1 for job in table.jobs)


def timers_of(model: TaskModel, table: ModeSchedule) -> list[Timer]:
    """Return the timers of a mode, by task in the order of the model, then by offset."""
    jobs: dict[str, list[Job]] = {}
    for job in table.jobs:
        jobs.setdefault(job.task, []).append(job)
    return [timer for task in model.tasks if task.name in jobs for timer in _of_task(task, jobs[task.name], table)]


def _of_task(task: Task, jobs: Sequence[Job], table: ModeSchedule) -> list[Timer]:
    cycle = cycle_of(table)
    if task.period is not None and _is_even(task.period, jobs, table.hyperperiod):
        return [_timer(jobs[0], None, task.period, jobs[0].start % task.period)]
    repeats = table.hyperperiod.fraction.denominator
    found = [
        _timer(job, job.index, cycle, job.start + table.hyperperiod * turn) for turn in range(repeats) for job in jobs
    ]
    return sorted(found, key=lambda timer: (timer.offset, timer.job))


def _is_even(period: Duration, jobs: Sequence[Job], hyperperiod: Duration) -> bool:
    """Return whether one timer can start all jobs: same version and units, exactly one period apart."""
    phases = {job.start % period for job in jobs}
    ways = {(job.version, job.units) for job in jobs}
    whole = period.fraction.denominator == 1
    return whole and len(phases) == len(ways) == 1 and period * len(jobs) == hyperperiod


def _timer(job: Job, index: int | None, period: Duration, offset: Duration) -> Timer:
    """Return a timer; what is no whole nanosecond starts up to one early and has a budget up to one longer."""
    return Timer(
        task=job.task,
        job=index,
        version=job.version,
        units=job.units,
        period=int(period.fraction),
        offset=math.floor(offset.fraction),
        budget=math.ceil((job.end - job.start).fraction),
    )
