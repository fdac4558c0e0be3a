"""Mode of preemptive jobs in whole ticks: the demand of each task on the units, under each option."""

from __future__ import annotations

import itertools
import math
from dataclasses import field, replace
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.models import Anchor
from halpipe.pipeline.parts import Service, interrupt_load, pieces, reserved_length, service_of
from halpipe.pipeline.solve.edf.fixed import Fixed
from halpipe.pipeline.solve.lanes import quanta_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.core.durations import Duration
    from halpipe.models import Access, Precedence, Task, TaskModel, Unit, Version
    from halpipe.pipeline.jobs import ActiveTask, Expansion

MAX_UNIT_SETS = 256
"""Unit sets of one version that are tried."""

ANY_NUMBER = 10**9
"""Stands for no limit of gaps."""


@record
class Phase:
    """An access phase: `height` quanta of resource `resource` while [begin, end) is executed."""

    resource: int
    begin: int
    end: int
    height: int


@record
class Window:
    """A job may start between `least` and `most` after some start (or end) of a job of `task`.

    An aim stands for another rule, which the cost of a table decides: jobs that stay need not keep it.
    """

    task: int
    least: int
    most: int
    from_end: bool
    is_aim: bool = False


@record
class Way:
    """One version on one set of units. Times are ticks; `length` is L(wcet), what a job in one piece reserves.

    `ends` are the ends of the pieces, the WCET last. `bounds` are the same in exact time, 0 first.
    """

    version: Version
    units: tuple[int, ...]
    service: Service[int]
    wcet: int
    length: int
    ends: tuple[int, ...]
    bounds: tuple[Duration, ...]
    anywhere: bool
    resume: int
    max_gaps: int
    min_part: int
    phases: tuple[Phase, ...]
    windows: tuple[Window, ...]


@record
class Work:
    """A task of the mode: its jobs are released `phase` + j `period`, and late after `latest` and `deadline`.

    `phase` is None where it is free. Jobs may start `slip` after their release; of a task that polls, latest and
    deadline are what is certainly enough for its arrivals. For a task on demand, `demands` names for each job the task
    and job that demand it, and which of its demands that is; then period, latest and deadline mean nothing.
    """

    active: ActiveTask
    period: int
    jobs: int
    phase: int | None
    latest: int
    deadline: int
    demands: tuple[tuple[int, int, int], ...]
    ways: tuple[Way, ...]
    slip: int = 0
    arrivals: tuple[int, int] | None = None
    """Of a task that polls, how far starts may be apart, and by when after a start the next job must have ended."""

    @property
    def name(self) -> str:
        """The task's name."""
        return self.active.name

    @property
    def is_cyclic(self) -> bool:
        """Whether the task has a period."""
        return self.active.task.period is not None


@record
class Mode:
    """All works of a mode on one grid; `capacity` has the quanta of each resource, `fixed` are jobs that stay.

    Executions and resumptions last `growth` times as long as they must: what a job does not take of it is its margin.
    With `is_lenient`, deadlines are those of such jobs, and the cost of what they are shortened to decides.
    """

    expansion: Expansion
    tick: Duration
    hyperperiod: int
    units: tuple[str, ...]
    platform: tuple[Unit, ...]
    services: tuple[Service[Duration], ...]
    works: tuple[Work, ...]
    capacity: dict[str, int]
    growth: Fraction = Fraction(1)
    fixed: Fixed = field(default_factory=Fixed)
    is_lenient: bool = False


def works_of(model: TaskModel, expansion: Expansion, tick: Duration, growth: Fraction = Fraction(1)) -> Mode:
    """Return the mode in ticks. What `tick` does not divide is rounded to the safe side (MODEL 8.1)."""
    return _Builder(model, expansion, tick, growth).build()


def lenient(mode: Mode) -> Mode:
    """Return a mode with the deadlines that its longer jobs have if they run in one piece."""
    works = []
    for work in mode.works:
        plain = (reserved_length(-(-way.bounds[-1] // mode.tick), way.service) for way in work.ways)
        early = max((way.length - length for way, length in zip(work.ways, plain, strict=True)), default=0)
        arrivals = work.arrivals and (work.arrivals[0], work.arrivals[1] + early)
        works.append(replace(work, deadline=work.deadline + early, arrivals=arrivals))
    return replace(mode, works=tuple(works), is_lenient=True)


class _Builder:
    def __init__(self, model: TaskModel, expansion: Expansion, tick: Duration, growth: Fraction) -> None:
        self.model = model
        self.expansion = expansion
        self.tick = tick
        self.growth = growth
        self.units = {unit.name: unit for unit in model.units}
        self.unit_index = {name: number for number, name in enumerate(self.units)}
        self.resource_index = {resource.name: number for number, resource in enumerate(model.resources)}
        self.task_index = {active.name: number for number, active in enumerate(expansion.tasks)}
        self.capacity = quanta_of(expansion, (resource.name for resource in model.resources))

    def down(self, time: Duration) -> int:
        return time // self.tick

    def up(self, time: Duration) -> int:
        return -(-time // self.tick)

    def build(self) -> Mode:
        return Mode(
            expansion=self.expansion,
            tick=self.tick,
            hyperperiod=self.down(self.expansion.hyperperiod),
            units=tuple(self.units),
            platform=self.model.units,
            services=tuple(service_of(self.units, [name]) for name in self.units),
            works=tuple(map(self._work, self.expansion.tasks)),
            capacity=self.capacity,
            growth=self.growth,
        )

    def _work(self, active: ActiveTask) -> Work:
        task = active.task
        hyperperiod = self.expansion.hyperperiod
        period = task.period or hyperperiod
        latest, deadline = self.down(period * task.slack), self.down(task.deadline or period)
        if task.distance is not None:
            # From the start of a job to the end of the next, whatever the slips of both: enough, not necessary.
            deadline = self.down((task.deadline or task.distance) - period)
            latest = min(latest, self.down(task.distance - period))
        if task.let is not None:
            deadline = min(deadline, self.down(task.let))
        slip = min(self.down(period * task.slack), self.down(period) - 1)
        if self.expansion.is_released_at_start(active):
            latest = slip = 0
        return Work(
            active=active,
            period=self.down(period),
            jobs=active.jobs,
            phase=None if task.offset is None else self.down(task.offset % period),
            latest=min(latest, self.down(period) - 1),
            deadline=deadline,
            demands=tuple((self.task_index[d.task], d.index, d.slot) for d in active.demands),
            ways=tuple(way for version in active.versions for way in self._ways(version)),
            slip=slip,
            arrivals=self._arrivals(task),
        )

    def _arrivals(self, task: Task) -> tuple[int, int] | None:
        if task.distance is None:
            return None
        return self.down(task.distance), self.down(task.deadline or task.distance)

    def _ways(self, version: Version) -> Iterable[Way]:
        windows = tuple(self._windows(version))
        if any(window.task < 0 or window.most < window.least for window in windows):
            return
        names = tuple(dict.fromkeys(version.units))
        for chosen in itertools.islice(itertools.combinations(names, version.gang), MAX_UNIT_SETS):
            exact = service_of(self.units, chosen)
            service = tuple((self.down(distance), self.up(time)) for distance, time in exact)
            if any(distance <= 0 for distance, _ in service) or interrupt_load(service) >= 1:
                continue
            yield self._way(version, tuple(self.unit_index[name] for name in chosen), service, windows)

    def _way(self, version: Version, units: tuple[int, ...], service: Service[int], windows: tuple[Window, ...]) -> Way:
        split = version.split
        bounds = pieces(version)
        lengths = (self.up((end - start) * self.growth) for start, end in itertools.pairwise(bounds))
        ends = tuple(itertools.accumulate(lengths))
        growth = self.growth
        if split.anywhere and growth > 1:
            growth = self.tick * ends[-1] / bounds[-1]  # by which what was executed is shortened again
        return Way(
            version=version,
            units=units,
            service=service,
            wcet=ends[-1],
            length=reserved_length(ends[-1], service),
            ends=ends,
            bounds=bounds,
            anywhere=split.anywhere,
            resume=self.up(split.resume * growth),
            max_gaps=(ANY_NUMBER if split.max_gaps is None else split.max_gaps) if split.is_allowed else 0,
            min_part=self.up(max(split.min_part or ZERO, self.tick) * growth) + (growth > 1),
            phases=tuple(self._phases(version, bounds, ends, growth)),
            windows=windows,
        )

    def _phases(
        self, version: Version, bounds: Sequence[Duration], ends: Sequence[int], growth: Fraction
    ) -> Iterable[Phase]:
        """Yield the phases in grid time: inside a piece, they count from where the piece begins on the grid.

        Those that meet in execution times that grow still meet; what that rounds is seen by the cost of a table.
        """
        begun = self.down if growth == 1 else self.up
        for access in itertools.chain.from_iterable(self._within_pieces(a, bounds) for a in version.accesses):
            height = math.ceil(access.bound * self.capacity[access.resource])
            piece = next(n for n in range(len(ends)) if access.end <= bounds[n + 1])
            start = ends[piece - 1] if piece else 0
            begin = start + begun((access.start - bounds[piece]) * growth)
            end = start + self.up((access.end - bounds[piece]) * growth)
            yield Phase(self.resource_index[access.resource], begin, max(end, begin + 1), height)

    def _within_pieces(self, access: Access, bounds: Sequence[Duration]) -> Iterable[Access]:
        """Cut an access to a lock at the split points; what holds it in the gaps is seen by the cost of a table."""
        if access.resource not in self.expansion.locks:
            return (access,)
        cuts = [access.start, *(b for b in bounds if access.start < b < access.end), access.end]
        return (replace(access, start=begin, end=end) for begin, end in itertools.pairwise(cuts))

    def _windows(self, version: Version) -> Iterable[Window]:
        for row in version.precedences:
            task = self.task_index.get(row.task, -1)
            if row.anchor not in (Anchor.START, Anchor.END) or row.to is Anchor.END:
                yield self._aim(row, task, version)
                continue
            most = self.down(row.max)
            if row.anchor is Anchor.END:
                most -= self._early(task)
            yield Window(task, self.up(row.min), most, row.anchor is Anchor.END)

    def _aim(self, row: Precedence, task: int, version: Version) -> Window:
        """Return a window between starts or ends in which another one is likely to hold; the cost of a table decides.

        Any window at all where none is likely.
        """
        before = self.expansion.tasks[task].task
        late = self.up((before.period or ZERO) * before.slack) if row.anchor is Anchor.RELEASE else 0
        lag = self.up(row.point or ZERO) - (self.up(version.wcet or ZERO) if row.to is Anchor.END else 0)
        least, most = max(0, self.up(row.min) + lag), self.down(row.max) + lag - late
        if task < 0 or most < least:
            return Window(task, 0, self.down(self.expansion.hyperperiod), False, is_aim=True)
        return Window(task, least, most, row.anchor is Anchor.END, is_aim=True)

    def _early(self, task: int) -> int:
        """Return by how many ticks the jobs of a task may end before the end that the grid shows."""
        versions = self.expansion.tasks[task].versions if task >= 0 else ()
        is_rounded = any(time % self.tick for version in versions for time in (*pieces(version), version.split.resume))
        longest = max((pieces(version)[-1] + version.split.resume for version in versions), default=ZERO)
        return is_rounded + self.up(longest * (self.growth - 1))


def finer(tick: Duration) -> Duration:
    """Return an eighth of a tick, or the least fraction of it in whole nanoseconds, which targets count, if any is."""
    whole = (tick / parts for parts in (8, 4, 2, 1) if isinstance((tick / parts).ns, int))
    return next(whole, tick / 8)


def load_of(work: Work, way: Way, hyperperiod: int) -> Fraction:
    """Return the share of each of its units that a task takes under a way."""
    return Fraction(way.length * work.jobs, hyperperiod)
