"""Jobs that stay where an earlier schedule has them, on the circle of a mode; the others are placed around them.

Between their parts, what has begun in a gap must end in it, and what began before a job that stays must not go on in
its gaps (MODEL 8.2, nested). Their claims are access phases on the line of time.
"""

from __future__ import annotations

from dataclasses import field
from itertools import pairwise
from math import ceil
from typing import TYPE_CHECKING, NamedTuple

from halpipe.core.records import record
from halpipe.pipeline.jobs import start_in_time
from halpipe.pipeline.measure.placement import Placement
from halpipe.pipeline.measure.splitting import parts_cost
from halpipe.pipeline.parts import job_of, parts_of, phase_instants, renewed, service_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from halpipe.models import Job, Version
    from halpipe.pipeline.solve.edf.works import Mode, Way


class Claim(NamedTuple):
    """`height` quanta of `resource` on [begin, end)."""

    resource: int
    begin: int
    end: int
    height: int

    def moved(self, by: int) -> Claim:
        """Return the claim `by` ticks later."""
        return self._replace(begin=self.begin + by, end=self.end + by)


@record
class FixedJob:
    """A job that stays: on the grid its parts and claims are rounded outward, from the start of the hyperperiod."""

    task: int
    job: Job
    way: Way
    units: tuple[int, ...]
    spans: tuple[tuple[int, int], ...]
    claims: tuple[Claim, ...]

    @property
    def start(self) -> int:
        """The start of the job."""
        return self.spans[0][0]

    @property
    def end(self) -> int:
        """The end of the job."""
        return self.spans[-1][1]


class Walls:
    """The jobs that stay on one unit, repeated for ever with a period of `cycle`."""

    def __init__(self, jobs: Iterable[FixedJob], cycle: int) -> None:
        busy: list[tuple[int, int]] = []
        gaps: list[tuple[int, int]] = []
        for each in jobs:
            for turn in range(-(each.end // cycle) - 1, 2):
                shift = turn * cycle
                busy += ((begin + shift, end + shift) for begin, end in each.spans)
                gaps += ((end + shift, begin + shift) for (_, end), (begin, _) in pairwise(each.spans))
        self.begins = sorted(begin for begin, _ in busy)
        points = {0, *(t for pair in (*busy, *gaps) for t in pair if 0 < t < cycle)}
        self._points = sorted(points)
        self._places = list(_places(self._points, sorted(busy), sorted(gaps)))

    def rows(self) -> list[tuple[int, bool, bool, int, int]]:
        """Return for each point whether the unit is occupied from there on, whether in a gap, and the innermost one."""
        places = zip(self._points, self._places, strict=True)
        return [(point, is_busy, gap is not None, *(gap or (0, 0))) for point, (is_busy, gap) in places]


def _places(
    points: Sequence[int], busy: Sequence[tuple[int, int]], gaps: Sequence[tuple[int, int]]
) -> Iterator[tuple[bool, tuple[int, int] | None]]:
    """Yield for what begins at each point whether it is occupied, and the innermost gap around it."""
    open_busy: list[tuple[int, int]] = []
    open_gaps: list[tuple[int, int]] = []
    waiting_busy, waiting_gaps = list(reversed(busy)), list(reversed(gaps))
    for point in points:
        while waiting_busy and waiting_busy[-1][0] <= point:
            open_busy.append(waiting_busy.pop())
        while waiting_gaps and waiting_gaps[-1][0] <= point:
            open_gaps.append(waiting_gaps.pop())
        open_busy = [each for each in open_busy if each[1] > point]
        open_gaps = [each for each in open_gaps if each[1] > point]
        yield bool(open_busy), max(open_gaps, default=None)


@record
class Fixed:
    """All jobs that stay, the tasks that they are of, and what they make of each unit of theirs."""

    jobs: tuple[FixedJob, ...] = ()
    tasks: frozenset[int] = frozenset()
    walls: Mapping[int, Walls] = field(default_factory=dict)

    @classmethod
    def of(cls, jobs: Sequence[FixedJob], cycle: int) -> Fixed:
        """Return what `jobs` make together of a circle of `cycle` ticks."""
        units = sorted({unit for each in jobs for unit in each.units})
        walls = {unit: Walls([each for each in jobs if unit in each.units], cycle) for unit in units}
        return cls(tuple(jobs), frozenset(each.task for each in jobs), walls)


def window_excess(
    jobs: Iterable[FixedJob], instants: Mapping[int, Sequence[tuple[int, int]]], cycle: int
) -> dict[int, int]:
    """Return by how much windows of jobs that stay are missed, for the task that comes too early or too late.

    `instants` are start and end of every job of a task.
    """
    excess: dict[int, int] = {}
    for each in jobs:
        for window in (window for window in each.way.windows if not window.is_aim):
            distances = [
                _beyond(each.start - (end if window.from_end else start), window.least, window.most, cycle)
                for start, end in instants.get(window.task, ())
            ]
            missed = min(distances, default=cycle)
            excess[window.task] = excess.get(window.task, 0) + missed
    return excess


def _beyond(distance: int, least: int, most: int, cycle: int) -> int:
    """Return by how much a distance on the circle misses [least, most], at best."""
    shortest = distance % cycle
    shortest += max(0, -((shortest - least) // cycle)) * cycle
    return max(0, shortest - most)


def fix(mode: Mode, shipped: Mapping[tuple[str, int], Job]) -> tuple[Fixed, tuple[str, ...]]:
    """Return the jobs of `shipped` that stay, and the names of tasks that cannot.

    A task stays with all its jobs, each with a version, units and parts that the model still allows.
    """
    fixed: list[FixedJob] = []
    changed = []
    for number, work in enumerate(mode.works):
        jobs = [shipped[work.name, index] for index in range(work.active.jobs) if (work.name, index) in shipped]
        stays = [found for job in jobs if (found := _fixed(mode, number, job)) is not None]
        own = [each.job for each in stays]
        if jobs and len(stays) == work.active.jobs and start_in_time(mode.expansion, work.active, own):
            fixed += stays
        elif jobs:
            changed.append(work.name)
    return Fixed.of(fixed, mode.hyperperiod), tuple(changed)


def _fixed(mode: Mode, task: int, job: Job) -> FixedJob | None:
    """Return a job on the grid; None if it can no longer be as it is."""
    names = [mode.units[unit] for way in mode.works[task].ways for unit in way.units]
    ways = [way for way in mode.works[task].ways if way.version.name == job.version]
    used = {mode.units.index(name) for name in job.units if name in mode.units}
    way = next((way for way in ways if {*way.units} == used), ways[0] if ways else None)
    if way is None or not {*job.units} <= {*names}:
        return None
    version = way.version
    service = service_of({unit.name: unit for unit in mode.platform}, job.units)
    whole = renewed(job, version, service)
    job = job if job.parts or whole is None else whole  # in one piece, it has the length that its version has now
    if whole is None or not _is_allowed(mode, version, job):
        return None
    claims, resources = [], list(mode.capacity)
    for access in version.accesses:
        is_lock, height = access.resource in mode.expansion.locks, ceil(access.bound * mode.capacity[access.resource])
        try:
            begin, end = phase_instants(access, parts_of(job, version), version.split.resume, service, is_lock=is_lock)
        except ValueError:  # a gap inside
            return None
        claims.append(Claim(resources.index(access.resource), begin // mode.tick, -(-end // mode.tick), height))
    spans = tuple((begin // mode.tick, -(-end // mode.tick)) for begin, end in job.occupations())
    return FixedJob(task, job, way, tuple(mode.units.index(name) for name in job.units), spans, tuple(claims))


def _is_allowed(mode: Mode, version: Version, job: Job) -> bool:
    """Return whether the version allows the units of a job, its parts, and its length."""
    units = {unit.name: unit for unit in mode.platform}
    is_in_cycle = 0 <= job.start // mode.tick < mode.hyperperiod
    if not is_in_cycle or len({*job.units}) != version.gang or not {*job.units} <= {*version.units}:
        return False
    service = service_of(units, job.units)
    parts = parts_of(job, version)
    spans = [(part.start, part.executed_from, part.executed_to) for part in parts]
    if job_of(job.task, job.index, version, job.units, spans, service) != job:
        return False
    if not job.parts:
        return True
    placement = Placement.of(mode.expansion, [job], mode.platform)
    return not parts_cost(placement, placement.jobs[0])
