"""The OS of a whole AUTOSAR project as it would run: read from all its files with a reader of its own, and played.

Nothing of halpipe takes part. Alarms and schedule tables begin by their autostart, or by what the Rte configuration
states; the actions that they take on OsTasks are listed by instant. Times are exact fractions of seconds.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

from lxml import etree

AR = "{http://autosar.org/schema/r4.0}"


@dataclass
class Container:
    """A container: the short name of its definition, its values and references by name, and who wrote them."""

    path: str
    kind: str
    values: dict = field(default_factory=dict)
    refs: dict = field(default_factory=lambda: defaultdict(list))
    generated: set = field(default_factory=set)


@dataclass(frozen=True, order=True)
class Act:
    """What happens to an OsTask (path) at an instant, an activation or an event that is set, and what did it."""

    time: Fraction
    task: str
    event: str = ""
    by: str = ""


def read_project(folder):
    """All containers of all files by path; parts of one container are one, but those of copies do not count."""
    found = {}
    for path in sorted(Path(folder).rglob("*.xdm")):
        _read_xdm(etree.parse(path).getroot(), "", found)
    modules = tuple(f"{p.rpartition('/')[0]}/" for p, c in found.items() if c.kind in ("OsTask", "RteGeneration"))
    for path in sorted(Path(folder).rglob("*.arxml")):
        _read_arxml(etree.parse(path).getroot(), found, modules)
    return found


def read_starts(folder):
    """The events (paths) that start each runnable or BSW entity (path)."""
    found = defaultdict(set)
    for path in sorted(Path(folder).rglob("*.arxml")):
        for ref in etree.parse(path).getroot().iter(AR + "START-ON-EVENT-REF", AR + "STARTS-ON-EVENT-REF"):
            names = [e.findtext(AR + "SHORT-NAME") for e in ref.iterancestors()]
            event = "/" + "/".join(name.strip() for name in reversed(names) if name)
            found["".join((ref.text or "").split())].add(event)
    return found


def differences(folder, schedule, origins, coded=(), turns=1):
    """What a merged project does that its schedule does not say, or does not do; none if all is well.

    `origins` has the path of the OsTask or runnable that each task of the model was made of, `coded` the tables that
    code starts when those of the schedule begin. Some hyperperiods are played, after two.
    """
    events = read_starts(folder)
    os = Os(folder)
    os.mode = os.mode_of("Halpipe_")
    hosts = os.hosts()
    length = Fraction(schedule.modes[0].hyperperiod.in_unit("s"))
    wanted = defaultdict(list)
    for job in schedule.modes[0].jobs:
        path = origins[job.task].partition(":")[0]
        tasks = {path} if path in os.tasks else {task for event in events[path] for task in hosts[event]}
        here = {task for task in tasks if os.core(task) == job.units[0]} or tasks
        for task in here:
            start = Fraction(job.start.in_unit("s")) % length
            wanted[task] += [start + turn * length for turn in range(turns)]
    begin = min((os.begin(table) for table in os.named("Halpipe_") if os.begins(table)), default=0)
    os.calls.update(dict.fromkeys(coded, begin))
    acts = [act for act in os.play((2 + turns) * length + begin) if 2 * length <= act.time - begin]
    found = [f"contradiction at {path}" for path in os.contradictions()]
    found += [f"wrong expiry point at {path}" for path in os.misled()]
    done = defaultdict(list)
    for act in acts:
        done[act.task, act.event].append(act.time - begin - 2 * length)
    for (task, event), times in done.items():
        if task in wanted:
            found += [f"{task} {event} twice at {time}" for time, count in Counter(times).items() if count > 1]
            found += [f"{task} {event} started at {time}" for time in set(times) - set(wanted[task])]
            found += [f"{task} is extended, but activated"] if os.is_extended(task) and not event else []
    for task, times in wanted.items():
        started = {time for (name, _), all_of_it in done.items() if name == task for time in all_of_it}
        found += [f"{task} not started at {time}" for time in set(times) - started]
    return found, len(acts)


def _short(text):
    return "".join((text or "").split()).rpartition("/")[2]


def _read_arxml(root, found, configured):
    for element in root.iter(AR + "ECUC-CONTAINER-VALUE"):
        names = [e.findtext(AR + "SHORT-NAME") for e in (element, *element.iterancestors())]
        path = "/" + "/".join(name.strip() for name in reversed(names) if name)
        if path.startswith(configured):
            continue
        kind = _short(element.findtext(AR + "DEFINITION-REF"))
        container = found.setdefault(path, Container(path, kind))
        for value in element.iterfind(f"{AR}PARAMETER-VALUES/*"):
            text = (value.findtext(AR + "VALUE") or "").strip()
            if text:
                container.values[_short(value.findtext(AR + "DEFINITION-REF"))] = text
        for value in element.iterfind(f"{AR}REFERENCE-VALUES/*"):
            for target in value.iter(AR + "VALUE-REF", AR + "TARGET-REF"):
                name, text = _short(value.findtext(AR + "DEFINITION-REF")), "".join((target.text or "").split())
                if text and text not in container.refs[name]:
                    container.refs[name].append(text)
                    if any((o.text or "").strip() == "DV:RTE" for o in value.iter(AR + "ANNOTATION-ORIGIN")):
                        container.generated.add((name, text))


def _read_xdm(element, path, found, kind=""):
    tag, name = etree.QName(element).localname, element.get("name") or ""
    inside = path
    if any(
        a.get("name") == "ENABLE" and (a.get("value") or "").lower() == "false" for a in element.iterchildren("{*}a")
    ):
        return
    if element.get("type") in ("AR-PACKAGE", "AR-ELEMENT"):
        inside = f"{path}/{name}"
    elif tag in ("ctr", "chc") and element.get("type") not in ("AUTOSAR", "MODULE-CONFIGURATION"):
        inside = f"{path}/{name}"
        found.setdefault(inside, Container(inside, kind or name))
    elif tag in ("var", "ref") and path in found and element.get("value"):
        text = element.get("value").removeprefix("ASPath:")
        if tag == "var":
            found[path].values[name or kind] = text
        else:
            found[path].refs[name or kind].append(text)
    for child in element.iterchildren("{*}lst", "{*}ctr", "{*}chc", "{*}var", "{*}ref"):
        if tag == "chc" and element.get("type") != "AR-ELEMENT" and child.get("name") != element.get("value"):
            continue
        _read_xdm(child, inside, found, name if tag == "lst" else "")


class Os:
    """The alarms, tables and OsTasks of a project, in one of its application modes (path; empty: all of them)."""

    def __init__(self, folder, mode=""):
        self.mode = mode
        self.containers = read_project(folder)
        self.inside = defaultdict(list)  # each container, and all within it, by its path
        for container in self.containers.values():
            path = container.path
            while path:
                self.inside[path].append(container)
                path = path.rpartition("/")[0]
        self.tasks = {c.path: c for c in self.containers.values() if c.kind == "OsTask"}
        self.calls = {}  # alarms and tables that the Rte starts, with the offset that it expects
        for start in self._of("RteUsedOsActivation"):
            offset = Fraction(start.values.get("RteExpectedActivationOffset", "0"))
            for name in ("RteActivationOsAlarmRef", "RteActivationOsSchTblRef"):
                self.calls.update(dict.fromkeys(start.refs[name], offset))

    def _of(self, *kinds):
        return [c for c in self.containers.values() if c.kind in kinds]

    def named(self, prefix):
        """The schedule tables whose short names begin so."""
        return [t for t in self._of("OsScheduleTable") if t.path.rpartition("/")[2].startswith(prefix)]

    def begins(self, starter):
        """Whether an alarm or table has an autostart in the application mode."""
        starts = [c for c in self._below(starter) if c.kind == f"{starter.kind}Autostart"]
        modes = [mode for start in starts for mode in start.refs[f"{starter.kind}AppModeRef"]]
        return bool(starts) and (not self.mode or not modes or self.mode in modes)

    def mode_of(self, prefix):
        """The application mode in which tables of such names are started."""
        starts = [c for table in self.named(prefix) for c in self._below(table)]
        return next((mode for start in starts for mode in start.refs["OsScheduleTableAppModeRef"]), "")

    def modes(self):
        """The application modes of the project."""
        return [mode.path for mode in self._of("OsAppMode")]

    def begin(self, table):
        """The instant at which a table begins first."""
        return (self.value(table, "OsScheduleTableStartValue") or 0) * self.tick(
            table.refs["OsScheduleTableCounterRef"][0]
        )

    def core(self, task):
        """The name of the core that an OsTask is bound to, empty if that is not stated."""
        for application in self._of("OsApplication"):
            if task in application.refs["OsAppTaskRef"]:
                return next((path.rpartition("/")[2] for path in application.refs["OsApplicationCoreRef"]), "")
        return ""

    def hosts(self):
        """The OsTasks that run each event (path), by the mappings of the Rte."""
        found = defaultdict(set)
        for mapping in self._of("RteEventToTaskMapping", "RteBswEventToTaskMapping"):
            for infix in ("", "Bsw"):
                for event in mapping.refs[f"Rte{infix}EventRef"]:
                    found[event].update(mapping.refs[f"Rte{infix}MappedToTaskRef"])
        return found

    def _below(self, container):
        return self.inside[container.path]

    def is_extended(self, task):
        """Whether an OsTask waits for events."""
        container = self.tasks[task]
        return bool(container.refs["OsTaskEventRef"]) or container.values.get("OsTaskType") == "EXTENDED"

    def tick(self, counter):
        """The time of a tick of a counter."""
        stated = self.containers[counter].values.get("OsSecondsPerTick")
        if stated:
            return Fraction(stated)
        module = counter.rpartition("/")[0]
        for system in self._of("OsOS"):
            frequency = system.values.get("OsTickFrequency") or system.values.get("ArcOsTickFrequency")
            if frequency and system.path.startswith(module):
                return 1 / Fraction(frequency)
        drivers = [a for a in self._of("OsAlarm") if counter in self._refs(a, "OsAlarmIncrementCounterRef")]
        if len(drivers) == 1:
            return self._cycle(drivers[0]) * self.tick(drivers[0].refs["OsAlarmCounterRef"][0])
        return None

    def _refs(self, container, name):
        return [target for inside in self._below(container) for target in inside.refs[name]]

    def value(self, container, name):
        """The number that a parameter of a container, or of one inside it, states."""
        return next((Fraction(int(c.values[name], 0)) for c in self._below(container) if name in c.values), None)

    def _cycle(self, alarm):
        return self.value(alarm, "OsAlarmCycleTime") or Fraction(0)

    def _deeds(self, container):
        """Yield what actions inside a container do: an OsTask, and the event that is set, if any."""
        for inside in self._below(container):
            for prefix in ("OsAlarm", "OsScheduleTable"):
                yield from ((task, "") for task in inside.refs[f"{prefix}ActivateTaskRef"])
                events, named = inside.refs[f"{prefix}SetEventRef"], inside.refs[f"{prefix}SetEventTaskRef"]
                for event in events:
                    waiting = [t for t, c in self.tasks.items() if event in c.refs["OsTaskEventRef"]]
                    yield from ((task, event) for task in named or waiting)

    def play(self, until):
        """Return every action on an OsTask before an instant, in order; of one instant the higher priority first."""
        acts = [*self._alarms(until), *self._tables(until)]
        return sorted(acts, key=lambda act: (act.time, -self._priority(act.task), act.task, act.event))

    def _priority(self, task):
        return int(self.tasks[task].values.get("OsTaskPriority", "0")) if task in self.tasks else 0

    def _alarms(self, until):
        for alarm in self._of("OsAlarm"):
            deeds = list(self._deeds(alarm))
            cycle = self._cycle(alarm)
            if not deeds or not self.begins(alarm) or not cycle:
                continue
            in_ns = any(c.values.get("OsTimeUnit") == "NANOSECONDS" for c in self._below(alarm))
            tick = Fraction(1, 10**9) if in_ns else self.tick(alarm.refs["OsAlarmCounterRef"][0])
            time = (self.value(alarm, "OsAlarmAlarmTime") or 0) * tick
            while time < until:
                yield from (Act(time, task, event, alarm.path) for task, event in deeds)
                time += cycle * tick

    def _tables(self, until):
        for table in self._of("OsScheduleTable"):
            begins = self.begins(table)
            if not begins and table.path not in self.calls:
                continue
            tick = self.tick(table.refs["OsScheduleTableCounterRef"][0])
            start = self.value(table, "OsScheduleTableStartValue") or 0 if begins else self.calls[table.path] / tick
            length = self.value(table, "OsScheduleTableDuration")
            repeats = table.values.get("OsScheduleTableRepeating", "false").lower() in ("true", "1")
            points = [
                (int(point.values["OsScheduleTblExpPointOffset"], 0), list(self._deeds(point)))
                for point in self._below(table)
                if point.kind == "OsScheduleTableExpiryPoint"
            ]
            while start * tick < until:
                for offset, deeds in points:
                    time = (start + offset) * tick
                    if time < until:
                        yield from (Act(time, task, event, table.path) for task, event in deeds)
                if not repeats:
                    break
                start += length

    def misled(self):
        """Mappings that name an expiry point which does nothing to their OsTask."""
        found = []
        for mapping in self._of("RteEventToTaskMapping", "RteBswEventToTaskMapping"):
            for infix in ("", "Bsw"):
                for point in mapping.refs[f"Rte{infix}UsedOsSchTblExpiryPointRef"]:
                    tasks = {task for task, _ in self._deeds(self.containers[point])}
                    found += [] if tasks.issuperset(mapping.refs[f"Rte{infix}MappedToTaskRef"]) else [mapping.path]
        return found

    def contradictions(self):
        """Mappings that an alarm chosen by hand and an expiry point start, which exclude each other."""
        return [
            c.path
            for c in self._of("RteEventToTaskMapping", "RteBswEventToTaskMapping")
            for infix in ("", "Bsw")
            for alarm in c.refs[f"Rte{infix}UsedOsAlarmRef"]
            if c.refs[f"Rte{infix}UsedOsSchTblExpiryPointRef"]
            and (f"Rte{infix}UsedOsAlarmRef", alarm) not in c.generated
        ]
