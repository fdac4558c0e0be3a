"""Changes of a model that could make it schedulable: each function returns the changed model."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from halpipe.core.durations import Duration
    from halpipe.models import Precedence, Task, TaskModel, Version


def more_units(model: TaskModel, like: str, count: int) -> TaskModel:
    """Add `count` units that every version may use which may use the unit `like`."""
    taken = {unit.name for unit in model.units}
    names: list[str] = []
    for number in range(1, count + 1):
        name = f"{like}+{number}"
        while name in taken:
            name += "+"
        names.append(name)

    def widen(version: Version) -> Version:
        return replace(version, units=(*version.units, *names)) if like in version.units else version

    original = next(unit for unit in model.units if unit.name == like)
    widened = _each_version(model, None, widen)
    return replace(widened, units=(*model.units, *(replace(original, name=name) for name in names)))


def with_slack(model: TaskModel, tasks: Collection[str], slack: Fraction) -> TaskModel:
    """Give periodic tasks at least this slack."""

    def loosen(task: Task) -> Task:
        return task if task.period is None else replace(task, slack=max(slack, task.slack))

    return _each_task(model, tasks, loosen)


def with_wcet(model: TaskModel, tasks: Collection[str], factor: Fraction, grid: Duration | None = None) -> TaskModel:
    """Scale the WCETs of tasks, and their access phases and pieces with them; down to multiples of a grid, if given."""

    def shorten(version: Version) -> Version:
        wcet = version.wcet
        if wcet is None:
            return version
        shorter = wcet * factor
        if grid is not None and shorter > grid:
            shorter = grid * (shorter // grid)
        own = Fraction(shorter.ns) / wcet.ns if wcet else factor
        accesses = tuple(replace(a, start=a.start * own, end=a.end * own) for a in version.accesses)
        return replace(version, wcet=shorter, accesses=accesses, split=version.split.scaled(own))

    return _each_version(model, tasks, shorten)


def with_pieces(model: TaskModel, tasks: Collection[str], count: int) -> TaskModel:
    """Split tasks into `count` pieces, as equal as their access phases allow, beside the split points they have."""

    def cut(version: Version) -> Version:
        if version.split.anywhere or version.wcet is None:
            return version
        points = (version.wcet * Fraction(number, count) for number in range(1, count))
        free = {p for p in points if not any(a.start < p < a.end for a in version.accesses)}
        split = replace(version.split, points=tuple(sorted({*version.split.points, *free})), max_gaps=None)
        return replace(version, split=split)

    return _each_version(model, tasks, cut)


def with_window(model: TaskModel, task: str, predecessor: str, change: Callable[[Precedence], Precedence]) -> TaskModel:
    """Change the windows of `task` on `predecessor`."""

    def changed(version: Version) -> Version:
        rows = (change(row) if row.task == predecessor else row for row in version.precedences)
        return replace(version, precedences=tuple(rows))

    return _each_version(model, [task], changed)


def with_more_gaps(model: TaskModel, task: str, more: int) -> TaskModel:
    """Allow the jobs of a preemptive task so many preemptions more."""

    def allow(version: Version) -> Version:
        gaps = version.split.max_gaps
        return version if gaps is None else replace(version, split=replace(version.split, max_gaps=gaps + more))

    return _each_version(model, [task], allow)


def with_limits(model: TaskModel, chain: str, limits: dict[str, Duration]) -> TaskModel:
    """Give a chain other limits, by the names of their fields."""
    values: dict[str, Any] = dict(limits)
    return replace(model, chains=tuple(replace(c, **values) if c.name == chain else c for c in model.chains))


def with_task(model: TaskModel, tasks: Collection[str], **fields: Duration | None) -> TaskModel:
    """Give tasks another offset or deadline; an offset of None leaves their phases to the schedule."""
    values: dict[str, Any] = dict(fields)
    return _each_task(model, tasks, lambda task: replace(task, **values))


def _each_task(model: TaskModel, tasks: Collection[str], change: Callable[[Task], Task]) -> TaskModel:
    return replace(model, tasks=tuple(change(task) if task.name in tasks else task for task in model.tasks))


def _each_version(model: TaskModel, tasks: Collection[str] | None, change: Callable[[Version], Version]) -> TaskModel:
    changed = (
        replace(task, versions=tuple(map(change, task.versions))) if tasks is None or task.name in tasks else task
        for task in model.tasks
    )
    return replace(model, tasks=tuple(changed))
