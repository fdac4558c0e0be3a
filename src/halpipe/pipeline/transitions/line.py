"""The line of a switch: who occupies units and resources around it, and where one more job fits.

Times are integers in ticks from the switch on; jobs of the mode before have negative starts.
"""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, islice, pairwise
from typing import TYPE_CHECKING

from halpipe.core.durations import Duration, greatest_common_divisor
from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.models import Anchor, Binding, Edge, ModeSchedule, TaskModel, Unit, Version
from halpipe.pipeline.jobs import ActiveTask, Expansion, expand
from halpipe.pipeline.measure.placement import PlacedJob, PlacedPart, PlacedPhase, Placement, Placing, grid_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from halpipe.pipeline.parts import Service


@record
class Phase:
    """An access phase relative to its job's start, in ticks; its bound in quanta of the resource's capacity."""

    resource: str
    start: int
    end: int
    bound: int


@record
class Shape:
    """Occupation of a job under a version: `gang` of `units` for `length`, and its access phases.

    A job with gaps occupies them during its `parts` only, which count from its start.
    """

    task: str
    version: str
    length: int
    units: tuple[str, ...]
    gang: int
    phases: tuple[Phase, ...]
    parts: tuple[PlacedPart, ...] = ()

    def reached(self, point: int) -> int:
        """Return how long after its start a job has executed for `point`, without interrupts."""
        for part in self.parts:
            if point <= part.done:
                return part.start + point - part.begun
        return point

    @property
    def busy(self) -> tuple[tuple[int, int], ...]:
        """Spans in which units are occupied, from the job's start."""
        return tuple((part.start, part.end) for part in self.parts) or ((0, self.length),)


@dataclass(frozen=True, slots=True, order=True)
class LineJob:
    """A job placed on the line; `index` is its number in its own table."""

    start: int
    task: str
    index: int
    shape: Shape = field(compare=False)
    units: tuple[str, ...] = field(compare=False)
    delay: int = field(default=0, compare=False)
    """Since its release, where a window counts from there; a job of a table is released when it starts."""

    @property
    def end(self) -> int:
        """The end of the job."""
        return self.start + self.shape.length

    def moved(self, by: int) -> LineJob:
        """Return the job `by` ticks later."""
        return LineJob(self.start + by, self.task, self.index, self.shape, self.units, self.delay)

    def crosses(self, other: LineJob) -> bool:
        """Return whether the spans of two jobs meet, and neither lies in a gap of the other (MODEL 8.2, nested)."""
        if self.end <= other.start or other.end <= self.start:
            return False
        return not (self._has_gap_for(other) or other._has_gap_for(self))

    def _has_gap_for(self, other: LineJob) -> bool:
        begin, end = other.start - self.start, other.end - self.start
        return any(before.end <= begin and end <= after.start for before, after in pairwise(self.shape.parts))


class Layer:
    """Occupation of units and resources, sorted by time, so that neighbours of an instant are found quickly."""

    def __init__(self, jobs: Iterable[LineJob] = ()) -> None:
        self._busy: dict[str, list[tuple[int, int]]] = {}
        self._phases: dict[str, list[tuple[int, int, int]]] = {}
        self._longest: dict[str, int] = {}
        self._split: list[LineJob] = []
        self._begin = self._end = 0
        for job in sorted(jobs, key=lambda job: job.start):
            self.enter(job)

    def is_free(self, begin: int, end: int) -> bool:
        """Return whether no job at all is near [begin, end): a quick answer before the others are asked."""
        return begin >= self._end or end <= self._begin

    def enter(self, job: LineJob) -> None:
        """Occupy what a job needs."""
        is_first = not self._busy
        self._begin = job.start if is_first else min(self._begin, job.start)
        self._end = job.end if is_first else max(self._end, job.end)
        insort(self._busy.setdefault(_itself(job.task), []), (job.start, job.end))
        for begin, end in job.shape.busy:
            for unit in job.units:
                insort(self._busy.setdefault(unit, []), (job.start + begin, job.start + end))
        if job.shape.parts:
            self._split.append(job)
        for phase in job.shape.phases:
            insort(self._phases.setdefault(phase.resource, []), self._span(job, phase))

    def _span(self, job: LineJob, phase: Phase) -> tuple[int, int, int]:
        self._longest[phase.resource] = max(phase.end - phase.start, self._longest.get(phase.resource, 0))
        return job.start + phase.start, job.start + phase.end, phase.bound

    def free_from(self, unit: str, start: int, length: int) -> int:
        """Return the first time from `start` on at which a unit is free for `length`; its jobs do not overlap."""
        busy = self._busy.get(unit, ())
        for index in range(max(0, bisect_left(busy, (start, start)) - 1), len(busy)):
            begin, end = busy[index]
            if begin >= start + length:
                break
            start = max(start, end)
        return start

    def crossing_end(self, job: LineJob) -> int | None:
        """Return the end of a job with gaps on a unit of `job` that crosses it; None if there is no such job.

        Jobs in one piece lie in a gap wherever the unit is free for them.
        """
        return next((o.end for o in self._split if not set(o.units).isdisjoint(job.units) and o.crosses(job)), None)

    def phases_within(self, resource: str, begin: int, end: int) -> Iterator[tuple[int, int, int]]:
        """Return begin, end and bound of the access phases that are in force at some time in [begin, end)."""
        phases = self._phases.get(resource, ())
        first = bisect_left(phases, (begin - self._longest.get(resource, 0),))
        for index in range(first, len(phases)):
            if phases[index][0] >= end:
                break
            if phases[index][1] > begin:
                yield phases[index]


class Line:
    """Units and resources over time: layers that were made before, each moved by some time, and jobs entered since.

    A resource has `capacity` quanta.
    """

    def __init__(self, capacity: int, *layers: tuple[Layer, int]) -> None:
        self._capacity = capacity
        self._entered = Layer()
        self._layers = (*layers, (self._entered, 0))

    def enter(self, job: LineJob) -> None:
        """Occupy what a job needs."""
        self._entered.enter(job)

    def overloads(self, job: LineJob) -> bool:
        """Return whether the access phases of a job do not fit beside those that are there."""
        return self._resources_free_from(job.shape, job.start) != job.start

    def clashes(self, job: LineJob) -> bool:
        """Return whether a unit of a job is in use, or a job with gaps there crosses it."""
        is_free = all(self._free_for(unit, job.start, job.shape.busy) == job.start for unit in job.units)
        return not is_free or self._crossing_end(job) is not None

    def first_fit(self, shape: Shape, earliest: int, latest: int) -> tuple[int, tuple[str, ...]] | None:
        """Return the first start in [earliest, latest] at which a job of this shape fits, and its units."""
        start = earliest
        free: dict[str, int] = {}
        while start <= latest:
            start = self._free_from(_itself(shape.task), start, shape.length)
            at, units = self._units_free_from(shape, start, free)
            if at == start:
                at = self._resources_free_from(shape, start)
                if at == start and shape.parts:
                    at = self._crossing_end(LineJob(start, shape.task, 0, shape, units)) or start
                if at == start:
                    return (start, units) if start <= latest else None
            start = at
        return None

    def _crossing_end(self, job: LineJob) -> int | None:
        """Return the end of some job that crosses `job`."""
        for layer, shift in self._layers:
            end = layer.crossing_end(job.moved(-shift))
            if end is not None:
                return end + shift
        return None

    def _units_free_from(self, shape: Shape, start: int, free: dict[str, int]) -> tuple[int, tuple[str, ...]]:
        """Return the first time from `start` on at which enough units are free, and these; or a time before that.

        `free` holds the first such times of single units that are known from earlier starts; they stay true until then.
        """
        ready: list[str] = []
        later: list[int] = []
        busy = shape.busy
        for unit in shape.units:
            if free.get(unit, -1) < start:
                free[unit] = self._free_for(unit, start, busy)
            if free[unit] > start:
                later.append(free[unit])
                continue
            ready.append(unit)
            if len(ready) == shape.gang:
                return start, tuple(ready)
        return sorted(later)[shape.gang - len(ready) - 1], ()

    def _free_for(self, unit: str, start: int, busy: tuple[tuple[int, int], ...]) -> int:
        """Return the first time from `start` on from which a unit is free at all times of `busy`."""
        settled = 0
        while settled < len(busy):
            for begin, end in busy:
                later = self._free_from(unit, start + begin, end - begin) - begin
                settled = settled + 1 if later == start else 1
                start = later
        return start

    def _free_from(self, unit: str, start: int, length: int) -> int:
        """Return the first time from `start` on at which a unit is free for `length` in all layers."""
        settled = 0
        while settled < len(self._layers):
            for layer, shift in self._layers:
                at = start - shift
                if not layer.is_free(at, at + length) and (later := layer.free_from(unit, at, length)) > at:
                    start, settled = later + shift, 0
                settled += 1
        return start

    def _resources_free_from(self, shape: Shape, start: int) -> int:
        """Return `start` if all access phases fit there, else a later start at which the first overload is past."""
        for phase in shape.phases:
            past = self._overload_end(phase, start)
            if past is not None:
                return past - phase.start
        return start

    def _overload_end(self, phase: Phase, start: int) -> int | None:
        begin, end = start + phase.start, start + phase.end
        present = [
            (first + shift, last + shift, bound)
            for layer, shift in self._layers
            for first, last, bound in layer.phases_within(phase.resource, begin - shift, end - shift)
        ]
        for instant in sorted({begin, *(p[0] for p in present if p[0] > begin)}):
            here = [p for p in present if p[0] <= instant < p[1]]
            if sum(p[2] for p in here) + phase.bound > self._capacity:
                return min(p[1] for p in here)
        return None


def _itself(task: str) -> str:
    """Return the unit of which every task has one: it must not run against itself. No unit's name has a blank."""
    return f"task {task}"


# ------------------------------------------------------------------------------------------------ modes on one grid

GANG_SETS = 16
"""Unit sets that are tried for a gang whose units serve interrupts."""


@record
class Window:
    """A precedence constraint in ticks: an instant of a job of `task` lies between `low` and `high` before a start.

    Or before an end, if it leads `to_end`.
    """

    task: str
    low: int
    high: int
    origin: Anchor = Anchor.START
    point: int = 0
    to_end: bool = False

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
        """Occupations of a job of a table, for every active task: one piece of each version, or the parts of a job."""
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
        jobs = (
            LineJob(j.start, j.active.name, j.index, self._shape_of(j), j.units, placed.delay(j)) for j in placed.jobs
        )
        return tuple(sorted(jobs))

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
        for service, names in grouped((self._placing.service((unit,)), unit) for unit in units).items():
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
