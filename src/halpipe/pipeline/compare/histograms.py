"""Distributions of what a recording shows of each task, in bins of equal width with exact counts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from halpipe.core.durations import Duration
from halpipe.core.records import record
from halpipe.models.trace import column, plain

if TYPE_CHECKING:
    from halpipe.models import Job, Task, TaskModel
    from halpipe.models.trace import Column, Instant
    from halpipe.pipeline.compare import Comparison

BINS = 8
FIGURES = ("start error", "response", "execution", "jitter")


@record(kw_only=True)
class Histogram:
    """Counts of one figure of a task: bin k has the values from `least` + k * `width` up to the next bin.

    The last bin has the worst value, too.

    - start error: how long after its scheduled instant a job starts;
    - response: from the release to the end, of tasks of which the model states period and offset;
    - execution: the time in which a job really ran;
    - jitter: by how much the distance of two starts in succession differs from the schedule.
    """

    task: str
    figure: str
    least: Duration
    worst: Duration
    width: Duration
    counts: tuple[int, ...]


def histograms(comparison: Comparison, model: TaskModel | None = None) -> list[Histogram]:
    """Return the histograms by task and figure; a figure of which nothing is known has none."""
    matching, ran, tasks = (
        comparison.matching,
        comparison.ran,
        {task.name: task for task in model.tasks} if model else {},
    )
    # Jobs of a switch are counted from the switch, not from their releases.
    modes = {mode.name for mode in model.modes} if model else set()
    delays = [
        _delay(tasks.get(due.job.task), due.job, table.length) if table.name in modes else None
        for table, due in matching.jobs
    ]
    is_released = np.array([delay is not None for delay in delays], dtype=bool)[ran.job]
    response = ran.end - ran.start + ran.late + column([delay or 0 for delay in delays])[ran.job]
    length, has_end = ran.length, ran.has_end
    found = []
    for task, places in sorted(ran.by_task().items()):
        ended = places[has_end[places]]
        late = ran.late[places]
        values = (late, response[ended[is_released[ended]]], length[ended], np.diff(late))
        found += [_histogram(task, *each) for each in zip(FIGURES, values, strict=True) if len(each[1])]
    return found


def _delay(task: Task | None, job: Job, length: Instant) -> Instant | None:
    """Return how long after its release a job is scheduled; None where the model states no release."""
    if task is None or task.period is None or task.offset is None:
        return None
    return (job.start.ns - task.offset.ns - task.period.ns * job.index) % length


def _histogram(task: str, figure: str, values: Column) -> Histogram:
    least, worst = plain(values.min()), plain(values.max())
    width = max(1, int(-(-(worst - least) // BINS)))
    bins = np.minimum((values - least) // width, BINS - 1).astype(np.int64)
    return Histogram(
        task=task,
        figure=figure,
        least=Duration(least),
        worst=Duration(worst),
        width=Duration(width),
        counts=tuple(np.bincount(bins, minlength=BINS).tolist()),
    )
