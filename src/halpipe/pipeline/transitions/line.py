"""The line of a switch: who occupies units and resources around it, and where one more job fits.

Times are integers in ticks from the switch on; jobs of the mode before have negative starts.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from dataclasses import dataclass, field


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


class Line:
    """Units and resources over time; jobs are entered one by one. A resource has `capacity` quanta."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._busy: dict[str, list[tuple[int, int]]] = {}
        self._phases: dict[str, list[tuple[int, int, int]]] = {}

    def enter(self, job: LineJob) -> None:
        """Occupy what a job needs."""
        for unit in (*job.units, _itself(job.task)):
            insort(self._busy.setdefault(unit, []), (job.start, job.end))
        for phase in job.shape.phases:
            begin, end = job.start + phase.start, job.start + phase.end
            insort(self._phases.setdefault(phase.resource, []), (begin, end, phase.bound))

    def clashes(self, job: LineJob) -> bool:
        """Return whether a job does not fit beside those entered."""
        if any(self._unit_free_from(unit, job.start, job.shape.wcet) != job.start for unit in job.units):
            return True
        return self._resources_free_from(job.shape, job.start) != job.start

    def first_fit(self, shape: Shape, earliest: int, latest: int) -> tuple[int, tuple[str, ...]] | None:
        """Return the first start in [earliest, latest] at which a job of this shape fits, and its units."""
        start = earliest
        while start <= latest:
            free = {unit: self._unit_free_from(unit, start, shape.wcet) for unit in shape.units}
            ready = tuple(unit for unit in shape.units if free[unit] == start)
            if len(ready) < shape.gang:
                later = sorted(free.values())
                start = later[shape.gang - 1]
                continue
            moved = max(
                self._resources_free_from(shape, start),
                self._unit_free_from(_itself(shape.task), start, shape.wcet),
            )
            if moved == start:
                return start, ready[: shape.gang]
            start = moved
        return None

    def _unit_free_from(self, unit: str, start: int, length: int) -> int:
        """Return the first time from `start` on at which a unit is free for `length`."""
        busy = self._busy.get(unit, ())
        index = max(0, bisect_left(busy, (start, start)) - 1)
        for begin, end in busy[index:]:
            if begin >= start + length:
                break
            start = max(start, end) if end > start else start
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
        present = [p for p in self._phases.get(phase.resource, ()) if p[0] < end and p[1] > begin]
        for instant in sorted({begin, *(p[0] for p in present if p[0] > begin)}):
            here = [p for p in present if p[0] <= instant < p[1]]
            if sum(p[2] for p in here) + phase.bound > self._capacity:
                return min(p[1] for p in here)
        return None


def _itself(task: str) -> str:
    """Return the unit of which every task has one: it must not run against itself. No unit's name has a blank."""
    return f"task {task}"
