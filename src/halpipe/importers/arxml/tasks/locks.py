"""Locks: exclusive areas of components and modules, and OsResources, that two tasks may enter.

A runnable says which areas it may enter, or runs inside of, but not when; so its jobs hold the lock from start to end
(MODEL 10.5), a listed default. Each component instance has areas of its own. Jobs of one unit that are not split are
apart anyway. All that takes WCETs, which an overlay may state, so it is done once the overlay is on the model.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, named
from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.importers.arxml.meaning_codes import LOCK_LOST, LOCKS_HELD
from halpipe.importers.arxml.names import legal_name, listed, unique_name
from halpipe.models import Access, Resource, ResourceKind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.importers.arxml.system.values import Place, System
    from halpipe.importers.arxml.tasks.grouping import Draft
    from halpipe.importers.common.base import Coverage
    from halpipe.models import Task, TaskModel


@record
class Lock:
    """An exclusive area of one component instance, or an OsResource: its name, and the tasks that may hold it."""

    name: str
    place: Place
    tasks: tuple[str, ...]


def find_locks(system: System, drafts: Sequence[Draft]) -> tuple[Lock, ...]:
    """Return what two tasks or more may hold."""
    labels = {instance.context: instance.label for instance in system.instances}
    held: dict[tuple[str, Place], dict[str, None]] = {}
    for draft in drafts:
        for member in draft.members:
            for area in member.runnable.areas if member.runnable else ():
                label = f"{labels.get(member.context, '')}/{area.name}".lstrip("/")
                held.setdefault((label, area), {})[draft.name] = None
        for resource in draft.os_task.resources if draft.os_task else ():
            held.setdefault((resource.name, resource), {})[draft.name] = None
    return tuple(Lock(legal_name(n), place, tuple(tasks)) for (n, place), tasks in held.items() if len(tasks) > 1)


@record
class Locking:
    """Puts locks on a model whose WCETs are known, and accounts for the time that they are held."""

    locks: tuple[Lock, ...]
    coverage: Coverage

    def complete(self, model: TaskModel) -> tuple[TaskModel, tuple[Diagnostic, ...]]:
        """Return `model` with a resource for each lock that two of its tasks could hold at once."""
        findings = Findings()
        tasks = {task.name: task for task in model.tasks}
        taken = {resource.name for resource in model.resources}
        made: list[tuple[Lock, Resource]] = []
        for lock in self.locks:
            members = [name for name in lock.tasks if name in tasks]
            if len(members) < 2 or _are_apart([tasks[name] for name in members]):
                continue
            unknown = [name for name in members if not all(version.wcet for version in tasks[name].versions)]
            if unknown:
                findings.add(_lost(lock, unknown))
                continue
            resource = Resource(name=unique_name(lock.name, taken), kind=ResourceKind.LOCK, origin=lock.place.origin)
            made.append((lock, resource))
            for name in members:
                tasks[name] = _holding(tasks[name], resource.name)
                element = f'task "{name}"'
                self.coverage.defaulted(element, f'lock "{resource.name}"', "held by whole jobs", lock.place.at)
        if made:
            message = f"{len(made)} locks are held by whole jobs: {listed([resource.name for _, resource in made])}"
            findings.add(LOCKS_HELD(message, at=made[0][0].place.at))
        resources = (*model.resources, *(resource for _, resource in made))
        return replace(model, resources=resources, tasks=tuple(tasks.values())), tuple(findings.items)


def _lost(lock: Lock, unknown: Sequence[str]) -> Diagnostic:
    return LOCK_LOST(
        f"is not imported, since {listed(unknown)} have no WCET: jobs that hold it may overlap",
        at=lock.place.at,
        path=named(lock.place.kind, lock.place.path),
        help="state the WCETs in an overlay",
    )


def _are_apart(tasks: Sequence[Task]) -> bool:
    """Whether no two jobs of some tasks can be in progress at once: all have one unit, and none is split."""
    versions = [version for task in tasks for version in task.versions]
    units = {version.units for version in versions}
    return len(units) == 1 and len(next(iter(units))) == 1 and not any(v.split.is_allowed for v in versions)


def _holding(task: Task, lock: str) -> Task:
    """Return the task with a lock held from the start of each job to its end."""
    return replace(
        task,
        versions=tuple(
            replace(v, accesses=(*v.accesses, Access(resource=lock, start=ZERO, end=v.wcet))) if v.wcet else v
            for v in task.versions
        ),
    )
