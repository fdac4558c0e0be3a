"""The line of a switch: who occupies units and resources around it, and where one more job fits.

Times are integers in ticks from the switch on; jobs of the mode before have negative starts.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.pipeline.measure.placement import PlacedPart


@record
class Phase:
    """An access phase relative to its job's start, in ticks; its bound in quanta of the resource's capacity."""

    resource: str
    start: int
    end: int
    bound: int


@record
class Shape:
    """What a job occupies under a version: `gang` of `units` for `length`, and its access phases.

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
            if part.begun <= point <= part.done:
                return part.start + point - part.begun
        return point

    @property
    def busy(self) -> tuple[tuple[int, int], ...]:
        """When units are occupied, from the job's start."""
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
    is_lapped: bool = field(default=False, compare=False)
    """Whether it belongs to the cycle before that in which it starts."""

    @property
    def end(self) -> int:
        """The end of the job."""
        return self.start + self.shape.length

    def moved(self, by: int) -> LineJob:
        """Return the job `by` ticks later."""
        same = self.shape, self.units, self.delay, self.is_lapped
        return LineJob(self.start + by, self.task, self.index, *same)

    def crosses(self, other: LineJob) -> bool:
        """Return whether the spans of two jobs meet, and neither lies in a gap of the other (MODEL 8.2, nested)."""
        if self.end <= other.start or other.end <= self.start:
            return False
        return not (self._has_gap_for(other) or other._has_gap_for(self))

    def _has_gap_for(self, other: LineJob) -> bool:
        begin, end = other.start - self.start, other.end - self.start
        return any(before.end <= begin and end <= after.start for before, after in pairwise(self.shape.parts))


class Layer:
    """Who occupies units and resources, sorted by time, so that what is near an instant is found quickly."""

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
