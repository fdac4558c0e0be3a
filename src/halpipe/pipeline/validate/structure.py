"""Checks that nothing is missing, and of what is there but never used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import Check, place, task_path, version_path

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.pipeline.validate.context import Context


def check_model(context: Context) -> Iterator[Diagnostic]:
    """The model has units, tasks and modes; every task has versions, every version has units."""
    model = context.model
    path, at = about(model=model.name), place(model)
    if not model.units:
        yield codes.NO_UNITS("has no unit", at=at, path=path, help="declare the units in the model or the overlay")
    if not model.tasks:
        yield codes.NO_TASKS("has no task", at=at, path=path, help="declare at least one task")
    if not model.modes:
        yield codes.NO_MODES("has no mode", at=at, path=path, help="declare a mode that lists the tasks that run in it")
    for task in model.tasks:
        if not task.versions:
            help = "give the task at least one version, in the model or the overlay"
            yield codes.NO_VERSIONS("has no version", at=place(task), path=task_path(task), help=help)
        for version in task.versions:
            if not version.units:
                help = "name the units it may run on, in the model or the overlay"
                at, path = place(version, task), version_path(task, version)
                yield codes.VERSION_WITHOUT_UNITS("names no unit", at=at, path=path, help=help)


def check_modes(context: Context) -> Iterator[Diagnostic]:
    """Every mode runs something periodic, and every task it lists runs in some version."""
    for mode in context.model.modes:
        path = about(mode=mode.name)
        if not mode.runs:
            help = "list the tasks that run in it, or remove the mode"
            yield codes.EMPTY_MODE("selects nothing: no task runs in it", at=place(mode), path=path, help=help)
        for run in mode.runs:
            if not run.versions:
                help = "list the available versions, or remove the task from the mode"
                at = place(run, mode)
                text = "none of its versions is available"
                yield codes.RUN_SELECTS_NOTHING(text, at=at, path=about(path, task=run.task), help=help)
    for active in context.active:
        if active.tasks and all(task.task.period is None for task in active.tasks.values()):
            text = "no task that runs in it has a period, so nothing demands the others and there is no hyperperiod"
            help = "give a period to at least one of its tasks"
            yield codes.NOTHING_PERIODIC(text, at=place(active.mode), path=active.path, help=help)


def check_unused(context: Context) -> Iterator[Diagnostic]:
    """Note units, resources, tasks and versions that no schedule will ever contain."""
    units = {name for _, version in context.versions_of_tasks for name in version.units}
    for unit in context.units.values():
        if unit.name not in units:
            text, help = "no version may run on it", "remove it, or add it to the units of a version"
            yield codes.UNUSED_UNIT(text, at=place(unit), path=about(unit=unit.name), help=help)
    resources = {access.resource for _, _, access in context.accesses_of_versions}
    for resource in context.resources.values():
        if resource.name not in resources:
            text, help = "no version accesses it", "remove it, or add the missing access phases"
            yield codes.UNUSED_RESOURCE(text, at=place(resource), path=about(resource=resource.name), help=help)
    if context.model.modes:
        yield from _never_run(context)


def _never_run(context: Context) -> Iterator[Diagnostic]:
    available: dict[str, set[str]] = {}
    for mode in context.model.modes:
        for run in mode.runs:
            available.setdefault(run.task, set()).update(run.versions)
    for task in context.tasks.values():
        if task.name not in available:
            help = "list it in a mode, or remove it"
            yield codes.TASK_NEVER_RUNS("runs in no mode", at=place(task), path=task_path(task), help=help)
            continue
        for version in context.versions[task.name].values():
            if version.name not in available[task.name]:
                at, path = place(version, task), version_path(task, version)
                help = "list it in a mode, or remove it"
                yield codes.VERSION_NEVER_RUNS("is available in no mode", at=at, path=path, help=help)


CHECKS = (
    Check(
        "complete-model",
        "The model has units, tasks and modes; every task has a version, and every version a unit.",
        (codes.NO_UNITS, codes.NO_TASKS, codes.NO_MODES, codes.NO_VERSIONS, codes.VERSION_WITHOUT_UNITS),
        check_model,
    ),
    Check(
        "complete-modes",
        "In every mode a task with a period runs, and every task listed has an available version.",
        (codes.EMPTY_MODE, codes.RUN_SELECTS_NOTHING, codes.NOTHING_PERIODIC),
        check_modes,
    ),
    Check(
        "unused",
        "Every unit and resource is used, and every task and version is available in some mode.",
        (codes.UNUSED_UNIT, codes.UNUSED_RESOURCE, codes.TASK_NEVER_RUNS, codes.VERSION_NEVER_RUNS),
        check_unused,
    ),
)
