"""The schedules of two modes on the common grid of a switch between them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, islice
from typing import TYPE_CHECKING

from halpipe.core.durations import greatest_common_divisor
from halpipe.core.records import record
from halpipe.models import Anchor, Binding, Edge, Match
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.placement import Placement, Placing, grid_of
from halpipe.pipeline.transitions.line import LineJob, Phase, Shape

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from halpipe.core.durations import Duration
    from halpipe.models import ModeSchedule, TaskModel, Unit, Version
    from halpipe.pipeline.jobs import ActiveTask, Expansion
    from halpipe.pipeline.measure.placement import PlacedJob, PlacedPhase
    from halpipe.pipeline.parts import Service

GANG_SETS = 16
"""Unit sets that are tried for a gang whose units serve interrupts."""


@record
class Window:
    """A precedence constraint in ticks: an instant of a job of `task` lies between `low` and `high` before a start.

    Or before an end, if it leads `to_end`. That of the `same_cycle` reads as a window where a cycle is not whole.
    """

    task: str
    low: int
    high: int
    origin: Anchor = Anchor.START
    point: int = 0
    to_end: bool = False
    same_cycle: bool = False

    def lag(self, shape: Shape) -> int:
        """Return how long after its start a predecessor job of a table reaches the instant."""
        if self.origin is Anchor.END:
            return shape.length
        return shape.reached(self.point) if self.origin is Anchor.POINT else 0

    def instant(self, job: LineJob) -> int:
        """Return the instant of a predecessor job from which the window counts."""
        return job.start - job.delay if self.origin is Anchor.RELEASE else job.start + self.lag(job.shape)

    def of(self, shape: Shape) -> Window:
        """Return the window in which a job of this shape has to start."""
        if not self.to_end:
            return self
        return replace(self, low=self.low - shape.length, high=self.high - shape.length, to_end=False)


@dataclass(frozen=True)
class GridMode:
    """A scheduled mode with all its times in ticks, and all its bounds in quanta, of a common grid."""

    expansion: Expansion
    schedule: ModeSchedule
    tick: Duration
    quanta: int
    units: tuple[Unit, ...] = ()
    bound: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """The units of tasks that must stay on theirs."""
    _made: dict[object, Shape] = field(default_factory=dict, compare=False, repr=False)

    @property
    def hyperperiod(self) -> int:
        """The hyperperiod in ticks."""
        return self.expansion.hyperperiod // self.tick

    @cached_property
    def shapes(self) -> dict[str, tuple[Shape, ...]]:
        """What a job of a table may occupy, for every active task: one piece of each version, or the parts of a job."""
        return {active.name: tuple(self._in_time(active)) for active in self.expansion.tasks}

    def _in_time(self, active: ActiveTask) -> Iterator[Shape]:
        """Yield the shapes that are over within the logical execution time, of tasks that have one."""
        let = active.task.let
        return (shape for shape in self._shapes(active) if let is None or shape.length <= let // self.tick)

    @cached_property
    def windows(self) -> dict[tuple[str, str], tuple[Window, ...]]:
        """The precedence constraints of every (task, version)."""
        return {(a.name, v.name): tuple(self._windows(v)) for a in self.expansion.tasks for v in a.versions}

    @cached_property
    def jobs(self) -> tuple[LineJob, ...]:
        """One cycle, its start at 0; jobs may end beyond it."""
        placed = self._placement
        rows = [row for active in self.expansion.tasks for version in active.versions for row in version.precedences]
        released = {row.task for row in rows if row.anchor is Anchor.RELEASE}
        ringed = (
            {active.name for active in self.expansion.tasks} if any(r.match is Match.CYCLE for r in rows) else set()
        )
        return tuple(
            sorted(
                LineJob(
                    j.start,
                    j.active.name,
                    j.index,
                    self._shape_of(j),
                    j.units,
                    placed.delay(j) if j.active.name in released else 0,
                    j.active.name in ringed and placed.lap(j) > 0,
                )
                for j in placed.jobs
            )
        )

    @property
    def is_closed(self) -> bool:
        """Whether nothing may be in progress where the mode begins."""
        return self.expansion.mode.edge is Edge.CLOSED

    @cached_property
    def _placement(self) -> Placement:
        return Placement.of(self.expansion, self.schedule.jobs, self.units, self.tick)

    @cached_property
    def _placing(self) -> Placing:
        return Placing(self.expansion, self.units, self.tick)

    def _shapes(self, active: ActiveTask) -> Iterator[Shape]:
        jobs = self._placement.by_task[active.name]
        bound = self.bound.get(active.name)
        for version in active.versions:
            if bound and (len(bound) != version.gang or not set(bound) <= set(version.units)):
                continue  # the task stays on units that this version cannot have
            yield from self._whole(active, version, bound or version.units)
            patterns = (self._shape_of(job) for job in jobs if job.version is version and (job.parts or job.service))
            yield from dict.fromkeys(patterns)

    def _whole(self, active: ActiveTask, version: Version, units: tuple[str, ...]) -> Iterator[Shape]:
        """Yield shapes in one piece, each for units with the same interrupts; of gangs, for some sets of them."""
        if version.gang > 1:
            sets = [units] if not self._placing.service(units) else islice(combinations(units, version.gang), GANG_SETS)
            for chosen in sets:
                yield self._shape(active, version, tuple(chosen), self._placing.service(tuple(chosen)))
            return
        alike: dict[Service[Duration], list[str]] = {}
        for unit in units:
            alike.setdefault(self._placing.service((unit,)), []).append(unit)
        for service, names in alike.items():
            yield self._shape(active, version, tuple(names), service)

    def _shape(self, active: ActiveTask, version: Version, units: tuple[str, ...], service: Service[Duration]) -> Shape:
        length, phases = self._placing.in_one_piece(active, version, service)
        return Shape(active.name, version.name, length, units, version.gang, self._quanta(phases))

    def _shape_of(self, job: PlacedJob) -> Shape:
        key = (job.active.name, job.version.name, job.service, job.parts, job.units if job.parts or job.service else ())
        if key not in self._made:
            units = job.units if job.parts or job.service else job.version.units
            phases = self._quanta(job.phases)
            self._made[key] = Shape(
                job.active.name, job.version.name, job.length, units, job.version.gang, phases, job.parts
            )
        return self._made[key]

    def _quanta(self, phases: Iterable[PlacedPhase]) -> tuple[Phase, ...]:
        return tuple(Phase(a.resource, begin, end, int(a.bound * self.quanta)) for a, begin, end in phases)

    def _windows(self, version: Version) -> list[Window]:
        return [
            Window(
                row.task,
                row.min // self.tick,
                row.max // self.tick,
                row.anchor,
                row.point // self.tick if row.point is not None else 0,
                row.to is Anchor.END,
                row.match is Match.CYCLE,
            )
            for row in version.precedences
        ]


def on_common_grid(model: TaskModel, before: ModeSchedule, after: ModeSchedule) -> tuple[GridMode, GridMode]:
    """Put two schedules onto the coarsest grid that fits every duration of both exactly."""
    expansions = [expand(model, model.mode(mode.name)) for mode in (before, after)]
    grids = [grid_of(e, mode.jobs) for e, mode in zip(expansions, (before, after), strict=True)]
    tick = greatest_common_divisor([*grids, *(e.hyperperiod for e in expansions)])
    versions = [version for e in expansions for active in e.tasks for version in active.versions]
    quanta = math.lcm(*(access.bound.denominator for version in versions for access in version.accesses))
    first, second = expansions
    units = model.units
    bound = _bound_units(second, before, after)
    return GridMode(first, before, tick, quanta, units), GridMode(second, after, tick, quanta, units, bound)


def _bound_units(after: Expansion, before: ModeSchedule, target: ModeSchedule) -> dict[str, tuple[str, ...]]:
    """Return the units to which tasks of the mode after are bound: those of its jobs, or of the mode before."""
    bound: dict[str, tuple[str, ...]] = {}
    for table, bindings in ((target, (Binding.MODE, Binding.SYSTEM)), (before, (Binding.SYSTEM,))):
        for job in table.jobs:
            active = after.by_name.get(job.task)
            if active is not None and active.task.binding in bindings:
                bound.setdefault(job.task, job.units)
    return bound
