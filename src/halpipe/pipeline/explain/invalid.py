"""Findings of validate that prove that a mode has no schedule."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import by_name
from halpipe.pipeline.validate.sporadic import least_length

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.core.durations import Duration
    from halpipe.models import Run, Task, TaskModel, Unit, Version

ABOUT_A_MODE = {
    codes.PREDECESSOR_ABSENT.id,
    codes.CHAIN_LIMIT_TOO_LOW.id,
    codes.UNITS_OVERLOADED.id,
    codes.RESOURCE_OVERLOADED.id,
    codes.WCET_BEYOND_HYPERPERIOD.id,
}
"""Errors that leave a mode without a schedule."""

ABOUT_A_VERSION = {
    codes.WCET_BEYOND_DEADLINE.id,
    codes.BAD_GANG.id,
    codes.EMPTY_WINDOW.id,
    codes.PHASES_OVERLOAD.id,
    codes.ARRIVAL_TOO_LATE.id,
}
"""Errors that make a version unusable; they prove something where a task has no other one in some mode."""


def proves_infeasible(model: TaskModel, errors: Sequence[Diagnostic]) -> bool:
    """Tell whether the model, being complete otherwise, has a mode that certainly has no schedule.

    A model with an error of another kind means nothing yet, so nothing is proven of it.
    """
    found = {d.code for d in errors}
    if not found <= ABOUT_A_MODE | ABOUT_A_VERSION:
        return False
    return bool(found & ABOUT_A_MODE) or any(_has_no_version(model, run.task, run.versions) for run in _runs(model))


def _runs(model: TaskModel) -> Iterable[Run]:
    return (run for mode in model.modes for run in mode.runs)


def _has_no_version(model: TaskModel, name: str, available: Sequence[str]) -> bool:
    task = model.task(name)
    units = by_name(model.units)
    return all(_is_dead(units, task, version) for version in task.versions if version.name in available)


def _is_dead(units: Mapping[str, Unit], task: Task, version: Version) -> bool:
    """Tell whether no job can run in this version, whatever else there is."""
    return (
        _is_too_long(task, least_length(units, version) or ZERO)
        or version.gang > len(set(version.units))
        or any(row.min > row.max for row in version.precedences)
        or _overloads_itself(version)
    )


def _is_too_long(task: Task, length: Duration) -> bool:
    """Tell whether a job takes longer than its deadline allows, which may count from the start of the job before."""
    if task.period is None:
        return False
    if task.let is not None and length > task.let:
        return True
    if task.distance is not None:
        return task.period + length > (task.distance if task.deadline is None else task.deadline)
    return length > (task.period if task.deadline is None else task.deadline)


def _overloads_itself(version: Version) -> bool:
    return any(
        sum(a.bound for a in version.accesses if a.resource == b.resource and a.start <= b.start < a.end) > 1
        for b in version.accesses
    )


def tasks_of(model: TaskModel, findings: Iterable[Diagnostic]) -> tuple[str, ...]:
    """Return the tasks that findings of verify are about, in the order of the model."""
    named = {subject.name for d in findings for subject in d.subjects if subject.kind == "task"}
    return tuple(task.name for task in model.tasks if task.name in named)
