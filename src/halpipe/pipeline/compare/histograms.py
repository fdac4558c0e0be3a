"""Distributions of what a recording shows of each task, in bins of equal width with exact counts."""

from __future__ import annotations

from array import array
from collections import defaultdict
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.durations import Duration
from halpipe.core.records import record
from halpipe.models.trace import NONE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.models import Job, Task, TaskModel
    from halpipe.models.trace import Instant
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
    matching, tasks = comparison.matching, {task.name: task for task in model.tasks} if model else {}
    seen = matching.executions
    # Jobs of a switch are counted from the switch, not from their releases.
    modes = {mode.name for mode in model.modes} if model else set()
    values: dict[str, defaultdict[str, list[Instant]]] = {}
    for row in matching.rows():
        job, late = matching.due(row).job, matching.lateness(row)
        found = values.setdefault(job.task, defaultdict(list))
        found["start error"].append(late)
        if (length := seen.length(row)) is not None:
            found["execution"].append(length)
        table = matching.lines.table[matching.line[row]]
        delay = _delay(tasks.get(job.task), job, table.length) if table.name in modes else None
        if delay is not None and seen.end[row] != NONE:
            found["response"].append(seen.end[row] - seen.start[row] + late + delay)
    for found in values.values():
        found["jitter"].extend(after - before for before, after in pairwise(found["start error"]))
    return [
        _histogram(task, figure, found[figure])
        for task, found in sorted(values.items())
        for figure in FIGURES
        if found.get(figure)
    ]


def _delay(task: Task | None, job: Job, length: Instant) -> Instant | None:
    """Return how long after its release a job is scheduled; None where the model states no release."""
    if task is None or task.period is None or task.offset is None:
        return None
    return (job.start.ns - task.offset.ns - task.period.ns * job.index) % length


def _histogram(task: str, figure: str, values: Sequence[Instant]) -> Histogram:
    least, worst = min(values), max(values)
    width = max(1, int(-(-(worst - least) // BINS)))
    counts = array("q", [0]) * BINS
    for value in values:
        counts[min(int((value - least) // width), BINS - 1)] += 1
    return Histogram(
        task=task,
        figure=figure,
        least=Duration(least),
        worst=Duration(worst),
        width=Duration(width),
        counts=tuple(counts),
    )
