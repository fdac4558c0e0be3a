"""The jobs of a mode in exact integers: the common ground of metrics, latencies and the reference cost."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from halpipe.durations import Duration, greatest_common_divisor
from halpipe.pipeline.solve.problem import natural_tick

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.models import Job, Version
    from halpipe.pipeline.jobs import ActiveTask, Expansion


@dataclass(frozen=True, slots=True)
class PlacedJob:
    """A job with its version, in ticks."""

    active: ActiveTask
    index: int
    version: Version
    units: tuple[str, ...]
    start: int
    wcet: int

    @property
    def end(self) -> int:
        """The job's end; may lie beyond the hyperperiod."""
        return self.start + self.wcet


@dataclass(frozen=True)
class Placement:
    """All jobs of a mode on one grid that every duration of model and schedule fits exactly."""

    expansion: Expansion
    tick: Duration
    jobs: tuple[PlacedJob, ...]

    @classmethod
    def of(cls, expansion: Expansion, jobs: Iterable[Job]) -> Placement:
        """Place `jobs`, which name tasks and versions of the expansion."""
        listed = list(jobs)
        tick = greatest_common_divisor([natural_tick(expansion), *(job.start for job in listed)])
        placed = []
        for job in listed:
            active = expansion.by_name[job.task]
            version = active.task.version(job.version)
            wcet = version.wcet or Duration(0)
            placed.append(PlacedJob(active, job.index, version, job.units, job.start // tick, wcet // tick))
        return cls(expansion, tick, tuple(placed))

    @property
    def hyperperiod(self) -> int:
        """The hyperperiod in ticks."""
        return self.expansion.hyperperiod // self.tick

    @property
    def mean_wcet(self) -> int:
        """The mean WCET of the mode in ticks, at least one: what the cost takes for what has no distance."""
        return max(1, self.expansion.mean_wcet // self.tick)

    @cached_property
    def by_task(self) -> dict[str, list[PlacedJob]]:
        """The jobs of every active task, in the order given."""
        jobs: dict[str, list[PlacedJob]] = {active.name: [] for active in self.expansion.tasks}
        for job in self.jobs:
            jobs[job.active.name].append(job)
        return jobs
