"""Activation of OS tasks: every event of every component instance with its OS task, and OS tasks on their own."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import named
from halpipe.core.records import record
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.names import legal_name
from halpipe.importers.arxml.tasks.arrivals import Arrivals

if TYPE_CHECKING:
    from halpipe.core.diagnostics import Findings
    from halpipe.core.durations import Duration
    from halpipe.importers.arxml.system.values import (
        Arrival,
        Event,
        Instance,
        Mapping,
        OsTask,
        Place,
        Process,
        Runnable,
        System,
    )
    from halpipe.importers.arxml.tasks.dataflow import Actor


@record(kw_only=True)
class Activation:
    """One reason for work to be done: an event of an instance that starts a runnable, or an OsTask or process.

    `name` is what a task of it is called. `period` None means that it does not recur, as `reason` explains; `used`
    are the elements that the period comes from, where it is not the event's own. `arrival` is what the timing
    extension says of how often it happens; with `distance` that is sporadic, and the period is that of polling. `twin`
    is the runnable that is the same function as a BSW entity, and `joins` the event of it with which this one shares a
    call. `is_inherited` says that the period is that of the sender of its data, and `called_every` is the period of a
    call that is not due at each activation of its OsTask.
    """

    name: str
    place: Place
    context: tuple[str, ...] = ()
    runnable: Runnable | None = None
    event: Event | None = None
    mapping: Mapping | None = None
    os_task: OsTask | None = None
    process: Process | None = None
    arrival: Arrival | None = None
    period: Duration | None = None
    offset: Duration | None = None
    reason: str = ""
    used: tuple[Place, ...] = ()
    distance: Duration | None = None
    twin: Actor | None = None
    joins: Event | None = None
    is_inherited: bool = False
    called_every: Duration | None = None

    @property
    def kind(self) -> str:
        """The kind of event, or of what starts on its own: OsTask, PROCESS, a runnable without events."""
        return self.event.place.kind if self.event else self.place.kind

    @property
    def actor(self) -> Actor:
        """The runnable of this instance, or the OsTask or process."""
        return self.context, self.place.path

    @property
    def work(self) -> Actor:
        """What is executed: the runnable, or for a BSW entity the runnable that is the same function (`twin`)."""
        return self.twin or self.actor


def find_activations(system: System, findings: Findings) -> list[Activation]:
    """Pair the events of every instance with runnables and OS tasks; add what runs without any event.

    That is runnables whose arrival the timing extension states, OS tasks that host nothing, and processes.
    """
    arrivals = Arrivals(system)
    tasks = {task.place.path: task for task in system.configuration.tasks}
    mappings = _Mappings(system)
    found = [activation for instance in system.instances for activation in _of_instance(instance, mappings, tasks)]
    found += _without_events(system, found, arrivals)
    hosting = {activation.os_task.place.path for activation in found if activation.os_task}
    found += [
        Activation(name=task.place.name, place=task.place, os_task=task)
        for path, task in tasks.items()
        if path not in hosting
    ]
    found += [
        Activation(name=process.place.name, place=process.place, context=(process.place.path,), process=process)
        for process in system.processes
    ]
    if arrivals.subjects:
        found = [replace(activation, arrival=arrivals.of(activation)) for activation in found]
    return _named_apart(_joined(found, system), findings)


def _without_events(system: System, found: list[Activation], arrivals: Arrivals) -> list[Activation]:
    stated = frozenset(arrivals.subjects)
    if not stated:
        return []
    started = {activation.actor for activation in found}
    return [
        Activation(
            name=f"{instance.label}/{runnable.place.name}",
            place=runnable.place,
            context=instance.context,
            runnable=runnable,
        )
        for instance in system.instances
        for runnable in instance.component.runnables
        if runnable.place.path in stated and (instance.context, runnable.place.path) not in started
    ]


def _of_instance(instance: Instance, mappings: _Mappings, tasks: dict[str, OsTask]) -> list[Activation]:
    runnables = {runnable.place.path: runnable for runnable in instance.component.runnables}
    found = []
    for event in instance.component.events:
        runnable = runnables.get(event.runnable or "")
        if runnable is None:
            continue
        mapping = mappings.of(instance, event)
        found.append(
            Activation(
                name=f"{instance.label}/{runnable.place.name}",
                place=runnable.place,
                context=instance.context,
                runnable=runnable,
                event=event,
                mapping=mapping,
                os_task=tasks.get(mapping.task or "") if mapping else None,
            )
        )
    return found


class _Mappings:
    """The mappings of events to OS tasks, by event and instance."""

    def __init__(self, system: System) -> None:
        self._configured = system.configured
        self._by_event: dict[str, list[Mapping]] = {}
        for mapping in system.configuration.mappings:
            if mapping.event is not None:
                self._by_event.setdefault(mapping.event, []).append(mapping)

    def of(self, instance: Instance, event: Event) -> Mapping | None:
        """Choose the mapping of an event for one instance: its own, or one that names no instance."""
        mappings = self._by_event.get(event.place.path, [])
        own = [mapping for mapping in mappings if self._is_of(mapping.prototype, instance)]
        general = [mapping for mapping in mappings if mapping.prototype is None]
        any_instance = mappings if len(instance.context) == 1 else []
        found = own or general or any_instance
        return next((mapping for mapping in found if mapping.task is not None), found[0] if found else None)

    def _is_of(self, prototype: str | None, instance: Instance) -> bool:
        return prototype in instance.context or self._configured.get(prototype or "") == instance.context


def _joined(activations: list[Activation], system: System) -> list[Activation]:
    """Point BSW entities to the runnable that is the same function, where an instance of it exists."""
    if not system.twins:
        return activations
    runnable_of = {twin.entity: twin.runnable for twin in system.twins}
    actors = {a.place.path: a.actor for a in reversed(activations) if a.runnable is not None}
    return [replace(a, twin=actors.get(runnable_of.get(a.place.path, ""))) for a in activations]


def _named_apart(activations: list[Activation], findings: Findings) -> list[Activation]:
    """Give runnables that would be called the same their whole AUTOSAR path, and every name its legal form."""
    actors = {activation.actor: activation for activation in activations}
    shared = {name for name, count in Counter(a.name for a in actors.values()).items() if count > 1}
    names = {}
    for actor, activation in actors.items():
        name = legal_name(_full_name(activation) if activation.name in shared else activation.name)
        names[actor] = name
        if name != activation.name:
            findings.add(
                codes.RENAMED(
                    f'is called "{name}"',
                    at=activation.place.at,
                    path=named(activation.place.kind, activation.name),
                )
            )
    chosen = ((activation, names[activation.actor]) for activation in activations)
    return [activation if name == activation.name else replace(activation, name=name) for activation, name in chosen]


def _full_name(activation: Activation) -> str:
    if len(activation.context) < 2:
        return activation.place.path.lstrip("/")
    steps = [activation.context[0].lstrip("/"), *(path.rpartition("/")[2] for path in activation.context[1:])]
    return "/".join((*steps, activation.place.name))
