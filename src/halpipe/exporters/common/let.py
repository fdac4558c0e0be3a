"""Releases of jobs with a logical execution time, at which a target copies what they read (MODEL 10.1, 10.6)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.pipeline.parts import latest_phase

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from halpipe.core.durations import Duration
    from halpipe.models import Job, ModeSchedule, Task


def releases_of(mode: ModeSchedule, tasks: Mapping[str, Task]) -> Iterator[tuple[Job, Duration]]:
    """Yield the jobs of these tasks in a mode, and their releases: the offset, or the phase that the schedule chose."""
    for name, jobs in mode.by_task().items():
        if name not in tasks:
            continue
        task = tasks[name]
        assert task.period is not None, "verify refuses a LET without a period"
        offsets = sorted((job.start - task.period * job.index) % mode.hyperperiod for job in jobs)
        phase = latest_phase(offsets, mode.hyperperiod) if task.offset is None else task.offset % task.period
        yield from ((job, phase + task.period * job.index) for job in jobs)
