"""Elements of an AMALTHEA document, with its hardware and mapping: ids, references, quantities, units, memories."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING
from urllib.parse import quote_plus

from lxml import etree

from halpipe.core.embedding import properties_hash
from halpipe.exporters.common.frozen import freeze_children
from halpipe.models import ResourceKind, Task, TaskModel

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from halpipe.core.durations import Duration
    from halpipe.exporters.amalthea.stimuli import Stimulus

XSI = "http://www.w3.org/2001/XMLSchema-instance"
XMI = "http://www.omg.org/XMI"
_NAMESPACE = "http://app4mc.eclipse.org/amalthea/"
_AT_A_TIME = 64
_TIME_UNITS = ("s", "ms", "us", "ns")


def document(release: str) -> etree._Element:
    """Start a document."""
    uri = _NAMESPACE + release
    root = etree.Element(f"{{{uri}}}Amalthea", nsmap={"am": uri, "xmi": XMI, "xsi": XSI})
    root.set(f"{{{XMI}}}version", "2.0")
    return root


class Written:
    """The texts of what is complete."""

    def __init__(self) -> None:
        self.texts: list[bytes] = []
        self._waiting: Counter[etree._Element] = Counter()

    def children(self, parent: etree._Element) -> None:
        """Write the children of an element, all of which are complete, at every so many calls."""
        self._waiting[parent] += 1
        if self._waiting[parent] % _AT_A_TIME == 0:
            freeze_children(parent, self.texts, properties_hash)


def add(parent: etree._Element, tag: str, kind: str = "", **attributes: str | int) -> etree._Element:
    """Append an element, with its class where its tag does not tell it."""
    element = etree.SubElement(parent, tag)
    if kind:
        element.set(f"{{{XSI}}}type", f"am:{kind}")
    for name, value in attributes.items():
        element.set(name, str(value))
    return element


def named(parent: etree._Element, tag: str, kind: str, name: str, *, typed: bool = False) -> etree._Element:
    """Append an element that can be referred to; `typed` where its tag does not tell its class."""
    element = add(parent, tag, kind if typed else "")
    element.set(f"{{{XMI}}}id", ref(kind, name))
    element.set("name", name)
    return element


def ref(kind: str, *path: str) -> str:
    """Return a reference to an element by its class and name (encoded as Java's URLEncoder does)."""
    encoded = "/".join(quote_plus(name, safe="").replace("~", "%7E") for name in path)
    return f"{encoded}?type={kind}"


def refs(kind: str, names: Iterable[str]) -> str:
    """Return references to several elements of a class."""
    return " ".join(ref(kind, name) for name in names)


def add_time(parent: etree._Element, tag: str, time: Duration) -> None:
    """Append a time in the largest unit in which it is whole; others are cut to whole picoseconds."""
    for unit in _TIME_UNITS:
        if (value := time.in_unit(unit)).denominator == 1:
            add(parent, tag, value=value.numerator, unit=unit)
            return
    add(parent, tag, value=max(1, int(time.in_unit("ns") * 1000)), unit="ps")


def add_property(parent: etree._Element, key: str, value: str) -> None:
    """Append a custom property of halpipe."""
    holder = add(parent, "customProperties", key=f"halpipe:{key}")
    add(holder, "value", "StringObject", value=value)


class Unique:
    """Hands out names that are unique among those of one class."""

    def __init__(self) -> None:
        self._taken: set[str] = set()
        self._last: dict[str, int] = {}

    def __call__(self, name: str) -> str:
        """Return `name`, with a number behind it if it is taken."""
        chosen = name
        while chosen in self._taken:
            self._last[name] = self._last.get(name, 1) + 1
            chosen = f"{name}~{self._last[name]}"
        self._taken.add(chosen)
        return chosen


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


def write_mapping(
    parent: etree._Element, model: TaskModel, stimuli: Mapping[str, Sequence[Stimulus]], written: Written
) -> None:
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
            written.children(parent)
    for label, resource in _places(model).items():
        memory = ref("Memory", resource)
        add(parent, "memoryMapping", abstractElement=ref("Label", label), memory=memory)
        written.children(parent)


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
