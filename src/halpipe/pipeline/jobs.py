"""From a mode to its jobs: hyperperiod t_P, job counts N and the demands of tasks without a period.

Paper, section III: a periodic task has t_P / D jobs; a task without period has one job per demand, that is per
precedence constraint by which a job of another task names it, counted over the version that names it most.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from graphlib import TopologicalSorter
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration, greatest_common_divisor, least_common_multiple
from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.models import Anchor, Binding, Interrupt, Match, Mode, Precedence, ResourceKind, Task, TaskModel, Version
from halpipe.pipeline.parts import latest_phase

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from halpipe.models import Job


@record
class Demand:
    """The reason for a job of an on-demand task: constraint `slot` of job `index` of `task`."""

    task: str
    index: int
    slot: int


MOST_SETS = 1000
"""Sets of common units that are carried from mode to mode; beyond it a contradiction may be missed."""


def common_sets(modes: Iterable[Iterable[Version]], gang: int) -> set[frozenset[str]]:
    """Return sets of units any `gang` of which some version of that gang may use in each of the modes."""
    common: set[frozenset[str]] | None = None
    for versions in modes:
        here = {frozenset(version.units) for version in versions if version.gang == gang}
        both = here if common is None else {one & other for one in common for other in here}
        common = {units for units in both if len(units) >= gang}
        if len(common) > MOST_SETS:
            break
    return common or set()


@record
class ActiveTask:
    """A task of a mode with the versions available there and its number of jobs N (paper, section III)."""

    task: Task
    versions: tuple[Version, ...]
    jobs: int
    demands: tuple[Demand, ...] = ()

    @property
    def name(self) -> str:
        """The task's name."""
        return self.task.name

    def with_windows(self, keeps: Callable[[Precedence], bool]) -> ActiveTask:
        """Return the task with those of its precedence constraints that are to be kept."""
        versions = (replace(v, precedences=tuple(filter(keeps, v.precedences))) for v in self.versions)
        return replace(self, versions=tuple(versions))


@dataclass(frozen=True)
class Expansion:
    """A mode unrolled over its hyperperiod: `tasks` in model order, `interrupts` of all units, `locks` by name.

    The releases of the tasks named in `released` count.
    """

    mode: Mode
    hyperperiod: Duration
    tasks: tuple[ActiveTask, ...]
    interrupts: tuple[Interrupt, ...] = ()
    locks: frozenset[str] = frozenset()
    released: frozenset[str] = frozenset()

    @cached_property
    def by_name(self) -> dict[str, ActiveTask]:
        """The active tasks by name."""
        return {active.name: active for active in self.tasks}

    @cached_property
    def in_first(self) -> frozenset[str]:
        """The tasks whose phase lies in their first period: those that a LET or a constraint on the cycle names."""
        named = {active.name for active in self.tasks if active.task.let is not None}
        for active in self.tasks:
            rows = (row for version in active.versions for row in version.precedences)
            before = [row.task for row in rows if row.match is Match.CYCLE]
            named.update((active.name, *before) if before else ())
        return frozenset(named)

    def is_released_at_start(self, active: ActiveTask) -> bool:
        """Return whether the release of a task counts and no offset fixes it.

        The search then lets all its jobs start at their releases, which gives up its slack: otherwise a move of one job
        would move the releases of all.
        """
        return active.name in self.released and active.task.period is not None and active.task.offset is None

    @cached_property  # needed for each task, each time the same
    def job_count(self) -> int:
        """The sum of N over all tasks."""
        return sum(active.jobs for active in self.tasks)

    @cached_property
    def mean_wcet(self) -> Duration:
        """The mean WCET of all jobs in their first versions; zero without any."""
        work = sum(((active.versions[0].wcet or ZERO) * active.jobs for active in self.tasks), start=ZERO)
        return work / max(1, self.job_count)


def demands_of(version: Version) -> Counter[str]:
    """Return, for every task that a version names, how many of its constraints do."""
    return Counter(constraint.task for constraint in version.precedences)


def demand_ranges(versions: Sequence[Version]) -> dict[str, tuple[int, int]]:
    """Return, for every task that versions name, how many constraints of one version do at least and at most."""
    found = grouped(demand for version in versions for demand in demands_of(version).items())
    return {name: (min(n) if len(n) == len(versions) else 0, max(n)) for name, n in found.items()}


def expand(model: TaskModel, mode: Mode) -> Expansion:
    """Unroll `mode` over its hyperperiod. The model must have passed validation."""
    running = _running(model, mode)
    periods = [task.period for task, _ in running.values() if task.period is not None]
    hyperperiod = least_common_multiple(periods)
    demanders = _demanders(running)
    active = {
        name: ActiveTask(task, versions, hyperperiod // task.period)
        for name, (task, versions) in running.items()
        if task.period is not None
    }
    asked = {name: [other for other, _ in demanders[name]] for name in running if name not in active}
    for name in TopologicalSorter(asked).static_order():
        if name not in active:
            demands = tuple(
                Demand(other, index, slot)
                for other, slots in demanders[name]
                for index in range(active[other].jobs)
                for slot in range(slots)
            )
            active[name] = ActiveTask(*running[name], len(demands), demands)
    interrupts = tuple(interrupt for unit in model.units for interrupt in unit.interrupts)
    locks = frozenset(resource.name for resource in model.resources if resource.kind is ResourceKind.LOCK)
    tasks = tuple(active[name] for name in running)
    return Expansion(mode, hyperperiod, tasks, interrupts, locks, released(model))


def released(model: TaskModel) -> frozenset[str]:
    """Return the tasks whose releases count: those with a LET, or from whose release a window or a chain counts."""
    found = {task.name for task in model.tasks if task.let is not None}
    rows = (row for task in model.tasks for version in task.versions for row in version.precedences)
    found |= {row.task for row in rows if row.anchor is Anchor.RELEASE}
    return frozenset(found | {chain.tasks[0] for chain in model.chains if chain.anchor is Anchor.RELEASE})


def _running(model: TaskModel, mode: Mode) -> dict[str, tuple[Task, tuple[Version, ...]]]:
    """Return the tasks of `mode` with their available versions, in model order."""
    available = {run.task: frozenset(run.versions) for run in mode.runs}
    return {
        task.name: (task, tuple(v for v in task.versions if v.name in available[task.name]))
        for task in model.tasks
        if task.name in available
    }


def _demanders(running: dict[str, tuple[Task, tuple[Version, ...]]]) -> dict[str, list[tuple[str, int]]]:
    """Return for every task who names it and, over the versions, at most how often; in model order."""
    demanders: dict[str, list[tuple[str, int]]] = {name: [] for name in running}
    asking = ((name, versions) for name, (_, versions) in running.items() if any(v.precedences for v in versions))
    for name, versions in asking:
        for target, (_, most) in demand_ranges(versions).items():
            if target in demanders:
                demanders[target].append((name, most))
    return demanders


def natural_tick(expansion: Expansion) -> Duration:
    """Return the largest duration that divides every duration of the mode (MODEL 1)."""
    return greatest_common_divisor(durations(expansion))


def durations(expansion: Expansion) -> Iterator[Duration]:
    """Yield every duration of the mode that decides when something may start or end; many times the same."""
    for interrupt in expansion.interrupts:
        yield from (interrupt.distance, interrupt.wcet)
    for active in expansion.tasks:
        task = active.task
        yield from (d for d in (task.period, task.offset, task.let) if d)
        for version in active.versions:
            if version.wcet:
                yield version.wcet
            split = version.split
            yield from (d for d in (*split.points, split.resume, split.min_part) if d)
            for access in version.accesses:
                yield from (access.start, access.end)
            for row in version.precedences:
                yield from (row.min, row.max) if row.point is None else (row.min, row.max, row.point)


def start_in_time(expansion: Expansion, active: ActiveTask, jobs: Sequence[Job]) -> bool:
    """Return whether binding, slack and deadline allow all jobs of a task, from some release on (MODEL 3).

    The jobs, in their order, have the lengths of the model. A task that polls answers an arrival just after a start.
    """
    task, cycle = active.task, expansion.hyperperiod
    if task.binding is not Binding.JOB and len({frozenset(job.units) for job in jobs}) > 1:
        return False
    if task.period is None:
        return True
    phases = [(job.start - task.period * job.index) % cycle for job in jobs]
    release = latest_phase(sorted(set(phases)), cycle) if task.offset is None else task.offset % task.period
    slack, deadline = task.period * task.slack, task.let or task.deadline or task.period
    is_beyond = active.name in expansion.in_first and release >= task.period
    if is_beyond and task.let is not None:
        return False
    for job, phase in zip(jobs, phases, strict=True):
        late, length = (phase - release) % cycle, job.end - job.start
        room = slack if task.distance is not None else min(slack, deadline - length)
        if late > room or (is_beyond and late + release - task.period >= room):
            return False
    return task.distance is None or _serve_in_time(jobs, cycle, task.distance, task.deadline or task.distance)


def _serve_in_time(jobs: Sequence[Job], cycle: Duration, distance: Duration, deadline: Duration) -> bool:
    """Return whether each job starts within the distance of arrivals and ends within the deadline after a start."""
    for before, job in pairwise((*jobs[-1:], *jobs)):
        late = (job.start - before.start) % cycle or cycle
        if late > distance or late + job.end - job.start > deadline:
            return False
    return True
