"""Changes of a model that could make it schedulable: each returns the changed model."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from halpipe.core.durations import Duration
    from halpipe.models import Chain, Precedence, Task, TaskModel, Version


def more_units(model: TaskModel, like: str, count: int) -> TaskModel:
    """Add `count` units that every version may use which may use the unit `like`."""
    names = tuple(_fresh(model, f"{like}+{number}") for number in range(1, count + 1))
    original = next(unit for unit in model.units if unit.name == like)
    widened = _each_version(model, None, partial(_widened, like=like, names=names))
    return replace(widened, units=(*model.units, *(replace(original, name=name) for name in names)))


def _widened(version: Version, *, like: str, names: tuple[str, ...]) -> Version:
    return replace(version, units=(*version.units, *names)) if like in version.units else version


def _fresh(model: TaskModel, name: str) -> str:
    known = {unit.name for unit in model.units}
    while name in known:
        name += "+"
    return name


def with_slack(model: TaskModel, tasks: Collection[str], slack: Fraction) -> TaskModel:
    """Give periodic tasks at least this slack."""

    def loosen(task: Task) -> Task:
        return task if task.period is None else replace(task, slack=max(slack, task.slack))

    return _each_task(model, tasks, loosen)


def with_wcet(model: TaskModel, tasks: Collection[str], factor: Fraction) -> TaskModel:
    """Scale the WCETs of tasks, and their access phases and pieces with them."""

    def shorten(version: Version) -> Version:
        accesses = tuple(replace(a, start=a.start * factor, end=a.end * factor) for a in version.accesses)
        wcet = None if version.wcet is None else version.wcet * factor
        return replace(version, wcet=wcet, accesses=accesses, split=version.split.scaled(factor))

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


def with_wider_windows(model: TaskModel, task: str, predecessor: str, by: Duration) -> TaskModel:
    """Raise the maximum of the windows of `task` on `predecessor`."""

    def widen(row: Precedence) -> Precedence:
        return replace(row, max=row.max + by) if row.task == predecessor else row

    return _each_version(model, [task], lambda v: replace(v, precedences=tuple(map(widen, v.precedences))))


def with_earlier_windows(model: TaskModel, task: str, predecessor: str, by: Duration) -> TaskModel:
    """Lower the minimum of the windows of `task` on `predecessor`, to zero at most."""

    def widen(row: Precedence) -> Precedence:
        return replace(row, min=row.min - min(by, row.min)) if row.task == predecessor else row

    return _each_version(model, [task], lambda v: replace(v, precedences=tuple(map(widen, v.precedences))))


def with_more_gaps(model: TaskModel, task: str, more: int) -> TaskModel:
    """Allow the jobs of a task that are split so many gaps more."""

    def allow(version: Version) -> Version:
        gaps = version.split.max_gaps
        return version if gaps is None else replace(version, split=replace(version.split, max_gaps=gaps + more))

    return _each_version(model, [task], allow)


def without_offset(model: TaskModel, tasks: Collection[str]) -> TaskModel:
    """Let the phases of tasks be free."""
    return _each_task(model, tasks, lambda task: replace(task, offset=None))


def without_limits(model: TaskModel, chain: str) -> TaskModel:
    """Take the limits of a chain away; that of the latency stays in name, so that schedules state the figure."""

    def free(found: Chain) -> Chain:
        latency = None if found.max_latency is None else found.max_latency * 1000
        return replace(found, max_reaction=None, max_age=None, max_latency=latency)

    return replace(model, chains=tuple(free(c) if c.name == chain else c for c in model.chains))


def with_limits(
    model: TaskModel, chain: str, reaction: Duration | None, age: Duration | None, latency: Duration | None
) -> TaskModel:
    """Give a chain other limits."""

    def limit(found: Chain) -> Chain:
        return replace(found, max_reaction=reaction, max_age=age, max_latency=latency)

    return replace(model, chains=tuple(limit(c) if c.name == chain else c for c in model.chains))


def with_deadline(model: TaskModel, task: str, deadline: Duration) -> TaskModel:
    """Give a task another deadline."""
    return _each_task(model, [task], lambda found: replace(found, deadline=deadline))


def _each_task(model: TaskModel, tasks: Collection[str], change: Callable[[Task], Task]) -> TaskModel:
    return replace(model, tasks=tuple(change(task) if task.name in tasks else task for task in model.tasks))


def _each_version(model: TaskModel, tasks: Collection[str] | None, change: Callable[[Version], Version]) -> TaskModel:
    changed = (
        replace(task, versions=tuple(map(change, task.versions))) if tasks is None or task.name in tasks else task
        for task in model.tasks
    )
    return replace(model, tasks=tuple(changed))
