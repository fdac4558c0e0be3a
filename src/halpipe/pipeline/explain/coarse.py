"""A mode on a coarser grid: so that it only gets easier, for proofs, or so that it only gets harder, for schedules.

Easier: let all starts of a valid schedule be rounded down to the grid, which divides the periods. Jobs that did not
overlap then do not if WCETs are rounded down and access phases inward; a difference of two starts becomes one of the
two multiples around it, so that windows are rounded outward (by one more where they count from an end that is rounded),
and delays, deadlines and limits upward. So if the rounded mode has no schedule, neither has the mode. The limit of a
chain is kept where all versions of a task take equally long: else another job might be the newest on the grid.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration, greatest_common_divisor
from halpipe.models import Anchor

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.models import Access, Chain, Job, Precedence, Task, TaskModel, Version
    from halpipe.pipeline.jobs import Expansion

TICKS = 2**24
"""Ticks of a hyperperiod on the coarser grid, at most."""


def coarser_grid(expansion: Expansion) -> Duration | None:
    """Return the finest grid that is coarse enough; None where it would swallow a job."""
    common = greatest_common_divisor(a.task.period for a in expansion.tasks if a.task.period is not None)
    if not common:
        return None
    grid = common
    while expansion.hyperperiod // (grid / 10) <= TICKS:
        grid = grid / 10
    wcets = [version.wcet for active in expansion.tasks for version in active.versions if version.wcet is not None]
    return grid if wcets and grid <= min(wcets) else None


def easier(model: TaskModel, grid: Duration) -> TaskModel:
    """Round a model so that whatever has a schedule keeps one."""
    rounded = _Rounded(model, grid, lambda time: grid * (time // grid), lambda time: grid * -(-time // grid))
    chains = tuple(rounded.chain(chain) for chain in model.chains if _keeps_order(model, chain, grid))
    return replace(model, tasks=tuple(map(rounded.task, model.tasks)), chains=chains)


def harder(model: TaskModel, grid: Duration) -> TaskModel | None:
    """Round a model so that starts of a schedule for it are those of one for the model; None if offsets forbid it."""
    if any(task.offset is not None and task.offset % grid for task in model.tasks):
        return None
    rounded = _Rounded(model, grid, lambda time: grid * -(-time // grid), lambda time: grid * (time // grid))
    chains = tuple(map(rounded.chain, model.chains))
    return replace(model, tasks=tuple(map(rounded.task, model.tasks)), chains=chains)


def as_stated(model: TaskModel, jobs: tuple[Job, ...]) -> tuple[Job, ...]:
    """Give the jobs of a rounded model the WCETs of the model itself."""
    wcets = {(task.name, version.name): version.wcet or ZERO for task in model.tasks for version in task.versions}
    return tuple(replace(job, end=job.start + wcets[job.task, job.version]) for job in jobs)


class _Rounded:
    """Rounds what takes time to `shorter` or longer times, and what allows time to `wider` or narrower ones."""

    def __init__(
        self,
        model: TaskModel,
        grid: Duration,
        shorter: Callable[[Duration], Duration],
        wider: Callable[[Duration], Duration],
    ) -> None:
        self.grid, self.shorter, self.wider = grid, shorter, wider
        self.is_easier = wider(grid / 2) > grid / 2
        self.uneven = {t.name for t in model.tasks if any(v.wcet is not None and v.wcet % grid for v in t.versions)}

    def task(self, task: Task) -> Task:
        """Round a task."""
        slack, offset = task.slack, task.offset
        if task.period is not None:
            slack = min(self.wider(task.period * task.slack), task.period) / task.period
        if offset is not None:
            offset = self.grid * (offset // self.grid)
        deadline = None if task.deadline is None else self.wider(task.deadline)
        versions = tuple(map(self.version, task.versions))
        return replace(task, slack=slack, offset=offset, deadline=deadline, versions=versions)

    def version(self, version: Version) -> Version:
        """Round a version; an access phase of which nothing is left goes."""
        rows = tuple(map(self.window, version.precedences))
        accesses = tuple(a for a in map(self.access, version.accesses) if a.start < a.end)
        wcet = None if version.wcet is None else self.shorter(version.wcet)
        return replace(version, wcet=wcet, accesses=accesses, precedences=rows)

    def access(self, access: Access) -> Access:
        """Round an access phase: inward where it is to be shorter."""
        return replace(access, start=self.wider(access.start), end=self.shorter(access.end))

    def window(self, row: Precedence) -> Precedence:
        """Round a window: outward where it is to be wider."""
        low, high = self.shorter(row.min), self.wider(row.max)
        if row.anchor is Anchor.END and row.task in self.uneven:
            high = high + self.grid if self.is_easier else high - self.grid
        return replace(row, min=low, max=high)

    def chain(self, chain: Chain) -> Chain:
        """Round the limits of a chain."""
        reaction, age = (None if time is None else self.wider(time) for time in (chain.max_reaction, chain.max_age))
        return replace(chain, max_reaction=reaction, max_age=age)


def _keeps_order(model: TaskModel, chain: Chain, grid: Duration) -> bool:
    """Tell whether the jobs that data go through on the grid are no worse than those they go through really."""
    tasks = [model.task(name) for name in chain.tasks]
    first = tasks[0]
    apart = first.period is not None and first.period - first.period * first.slack >= grid
    return apart and all(len({version.wcet for version in task.versions}) == 1 for task in tasks)
