"""The line of a switch: who occupies units and resources around it, and where one more job fits.

Times are integers in ticks from the switch on; jobs of the mode before have negative starts.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


@dataclass(frozen=True, slots=True)
class Phase:
    """An access phase relative to its job's start, in ticks; its bound in quanta of the resource's capacity."""

    resource: str
    start: int
    end: int
    bound: int


@dataclass(frozen=True, slots=True)
class Shape:
    """What a job occupies under a version: `gang` of `units` for `wcet`, and its access phases."""

    task: str
    version: str
    wcet: int
    units: tuple[str, ...]
    gang: int
    phases: tuple[Phase, ...]


@dataclass(frozen=True, slots=True, order=True)
class LineJob:
    """A job placed on the line; `index` is its number in its own table."""

    start: int
    task: str
    index: int
    shape: Shape = field(compare=False)
    units: tuple[str, ...] = field(compare=False)

    @property
    def end(self) -> int:
        """The end of the job."""
        return self.start + self.shape.wcet

    def moved(self, by: int) -> LineJob:
        """Return the job `by` ticks later."""
        return LineJob(self.start + by, self.task, self.index, self.shape, self.units)


class Layer:
    """Who occupies units and resources, sorted by time, so that what is near an instant is found quickly."""

    def __init__(self, jobs: Iterable[LineJob] = ()) -> None:
        self._busy: dict[str, list[tuple[int, int]]] = {}
        self._phases: dict[str, list[tuple[int, int, int]]] = {}
        self._longest: dict[str, int] = {}
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
        for unit in (*job.units, _itself(job.task)):
            insort(self._busy.setdefault(unit, []), (job.start, job.end))
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

    def first_fit(self, shape: Shape, earliest: int, latest: int) -> tuple[int, tuple[str, ...]] | None:
        """Return the first start in [earliest, latest] at which a job of this shape fits, and its units."""
        start = earliest
        free: dict[str, int] = {}
        while start <= latest:
            start = self._free_from(_itself(shape.task), start, shape.wcet)
            at, units = self._units_free_from(shape, start, free)
            if at == start:
                at = self._resources_free_from(shape, start)
                if at == start:
                    return (start, units) if start <= latest else None
            start = at
        return None

    def _units_free_from(self, shape: Shape, start: int, free: dict[str, int]) -> tuple[int, tuple[str, ...]]:
        """Return the first time from `start` on at which enough units are free, and these; or a time before that.

        `free` holds the first such times of single units that are known from earlier starts; they stay true until then.
        """
        ready: list[str] = []
        later: list[int] = []
        for unit in shape.units:
            if free.get(unit, -1) < start:
                free[unit] = self._free_from(unit, start, shape.wcet)
            if free[unit] > start:
                later.append(free[unit])
                continue
            ready.append(unit)
            if len(ready) == shape.gang:
                return start, tuple(ready)
        return sorted(later)[shape.gang - len(ready) - 1], ()

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
