"""Callback groups and executors: which callbacks never overlap in ROS, and how a model says so.

The callbacks of a mutually exclusive group share data without locks. A resource that each of their tasks needs wholly,
for its whole WCET, keeps them apart on any units, just as the group does. That takes the WCETs, which an overlay may
state, so it is done once the overlay is on the model. Tasks that all have one and the same unit are apart without it.
A single-threaded executor is not modelled: it is how ROS assigns cores, which the schedule takes over.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, Severity, named
from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.core.suggest import counted, few
from halpipe.importers.ros import codes
from halpipe.importers.ros.graph import Group, Kind, Names
from halpipe.models import Access, Origin, Resource

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.importers.common.base import Coverage
    from halpipe.importers.ros.graph import RosGraph
    from halpipe.models import Task, TaskModel

CALLBACK_GROUP = "callback_group"
DEFAULT_GROUP = "default_callback_group"
"""The group that rclcpp puts callbacks into for which no other is stated; it is mutually exclusive."""

_CORES = "the schedule assigns the cores, not an executor"
_GIVEN_UP = "its tasks may overlap on different units"
_NO_PAIR = "no two of its callbacks that exclude each other are tasks"


def default_groups(graph: RosGraph, coverage: Coverage) -> list[Group]:
    """Return the default groups of nodes: of the callbacks that are in no stated one."""
    grouped = {name for group in graph.groups if group.kind == CALLBACK_GROUP for name in group.callbacks}
    loose: dict[str, list[str]] = {}
    for callback in graph.callbacks:
        if callback.name not in grouped and callback.kind not in (Kind.NODE, Kind.SERVICE):
            loose.setdefault(callback.node, []).append(callback.name)
    places = {node.name: node.at for node in graph.nodes}
    found = []
    for node, callbacks in loose.items():
        if len(callbacks) > 1 and node in places:
            coverage.defaulted(node, "callback group", "mutually exclusive, as rclcpp's default", places[node])
            name = f"{node}/{DEFAULT_GROUP}"
            found.append(
                Group(kind=DEFAULT_GROUP, name=name, exclusive=True, callbacks=tuple(callbacks), at=places[node])
            )
    return found


@record
class Exclusion:
    """The groups of an import and the task of each callback; `as_resources`: whether tasks are to be kept apart."""

    groups: Sequence[Group]
    tasks_of: Mapping[str, str]
    as_resources: bool
    coverage: Coverage

    def complete(self, model: TaskModel) -> tuple[TaskModel, tuple[Diagnostic, ...]]:
        """Return `model` with a resource for each exclusive group; account for all groups, warn where one is lost."""
        findings = Findings()
        tasks = {task.name: task for task in model.tasks}
        names = Names(findings, {resource.name for resource in model.resources})
        resources: list[Resource] = []
        lost: list[tuple[Group, list[str]]] = []
        executors = []
        done: set[tuple[str, frozenset[str]]] = set()
        for group in self.groups:
            members = self._members(group, model)
            again = (group.name, frozenset(members)) in done
            done.add((group.name, frozenset(members)))
            if not group.exclusive or (len(members) < 2 and not any(_meets_itself(tasks[name]) for name in members)):
                self._ignored(group, _NO_PAIR)
            elif group.kind == "executor":
                executors.append(group)
                self._ignored(group, _CORES)
            elif again:
                self._mapped(group)
            elif self.as_resources and all(_can_hold(tasks[name]) for name in members):
                name = names.unique(group.name, f'callback group "{group.name}"', group.at)
                resources.append(Resource(name=name, origin=Origin(group.at.file, group.at.line, group.name)))
                tasks |= {member: _holding(tasks[member], name) for member in members}
                self._mapped(group)
            elif _one_unit(tasks[name] for name in members):
                self._mapped(group)
            else:
                lost.append((group, members))
                self._ignored(group, _GIVEN_UP)
        findings.extend(self._reports(lost, executors, tasks))
        model = replace(model, resources=(*model.resources, *resources), tasks=tuple(tasks.values()))
        return model, tuple(dict.fromkeys(findings.items))

    def _members(self, group: Group, model: TaskModel) -> list[str]:
        """Return the tasks of a group, also those that stand for a callback in one mode only."""
        named = {self.tasks_of[name] for name in group.callbacks if name in self.tasks_of}
        named |= {f"{name}@{mode.name}" for name in named for mode in model.modes}
        return [task.name for task in model.tasks if task.name in named]

    def _mapped(self, group: Group) -> None:
        if group.kind != DEFAULT_GROUP:
            self.coverage.mapped(group.kind)

    def _ignored(self, group: Group, reason: str) -> None:
        if group.kind != DEFAULT_GROUP:
            self.coverage.ignored(group.kind, group.name, reason, group.at)

    def _reports(
        self, lost: Sequence[tuple[Group, list[str]]], executors: Sequence[Group], tasks: Mapping[str, Task]
    ) -> Iterable[Diagnostic]:
        if lost:
            group, members = lost[0]
            unable = [name for name in members if not _can_hold(tasks[name])]
            text = (
                f"callbacks of {len(lost)} mutually exclusive callback groups may overlap: "
                f"{few([group.name for group, _ in lost])}"
            )
            help = "omit --groups ignored, or give the tasks of a group one and the same unit"
            if self.as_resources:
                text += (
                    f"; for the first, {few(unable)} cannot hold it to their ends, for want of a WCET or being split"
                )
                help = "state their WCETs in an overlay or with --calibrate, or give them one and the same unit"
            yield codes.EXCLUSION(text, at=group.at, path=named("callback group", group.name), help=help)
        if executors:
            what = counted(len(executors), "single-threaded executor")
            text = f"not represented: {what}, whose callbacks may run in parallel"
            help = "in the overlay, give the tasks of an executor one and the same unit if they share data across nodes"
            yield codes.EXCLUSION(text, at=executors[0].at, help=help, severity=Severity.NOTE)


def _can_hold(task: Task) -> bool:
    """Return whether a resource can be held from start to end: WCETs are known, and no job is split."""
    return all(version.wcet and not version.split.is_allowed for version in task.versions)


def _meets_itself(task: Task) -> bool:
    """Return whether a job may still run when the next one of its task starts."""
    return task.period is not None and task.deadline is not None and task.deadline > task.period


def _one_unit(tasks: Iterable[Task]) -> bool:
    """Return whether only one unit is left for all versions of all tasks."""
    units = {version.units for task in tasks for version in task.versions}
    return len(units) == 1 and len(next(iter(units))) == 1


def _holding(task: Task, resource: str) -> Task:
    """Return the task with the whole of `resource` needed from the start of each job to its WCET."""
    versions = []
    for version in task.versions:
        assert version.wcet is not None
        whole = Access(resource=resource, start=ZERO, end=version.wcet)
        versions.append(replace(version, accesses=(*version.accesses, whole)))
    return replace(task, versions=tuple(versions))
