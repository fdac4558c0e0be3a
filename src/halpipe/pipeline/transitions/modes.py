"""The schedules of two modes on the common grid of a switch between them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from halpipe.durations import Duration, greatest_common_divisor
from halpipe.models import Anchor
from halpipe.pipeline.jobs import expand, natural_tick
from halpipe.pipeline.transitions.line import LineJob, Phase, Shape

if TYPE_CHECKING:
    from halpipe.models import ModeSchedule, TaskModel, Version
    from halpipe.pipeline.jobs import ActiveTask, Expansion


@dataclass(frozen=True, slots=True)
class Window:
    """A precedence constraint in ticks: `task` starts, or ends, between `low` and `high` before."""

    task: str
    low: int
    high: int
    from_end: bool

    def instant(self, job: LineJob) -> int:
        """Return the instant of a predecessor job from which the window counts."""
        return job.end if self.from_end else job.start

    def met_by(self, start: int, predecessors: list[LineJob]) -> bool:
        """Return whether some predecessor job lies in the window of a job that starts at `start`."""
        return any(self.low <= start - self.instant(job) <= self.high for job in predecessors)


@dataclass(frozen=True)
class GridMode:
    """A scheduled mode with all its times in ticks, and all its bounds in quanta, of a common grid."""

    expansion: Expansion
    schedule: ModeSchedule
    tick: Duration
    quanta: int

    @property
    def hyperperiod(self) -> int:
        """The hyperperiod in ticks."""
        return self.expansion.hyperperiod // self.tick

    @cached_property
    def shapes(self) -> dict[str, tuple[Shape, ...]]:
        """The versions of every active task, in model order."""
        return {a.name: tuple(self._shape(a, version) for version in a.versions) for a in self.expansion.tasks}

    @cached_property
    def windows(self) -> dict[tuple[str, str], tuple[Window, ...]]:
        """The precedence constraints of every (task, version)."""
        return {(a.name, v.name): tuple(self._windows(v)) for a in self.expansion.tasks for v in a.versions}

    @cached_property
    def jobs(self) -> tuple[LineJob, ...]:
        """One cycle, its start at 0; jobs may end beyond it."""
        by_version = {(s.task, s.version): s for shapes in self.shapes.values() for s in shapes}
        placed = (
            LineJob(job.start // self.tick, job.task, job.index, by_version[job.task, job.version], job.units)
            for job in self.schedule.jobs
        )
        return tuple(sorted(placed))

    def _shape(self, active: ActiveTask, version: Version) -> Shape:
        phases = tuple(
            Phase(a.resource, a.start // self.tick, a.end // self.tick, int(a.bound * self.quanta))
            for a in version.accesses
        )
        wcet = (version.wcet or Duration(0)) // self.tick
        return Shape(active.name, version.name, wcet, version.units, version.gang, phases)

    def _windows(self, version: Version) -> list[Window]:
        return [
            Window(row.task, row.min // self.tick, row.max // self.tick, row.anchor is Anchor.END)
            for row in version.precedences
        ]


def on_common_grid(model: TaskModel, before: ModeSchedule, after: ModeSchedule) -> tuple[GridMode, GridMode]:
    """Put two schedules onto the coarsest grid that fits every duration of both exactly."""
    expansions = [expand(model, model.mode(mode.name)) for mode in (before, after)]
    starts = [job.start for mode in (before, after) for job in mode.jobs]
    tick = greatest_common_divisor(
        [*(natural_tick(e) for e in expansions), *(e.hyperperiod for e in expansions), *starts]
    )
    versions = [version for e in expansions for active in e.tasks for version in active.versions]
    quanta = math.lcm(*(access.bound.denominator for version in versions for access in version.accesses))
    first, second = expansions
    return GridMode(first, before, tick, quanta), GridMode(second, after, tick, quanta)
