"""The ECU configuration of EcuC, Os and Rte: cores, applications, OsTasks, counters, schedule tables, mappings.

A mapping names one expiry point at most, though a task may start at several; its OsTask is activated by all of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.exporters.arxml.document import (
    CONTAINER,
    Module,
    add,
    group,
    is_from,
    named,
    ref,
    sd,
    sdx,
    seconds_text,
    special,
)
from halpipe.exporters.arxml.software import ShortNames
from halpipe.exporters.arxml.tables import DEFAULT_START, SYSTEM

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lxml import etree

    from halpipe.exporters.arxml.document import Container
    from halpipe.exporters.arxml.software import Layout
    from halpipe.exporters.arxml.tables import Plan, Table, Work
    from halpipe.exporters.arxml.ticks import Hold
    from halpipe.models import Task, TaskModel

PACKAGE = "Ecu"
_POINT = "OsScheduleTableExpiryPoint"
_HOOKS = ("Error", "Shutdown", "Startup")
_SYMBOLIC = "ECUC-SYMBOLIC-NAME-REFERENCE-DEF"


class OsNames:
    """Short names and paths of the containers of the Os, which the Rte refers to."""

    def __init__(self, plan: Plan, layout: Layout) -> None:
        self.base = layout.path(PACKAGE)
        self.layout = layout
        events = (event for found in plan.events.values() for event in found.values())
        taken = (*plan.tasks, *plan.idle.values(), *events, *(table.name for table in plan.tables))
        names = ShortNames(SYSTEM, DEFAULT_START, *taken)
        self.counters = {unit: names("Counter", layout.units[unit]) for unit in plan.units}
        self.applications = {unit: names("Application", layout.units[unit]) for unit in plan.units}
        modes = dict.fromkeys(table.mode for table in plan.tables if table.is_repeating)
        self.starts = {mode: names("Start", layout.modes[mode]) for mode in modes}

    def path(self, name: str) -> str:
        """Return the path of a container of the Os."""
        return f"{self.base}/Os/{name}"

    def core(self, unit: str) -> str:
        """Return the path of the core of a unit."""
        return f"{self.base}/EcuC/EcucHardware/{self.layout.units[unit]}"

    def point(self, table: Table, offset: int) -> str:
        """Return the path of an expiry point."""
        return self.path(f"{table.name}/{point_name(offset)}")


def point_name(offset: int) -> str:
    """Return the short name of the expiry point at an offset."""
    return f"At_{offset}"


def write_cores(elements: etree._Element, plan: Plan, layout: Layout, prefix: str) -> None:
    """Append the configuration of EcuC: the cores, numbered as the units are ordered."""
    module = Module(elements, "EcuC", prefix, layout.path(PACKAGE))
    hardware = module.container("EcucHardware", "EcucHardware")
    hardware.define()
    for number, unit in enumerate(plan.units):
        hardware.inside("EcucCoreDefinition", layout.units[unit]).integer("EcucCoreId", number)


def write_collection(elements: etree._Element, layout: Layout) -> None:
    """Append the list of the configured modules, which says of which system they are."""
    collection = named(elements, "ECUC-VALUE-COLLECTION", "EcuConfiguration")
    ref(collection, "ECU-EXTRACT-REF", "SYSTEM", layout.path("System", "System"))
    values = add(collection, "ECUC-VALUES")
    for module in ("EcuC", "Os", "Rte"):
        entry = add(values, "ECUC-MODULE-CONFIGURATION-VALUES-REF-CONDITIONAL")
        path = layout.path(PACKAGE, module)
        ref(entry, "ECUC-MODULE-CONFIGURATION-VALUES-REF", "ECUC-MODULE-CONFIGURATION-VALUES", path)


def write_os(elements: etree._Element, plan: Plan, names: OsNames, prefix: str, release: str) -> None:
    """Append the configuration of the Os."""
    module = Module(elements, "Os", prefix, names.base)
    system = module.container("OsOS", SYSTEM)
    system.define()
    system.integer("OsNumberOfCores", len(plan.units))
    for name in ("OsStackMonitoring", "OsUseGetServiceId", "OsUseParameterAccess", "OsUseResScheduler"):
        system.flag(name, value=False)
    system.choice("OsStatus", "STANDARD")
    _hooks(system, "OsHooks", "Os", (*_HOOKS, "PostTask", "PreTask", "Protection"))
    for start in (DEFAULT_START, *names.starts.values()):
        module.container("OsAppMode", start).define()
    for name in (*plan.tasks, *plan.idle.values()):
        _task(module, name, plan, names)
    for found in plan.events.values():
        for event in found.values():
            module.container("OsEvent", event).define()
    for unit in plan.units:
        _counter(module, names.counters[unit], plan)
    for table in plan.tables:
        _table(module, table, plan, names)
    for number, unit in enumerate(plan.units):
        _application(module, unit, number, plan, names, release)


def _hooks(container: Container, kind: str, prefix: str, hooks: Iterable[str]) -> None:
    """Append that there are no hooks, each of which generators want to be told."""
    inside = container.inside(kind, kind)
    for hook in hooks:
        inside.flag(f"{prefix}{hook}Hook", value=False)


def _task(module: Module, name: str, plan: Plan, names: OsNames) -> None:
    """Append an OsTask; it runs to its end, or to where it is held, as the schedule has it.

    With one priority for all, late ones queue. Only an OsTask that is split anywhere is preempted, by those above it.
    """
    layout, work = names.layout, plan.tasks.get(name)
    events = plan.events.get(name, {})
    container = module.container("OsTask", name)
    if work is not None:
        data = special(container.element, "work")
        sdx(data, "RUNNABLE-ENTITY", layout.runnable(work.task))
        for version in work.versions:
            sdx(data, "SWC-IMPLEMENTATION", layout.implementation(work.task, version))
        sdx(data, "HW-ELEMENT", layout.unit(work.unit))
        for hold, event in events.items():
            _hold(group(data, "hold"), hold, event, work, names)
        for higher in plan.above.get(name, ()):
            sdx(group(data, "below"), CONTAINER, names.path(higher))
    container.define()
    container.integer("OsTaskActivation", 1)
    container.integer("OsTaskPriority", plan.priorities.get(name, 1))
    container.choice("OsTaskSchedule", "FULL" if name in plan.above else "NON")
    for event in events.values():
        container.refer("OsTaskEventRef", names.path(event))


def _hold(data: etree._Element, hold: Hold, event: str, work: Work, names: OsNames) -> None:
    """Append where an OsTask is held: it waits for an event, and clears it, when so much of its work is done."""
    sd(data, "at", hold.position)
    sdx(data, CONTAINER, names.path(event))
    if len(work.versions) > 1:
        sdx(data, "SWC-IMPLEMENTATION", names.layout.implementation(work.task, hold.version))


def _counter(module: Module, name: str, plan: Plan) -> None:
    counter = module.container("OsCounter", name)
    text, exact = seconds_text(plan.counter.tick)
    if not exact:
        sd(special(counter.element, "counter"), "tick", plan.counter.tick)
    counter.define()
    counter.integer("OsCounterMaxAllowedValue", plan.counter.max_value)
    counter.integer("OsCounterMinCycle", plan.counter.min_cycle)
    counter.integer("OsCounterTicksPerBase", 1)
    counter.number("OsSecondsPerTick", text)
    counter.choice("OsCounterType", "HARDWARE")


def _application(module: Module, unit: str, number: int, plan: Plan, names: OsNames, release: str) -> None:
    application = module.container("OsApplication", names.applications[unit])
    application.define()
    has_cores = is_from(release, "4.2.2")
    application.flag("OsTrusted", value=False)
    if not has_cores:
        application.integer("OsApplicationCoreAssignment", number)
    for name, work in plan.tasks.items():
        if work.unit == unit:
            application.refer("OsAppTaskRef", names.path(name))
    if unit in plan.idle:
        application.refer("OsAppTaskRef", names.path(plan.idle[unit]))
    application.refer("OsAppCounterRef", names.path(names.counters[unit]))
    for table in plan.tables:
        if table.unit == unit:
            application.refer("OsAppScheduleTableRef", names.path(table.name))
    if has_cores:
        application.refer("OsApplicationCoreRef", names.core(unit), definition=_SYMBOLIC)
    _hooks(application, "OsApplicationHooks", "OsApp", _HOOKS)


# ------------------------------------------------------------------------------------------------------ tables


def _table(module: Module, table: Table, plan: Plan, names: OsNames) -> None:
    container = module.container("OsScheduleTable", table.name)
    _succession(container, table, plan, names)
    container.define()
    container.integer("OsScheduleTableDuration", table.duration)
    container.flag("OsScheduleTableRepeating", value=table.is_repeating)
    container.refer("OsScheduleTableCounterRef", names.path(names.counters[table.unit]))
    container.refer("OsSchTblAccessingApplication", names.path(names.applications[table.unit]))
    if table.is_repeating:
        _autostart(container, table, plan, names)
    for point in table.points:
        at = container.inside(_POINT, point_name(point.offset))
        at.integer("OsScheduleTblExpPointOffset", point.offset)
        for task, version in zip(point.tasks, point.versions, strict=True):
            action = at.inside("OsScheduleTableTaskActivation", task, defined=False)
            work = plan.tasks.get(task)
            if work is not None and len(work.versions) > 1:
                data = special(action.element, "activation")
                sdx(data, "SWC-IMPLEMENTATION", names.layout.implementation(work.task, version))
            action.define()
            action.refer("OsScheduleTableActivateTaskRef", names.path(task))
        for task, event in point.events:
            action = at.inside("OsScheduleTableEventSetting", event)
            action.refer("OsScheduleTableSetEventRef", names.path(event))
            action.refer("OsScheduleTableSetEventTaskRef", names.path(task))


def _autostart(container: Container, table: Table, plan: Plan, names: OsNames) -> None:
    """Autostart the first mode, or another one where StartOS names it; never at 0, which means now."""
    start = container.inside("OsScheduleTableAutostart", "OsScheduleTableAutostart")
    start.choice("OsScheduleTableAutostartType", "ABSOLUTE")
    start.integer("OsScheduleTableStartValue", plan.counter.min_cycle)
    if table.mode == next(iter(names.starts)):
        start.refer("OsScheduleTableAppModeRef", names.path(DEFAULT_START))
    start.refer("OsScheduleTableAppModeRef", names.path(names.starts[table.mode]))


def _succession(container: Container, table: Table, plan: Plan, names: OsNames) -> None:
    """Append what a table is of, and what NextScheduleTable lets follow it, for which AUTOSAR has no parameter."""
    data = special(container.element, "table")
    sd(data, "mode", table.mode)
    sd(data, "target", table.target or None)
    targets = [table.target] if table.target else [target for source, target in plan.switches if source == table.mode]
    for target in targets:
        switch = None if table.target else plan.table(table.unit, table.mode, target)
        follower = switch or plan.table(table.unit, target)
        if follower is not None:
            inner = group(data, "next")
            sdx(inner, CONTAINER, names.path(follower.name))
            sd(inner, "target", target)


def write_rte(
    elements: etree._Element, model: TaskModel, plan: Plan, layout: Layout, names: OsNames, prefix: str, release: str
) -> None:
    """Append the configuration of the Rte for every periodic task; those on demand have no event to map."""
    points: dict[str, str] = {}
    for table in plan.tables:
        for point in table.points:
            for name in point.tasks:
                points.setdefault(name, names.point(table, point.offset))
    os_tasks: dict[str, list[str]] = {}
    for name, work in plan.tasks.items():
        os_tasks.setdefault(work.task, []).append(name)
    module = Module(elements, "Rte", prefix, layout.path(PACKAGE))
    _write_general(module, release)
    for task in model.tasks:
        if task.period is None or task.name not in os_tasks:
            continue
        instance = module.container("RteSwComponentInstance", layout.tasks[task.name])
        instance.define()
        instance.refer_outside("RteSoftwareComponentInstanceRef", layout.prototype(task.name), "SW-COMPONENT-PROTOTYPE")
        for name in os_tasks[task.name]:
            _mapping(instance, task, name, points[name], layout, names)


def _mapping(instance: Container, task: Task, name: str, point: str, layout: Layout, names: OsNames) -> None:
    mapping = instance.inside("RteEventToTaskMapping", name)
    mapping.integer("RtePositionInTask", 1)
    mapping.flag("RteImmediateRestart", value=False)
    mapping.refer_outside("RteEventRef", layout.event(task.name), "TIMING-EVENT")
    mapping.refer("RteMappedToTaskRef", names.path(name))
    mapping.refer("RteUsedOsSchTblExpiryPointRef", point)


def _write_general(module: Module, release: str) -> None:
    """Append what every configuration of the Rte has to state, and nothing here depends on."""
    general = module.container("RteBswGeneral", "RteBswGeneral")
    general.define()
    for name in ("RteSchMVersionInfoApi", "RteUseComShadowSignalApi"):
        general.flag(name, value=False)
    generation = module.container("RteGeneration", "RteGeneration")
    generation.define()
    generation.choice("RteCalibrationSupport", "NONE")
    generation.integer("RteCodeVendorId", 0)
    for name in ("DevErrorDetect", "DevErrorDetectUninit", "MeasurementSupport", "ValueRangeCheckEnabled"):
        generation.flag(f"Rte{name}", value=False)
    generation.flag("RteVfbTraceEnabled", value=False)
    generation.choice("RteGenerationMode", "COMPATIBILITY_MODE")
    generation.choice("RteOptimizationMode", "RUNTIME")
    if is_from(release, "4.2.2"):
        generation.choice("RteIocInteractionReturnValue", "RTE_IOC")
    start = module.container("RteInitializationBehavior", "RteInitializationBehavior")
    start.define()
    start.choice("RteInitializationStrategy", "RTE_INITIALIZATION_STRATEGY_AT_DATA_DECLARATION")
    start.text("RteSectionInitializationPolicy", "INIT")
    module.container("RteOsInteraction", "RteOsInteraction").define()
