"""ECU configuration of Os, Rte and EcuC: cores, OsTasks, event mappings, and the periodic triggers of the OS.

Triggers are alarms and expiry points of repeating schedule tables, in ticks of their counters."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import named
from halpipe.core.durations import Duration, seconds
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.words import parse_number
from halpipe.importers.arxml.system.containers import Container, Containers, Data
from halpipe.importers.arxml.system.values import (
    Configuration,
    Core,
    EventMapping,
    OsApplication,
    OsIsr,
    OsTask,
    Place,
    RteInstance,
    Trigger,
)
from halpipe.models.project import Deed

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    from halpipe.importers.arxml.files.tree import Stated, Tree

_PREFIXES, _CAUSES = ("Rte", "RteBsw"), ("SchTblExpiryPoint", "Alarm", "Event")
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
        spinlocks=tuple(_spinlocks(containers, applications)),
        kinds=containers.kinds,
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
    found: list[Stated] = []
    todo = [application]
    for container in todo:
        for target in container.stated(
            "OsApplicationCoreRef", "OsCoreEcucCoreRef", "OsAppEcucPartitionRef", "EcucPartitionCoreRef"
        ):
            step = containers.by_path.get(target.text)
            if target.text in cores:
                found.append(target)
            elif step is not None and step not in todo:
                todo.append(step)
    core = containers.tree.agreed(application.node, "core", found)
    return cores[core.text] if core else None


def _task(containers: Containers, container: Container, core: str | None) -> OsTask:
    kind = container.value("OsTaskType")
    name = "OsTaskExecutionBudget"
    inside = next((found for found in containers.below(container) if found.value(name)), None)
    schedule = container.value("OsTaskSchedule")
    return OsTask(
        container.place,
        core,
        container.time("OsTaskPeriod"),
        schedule.text if schedule is not None and schedule.text in ("FULL", "NON") else "",
        is_basic=(kind is None or kind.text == "BASIC") and not container.refs("OsTaskEventRef"),
        budget=inside.time(name) if inside else None,
        protection=inside.place if inside else None,
        resources=tuple(
            Place(path, "OsResource", containers.by_path[path].node.at)
            for path in dict.fromkeys(_linked(containers, path) for path in container.targets("OsTaskResourceRef"))
            if path in containers.by_path
        ),
    )


def _linked(containers: Containers, path: str) -> str:
    """Return the OsResource that a linked one stands for: both are one lock."""
    seen: set[str] = set()
    while path in containers.by_path and path not in seen:
        seen.add(path)
        path = containers.by_path[path].target("OsResourceLinkedResourceRef") or path
    return path


def _spinlocks(
    containers: Containers, applications: Iterable[OsApplication]
) -> Iterator[tuple[Place, tuple[str, ...]]]:
    """Yield the spinlocks of which it is clear who takes them: each accessing OsApplication has one OsTask."""
    inside = {application.place.path: application for application in applications}
    for container in containers.of("OsSpinlock"):
        found = [inside[path] for path in container.targets("OsSpinlockAccessingApplication") if path in inside]
        if found and all(len(application.tasks) == 1 and not application.routines for application in found):
            yield container.place, tuple(task for application in found for task in application.tasks)


def _routines(containers: Containers, applications: Iterable[OsApplication]) -> Iterator[OsIsr]:
    """Yield the interrupt routines, with what their timing protection says."""
    core_of = {path: application.core for application in applications for path in application.routines}
    for container in containers.of("OsIsr"):
        inside = list(containers.below(container))
        budget, frame = (
            next((time for inner in inside if (time := inner.time(name))), None)
            for name in ("OsIsrExecutionBudget", "OsIsrTimeFrame")
        )
        yield OsIsr(container.place, core_of.get(container.node.path), budget, frame)


# ------------------------------------------------------------------------------------------------- mappings


def _mappings(containers: Containers) -> Iterator[EventMapping]:
    for container in containers.of("RteEventToTaskMapping", "RteBswEventToTaskMapping"):
        position = container.number("RtePositionInTask") if "Bsw" not in container.kind else None
        if position is None:
            position = container.number("RteBswPositionInTask")
        yield EventMapping(
            place=container.place,
            prototype=_prototype(containers, container),
            event=container.target("RteEventRef", "RteBswEventRef"),
            task=containers.own(container.target("RteMappedToTaskRef", "RteBswMappedToTaskRef")),
            position=int(position) if position is not None else None,
            offset=container.value("RteActivationOffset") or container.value("RteBswActivationOffset"),
            period=next(filter(None, map(container.value, _PERIODS)), None),
            is_called=bool(container.refs("RteMappedToTaskRef", "RteBswMappedToTaskRef")),
            triggers=tuple(
                container.targets(*(f"{prefix}UsedOs{what}Ref" for what in _CAUSES for prefix in _PREFIXES))
            ),
        )


def _instances(containers: Containers) -> Iterator[RteInstance]:
    for container in containers.of("RteSwComponentInstance"):
        if named := _named(containers, container):
            events = [event.path for inside in containers.below(container) for event in inside.refs("RteEventRef")]
            yield RteInstance(place=container.place, prototype=named.text, at=named.at, events=tuple(events))


def _named(containers: Containers, instance: Container) -> Stated | None:
    """Return the prototype that an instance of the Rte names, which files need not define."""
    name = "RteSoftwareComponentInstanceRef"
    return containers.tree.agreed(instance.node, name, (ref.stated for ref in instance.refs(name)))


def _prototype(containers: Containers, mapping: Container) -> str | None:
    owner = containers.by_path.get(mapping.node.parent.path) if mapping.node.parent is not None else None
    named = _named(containers, owner) if owner is not None else None
    return named.text if named else None


_CONTAINER = "ECUC-CONTAINER-VALUE"
_POINT = "OsScheduleTableExpiryPoint"
_COUNTER = "OsScheduleTableCounterRef"
_DEFAULT_MODE = "OSDEFAULTAPPMODE"
_FREQUENCIES = ("OsTickFrequency", "ArcOsTickFrequency")  # of the OsOS of some vendors, in ticks per second


def read_triggers(containers: Containers) -> Iterator[Trigger]:
    """Yield every alarm that recurs, and every expiry point of the tables that run together."""
    ticks = Ticks(containers)
    stopped = {
        group.target(_CONTAINER): group
        for added in containers.added.values()
        for data in added.data()
        for group in data.groups("stopped")
    }
    elsewhere = started_elsewhere(containers)
    for starter in elsewhere:
        message = "is started in another application mode only, and left out"
        help = "schedule each application mode on its own, or state periods in the overlay (sources)"
        starter.place.report(containers.tree.findings, codes.OTHER_START, message, help=help)
    for alarm in containers.of("OsAlarm"):
        if alarm in elsewhere:
            continue
        yield from _alarm(containers, alarm, ticks, stopped.get(alarm.node.path))
    for table in _running(containers, stopped, elsewhere):
        yield from _expiry_points(table, containers, ticks, stopped.get(table.node.path))


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
        if tick := counter.time("OsSecondsPerTick"):
            return tick
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
        message = "has no OsSecondsPerTick"
        help = "state the duration of a tick, or give periods in the overlay (sources)"
        counter.place.report(self._containers.tree.findings, codes.NO_TICK, message, help=help)
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


def deeds_of(containers: Containers, container: Container) -> Iterator[Deed]:
    """Yield what an alarm, table or expiry point does to OsTasks, an empty one where no OsTask waits for an event.

    The tasks that an event wakes are those that the action names, else those that list the event.
    """
    point = ""
    for inside in containers.below(container):
        path = inside.node.path
        point = path if inside.kind == _POINT else point
        for prefix in ("OsAlarm", "OsScheduleTable"):
            if task := inside.target(f"{prefix}ActivateTaskRef"):
                yield Deed(path, task, point)
            stated = (ref.stated for ref in inside.refs(f"{prefix}SetEventRef"))
            if event := containers.tree.agreed(inside.node, f"{prefix}SetEventRef", stated):
                named = inside.target(f"{prefix}SetEventTaskRef")
                waiting = [task for task, events in containers.waits.items() if event.text in events]
                yield from (Deed(path, task, point, event.text) for task in ([named] if named else waiting or [""]))


def _acts(deeds: Iterable[Deed]) -> dict[str, tuple[str, ...]]:
    """Return the tasks that are activated, the events that are set, and the tasks that these wake."""
    found = tuple(deeds)
    return {
        "tasks": tuple(dict.fromkeys(deed.os_task for deed in found if not deed.event)),
        "events": tuple(dict.fromkeys(deed.event for deed in found if deed.event)),
        "wakes": tuple(dict.fromkeys(deed.os_task for deed in found if deed.event and deed.os_task)),
    }


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
    if not start:
        _report_zero(containers, alarm, "OsAlarmCounterRef", cycle)
    yield Trigger(
        place=alarm.place,
        period=tick * cycle,
        offset=tick * (start or 0),
        through=through,
        **_acts(deeds_of(containers, alarm)),
    )


def chosen_mode(containers: Containers) -> str:
    """Return the application mode (path) to schedule: that of an export before, OSDEFAULTAPPMODE, or the most named."""
    inside = (c for added in containers.added.values() for c in containers.below(added))
    own = [mode for c in inside for mode in c.targets("OsScheduleTableAppModeRef")]
    counts = Counter(mode for named in _modes(containers).values() for mode in dict.fromkeys(named))
    known = own or list(counts) or [container.node.path for container in containers.of("OsAppMode")]
    return max(known, key=lambda mode: (mode.endswith(f"/{_DEFAULT_MODE}"), counts[mode]), default="")


def _modes(containers: Containers) -> dict[str, list[str]]:
    """Return the application modes that the autostarts of alarms and tables (paths) name."""
    found = {}
    for starter in containers.of("OsAlarm", "OsScheduleTable"):
        own = [m for c in containers.below(starter) for m in c.targets(f"{starter.kind}AppModeRef")]
        if own:
            found[starter.node.path] = own
    return found


def started_elsewhere(containers: Containers) -> list[Container]:
    """Return the alarms and tables that the OS starts in other application modes than the one to schedule."""
    modes, chosen = _modes(containers), chosen_mode(containers)
    starters = containers.of("OsAlarm", "OsScheduleTable")
    return [starter for starter in starters if chosen not in modes.get(starter.node.path, [chosen])]


def _running(
    containers: Containers, stopped: Mapping[str | None, Data], elsewhere: Sequence[Container]
) -> list[Container]:
    """Return the repeating tables that run together: of those in each other's way, the ones that the OS starts."""
    own = [table for table in containers.of("OsScheduleTable") if table not in elsewhere]
    tables = [table for table in own if _repeats(containers, table)]
    others = replaced(containers, tables, stopped)
    for table, other in others.items():
        message = f"is not started by the OS, but {other.node.path} is, which it cannot run beside; it is left out"
        help = "state an autostart for the table of the mode to schedule, or periods in the overlay (sources)"
        table.place.report(containers.tree.findings, codes.UNSTARTED_TABLE, message, help=help)
    return [table for table in tables if table not in others]


def replaced(
    containers: Containers, tables: Iterable[Container], stopped: Collection[str | None] = ()
) -> dict[Container, Container]:
    """Return the tables of other modes, which only code starts, each with one that the OS starts in its place."""
    started = [t for t in tables if t.node.path in stopped or autostart_of(containers, t) is not None]
    others = ((t, next((s for s in started if _meets(containers, t, s)), None)) for t in tables if t not in started)
    return {table: other for table, other in others if other is not None}


def _repeats(containers: Containers, table: Container) -> bool:
    """Whether a table repeats; report one that does not. One without a duration is not set, and does nothing."""
    repeating = table.value("OsScheduleTableRepeating")
    if not table.number("OsScheduleTableDuration"):
        return False
    if repeating is not None and repeating.text.lower() in ("true", "1"):
        return True
    message = "is not repeating, so that it gives no task a period"
    at, path = repeating.at if repeating else table.node.at, named("OsScheduleTable", table.node.path)
    containers.tree.findings.report(codes.SINGLE_SHOT, message, at=at, path=path)
    return False


def autostart_of(containers: Containers, starter: Container) -> Container | None:
    """Return the container by which the OS starts an alarm, a table or an OsTask."""
    return next((c for c in containers.below(starter) if c.kind == f"{starter.kind}Autostart"), None)


def _meets(containers: Containers, table: Container, other: Container) -> bool:
    """Whether two tables have the same counter, or activate or wake the same OsTasks."""
    first, second = (
        {*each.targets(_COUNTER), *(deed.os_task for deed in deeds_of(containers, each) if deed.os_task)}
        for each in (table, other)
    )
    return not first.isdisjoint(second)


def _start(containers: Containers, table: Container, stopped: Data | None) -> Fraction:
    """Return the ticks after which a table begins, at its initial offset: absolute values count from 0 as well."""
    if stopped is not None:
        return stopped.value("start", _ticks) or Fraction(0)
    start = autostart_of(containers, table)
    kind = start.value("OsScheduleTableAutostartType") if start else None
    moved = next((c for c in containers.below(table) if c.kind == "OsScheduleTblAdjustableExpPoint"), None)
    is_synchronous = kind is not None and kind.text == "SYNCHRON"
    if is_synchronous or moved is not None:
        where = kind.at if kind is not None and is_synchronous else moved.node.at if moved else table.node.at
        containers.tree.findings.report(
            codes.PHASE_UNKNOWN,
            "begins when its counter is synchronised" if is_synchronous else "has an adjustable expiry point",
            at=where,
            path=named("OsScheduleTable", table.node.path),
            help="state the offsets of its tasks in the overlay (tasks: offset)",
        )
    old = "OsScheduleTableAbsValue" if kind is not None and kind.text == "ABSOLUTE" else "OsScheduleTableRelOffset"
    names = ("OsScheduleTableStartValue", old, "ArcCoreOsScheduleTableOffset")  # releases before 4 state both of `old`
    found = map(start.number, names) if start and not is_synchronous else ()
    return next(filter(None, found), Fraction(0))


def _report_zero(containers: Containers, starter: Container, counter_ref: str, cycle: Fraction) -> None:
    """Report a start at the value 0, with which the counter begins; after all its values it may be another phase."""
    begins = autostart_of(containers, starter)
    kind = begins.value(f"{starter.kind}AutostartType") if begins else None
    counter = containers.by_path.get(starter.target(counter_ref) or "")
    most = counter.number("OsCounterMaxAllowedValue") if counter else None
    if kind is None or kind.text != "ABSOLUTE" or (most is not None and (most + 1) % cycle == 0):
        return
    containers.tree.findings.report(
        codes.PHASE_UNKNOWN,
        "begins at the value 0 of its counter: at once, or after all values of the counter, as the OS has it",
        at=kind.at,
        path=named(starter.kind, starter.node.path),
        help="state a start value above 0, or the offsets of its tasks in the overlay (tasks: offset)",
    )


def _expiry_points(table: Container, containers: Containers, ticks: Ticks, stopped: Data | None) -> Iterator[Trigger]:
    duration = table.number("OsScheduleTableDuration")
    tick, through = ticks.counter(table, _COUNTER)
    if tick is None or not duration:
        return
    start = _start(containers, table, stopped)
    if not start:
        _report_zero(containers, table, _COUNTER, duration)
    for point in containers.below(table):
        if point.kind == _POINT:
            yield Trigger(
                place=point.place,
                period=tick * duration,
                offset=tick * (start + (point.number("OsScheduleTblExpPointOffset") or 0)),
                through=(*through, table.place),
                **_acts(deeds_of(containers, point)),
            )
