"""Growth of the jobs of one version while all start instants stay.

Every rule of MODEL 3 that a WCET enters gives a limit of its own: the next start on the unit, the deadline, windows
that count from the end, limits of chains. Access phases keep their distance from the start, so they say nothing. All
limits are exact, and at a limit the schedule is still valid.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

from halpipe.core.durations import Duration, greatest_common_divisor
from halpipe.models import Anchor
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.latency import members_of, worst_age, worst_latency, worst_reaction
from halpipe.pipeline.measure.placement import PlacedJob, Placement
from halpipe.pipeline.whatif.changed import time_limit

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.models import Chain, ModeSchedule, Precedence, Schedule, Task, TaskModel
    from halpipe.pipeline.measure.latency import Measure


class Limit(NamedTuple):
    """How far the WCET may grow, in ticks, and what comes then."""

    growth: int
    reason: str


def common_tick(model: TaskModel, schedule: Schedule) -> Duration:
    """Return the largest duration that divides every time that a rule compares."""
    times: list[Duration] = [time for unit in model.units for i in unit.interrupts for time in (i.distance, i.wcet)]
    for task in model.tasks:
        times += [time for time in (task.period, task.offset, task.deadline, task.distance, task.let) if time]
        times += [task.period * task.slack] if task.period is not None else []
        for version in task.versions:
            times += [version.wcet] if version.wcet is not None else []
            times += [*version.split.points, version.split.resume, version.split.min_part or version.split.resume]
            times += [time for row in version.precedences for time in (row.min, row.max, row.point) if time]
            times += [time for access in version.accesses for time in (access.start, access.end)]
    times += [t for c in model.chains for t in (c.max_latency, c.max_reaction, c.max_age) if t is not None]
    jobs = [*(job for mode in schedule.modes for job in mode.jobs), *(j for t in schedule.transitions for j in t.jobs)]
    times += [job.start for job in jobs]
    times += [time for job in jobs for part in job.parts for time in (part.start, part.executed_to)]
    times += [table.length for table in schedule.transitions]
    return greatest_common_divisor(times)


@dataclass(frozen=True)
class FixedStarts:
    """The jobs of one mode, in ticks, each at its start; the schedule of the mode is valid."""

    model: TaskModel
    placement: Placement

    @classmethod
    def of(cls, model: TaskModel, mode: ModeSchedule, tick: Duration) -> FixedStarts:
        """Put a valid schedule of a mode onto the grid of `tick`."""
        expansion = expand(model, model.mode(mode.name))
        coarse = Placement.of(expansion, mode.jobs, model.units)
        times = coarse.tick // tick
        jobs = tuple(replace(job, start=job.start * times, length=job.length * times) for job in coarse.jobs)
        return cls(model, Placement(expansion, tick, jobs))

    def limit(self, task: str, version: str) -> Limit | None:
        """Return the tightest limit for a version; None where no job uses it."""
        growing = [job for job in self.placement.by_task.get(task, ()) if job.version.name == version]
        if not growing:
            return None
        limits = [*self._next_on_units(growing), *self._deadline(growing), *self._windows(growing)]
        tightest = min(limits, key=lambda limit: limit.growth)
        return min([tightest, *self._chains(growing, tightest.growth)], key=lambda limit: limit.growth)

    @property
    def _circle(self) -> int:
        return self.placement.hyperperiod

    def _text(self, ticks: int) -> str:
        return str(self.placement.tick * ticks)

    # ---- units

    @cached_property
    def _by_unit(self) -> dict[str, tuple[list[int], list[PlacedJob]]]:
        found: dict[str, list[tuple[int, PlacedJob]]] = defaultdict(list)
        for job in self.placement.jobs:
            for unit in job.units:
                found[unit].append((job.start, job))
        ordered = {unit: sorted(jobs, key=lambda pair: pair[0]) for unit, jobs in found.items()}
        return {unit: ([s for s, _ in jobs], [job for _, job in jobs]) for unit, jobs in ordered.items()}

    def _next_on_units(self, growing: list[PlacedJob]) -> Iterator[Limit]:
        for job in growing:
            for unit in job.units:
                starts, jobs = self._by_unit[unit]
                place = (bisect_left(starts, job.start) + 1) % len(starts)
                distance = (starts[place] - job.start) % self._circle or self._circle
                then = jobs[place]
                reason = f'unit "{unit}": "{then.active.name}" job {then.index} starts at {self._text(then.start)}'
                yield Limit(distance - job.length, reason)

    # ---- deadlines

    def _deadline(self, growing: list[PlacedJob]) -> Iterator[Limit]:
        """Take the phase that leaves most: every phase that suits the slack and the other versions may be meant."""
        task = growing[0].active.task
        limit = time_limit(task)
        if task.period is None or limit is None:
            return
        tick, version = self.placement.tick, growing[0].version.name
        deadline, period, slack = limit // tick, task.period // tick, task.period * task.slack // tick
        jobs = self.placement.by_task[task.name]
        latest = [((job.start - job.index * period) % self._circle, job) for job in jobs]
        best: Limit | None = None
        for phase in self._phases(task, sorted({at for at, _ in latest}), slack):
            rooms = [(deadline - (at - phase) % self._circle - job.length, job) for at, job in latest]
            if all(room >= 0 for room, _ in rooms):
                room, job = min(((r, j) for r, j in rooms if j.version.name == version), key=lambda pair: pair[0])
                if best is None or room > best.growth:
                    best = Limit(room, f"deadline {limit} of job {job.index}")
        if best is not None:
            yield best

    def _phases(self, task: Task, latest: list[int], slack: int) -> Iterator[int]:
        """Yield the phases at which every job lies within its slack."""
        if task.offset is not None and task.period is not None:
            yield task.offset % task.period // self.placement.tick
            return
        for place, phase in enumerate(latest):
            if (latest[place - 1] - phase) % self._circle <= slack:  # the one before is the furthest behind
                yield phase

    # ---- windows

    def _windows(self, growing: list[PlacedJob]) -> Iterator[Limit]:
        """Look at every window that counts from the end of the growing jobs' task."""
        name, version = growing[0].active.name, growing[0].version.name
        moving = sorted(job.end % self._circle for job in growing)
        others = [job for job in self.placement.by_task[name] if job.version.name != version]
        resting = sorted(job.end % self._circle for job in others)
        for job, row in self._needing_end.get(name, ()):
            top = job.start - row.min // self.placement.tick
            width = (row.max - row.min) // self.placement.tick
            if not resting or next(self._before(resting, top)) > width:
                reason = f'window of "{job.active.name}" job {job.index}: [{row.min}, {row.max}] from the end'
                yield Limit(self._reach(moving, top, width), reason)

    @cached_property
    def _needing_end(self) -> dict[str, list[tuple[PlacedJob, Precedence]]]:
        found: dict[str, list[tuple[PlacedJob, Precedence]]] = defaultdict(list)
        for job in self.placement.jobs:
            for row in job.version.precedences:
                if row.anchor is Anchor.END:
                    found[row.task].append((job, row))
        return found

    def _before(self, instants: list[int], top: int) -> Iterator[int]:
        """Yield how far instants lie before `top`, the nearest first, through one hyperperiod."""
        top %= self._circle
        place = bisect_left(instants, top + 1)
        for step in range(1, len(instants) + 1):
            yield (top - instants[place - step]) % self._circle

    def _reach(self, moving: list[int], top: int, width: int) -> int:
        """Return how far the ends may move before none of them lies in [top - width, top] for a moment.

        Each is inside from `distance - width` to `distance`; as long as the next one comes in before, all is well.
        """
        reach = 0
        distances = list(self._before(moving, top))
        for distance in (*distances, distances[0] + self._circle):
            if distance - width > reach:
                return reach
            reach = max(reach, distance)
        return reach

    # ---- chains

    def _chains(self, growing: list[PlacedJob], cap: int) -> Iterator[Limit]:
        by_task = self.placement.by_task
        for chain in self.model.chains:
            if growing[0].active.name not in chain.tasks or not all(name in by_task for name in chain.tasks):
                continue
            stated = (
                ("latency", chain.max_latency, worst_latency),
                ("reaction time", chain.max_reaction, worst_reaction),
                ("data age", chain.max_age, worst_age),
            )
            for what, limit, measure in stated:
                if limit is not None:
                    most = self._chain_reach(chain, measure, limit // self.placement.tick, growing, cap)
                    if most < cap:
                        cap = most
                        yield Limit(most, f'chain "{chain.name}": {what} {limit}')

    def _chain_reach(self, chain: Chain, measure: Measure, limit: int, growing: list[PlacedJob], cap: int) -> int:
        """Return the largest growth up to `cap` within the limit, by bisection: latencies grow with it."""
        name, version = growing[0].active.name, growing[0].version.name

        def keeps(growth: int) -> bool:
            jobs = tuple(
                replace(job, length=job.length + growth)
                if (job.active.name, job.version.name) == (name, version)
                else job
                for job in self.placement.jobs
                if job.active.name in chain.tasks
            )
            members = members_of(replace(self.placement, jobs=jobs), chain)
            latency = None if members is None else measure(members, self._circle)
            return latency is not None and latency <= limit

        if keeps(cap):
            return cap
        good, bad = 0, cap
        while bad - good > 1:
            middle = (good + bad) // 2
            good, bad = (middle, bad) if keeps(middle) else (good, middle)
        return good
