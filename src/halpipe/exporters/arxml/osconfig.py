"""The ECU configuration of EcuC, Os and Rte: cores, applications, OsTasks, counters, schedule tables, mappings.

A mapping names one expiry point at most, though a task may start at several; its OsTask is activated by all of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.grouping import grouped
from halpipe.exporters.arxml.document import (
    CONTAINER,
    MODULE,
    MODULE_DEF,
    Box,
    add,
    group,
    is_from,
    named,
    ref,
    sd,
    sdx,
    seconds_text,
    write_box,
)
from halpipe.exporters.arxml.software import Layout, ShortNames
from halpipe.exporters.arxml.tables import DEFAULT_START, SYSTEM, Plan, Table, Work
from halpipe.exporters.arxml.ticks import begin_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lxml import etree

    from halpipe.core.diagnostics import Findings
    from halpipe.exporters.arxml.definitions import Definitions
    from halpipe.exporters.arxml.ticks import Hold
    from halpipe.models import TaskModel

PACKAGE = "Ecu"
_POINT = "OsScheduleTableExpiryPoint"
_HOOKS = ("Error", "Shutdown", "Startup")
_OFF = dict.fromkeys(("OsStackMonitoring", "OsUseGetServiceId", "OsUseParameterAccess", "OsUseResScheduler"), False)
_VARIANTS, _VARIANT = "RtePostBuildVariantConfiguration", "RtePostBuildUsedPredefinedVariant"
_SYMBOLIC = "ECUC-SYMBOLIC-NAME-REFERENCE-DEF"


class OsNames:
    """Short names and paths of the containers of the Os, which the Rte refers to."""

    def __init__(self, plan: Plan, layout: Layout, prefix: str, definitions: Definitions, findings: Findings) -> None:
        self.base = layout.path(PACKAGE)
        self.layout = layout
        self.definitions = definitions
        self._findings = findings
        self._prefix = prefix
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

    def module(self, name: str) -> Box:
        """Start the configuration of a module."""
        known = self.definitions.of(name)
        return Box(f"{self.base}/{name}", known.path if known else f"{self._prefix}/{name}", MODULE_DEF, is_new=True)

    def write(self, elements: etree._Element, box: Box) -> None:
        """Append the configuration of a module, with what its definition, if there is one, demands."""
        self.definitions.complete(box, self._findings)
        write_box(elements, box, self.layout.texts)

    def core(self, unit: str) -> str:
        """Return the path of the core of a unit."""
        return f"{self.base}/EcuC/EcucHardware/{self.layout.units[unit]}"

    def point(self, table: Table, offset: int) -> str:
        """Return the path of an expiry point."""
        return self.path(f"{table.name}/{point_name(offset)}")


def point_name(offset: int) -> str:
    """Return the short name of the expiry point at an offset."""
    return f"At_{offset}"


def write_cores(elements: etree._Element, plan: Plan, names: OsNames) -> None:
    """Append the configuration of EcuC: the cores, numbered as the units are ordered."""
    cores = names.module("EcuC")
    if names.definitions.has("EcuC/EcucHardware", otherwise=True):
        hardware = cores.new("EcucHardware", "EcucHardware")
        for number, unit in enumerate(plan.units):
            hardware.new(names.layout.units[unit], "EcucCoreDefinition").fill(EcucCoreId=number)
    names.write(elements, cores)


def write_collection(elements: etree._Element, layout: Layout) -> None:
    """Append the list of the configured modules, which says of which system they are."""
    collection = named(elements, "ECUC-VALUE-COLLECTION", "EcuConfiguration")
    ref(collection, "ECU-EXTRACT-REF", "SYSTEM", layout.path("System", "System"))
    values = add(collection, "ECUC-VALUES")
    for name in ("EcuC", "Os", "Rte"):
        entry = add(values, f"{MODULE}-REF-CONDITIONAL")
        ref(entry, f"{MODULE}-REF", MODULE, layout.path(PACKAGE, name))


def write_os(elements: etree._Element, plan: Plan, names: OsNames, release: str) -> None:
    """Append the configuration of the Os."""
    os_module = names.module("Os")
    system = os_module.new(SYSTEM, "OsOS").fill(OsNumberOfCores=len(plan.units), **_OFF, OsStatus="STANDARD")
    _hooks(system, "OsHooks", "Os", (*_HOOKS, "PostTask", "PreTask", "Protection"))
    for start in (DEFAULT_START, *names.starts.values()):
        os_module.new(start, "OsAppMode")
    for name in (*plan.tasks, *plan.idle.values()):
        _task(os_module, name, plan, names)
    for found in plan.events.values():
        for event in found.values():
            os_module.new(event, "OsEvent")
    for unit in plan.units:
        _counter(os_module, names.counters[unit], plan)
    for table in plan.tables:
        _table(os_module, table, plan, names)
    for number, unit in enumerate(plan.units):
        _application(os_module, unit, number, plan, names, release)
    names.write(elements, os_module)


def _hooks(box: Box, kind: str, prefix: str, hooks: Iterable[str]) -> None:
    """Append that there are no hooks, each of which generators need to read."""
    box.new(kind, kind).fill(**{f"{prefix}{hook}Hook": False for hook in hooks})


def _task(os_module: Box, name: str, plan: Plan, names: OsNames) -> None:
    """Append an OsTask; it runs to its end, or to where it is held, as the schedule has it.

    With one priority for all, late ones queue. Only an OsTask that is split anywhere is preempted, by those above it.
    """
    layout, work = names.layout, plan.tasks.get(name)
    events = plan.events.get(name, {})
    box = os_module.new(name, "OsTask")
    if work is not None:
        data = box.special("work")
        sdx(data, "RUNNABLE-ENTITY", layout.runnable(work.task))
        for version in work.versions:
            sdx(data, "SWC-IMPLEMENTATION", layout.implementation(work.task, version))
        sdx(data, "HW-ELEMENT", layout.unit(work.unit))
        for hold, event in events.items():
            _hold(group(data, "hold"), hold, event, work, names)
        for higher in plan.above.get(name, ()):
            sdx(group(data, "below"), CONTAINER, names.path(higher))
    box.fill(OsTaskActivation=2 if name in plan.queued else 1, OsTaskPriority=plan.priorities.get(name, 1))
    box.fill(OsTaskSchedule="FULL" if name in plan.above else "NON")
    for event in events.values():
        box.refer("OsTaskEventRef", names.path(event))


def _hold(data: etree._Element, hold: Hold, event: str, work: Work, names: OsNames) -> None:
    """Append where an OsTask is held: it waits for an event, and clears it, when so much of its work is done."""
    sd(data, "at", hold.position)
    sdx(data, CONTAINER, names.path(event))
    if len(work.versions) > 1:
        sdx(data, "SWC-IMPLEMENTATION", names.layout.implementation(work.task, hold.version))


def _counter(os_module: Box, name: str, plan: Plan) -> None:
    text, exact = seconds_text(plan.counter.tick)
    box = os_module.new(name, "OsCounter")
    if not exact:
        sd(box.special("counter"), "tick", plan.counter.tick)
    fill_counter(box, plan.counter.max_value, plan.counter.min_cycle, text)


def fill_counter(box: Box, max_value: int, min_cycle: int, tick: str) -> None:
    """State the parameters of a counter, with its tick in seconds."""
    box.fill(OsCounterMaxAllowedValue=max_value, OsCounterMinCycle=min_cycle, OsCounterTicksPerBase=1)
    box.number("OsSecondsPerTick", tick)
    box.fill(OsCounterType="HARDWARE")


def _application(os_module: Box, unit: str, number: int, plan: Plan, names: OsNames, release: str) -> None:
    box = os_module.new(names.applications[unit], "OsApplication").fill(OsTrusted=False)
    core_ref = "Os/OsApplication/OsApplicationCoreRef"
    has_cores = names.definitions.has(core_ref, otherwise=is_from(release, "4.2.2"))
    if not has_cores:
        box.fill(OsApplicationCoreAssignment=number)
    for name, work in plan.tasks.items():
        if work.unit == unit:
            box.refer("OsAppTaskRef", names.path(name))
    if unit in plan.idle:
        box.refer("OsAppTaskRef", names.path(plan.idle[unit]))
    box.refer("OsAppCounterRef", names.path(names.counters[unit]))
    for table in plan.tables:
        if table.unit == unit:
            box.refer("OsAppScheduleTableRef", names.path(table.name))
    if has_cores:
        box.refer("OsApplicationCoreRef", names.core(unit), definition=_SYMBOLIC)
    _hooks(box, "OsApplicationHooks", "OsApp", _HOOKS)


# ------------------------------------------------------------------------------------------------------ tables


def _table(os_module: Box, table: Table, plan: Plan, names: OsNames) -> None:
    box = os_module.new(table.name, "OsScheduleTable")
    _succession(box, table, plan, names)
    box.fill(OsScheduleTableDuration=table.duration, OsScheduleTableRepeating=table.is_repeating)
    box.refer("OsScheduleTableCounterRef", names.path(names.counters[table.unit]))
    box.refer("OsSchTblAccessingApplication", names.path(names.applications[table.unit]))
    if table.is_repeating:  # the first mode begins by itself, another one where StartOS names it
        first = [DEFAULT_START] if table.mode == next(iter(names.starts)) else []
        begin = plan.counter.ticks(begin_of([plan.counter]))
        autostart(box, begin, [names.path(mode) for mode in (*first, names.starts[table.mode])])
    for point in table.points:
        at = box.new(point_name(point.offset), _POINT).fill(OsScheduleTblExpPointOffset=point.offset)
        for task, version in zip(point.tasks, point.versions, strict=True):
            action = at.new(task, "OsScheduleTableTaskActivation")
            work = plan.tasks.get(task)
            if work is not None and len(work.versions) > 1:
                data = action.special("activation")
                sdx(data, "SWC-IMPLEMENTATION", names.layout.implementation(work.task, version))
            action.refer("OsScheduleTableActivateTaskRef", names.path(task))
        for task, event in point.events:
            action = at.new(event, "OsScheduleTableEventSetting")
            action.refer("OsScheduleTableSetEventRef", names.path(event))
            action.refer("OsScheduleTableSetEventTaskRef", names.path(task))


def autostart(table: Box, value: int, modes: Iterable[str]) -> None:
    """Start a table by itself in some application modes (paths), at a value of its counter."""
    box = table.new("OsScheduleTableAutostart", "OsScheduleTableAutostart")
    box.fill(OsScheduleTableAutostartType="ABSOLUTE", OsScheduleTableStartValue=value)
    for mode in modes:
        box.refer("OsScheduleTableAppModeRef", mode)


def _succession(box: Box, table: Table, plan: Plan, names: OsNames) -> None:
    """Append what a table is of, and what NextScheduleTable lets follow it, for which AUTOSAR has no parameter."""
    data = box.special("table")
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


# --------------------------------------------------------------------------------------------------------- Rte


def write_rte(elements: etree._Element, model: TaskModel, plan: Plan, names: OsNames, release: str) -> None:
    """Append the configuration of the Rte for every periodic task; those on demand have no event to map."""
    layout = names.layout
    points: dict[str, str] = {}
    for table in plan.tables:
        for point in table.points:
            for name in point.tasks:
                points.setdefault(name, names.point(table, point.offset))
    os_tasks = grouped((work.task, name) for name, work in plan.tasks.items())
    rte = names.module("Rte")
    _fill_general(rte, names.definitions, release)
    if names.definitions.has(
        f"Rte/{_VARIANTS}/{_VARIANT}", otherwise=False
    ):  # the configuration has one variant, of no criteria
        named(elements, "PREDEFINED-VARIANT", "Only")
        variants = rte.new(_VARIANTS, _VARIANTS)
        _foreign(variants, _VARIANT, f"{names.base}/Only", "PREDEFINED-VARIANT")
    for task in model.tasks:
        if task.period is None or task.name not in os_tasks:
            continue
        box, prototype = rte.new(layout.tasks[task.name], "RteSwComponentInstance"), layout.prototype(task.name)
        _foreign(box, "RteSoftwareComponentInstanceRef", prototype, "SW-COMPONENT-PROTOTYPE")
        for name in os_tasks[task.name]:
            mapping = box.new(name, "RteEventToTaskMapping").fill(RtePositionInTask=1, RteImmediateRestart=False)
            _foreign(mapping, "RteEventRef", layout.event(task.name), "TIMING-EVENT")
            mapping.refer("RteMappedToTaskRef", names.path(name))
            mapping.refer("RteUsedOsSchTblExpiryPointRef", points[name])
    names.write(elements, rte)


def _foreign(box: Box, name: str, path: str, dest: str) -> None:
    """Append a reference to an element of the system."""
    box.refer(name, path, definition="ECUC-FOREIGN-REFERENCE-DEF", dest=dest)


def _fill_general(rte: Box, definitions: Definitions, release: str) -> None:
    """Append what every configuration of the Rte has to state, and nothing here depends on."""
    rte.new("RteBswGeneral", "RteBswGeneral").fill(RteSchMVersionInfoApi=False, RteUseComShadowSignalApi=False)
    generation = rte.new("RteGeneration", "RteGeneration").fill(RteCalibrationSupport="NONE", RteCodeVendorId=0)
    checks = ("DevErrorDetect", "DevErrorDetectUninit", "MeasurementSupport", "ValueRangeCheckEnabled")
    generation.fill(**{f"Rte{name}": False for name in checks}, RteVfbTraceEnabled=False)
    generation.fill(RteGenerationMode="COMPATIBILITY_MODE", RteOptimizationMode="RUNTIME")
    if definitions.has("Rte/RteGeneration/RteIocInteractionReturnValue", otherwise=is_from(release, "4.2.2")):
        generation.fill(RteIocInteractionReturnValue="RTE_IOC")
    start = rte.new("RteInitializationBehavior", "RteInitializationBehavior")
    start.fill(RteInitializationStrategy="RTE_INITIALIZATION_STRATEGY_AT_DATA_DECLARATION")
    start.text("RteSectionInitializationPolicy", "INIT")
    rte.new("RteOsInteraction", "RteOsInteraction")
