"""The ECU configuration of Os, Rte and EcuC: cores, OS tasks and what triggers them, events mapped to OS tasks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.durations import Duration, seconds
from halpipe.importers.arxml.system.containers import Container, Containers
from halpipe.importers.arxml.system.triggers import read_triggers
from halpipe.importers.arxml.system.values import (
    Configuration,
    Core,
    Mapping,
    OsApplication,
    OsIsr,
    OsTask,
    Place,
    RteInstance,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.importers.arxml.files.tree import Tree


_PERIODS = ("RtePeriod", "RteBswPeriod", "RteBswEventPeriod")


def read_configuration(tree: Tree, modules: frozenset[str] | None = None) -> Configuration:
    """Read cores, applications, OS tasks, what triggers them, and the mapping of events to them."""
    containers = Containers(tree, modules)
    cores = _cores(containers)
    applications, numbered = _applications(containers, cores)
    core_of = {task: application.core for application in applications for task in application.tasks}
    tasks = [_task(containers, container, core_of.get(container.node.path)) for container in containers.of("OsTask")]
    return Configuration(
        cores=(*cores.values(), *numbered),
        applications=tuple(applications),
        tasks=tuple(tasks),
        triggers=tuple(read_triggers(containers)),
        mappings=tuple(_mappings(containers)),
        instances=tuple(_instances(containers)),
        modules=tuple(sorted(modules or ())),
        routines=tuple(_routines(containers, applications)),
    )


# ------------------------------------------------------------------------------------------ cores and OS tasks


def _cores(containers: Containers) -> dict[str, Core]:
    """Return the configured cores by path, in order of their ids."""
    found = containers.of("EcucCoreDefinition")
    names = [container.node.name for container in found]
    cores = []
    for container in found:
        number = container.number("EcucCoreId")
        name = container.node.name if names.count(container.node.name) == 1 else container.node.path.lstrip("/")
        hardware = container.target("EcucCoreHwRef")
        cores.append(Core(name, int(number) if number is not None else None, container.place, hardware))
    cores.sort(key=lambda core: (core.id is None, core.id or 0))
    return {core.place.path: core for core in cores if core.place}


def _applications(containers: Containers, cores: dict[str, Core]) -> tuple[list[OsApplication], list[Core]]:
    """Return the OsApplications, and the cores that they number without any container that defines them."""
    by_id = {core.id: core for core in cores.values() if core.id is not None}
    numbered: dict[int, Core] = {}
    applications = []
    for container in containers.of("OsApplication"):
        core = _bound_core(containers, container, cores)
        number = container.number("OsApplicationCoreAssignment")
        if core is None and number is not None:
            core = by_id.get(int(number)) or numbered.setdefault(int(number), Core(f"core{number}", int(number), None))
        tasks = tuple(container.targets("OsAppTaskRef"))
        routines = tuple(container.targets("OsAppIsrRef"))
        applications.append(OsApplication(container.place, tasks, core.name if core else None, routines))
    return applications, [numbered[number] for number in sorted(numbered)]


def _bound_core(containers: Containers, application: Container, cores: dict[str, Core]) -> Core | None:
    """Follow the references from an OsApplication to a core, directly, by an OsCore or by its partition."""
    seen: set[str] = set()
    todo = [application]
    while todo:
        container = todo.pop(0)
        for path in container.targets(
            "OsApplicationCoreRef", "OsCoreEcucCoreRef", "OsAppEcucPartitionRef", "EcucPartitionCoreRef"
        ):
            if path in cores:
                return cores[path]
            if path in containers.by_path and path not in seen:
                seen.add(path)
                todo.append(containers.by_path[path])
    return None


def _task(containers: Containers, container: Container, core: str | None) -> OsTask:
    kind = container.value("OsTaskType")
    name = "OsTaskExecutionBudget"
    inside = next((found for found in containers.below(container) if found.value(name)), None)
    budget = inside.number(name) if inside else None
    return OsTask(
        container.place,
        core,
        _task_period(container),
        _schedule(container),
        is_basic=(kind is None or kind.text == "BASIC") and not container.refs("OsTaskEventRef"),
        budget=seconds(budget) if budget else None,
        protection=inside.place if inside else None,
        resources=tuple(
            Place(path, "OsResource", containers.by_path[path].node.at)
            for path in container.targets("OsTaskResourceRef")
            if path in containers.by_path
        ),
    )


def _schedule(container: Container) -> str:
    """Return whether jobs of an OsTask may be preempted, FULL or NON; empty where that is not stated."""
    stated = container.value("OsTaskSchedule")
    return stated.text if stated is not None and stated.text in ("FULL", "NON") else ""


def _routines(containers: Containers, applications: Iterable[OsApplication]) -> Iterator[OsIsr]:
    """Yield the interrupt routines, with what their timing protection says."""
    core_of = {path: application.core for application in applications for path in application.routines}
    for container in containers.of("OsIsr"):
        inside = list(containers.below(container))
        budget, frame = (
            next((number for inner in inside if (number := inner.number(name))), None)
            for name in ("OsIsrExecutionBudget", "OsIsrTimeFrame")
        )
        yield OsIsr(
            container.place,
            core_of.get(container.node.path),
            seconds(budget) if budget else None,
            seconds(frame) if frame else None,
        )


def _task_period(container: Container) -> Duration | None:
    number = container.number("OsTaskPeriod")
    return seconds(number) if number else None


# ------------------------------------------------------------------------------------------------- mappings


def _mappings(containers: Containers) -> Iterator[Mapping]:
    for container in containers.of("RteEventToTaskMapping", "RteBswEventToTaskMapping"):
        position = container.number("RtePositionInTask") if "Bsw" not in container.kind else None
        if position is None:
            position = container.number("RteBswPositionInTask")
        yield Mapping(
            place=container.place,
            prototype=_instance(containers, container),
            event=container.target("RteEventRef", "RteBswEventRef"),
            task=containers.own(container.target("RteMappedToTaskRef", "RteBswMappedToTaskRef")),
            position=int(position) if position is not None else None,
            offset=container.value("RteActivationOffset") or container.value("RteBswActivationOffset"),
            period=next(filter(None, map(container.value, _PERIODS)), None),
            is_called=bool(container.refs("RteMappedToTaskRef", "RteBswMappedToTaskRef")),
            triggers=tuple(
                container.targets(
                    "RteUsedOsSchTblExpiryPointRef",
                    "RteBswUsedOsSchTblExpiryPointRef",
                    "RteUsedOsAlarmRef",
                    "RteBswUsedOsAlarmRef",
                    "RteUsedOsEventRef",
                    "RteBswUsedOsEventRef",
                )
            ),
        )


def _instances(containers: Containers) -> Iterator[RteInstance]:
    for container in containers.of("RteSwComponentInstance"):
        for ref in container.refs("RteSoftwareComponentInstanceRef"):
            events = [event.path for inside in containers.below(container) for event in inside.refs("RteEventRef")]
            yield RteInstance(place=container.place, prototype=ref.path, at=ref.at, events=tuple(events))


def _instance(containers: Containers, mapping: Container) -> str | None:
    parent = mapping.node.parent
    owner = containers.by_path.get(parent.path) if parent is not None else None
    refs = owner.refs("RteSoftwareComponentInstanceRef") if owner is not None else []
    return refs[0].path if refs else None
