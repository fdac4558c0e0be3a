"""Cost of broken rules of preemptive jobs, bound tasks and sporadic arrivals (MODEL 8.2 and 8.3).

All costs are in ticks, at least one for every rule broken; what has no distance counts one mean WCET. A mode that uses
nothing of MODEL 8 costs nothing here.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from itertools import pairwise
from math import ceil
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.models import Binding
from halpipe.pipeline.measure.placement import reserved
from halpipe.pipeline.parts import latest_phase

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.models import Version
    from halpipe.pipeline.jobs import ActiveTask
    from halpipe.pipeline.measure.placement import PlacedJob, Placement


def splitting_cost(placement: Placement) -> int:
    """Return how far the schedule is from keeping the rules `parts`, `nested`, `binding`, and those of arrivals."""
    split = [job for job in placement.jobs if job.parts]
    cost = sum(parts_cost(placement, job) for job in split)
    if split:
        cost += _nesting_cost(placement, split)
    for active in placement.expansion.tasks:
        if active.task.binding is not Binding.JOB:
            cost += _binding_cost(placement, active)
        if active.task.distance is not None:
            cost += _arrival_cost(placement, active)
            cost += _deadline_cost(placement, active) if active.task.let is not None else 0
        elif active.task.period is not None and _may_be_longer(placement.by_task[active.name]):
            cost += _deadline_cost(placement, active)
    return cost


def _may_be_longer(jobs: list[PlacedJob]) -> bool:
    return any(job.parts or job.service for job in jobs)


# ---- parts


def parts_cost(placement: Placement, job: PlacedJob) -> int:
    """Return how far the parts of one job are from those that its version allows."""
    tick, split = placement.tick, job.version.split
    wcet, resume = (job.version.wcet or ZERO) // tick, split.resume // tick
    bounds = [0, *(part.done for part in job.parts[:-1]), wcet]
    begun = [part.begun for part in job.parts]
    cost = abs(job.parts[0].start) + abs(job.parts[-1].done - wcet)
    cost += sum(abs(a - b) for a, b in zip(begun, bounds, strict=False))
    cost += sum(max(0, part.begun + 1 - part.done) for part in job.parts)
    cost += sum(max(0, earlier.end + 1 - later.start) for earlier, later in pairwise(job.parts))
    allowed = _Boundaries.of(job.version, tick, placement.expansion.locks)
    cost += sum(allowed.distance(bound) for bound in bounds[1:-1])
    for number, part in enumerate(job.parts):
        work = part.done - part.begun + (resume if number else 0)
        cost += abs(part.end - part.start - reserved(tick * work, job.service) // tick) if work > 0 else 0
    if split.min_part is not None:
        cost += sum(max(0, split.min_part // tick - (part.done - part.begun)) for part in job.parts)
    if split.max_gaps is not None:
        cost += max(0, len(job.parts) - 1 - split.max_gaps) * placement.mean_wcet
    return cost


@record
class _Boundaries:
    """Preemption points of a version, in ticks of execution: the points, or `anywhere` outside all phases but locks."""

    anywhere: bool
    wcet: int
    points: tuple[int, ...]
    phases: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, version: Version, tick: Duration, locks: frozenset[str] = frozenset()) -> _Boundaries:
        points = tuple(sorted(point // tick for point in version.split.points))
        claims = (access for access in version.accesses if access.resource not in locks)
        phases = sorted((access.start // tick, access.end // tick) for access in claims)
        merged: list[tuple[int, int]] = []
        for begin, end in phases:  # between phases that overlap there is no instant outside
            if merged and begin < merged[-1][1]:
                merged[-1] = (merged[-1][0], max(end, merged[-1][1]))
            else:
                merged.append((begin, end))
        return cls(version.split.anywhere, (version.wcet or ZERO) // tick, points, tuple(merged))

    def distance(self, bound: int) -> int:
        """Return how far a boundary lies from the nearest one that is allowed."""
        if not self.anywhere:
            place = bisect_left(self.points, bound)
            near = self.points[max(0, place - 1) : place + 1]
            return min((abs(bound - point) for point in near), default=self.wcet)
        if not 0 < bound < self.wcet:
            return max(1 - bound, bound + 1 - self.wcet)
        return next((min(bound - begin, end - bound) for begin, end in self.phases if begin < bound < end), 0)


# ---- nested


def _nesting_cost(placement: Placement, split: list[PlacedJob]) -> int:
    """Return by how much spans cross where they must be apart, or one in a gap of the other."""
    circle = placement.hyperperiod
    on_unit: dict[str, _Spans] = {}
    for job in placement.jobs:
        for unit in dict.fromkeys(job.units):
            on_unit.setdefault(unit, _Spans([])).jobs.append(job)
    cost, seen = 0, set()
    for job in split:
        for unit in dict.fromkeys(job.units):
            for other, shift in on_unit[unit].meeting(job, circle):
                pair = _pair(job, other, shift)
                if pair not in seen:
                    seen.add(pair)
                    cost += _crossing(job, other, shift, is_own=job.active is other.active)
    return cost


def _pair(job: PlacedJob, other: PlacedJob, shift: int) -> tuple[tuple[str, int], tuple[str, int], int]:
    """Return the same name for a pair of jobs from whichever of the two it is looked at."""
    one, two = (job.active.name, job.index), (other.active.name, other.index)
    if one == two:
        return one, two, abs(shift)
    return (one, two, shift) if one < two else (two, one, -shift)


class _Spans:
    """Jobs of one unit, to be found by their spans."""

    def __init__(self, jobs: list[PlacedJob]) -> None:
        self.jobs = jobs
        self._starts: list[int] = []
        self._longest = 0

    def meeting(self, job: PlacedJob, circle: int) -> Iterator[tuple[PlacedJob, int]]:
        """Yield the jobs, and by how much to shift them, whose spans have some time in common with that of `job`."""
        if not self._starts:
            self.jobs.sort(key=lambda other: other.start)
            self._starts = [other.start for other in self.jobs]
            self._longest = max(other.length for other in self.jobs)
        first = (job.start - self._longest) // circle
        for turn in range(first, job.end // circle + 1):
            shift = turn * circle
            place = bisect_left(self._starts, job.start - self._longest - shift)
            while place < len(self.jobs) and self._starts[place] + shift < job.end:
                other = self.jobs[place]
                if other.end + shift > job.start and not (other is job and not shift):
                    yield other, shift
                place += 1


def _crossing(job: PlacedJob, other: PlacedJob, shift: int, *, is_own: bool) -> int:
    """Return by how much two spans that meet must move to be apart, or one in a gap of the other."""
    begin, end = other.start + shift, other.end + shift
    apart = min(job.end, end) - max(job.start, begin)
    if is_own:
        return apart
    inside = [_outside(gap, (begin, end)) for gap in _gaps(job, 0)]
    inside += [_outside(gap, (job.start, job.end)) for gap in _gaps(other, shift)]
    return min([apart, *inside])


def _gaps(job: PlacedJob, shift: int) -> Iterator[tuple[int, int]]:
    for (_, end), (start, _) in pairwise(job.occupations()):
        yield end + shift, start + shift


def _outside(gap: tuple[int, int], span: tuple[int, int]) -> int:
    return max(0, gap[0] - span[0]) + max(0, span[1] - gap[1])


# ---- binding, deadlines, arrivals


def _binding_cost(placement: Placement, active: ActiveTask) -> int:
    """Return one mean WCET for every job that is not where most jobs of its task are."""
    jobs = placement.by_task[active.name]
    if len(jobs) < 2:
        return 0
    sets = Counter(frozenset(job.units) for job in jobs)
    return (sets.total() - max(sets.values(), default=0)) * placement.mean_wcet


def _deadline_cost(placement: Placement, active: ActiveTask) -> int:
    """Return by how much the jobs of a periodic task end after their deadlines, at the phase that is best for them."""
    task, circle = active.task, placement.hyperperiod
    period = (task.period or ZERO) // placement.tick
    due = task.let if task.distance is not None else min(d for d in (task.deadline or task.period, task.let) if d)
    deadline = (due or ZERO) / placement.tick
    jobs = placement.by_task[active.name]
    offsets = sorted(((job.start - job.index * period) % circle, job.length) for job in jobs)
    if not offsets:
        return 0
    phase = latest_phase([offset for offset, _ in offsets], circle)
    if task.offset is not None:
        phase = task.offset % (task.period or ZERO) // placement.tick
    return sum(max(0, ceil((offset - phase) % circle + length - deadline)) for offset, length in offsets)


def _arrival_cost(placement: Placement, active: ActiveTask) -> int:
    """Return by how much an arrival just after a start may wait too long for the next job to start, and to end."""
    task, circle = active.task, placement.hyperperiod
    distance = task.distance or ZERO
    deadline = (task.deadline or distance) / placement.tick
    jobs = sorted(placement.by_task[active.name], key=lambda job: job.start)
    if not jobs:
        return 0
    cost = 0
    for before, job in zip([jobs[-1], *jobs], jobs, strict=False):
        since = job.start - before.start + (circle if job is jobs[0] else 0)
        cost += max(0, ceil(since - distance / placement.tick))
        cost += max(0, ceil(since + job.length - deadline))
    return cost
