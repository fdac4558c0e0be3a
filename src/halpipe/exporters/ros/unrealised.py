"""Sentences about what executors and timers on Linux cannot do of a schedule, for the file and for its user."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.exporters.ros.codes import UNREALISED
from halpipe.exporters.ros.timers import is_exact

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.exporters.ros import RosOptions
    from halpipe.models import Schedule, TaskModel

_MOST_NAMES = 5


def unrealised(model: TaskModel, schedule: Schedule, options: RosOptions) -> list[Diagnostic]:
    """Return one warning for each kind of thing that the exported file cannot make happen."""
    path = about(model=model.name)
    return [UNREALISED(text, path=path, help=help) for text, help in _sentences(model, schedule, options)]


def package_remarks(model: TaskModel, schedule: Schedule) -> list[Diagnostic]:
    """Return one warning for each thing of the schedule that the package leaves open."""
    from halpipe.exporters.ros.packaging import specific_sentences

    path = about(model=model.name)
    return [UNREALISED(text, path=path, help=help) for text, help in specific_sentences(model, schedule)]


def _sentences(model: TaskModel, schedule: Schedule, options: RosOptions) -> Iterator[tuple[str, str]]:
    used = {job.task for table in schedule.modes for job in table.jobs}
    units = {unit for table in schedule.modes for job in table.jobs for unit in job.units}
    if len(schedule.modes) > 1:
        yield (
            f"{len(schedule.modes)} modes, each with executors of its own: executors do not switch between modes",
            "start the executors of one mode; switching needs a launcher that plays the transition tables",
        )
    if ruled := dict.fromkeys(rule.task for rule in model.health):
        yield (
            f"health rules are written, but executors do not follow them: {_few(list(ruled))}",
            "let a supervisor watch the callbacks, and start the executors of the mode that is meant",
        )
    if on_demand := [task.name for task in model.tasks if task.period is None and task.name in used]:
        yield (
            f"started by timers, not by their messages: {_few(on_demand)}",
            "start them by time only; in a subscription, store the message for the timer's callback",
        )
    gangs = dict.fromkeys(job.task for table in schedule.modes for job in table.jobs if len(job.units) > 1)
    if gangs:
        yield (
            f"run on one CPU, though they occupy several units: {_few(list(gangs))}",
            "let the callback start helping threads on the CPUs of the units that are kept free for it",
        )
    if apart := _apart_by_time(model, schedule):
        yield (
            f"kept apart by their instants only, since their executors differ: callbacks that share {_few(apart)}",
            "let no callback run longer than its WCET, or give the tasks of a group one and the same unit",
        )
    if any(version.accesses for task in model.tasks if task.name in used for version in task.versions):
        yield (
            "bounds of access phases are not enforced",
            "export the regulator format (memguard or resctrl) to enforce them",
        )
    if rounded := [table.name for table in schedule.modes if not is_exact(table)]:
        yield (
            f"jobs start up to 1ns early, since timers count whole nanoseconds: mode {_few(rounded)}",
            "nothing to do: the rounding does not add up",
        )
    if options.cpus is None:
        yield "CPUs are numbered in the order of the units of the model", "state them with --cpus unit=number,..."
    elif loose := [unit.name for unit in model.units if unit.name in units and unit.name not in options.cpus]:
        yield f"executors without affinity: {_few(loose)}", "state their CPUs with --cpus unit=number,..."


def _apart_by_time(model: TaskModel, schedule: Schedule) -> list[str]:
    """Return the resources that tasks need wholly on more than one executor."""
    on: dict[str, set[str]] = {}
    for table in schedule.modes:
        for job in table.jobs:
            version = model.task(job.task).version(job.version)
            for access in version.accesses:
                if access.bound == 1 and not access.start and access.end == version.wcet:
                    on.setdefault(access.resource, set()).add(job.units[0])
    return [resource.name for resource in model.resources if len(on.get(resource.name, ())) > 1]


def _few(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return ", ".join(f'"{name}"' for name in names[:_MOST_NAMES]) + more
