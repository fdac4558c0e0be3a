"""The model as it would be at another size: units, bandwidth, WCETs.

A version that cannot run at that size is taken out of every mode; it stays in its task, so that names remain known.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.pipeline.explain.changes import more_units
from halpipe.pipeline.validate.context import place
from halpipe.pipeline.whatif import codes

if TYPE_CHECKING:
    from collections.abc import Callable
    from fractions import Fraction

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Access, Split, Task, TaskModel, Version

    Rebuild = Callable[[Task, Version], "Version | Unusable"]


@record
class Unusable:
    """A version that cannot run at the size in question: why, and what keeps its place in the task."""

    reason: str
    instead: Version


@record
class Changed:
    """A changed model. `lost` names the tasks that no available version is left for: with any, nothing can work."""

    model: TaskModel
    lost: tuple[Diagnostic, ...] = ()


def with_units(model: TaskModel, type: str, count: int, *, alike: bool = False) -> Changed:
    """Leave or make `count` units of a type: the last are left out, further ones are copies of the first.

    With `alike`, all of them serve every version that may use any, and no interrupts: at least as much as any choice of
    `count` units.
    """
    own = [unit.name for unit in model.units if unit.type == type]
    if alike:
        model = _rebuilt(model, lambda _, v: _with_all(v, own)).model
        units = tuple(replace(unit, interrupts=()) if unit.type == type else unit for unit in model.units)
        model = replace(model, units=units)
    if count > len(own):
        return Changed(more_units(model, own[0], count - len(own)))
    gone = frozenset(own[count:])
    smaller = replace(model, units=tuple(unit for unit in model.units if unit.name not in gone))
    spare = tuple(unit.name for unit in smaller.units)[:1]

    def narrowed(_: Task, version: Version) -> Version | Unusable:
        left = tuple(name for name in version.units if name not in gone)
        if len(left) >= version.gang:
            return replace(version, units=left)
        reason = f"needs {version.gang} unit{'s' if version.gang > 1 else ''} and has {len(left)}"
        return Unusable(reason, replace(version, units=left or spare, gang=1))

    return _rebuilt(smaller, narrowed)


def _with_all(version: Version, names: list[str]) -> Version:
    if not set(names) & set(version.units):
        return version
    return replace(version, units=tuple(dict.fromkeys((*version.units, *names))))


def with_bandwidth(model: TaskModel, resource: str, share: Fraction) -> Changed:
    """Give a resource `share` of its bandwidth: every bound on it grows by 1 / share."""

    def grown(access: Access) -> Access:
        return replace(access, bound=access.bound / share) if access.resource == resource else access

    def rebuild(_: Task, version: Version) -> Version | Unusable:
        changed = replace(version, accesses=tuple(map(grown, version.accesses)))
        if peak_bound(changed, resource) > 1:
            return Unusable(f'claims more of "{resource}" than there is', version)
        return changed

    return _rebuilt(model, rebuild)


def peak_bound(version: Version, resource: str) -> Fraction | int:
    """Return the most that a job of the version claims of a resource at an instant."""
    own = [access for access in version.accesses if access.resource == resource]
    sums = (sum(other.bound for other in own if other.start <= access.start < other.end) for access in own)
    return max(sums, default=0)


def with_factor(model: TaskModel, factor: Fraction) -> Changed:
    """Scale every WCET, and the access phases and pieces with it."""

    def rebuild(task: Task, version: Version) -> Version | Unusable:
        scaled = tuple(replace(a, start=a.start * factor, end=a.end * factor) for a in version.accesses)
        return _if_in_time(task, version, scaled, version.split.scaled(factor), factor)

    return _rebuilt(model, rebuild)


def with_version_factor(model: TaskModel, task: str, version: str, factor: Fraction) -> Changed:
    """Scale the WCET of one version by a factor of at least 1; its access phases and split points stay."""

    def rebuild(owner: Task, own: Version) -> Version | Unusable:
        if (owner.name, own.name) != (task, version):
            return own
        return _if_in_time(owner, own, own.accesses, own.split, factor)

    return _rebuilt(model, rebuild)


def _if_in_time(
    task: Task, version: Version, accesses: tuple[Access, ...], split: Split, factor: Fraction
) -> Version | Unusable:
    wcet = (version.wcet or Duration(0)) * factor
    limit = time_limit(task)
    if limit is not None and wcet > limit:
        return Unusable(f"needs {wcet}, its deadline is {limit}", version)
    return replace(version, wcet=wcet, accesses=accesses, split=split)


def time_limit(task: Task) -> Duration | None:
    """Return the longest WCET that a deadline, or else the period, allows; None for a task on demand.

    Of a task that serves arrivals: what the deadline leaves when it is polled a period after the arrival.
    """
    if task.distance is not None and task.period is not None:
        return max(ZERO, (task.distance if task.deadline is None else task.deadline) - task.period)
    return task.deadline if task.period is not None and task.deadline is not None else task.period


def _rebuilt(model: TaskModel, rebuild: Rebuild) -> Changed:
    """Rebuild every version, and take those that are unusable out of the modes."""
    unusable: dict[tuple[str, str], str] = {}

    def kept(task: Task, version: Version) -> Version:
        made = rebuild(task, version)
        if isinstance(made, Unusable):
            unusable[task.name, version.name] = made.reason
            return made.instead
        return made

    tasks = tuple(replace(task, versions=tuple(kept(task, v) for v in task.versions)) for task in model.tasks)
    changed = replace(model, tasks=tasks)
    return _without(changed, unusable) if unusable else Changed(changed)


def _without(model: TaskModel, unusable: dict[tuple[str, str], str]) -> Changed:
    lost, modes = [], []
    for mode in model.modes:
        runs = []
        for run in mode.runs:
            left = tuple(name for name in run.versions if (run.task, name) not in unusable)
            runs.append(replace(run, versions=left))
            if not left:
                why = "; ".join(f'version "{name}" {unusable[run.task, name]}' for name in run.versions)
                path = about(mode=mode.name, task=run.task)
                lost.append(codes.LAST_VERSION(why, at=place(model.task(run.task)), path=path, help="see the others"))
        modes.append(replace(mode, runs=tuple(runs)))
    return Changed(replace(model, modes=tuple(modes)), tuple(lost))
