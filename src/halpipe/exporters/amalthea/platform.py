"""Hardware, operating system and mapping: units, memories, one scheduler for all, where each task runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.exporters.amalthea.document import Unique, add, named, ref, refs
from halpipe.models import ResourceKind

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lxml import etree

    from halpipe.exporters.amalthea.stimuli import Stimulus
    from halpipe.models import Task, TaskModel

_CLOCK = "clock"
_SCHEDULER = "TimeTable"
_NO_TYPE = "unit"


def definitions_of(model: TaskModel) -> dict[str, str]:
    """Return the name of the definition of every type of unit."""
    names = Unique()
    return {kind: names(kind or _NO_TYPE) for kind in dict.fromkeys(unit.type for unit in model.units)}


def write_hardware(parent: etree._Element, model: TaskModel, definitions: Mapping[str, str]) -> None:
    """Append units at 1 GHz, so that a tick is 1 ns, and memories."""
    for name in definitions.values():
        named(parent, "definitions", "ProcessingUnitDefinition", name, typed=True)
    memories = [resource for resource in model.resources if resource.kind is ResourceKind.MEMORY]
    for resource in memories:
        element = named(parent, "definitions", "MemoryDefinition", resource.name, typed=True)
        if resource.bandwidth is not None:
            add(element, "dataRate", value=resource.bandwidth, unit="BPerSecond")
    structure = named(parent, "structures", "HwStructure", "System")
    structure.set("structureType", "System")
    for unit in model.units:
        element = named(structure, "modules", "ProcessingUnit", unit.name, typed=True)
        element.set("frequencyDomain", ref("FrequencyDomain", _CLOCK))
        element.set("definition", ref("ProcessingUnitDefinition", definitions[unit.type]))
    for resource in memories:
        element = named(structure, "modules", "Memory", resource.name, typed=True)
        element.set("definition", ref("MemoryDefinition", resource.name))
    domain = named(parent, "domains", "FrequencyDomain", _CLOCK, typed=True)
    add(domain, "defaultValue", value="1.0", unit="GHz")


def write_system(parent: etree._Element, model: TaskModel, release: str) -> None:
    """Append the locks as semaphores, and the scheduler: the table."""
    for resource in model.resources:
        if resource.kind is ResourceKind.LOCK:
            semaphore = named(parent, "semaphores", "Semaphore", resource.name)
            semaphore.set("maxValue", "1")
    text = "starts every job at the instants of a table"
    if release != "1.2.0":
        definition = named(parent, "schedulerDefinitions", "SchedulerDefinition", _SCHEDULER)
        definition.set("description", text)
    system = add(parent, "operatingSystems", name="System")
    scheduler = named(system, "taskSchedulers", "TaskScheduler", _SCHEDULER)
    if release == "1.2.0":
        algorithm = add(scheduler, "schedulingAlgorithm", "UserSpecificSchedulingAlgorithm")
        add(algorithm, "parameterExtensions", key="algorithm", value=text)
    else:
        scheduler.set("definition", ref("SchedulerDefinition", _SCHEDULER))


def write_mapping(parent: etree._Element, model: TaskModel, stimuli: Mapping[str, Sequence[Stimulus]]) -> None:
    """Append where tasks run: on the units of their jobs in the schedule, else on all that their versions allow."""
    order = {unit.name: index for index, unit in enumerate(model.units)}
    if order:
        element = add(parent, "schedulerAllocation", scheduler=ref("TaskScheduler", _SCHEDULER))
        element.set("responsibility", refs("ProcessingUnit", order))
        element.set("executingPU", ref("ProcessingUnit", next(iter(order))))
    for task in model.tasks:
        units = _units(task, stimuli[task.name])
        if units:
            element = add(parent, "taskAllocation", task=ref("Task", task.name))
            element.set("scheduler", ref("TaskScheduler", _SCHEDULER))
            element.set("affinity", refs("ProcessingUnit", sorted(units, key=order.__getitem__)))
    for label, resource in _places(model).items():
        memory = ref("Memory", resource)
        add(parent, "memoryMapping", abstractElement=ref("Label", label), memory=memory)


def _units(task: Task, stimuli: Sequence[Stimulus]) -> set[str]:
    placed = {unit for stimulus in stimuli for unit in stimulus.units}
    return placed or {unit for version in task.versions for unit in version.units}


def _places(model: TaskModel) -> dict[str, str]:
    """Return the memory of every label: that of its first transfer."""
    places: dict[str, str] = {}
    for task in model.tasks:
        for access in (access for version in task.versions for access in version.accesses):
            for transfer in access.transfers:
                places.setdefault(transfer.buffer, access.resource)
    return places
