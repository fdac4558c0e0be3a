"""The ECU configuration of Os, Rte and EcuC: cores, OS tasks and what triggers them, events mapped to OS tasks.

Containers and parameters are known by the path of their definition. Vendors put their own names before the module
name in it (/MICROSAR/Os, /AUTOSAR/EcucDefs/Os, ...), so only what follows the module name counts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import named
from halpipe.core.durations import Duration, seconds
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.numbers import parse_number
from halpipe.importers.arxml.files.special import Data, each_data
from halpipe.importers.arxml.files.tree import NS, place, qualified
from halpipe.importers.arxml.system.values import (
    Configuration,
    Core,
    Mapping,
    OsApplication,
    OsIsr,
    OsTask,
    Place,
    RteInstance,
    Stated,
    Trigger,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from fractions import Fraction

    from lxml import etree

    from halpipe.importers.arxml.files.tree import Node, Ref, Tree

_MODULES = ("Os", "Rte", "EcuC")
_CONTAINER = "ECUC-CONTAINER-VALUE"
_MODULE = "ECUC-MODULE-CONFIGURATION-VALUES"
_FREQUENCIES = ("OsTickFrequency", "ArcOsTickFrequency")  # of the OsOS of some vendors, in ticks per second
_VALUE_PATHS = tuple(map(qualified, ("VALUE-REF", "VALUE-IREF/TARGET-REF")))


class Container:
    """An ECU configuration container: the short name of its definition, its parameters and references by theirs."""

    def __init__(self, tree: Tree, node: Node, kind: str) -> None:
        self.node = node
        self.kind = kind
        self._tree = tree
        self._parameters: dict[str, list[tuple[etree._Element, str]]] | None = None
        self._references: dict[str, list[tuple[etree._Element, str]]] | None = None

    def data(self) -> list[Data]:
        """Return the special data of a container that halpipe put on top of a project."""
        return list(each_data(self._tree, self.node, "delta"))

    @property
    def place(self) -> Place:
        """Where the container is, with the name of its definition as its kind."""
        return Place(self.node.path, self.kind, self.node.at)

    def value(self, name: str) -> Stated | None:
        """Return the parameter `name`; report a conflict if two parts of the container state it differently."""
        first: Stated | None = None
        if self._parameters is None:
            self._parameters = self._by_definition("PARAMETER-VALUES/*")
        for element, file in self._parameters.get(name, ()):
            text = (element.findtext(NS + "VALUE") or "").strip()
            found = Stated(text, place(element, file))
            if first is None:
                first = found
            elif first.text != found.text:
                self._tree.report_conflict(self.node, name, (first.text, first.at), (found.text, found.at))
        return first if first is not None and first.text else None

    def number(self, name: str) -> Fraction | None:
        """Return the parameter `name` as an exact number; report it if it is none."""
        stated = self.value(name)
        if stated is None:
            return None
        number = parse_number(stated.text)
        if number is None or number < 0:
            self._tree.findings.add(
                codes.BAD_NUMBER(
                    f'{name} "{stated.text}" is no non-negative number',
                    at=stated.at,
                    path=named(self.kind, self.node.path),
                    help="write a number such as 20, 0x14 or 2.5E-8",
                )
            )
            return None
        return number

    def refs(self, *names: str) -> list[Ref]:
        """Return the targets of the references called one of `names`."""
        if self._references is None:
            self._references = self._by_definition("REFERENCE-VALUES/*")
        found: dict[str, Ref] = {}
        for name in names:
            for element, file in self._references.get(name, ()):
                for path in _VALUE_PATHS:
                    value = element.find(path)
                    ref = self._tree.reference(self.node, value, file) if value is not None else None
                    if ref is not None:
                        found[ref.path] = ref
        return list(found.values())

    def _by_definition(self, path: str) -> dict[str, list[tuple[etree._Element, str]]]:
        """Return values with their files by the short names of their definitions."""
        found: dict[str, list[tuple[etree._Element, str]]] = {}
        for element, file in self.node.elements(path):
            found.setdefault(_last(element.findtext(NS + "DEFINITION-REF")), []).append((element, file))
        return found

    def targets(self, *names: str) -> list[str]:
        """Return the paths of the existing targets of references; report those that dangle."""
        what = f'{self.kind} "{self.node.path}"'
        found = (self._tree.find(ref, what) for ref in self.refs(*names))
        return [node.path for node in found if node is not None]

    def target(self, *names: str) -> str | None:
        """Return the path of the first existing target of a reference."""
        return next(iter(self.targets(*names)), None)


def _last(definition: str | None) -> str:
    return "".join((definition or "").split()).rpartition("/")[2]


class Containers:
    """Every container of the modules Os, Rte and EcuC, by path; of `modules` only, if given (paths)."""

    def __init__(self, tree: Tree, modules: frozenset[str] | None = None) -> None:
        self.tree = tree
        self.by_path: dict[str, Container] = {}
        self.added: dict[str, Container] = {}
        for node in tree.tagged(_CONTAINER):
            if modules is not None and _module_of(node).path not in modules:
                continue
            definition = tree.text(node, "DEFINITION-REF")
            steps = "".join(definition.value.split()).split("/") if definition else []
            if any(module in steps for module in _MODULES):
                container = Container(tree, node, steps[-1])
                self.by_path[node.path] = container
                if container.data():
                    self.added[node.path] = container

    def of(self, *kinds: str) -> list[Container]:
        """Return the project's own containers of the given definitions, in document order.

        What an export put on top of the project plays a schedule; it is no source of that schedule's model.
        """
        return [c for path, c in self.by_path.items() if c.kind in kinds and path not in self.added]

    def own(self, path: str | None) -> str | None:
        """Return the path of a container unless an export put it on top of the project."""
        return None if path in self.added else path

    def beside(self, container: Container, kind: str) -> list[Container]:
        """Return the containers of a definition in the module configuration that holds `container`."""
        inside = (self.by_path.get(node.path) for node in _module_of(container.node).inside(_CONTAINER))
        return [found for found in inside if found is not None and found.kind == kind]

    def below(self, container: Container) -> Iterator[Container]:
        """Yield the container and everything inside it."""
        yield container
        for node in container.node.inside(_CONTAINER):
            if node.path in self.by_path:
                yield from self.below(self.by_path[node.path])


def _module_of(node: Node) -> Node:
    """Return the module configuration that holds a container."""
    while node.parent is not None and node.tag != _MODULE:
        node = node.parent
    return node


def read_configuration(tree: Tree, modules: frozenset[str] | None = None) -> Configuration:
    """Read cores, applications, OS tasks, what triggers them, and the mapping of events to them."""
    containers = Containers(tree, modules)
    cores = _cores(containers)
    applications, numbered = _applications(containers, cores)
    core_of = {task: application.core for application in applications for task in application.tasks}
    tasks = [
        OsTask(container.place, core_of.get(container.node.path), _task_period(container), _schedule(container))
        for container in containers.of("OsTask")
    ]
    return Configuration(
        cores=(*cores.values(), *numbered),
        applications=tuple(applications),
        tasks=tuple(tasks),
        triggers=tuple(_triggers(containers)),
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


# ------------------------------------------------------------------------------------------------- triggers


def _triggers(containers: Containers) -> Iterator[Trigger]:
    ticks = Ticks(containers)
    stopped = {
        group.target(_CONTAINER): group
        for added in containers.added.values()
        for data in added.data()
        for group in data.groups("stopped")
    }
    for alarm in containers.of("OsAlarm"):
        yield from _alarm(containers, alarm, ticks, stopped.get(alarm.node.path))
    for table in containers.of("OsScheduleTable"):
        yield from _expiry_points(containers, table, ticks)


class Ticks:
    """Converts the ticks of counters into time; a counter without a tick duration is reported once."""

    def __init__(self, containers: Containers) -> None:
        self._containers = containers
        self._known: dict[str, Duration | None] = {}
        self._driven: list[Container] = []

    def counter(self, container: Container, name: str) -> tuple[Duration | None, tuple[Place, ...]]:
        """Return the tick of the counter that `container` refers to by `name`, and the counter's place."""
        path = container.target(name)
        counter = self._containers.by_path.get(path or "")
        return (None, ()) if counter is None else (self.of(counter), (counter.place,))

    def of_alarm(self, alarm: Container) -> tuple[Duration | None, tuple[Place, ...]]:
        """Return what an alarm counts, and the counter's place; EB tresos may count nanoseconds instead of ticks."""
        for inside in self._containers.below(alarm):
            unit = inside.value("OsTimeUnit")
            if unit is not None and unit.text == "NANOSECONDS":
                return Duration(1), ()
        return self.counter(alarm, "OsAlarmCounterRef")

    def of(self, counter: Container) -> Duration | None:
        """Return the tick of a counter, None if nothing tells it."""
        if counter.node.path not in self._known:
            self._known[counter.node.path] = self._tick(counter)
        return self._known[counter.node.path]

    def _tick(self, counter: Container) -> Duration | None:
        number = counter.number("OsSecondsPerTick")
        if number:
            return seconds(number)
        systems = self._containers.beside(counter, "OsOS")
        stated = {number for system in systems for number in map(system.number, _FREQUENCIES) if number}
        if len(stated) == 1:
            return seconds(1 / stated.pop())
        alarms = [alarm for alarm in self._containers.of("OsAlarm") if self._increments(alarm, counter)]
        if len(alarms) == 1 and counter not in self._driven:
            self._driven.append(counter)  # counters that drive each other in a circle have no tick
            cycle, tick = _cycle(self._containers, alarms[0]), self.of_alarm(alarms[0])[0]
            if cycle and tick:
                return tick * cycle
        self._containers.tree.findings.add(
            codes.NO_TICK(
                "has no OsSecondsPerTick",
                at=counter.node.at,
                path=named("OsCounter", counter.node.path),
                help="state the duration of a tick, or give periods in the overlay (sources)",
            )
        )
        return None

    def _increments(self, alarm: Container, counter: Container) -> bool:
        inside = self._containers.below(alarm)
        return any(ref.path == counter.node.path for c in inside for ref in c.refs("OsAlarmIncrementCounterRef"))


def _cycle(containers: Containers, alarm: Container) -> Fraction | None:
    """Return the ticks after which an alarm comes again; None if it does not, or is started by code."""
    cycles = (inside.number("OsAlarmCycleTime") for inside in containers.below(alarm))
    return next((cycle for cycle in cycles if cycle), None)


def _ticks(text: str) -> Fraction:
    number = parse_number(text)
    if number is None or number < 0:
        raise ValueError(f"{text[:40]!r} is no number of ticks")
    return number


def _woken(containers: Containers, inside: Iterable[Container], kind: str) -> tuple[str, ...]:
    """Return the tasks that wait for the events set by an action: those it names, else those that list the event."""
    found: dict[str, None] = {}
    for action in inside:
        events = action.targets(f"{kind}SetEventRef")
        named = action.targets(f"{kind}SetEventTaskRef")
        if events and not named:
            named = [
                task.node.path
                for task in containers.of("OsTask")
                if not {ref.path for ref in task.refs("OsTaskEventRef")}.isdisjoint(events)
            ]
        found.update(dict.fromkeys(named))
    return tuple(found)


def _alarm(containers: Containers, alarm: Container, ticks: Ticks, stopped: Data | None) -> Iterator[Trigger]:
    """Yield what an alarm does again and again; one that a schedule table replaces did what its table remembers."""
    inside = list(containers.below(alarm))
    cycle = _cycle(containers, alarm) or (stopped.value("cycle", _ticks) if stopped else None)
    if not cycle:
        return
    tick, through = ticks.of_alarm(alarm)
    if tick is None:
        return
    start = next((n for n in (c.number("OsAlarmAlarmTime") for c in inside) if n), None)
    if stopped and start is None:
        start = stopped.value("start", _ticks)
    yield Trigger(
        place=alarm.place,
        period=tick * cycle,
        offset=tick * (start or 0),
        tasks=tuple(path for c in inside for path in c.targets("OsAlarmActivateTaskRef")),
        events=tuple(path for c in inside for path in c.targets("OsAlarmSetEventRef")),
        through=through,
        wakes=_woken(containers, inside, "OsAlarm"),
    )


def _expiry_points(containers: Containers, table: Container, ticks: Ticks) -> Iterator[Trigger]:
    repeating = table.value("OsScheduleTableRepeating")
    duration = table.number("OsScheduleTableDuration")
    if not duration:
        return
    if repeating is None or repeating.text.lower() not in ("true", "1"):
        containers.tree.findings.add(
            codes.SINGLE_SHOT(
                "is not repeating, so that it gives no task a period",
                at=repeating.at if repeating else table.node.at,
                path=named("OsScheduleTable", table.node.path),
            )
        )
        return
    tick, through = ticks.counter(table, "OsScheduleTableCounterRef")
    if tick is None:
        return
    for point in containers.below(table):
        if point.kind != "OsScheduleTableExpiryPoint":
            continue
        inside = list(containers.below(point))
        yield Trigger(
            place=point.place,
            period=tick * duration,
            offset=tick * (point.number("OsScheduleTblExpPointOffset") or 0),
            tasks=tuple(path for c in inside for path in c.targets("OsScheduleTableActivateTaskRef")),
            events=tuple(path for c in inside for path in c.targets("OsScheduleTableSetEventRef")),
            through=(*through, table.place),
            wakes=_woken(containers, inside, "OsScheduleTable"),
        )


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


def container_kinds(tree: Tree) -> dict[str, str]:
    """Return the short name of the definition of every container of Os, Rte and EcuC, by the container's path."""
    return {path: container.kind for path, container in Containers(tree).by_path.items()}


def symbolic_values(tree: Tree) -> dict[str, list[Stated]]:
    """Return the values of every numerical ECU configuration parameter by the short name of its definition.

    Some BSW module descriptions state a period as the name of the parameter that holds it.
    """
    found = {name: [Stated(text.value, text.at) for text in texts] for name, texts in tree.symbols.items()}
    for node in tree.tagged(_CONTAINER):
        for element, file in node.elements("PARAMETER-VALUES/*"):
            name = _last(element.findtext(NS + "DEFINITION-REF"))
            text = (element.findtext(NS + "VALUE") or "").strip()
            if name and text:
                found.setdefault(name, []).append(Stated(text, place(element, file)))
    return found
