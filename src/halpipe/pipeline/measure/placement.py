"""The jobs of a mode in exact integers: the common ground of metrics, latencies and the reference cost.

This is the one place of the pipeline that works out when a placed job occupies its units and resources.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

from halpipe.core.durations import ZERO, Duration, greatest_common_divisor
from halpipe.core.records import record
from halpipe.models import Anchor, Part
from halpipe.pipeline.jobs import natural_tick
from halpipe.pipeline.parts import latest_phase, parts_of, phase_instants, reserved_length, service_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.models import Access, Job, Unit, Version
    from halpipe.pipeline.jobs import ActiveTask, Expansion
    from halpipe.pipeline.parts import Service


class PlacedPart(NamedTuple):
    """A part of a job in ticks, from the job's start: wall-clock [start, end), execution [begun, done)."""

    start: int
    end: int
    begun: int
    done: int


class PlacedPhase(NamedTuple):
    """An access phase in ticks, from the job's start: in force on [start, end)."""

    access: Access
    start: int
    end: int


@record
class PlacedJob:
    """A job with its version, in ticks; `length` is from its start to its end.

    `parts` is empty for a job in one piece; `service` are the interrupts of its units.
    """

    active: ActiveTask
    index: int
    version: Version
    units: tuple[str, ...]
    start: int
    length: int
    phases: tuple[PlacedPhase, ...] = ()
    parts: tuple[PlacedPart, ...] = ()
    service: Service[Duration] = ()

    @property
    def end(self) -> int:
        """The job's end; may lie beyond the hyperperiod."""
        return self.start + self.length

    def occupations(self) -> tuple[tuple[int, int], ...]:
        """Return when the job occupies its units: [start, end) of its parts."""
        return tuple((self.start + p.start, self.start + p.end) for p in self.parts) or ((self.start, self.end),)


@dataclass(frozen=True)
class Placement:
    """All jobs of a mode on one grid that every duration of model and schedule fits exactly."""

    expansion: Expansion
    tick: Duration
    jobs: tuple[PlacedJob, ...]

    @classmethod
    def of(
        cls, expansion: Expansion, jobs: Iterable[Job], units: Iterable[Unit] = (), tick: Duration | None = None
    ) -> Placement:
        """Place `jobs`, which name tasks and versions of the expansion; `units` state the interrupts they serve.

        The grid is the coarsest that fits, unless a `tick` is given that fits, too.
        """
        listed = list(jobs)
        placing = Placing(expansion, units, tick or grid_of(expansion, listed))
        return cls(expansion, placing.tick, tuple(placing.placed(job) for job in listed))

    @property
    def hyperperiod(self) -> int:
        """The hyperperiod in ticks."""
        return self.expansion.hyperperiod // self.tick

    @cached_property
    def phases(self) -> dict[str, int]:
        """The phase of every periodic task that has jobs: its offset, or the latest that delays some job not at all."""
        found = {}
        for active in self.expansion.tasks:
            jobs, task = self.by_task[active.name], active.task
            if task.period is None or not jobs:
                continue
            period = task.period // self.tick
            offsets = sorted((job.start - job.index * period) % self.hyperperiod for job in jobs)
            phase = None if task.offset is None else task.offset % task.period // self.tick
            found[active.name] = latest_phase(offsets, self.hyperperiod) if phase is None else phase
        return found

    def delay(self, job: PlacedJob) -> int:
        """Return the time since the release of a job; 0 for one on demand."""
        period = job.active.task.period
        if period is None:
            return 0
        return (job.start - job.index * (period // self.tick) - self.phases[job.active.name]) % self.hyperperiod

    def lap(self, job: PlacedJob) -> int:
        """Return the hyperperiod for a job that belongs to the cycle before (MODEL 10.1), else 0."""
        task = job.active.task
        if task.period is None:
            return 0
        offset = ZERO if task.offset is None else task.offset % task.period
        return self.hyperperiod if job.start < (task.period * job.index + offset) // self.tick else 0

    def instant(self, job: PlacedJob, anchor: Anchor, point: Duration | None = None) -> int:
        """Return an instant of a job (MODEL 10.1)."""
        if anchor is Anchor.RELEASE:
            return job.start - self.delay(job)
        if anchor is not Anchor.POINT or point is None:
            return job.end if anchor is Anchor.END else job.start
        parts = job.parts or (PlacedPart(0, job.length, 0, (job.version.wcet or ZERO) // self.tick),)
        executed = point // self.tick
        for number, part in enumerate(parts):
            if part.begun <= executed <= part.done:
                work = point - self.tick * part.begun + (job.version.split.resume if number else ZERO)
                return job.start + part.start + reserved(work, job.service) // self.tick
        return job.end

    def data(self, job: PlacedJob) -> tuple[int, int]:
        """Return when a job reads and when it writes its data (MODEL 10.6)."""
        let = job.active.task.let
        if let is None:
            return job.start, job.end
        release = job.start - self.delay(job)
        return release, release + let // self.tick

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

    @cached_property
    def quanta(self) -> int:
        """The common denominator of all bounds: in how many equal parts every resource is shared (w_ac of the cost)."""
        versions = (version for active in self.expansion.tasks for version in active.versions)
        return math.lcm(*(access.bound.denominator for version in versions for access in version.accesses))

    @cached_property
    def claims(self) -> dict[str, list[Step]]:
        """Return the claimed quanta of each resource that jobs access, over the hyperperiod."""
        phases: dict[str, list[Interval]] = {}
        for job in self.jobs:
            for access, begin, end in job.phases:
                height = access.bound.numerator * (self.quanta // access.bound.denominator)
                phases.setdefault(access.resource, []).append(Interval(job.start + begin, end - begin, height))
        return {name: sweep(intervals, self.hyperperiod) for name, intervals in phases.items()}


def grid_of(expansion: Expansion, jobs: Iterable[Job]) -> Duration:
    """Return the largest duration that divides every duration of the mode, and every instant of its jobs."""
    instants = (d for job in jobs for d in (job.start, *_part_times(job)))
    return greatest_common_divisor([natural_tick(expansion), *instants])


def _part_times(job: Job) -> Iterator[Duration]:
    for part in job.parts:
        yield from (part.start, part.end, part.executed_from, part.executed_to)


class Placing:
    """Puts jobs on a grid; what all jobs in one piece of a version have in common is worked out once."""

    def __init__(self, expansion: Expansion, units: Iterable[Unit], tick: Duration) -> None:
        self.tick = tick
        self._by_name = expansion.by_name
        self._locks = expansion.locks
        self._interrupted = {unit.name: unit for unit in units if unit.interrupts}
        self._whole: dict[tuple[str, str, Service[Duration]], tuple[int, tuple[PlacedPhase, ...]]] = {}

    def service(self, units: Iterable[str]) -> Service[Duration]:
        """Return the interrupts of the units named, together."""
        if not self._interrupted:
            return ()
        return service_of(self._interrupted, [name for name in units if name in self._interrupted])

    def placed(self, job: Job) -> PlacedJob:
        """Return a job on the grid."""
        active = self._by_name[job.task]
        version = active.task.version(job.version)
        service = self.service(job.units)
        start = job.start // self.tick
        if not job.parts:
            length, phases = self.in_one_piece(active, version, service)
            return PlacedJob(active, job.index, version, job.units, start, length, phases, (), service)
        parts = tuple(self._part(part, job.start) for part in job.parts)
        phases = tuple(self._phases(version, parts_of(job, version), job.start, service))
        length = (job.parts[-1].end - job.start) // self.tick
        return PlacedJob(active, job.index, version, job.units, start, length, phases, parts, service)

    def in_one_piece(
        self, active: ActiveTask, version: Version, service: Service[Duration]
    ) -> tuple[int, tuple[PlacedPhase, ...]]:
        """Return length and access phases of a job without gaps on units with some interrupts."""
        key = (active.name, version.name, service)
        if key not in self._whole:
            wcet = version.wcet or ZERO
            length = reserved(wcet, service)
            whole = Part(start=ZERO, end=length, executed_from=ZERO, executed_to=wcet)
            self._whole[key] = length // self.tick, tuple(self._phases(version, (whole,), ZERO, service))
        return self._whole[key]

    def _part(self, part: Part, start: Duration) -> PlacedPart:
        begin, end = part.start - start, part.end - start
        return PlacedPart(*(time // self.tick for time in (begin, end, part.executed_from, part.executed_to)))

    def _phases(
        self, version: Version, parts: tuple[Part, ...], start: Duration, service: Service[Duration]
    ) -> Iterator[PlacedPhase]:
        for access in version.accesses:
            try:
                begin, end = phase_instants(
                    access, parts, version.split.resume, service, is_lock=access.resource in self._locks
                )
            except ValueError:  # a gap lies inside, or interrupts fill the unit: other terms of the cost tell
                continue
            yield PlacedPhase(access, (begin - start) // self.tick, (end - start) // self.tick)


def reserved(work: Duration, service: Service[Duration]) -> Duration:
    """Return the reserved length of some work; where interrupts leave no time for it, as if there were none."""
    try:
        return reserved_length(work, service)
    except ValueError:
        return work


# ------------------------------------------------------------------------------------------------ intervals on a circle


class Interval(NamedTuple):
    """`height` in force on [start, start + length) of the circle; a length beyond the period covers it repeatedly."""

    start: int
    length: int
    height: int


class Step(NamedTuple):
    """The sum of all heights on [begin, end)."""

    begin: int
    end: int
    level: int


def sweep(intervals: Iterable[Interval], period: int) -> list[Step]:
    """Return the sum of `intervals` as steps that cover [0, period) in order."""
    changes: dict[int, int] = {0: 0}
    for start, length, height in intervals:
        rounds, rest = divmod(length, period)
        begin, end = start % period, start % period + rest
        changes[0] += height * rounds
        changes[begin] = changes.get(begin, 0) + height
        if end > period:
            changes[0] += height
            end -= period
        changes[end] = changes.get(end, 0) - height
    times = sorted(time for time in changes if time < period)
    level = 0
    steps = []
    for begin, end in zip(times, [*times[1:], period], strict=True):
        level += changes[begin]
        steps.append(Step(begin, end, level))
    return steps


@record
class Instants:
    """Recurring instants on the circle, for the search of the next or the last one before an absolute time."""

    times: tuple[int, ...]
    labels: tuple[int, ...]
    period: int

    @classmethod
    def of(cls, instants: Iterable[tuple[int, int]], period: int) -> Instants:
        """Build from (time, label) pairs; times are taken modulo the period."""
        ordered = sorted((time % period, label) for time, label in instants)
        return cls(tuple(time for time, _ in ordered), tuple(label for _, label in ordered), period)

    def at_or_after(self, time: int) -> tuple[int, int]:
        """Return the first instant at or after `time`, absolute, and its label."""
        rounds, rest = divmod(time, self.period)
        index = bisect_left(self.times, rest)
        if index == len(self.times):
            rounds, index = rounds + 1, 0
        return rounds * self.period + self.times[index], self.labels[index]

    def at_or_before(self, time: int) -> tuple[int, int]:
        """Return the last instant at or before `time`, absolute, and its label."""
        rounds, rest = divmod(time, self.period)
        index = bisect_right(self.times, rest) - 1
        if index < 0:
            rounds, index = rounds - 1, len(self.times) - 1
        return rounds * self.period + self.times[index], self.labels[index]

    def __iter__(self) -> Iterator[tuple[int, int]]:
        return iter(zip(self.times, self.labels, strict=True))
