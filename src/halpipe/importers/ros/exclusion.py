"""Callback groups and executors: which callbacks never overlap in ROS, and how much of that a model can say.

The callbacks of a mutually exclusive group share data without locks. A resource that each of their tasks needs wholly,
for its whole WCET, keeps them apart on any units, just as the group does. That takes the WCETs, so it is done where
they are known and the user asks for it. A single-threaded executor is not modelled: it is how ROS deals out cores,
which the schedule takes over.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.durations import ZERO
from halpipe.importers.ros import codes
from halpipe.importers.ros.names import Names
from halpipe.models import Access, Origin, Resource

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from halpipe.diagnostics import Findings
    from halpipe.importers.base import Coverage
    from halpipe.importers.ros.graph import Group
    from halpipe.models import Task, TaskModel

CALLBACK_GROUP = "callback_group"
_ON_UNITS = "exclusion holds between tasks that share a unit; the model has no element for it"
_NO_PAIR = "no two of its callbacks that exclude each other are tasks"


def exclude(
    model: TaskModel,
    groups: Sequence[Group],
    tasks_of: Mapping[str, str],
    as_resources: bool,
    findings: Findings,
    coverage: Coverage,
) -> TaskModel:
    """Return `model` with a resource for each exclusive callback group that can have one; account for all groups."""
    tasks = {task.name: task for task in model.tasks}
    names = Names(findings)
    resources = []
    left: dict[str, list[Group]] = {CALLBACK_GROUP: [], "executor": []}
    for group in groups:
        members = list(dict.fromkeys(tasks_of[name] for name in group.callbacks if name in tasks_of))
        if not group.exclusive or len(members) < 2:
            coverage.ignored(group.kind, group.name, _NO_PAIR, group.at)
        elif group.kind == CALLBACK_GROUP and as_resources and all(_has_wcets(tasks[name]) for name in members):
            path = f'callback group "{group.name}"'
            name = names.unique(group.name, path, group.at)
            resources.append(Resource(name=name, origin=Origin(group.at.file, group.at.line, group.name)))
            tasks |= {member: _holding(tasks[member], name) for member in members}
            coverage.mapped(group.kind)
        else:
            left[group.kind].append(group)
            coverage.ignored(group.kind, group.name, _ON_UNITS, group.at)
    _report(left, as_resources, findings)
    return replace(model, resources=(*model.resources, *resources), tasks=tuple(tasks.values()))


def _has_wcets(task: Task) -> bool:
    return all(version.wcet for version in task.versions)


def _holding(task: Task, resource: str) -> Task:
    """Return the task with the whole of `resource` needed from the start of each job to its WCET."""
    versions = []
    for version in task.versions:
        assert version.wcet is not None
        whole = Access(resource=resource, start=ZERO, end=version.wcet)
        versions.append(replace(version, accesses=(*version.accesses, whole)))
    return replace(task, versions=tuple(versions))


def _report(left: Mapping[str, Sequence[Group]], as_resources: bool, findings: Findings) -> None:
    first = next((group for groups in left.values() for group in groups), None)
    if first is None:
        return
    if as_resources and left[CALLBACK_GROUP]:
        help = "measure all callbacks of the groups with --calibrate, or give their tasks one and the same unit"
    else:
        help = "in the overlay, give the tasks of such a group one and the same unit, or use --groups resources"
    findings.add(
        codes.EXCLUSION(
            f"{len(left[CALLBACK_GROUP])} mutually exclusive callback groups and {len(left['executor'])} "
            "single-threaded executors are not represented: only tasks on the same unit never overlap",
            at=first.at,
            help=help,
        )
    )
