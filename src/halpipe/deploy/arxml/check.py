"""OS of a merged AUTOSAR project, read from its ECU configuration, played, and compared with the first mode.

Alarms and schedule tables begin by their autostart, or by what the Rte configuration states. Instants are exact. The
reader shares nothing with the importer; it knows containers by the short names of their definitions.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, NamedTuple

from halpipe.core.bundles import CHANGED_FILE
from halpipe.core.diagnostics import Findings, Location, error, named
from halpipe.core.durations import seconds
from halpipe.core.files import parse_xml, read_bytes, sha256
from halpipe.core.grouping import grouped
from halpipe.core.suggest import few
from halpipe.deploy.base import Checked, Target

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

    from lxml import etree

    from halpipe.models import ModeSchedule

_AR = "{http://autosar.org/schema/r4.0}"
_NO_LEVEL = ("AUTOSAR", "MODULE-CONFIGURATION")


@dataclass(slots=True)
class Container:
    """A container of all its parts: the short name of its definition, its values and references by name."""

    path: str
    kind: str
    values: dict[str, str] = field(default_factory=dict)
    refs: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    inside: list[Container] = field(default_factory=list)

    def all(self) -> Iterator[Container]:
        """Yield the container and everything inside it."""
        yield self
        for inner in self.inside:
            yield from inner.all()

    def number(self, name: str) -> Fraction | None:
        """Return the first number that a parameter in it states; None if there is none, or no number."""
        for container in self.all():
            if name in container.values:
                return _number(container.values[name])
        return None


class Act(NamedTuple):
    """An activation of an OsTask (path), or an event set for it, at an instant (s), by an alarm or table."""

    time: Fraction
    task: str
    event: str
    by: str


def _number(text: str) -> Fraction | None:
    try:
        return Fraction(int(text, 0)) if text[:2].lower() in ("0x", "0b") else Fraction(text)
    except (ValueError, ZeroDivisionError):
        return None


def _last(text: str | None) -> str:
    return "".join((text or "").split()).rpartition("/")[2]


class Os:
    """The alarms, tables and OsTasks of all files of a project."""

    def __init__(self, roots: list[etree._Element], tables: Collection[str] = ()) -> None:
        self._found: dict[str, Container] = {}
        for root in roots:
            if root.tag == f"{_AR}AUTOSAR":
                self._read_arxml(root)
            else:
                self._read_xdm(root, "", "")
        for path, container in self._found.items():
            holder = self._found.get(path.rpartition("/")[0])
            if holder is not None:
                holder.inside.append(container)
        self.tasks = {c.path: c for c in self._of("OsTask")}
        self._waiting: dict[str, list[str]] = defaultdict(list)
        for task in self.tasks.values():
            for event in task.refs["OsTaskEventRef"]:
                self._waiting[event].append(task.path)
        self._mode = self._application_mode(tables)

    def is_extended(self, task: str) -> bool:
        """Whether an OsTask waits for events."""
        container = self.tasks[task]
        return bool(container.refs["OsTaskEventRef"]) or container.values.get("OsTaskType") == "EXTENDED"

    def priority(self, task: str) -> Fraction:
        """Return the priority of an OsTask, 0 for an unknown one."""
        return (self.tasks[task].number("OsTaskPriority") if task in self.tasks else None) or Fraction(0)

    # ------------------------------------------------------------------------------------------------- reading

    def _enter(self, path: str, kind: str) -> Container:
        return self._found.setdefault(path, Container(path, kind))

    def _read_arxml(self, root: etree._Element) -> None:
        for element in root.iter(f"{_AR}ECUC-CONTAINER-VALUE"):
            names = [each.findtext(f"{_AR}SHORT-NAME") for each in (element, *element.iterancestors())]
            path = "/" + "/".join(name.strip() for name in reversed(names) if name)
            container = self._enter(path, _last(element.findtext(f"{_AR}DEFINITION-REF")))
            for value in element.iterfind(f"{_AR}PARAMETER-VALUES/*"):
                text = (value.findtext(f"{_AR}VALUE") or "").strip()
                if text:
                    container.values[_last(value.findtext(f"{_AR}DEFINITION-REF"))] = text
            for value in element.iterfind(f"{_AR}REFERENCE-VALUES/*"):
                known = container.refs[_last(value.findtext(f"{_AR}DEFINITION-REF"))]
                for target in value.iter(f"{_AR}VALUE-REF", f"{_AR}TARGET-REF"):
                    text = "".join((target.text or "").split())
                    known += [text] if text and text not in known else []

    def _read_xdm(self, element: etree._Element, path: str, kind: str) -> None:
        """Read project data of EB tresos: what is not enabled does not exist, and only the chosen part of a choice."""
        tag, name, type = str(element.tag).rpartition("}")[2], element.get("name") or "", element.get("type")
        notes = {a.get("name"): a.get("value") or "" for a in element.iterchildren("{*}a")}
        if notes.get("ENABLE", "").lower() == "false":
            return
        if type in ("AR-PACKAGE", "AR-ELEMENT") or (tag in ("ctr", "chc") and type not in _NO_LEVEL):
            path = f"{path}/{name}"
            if type not in ("AR-PACKAGE", "AR-ELEMENT"):
                self._enter(path, kind or name)
        elif tag in ("var", "ref") and path in self._found and element.get("value"):
            text = (element.get("value") or "").removeprefix("ASPath:")
            if tag == "var":
                self._found[path].values[name or kind] = text
            else:
                self._found[path].refs[name or kind].append(text)
        chosen = element.get("value") if tag == "chc" and type != "AR-ELEMENT" else None
        for child in element.iterchildren("{*}lst", "{*}ctr", "{*}chc", "{*}var", "{*}ref"):
            if chosen is None or child.get("name") == chosen:
                self._read_xdm(child, path, name if tag == "lst" else "")

    def _of(self, *kinds: str) -> list[Container]:
        return [container for container in self._found.values() if container.kind in kinds]

    # ------------------------------------------------------------------------------------------------- playing

    def _application_mode(self, tables: Collection[str]) -> str:
        """Return the application mode (path) in which the given tables, those of the schedule, are started."""
        begins = (c for table in self._of("OsScheduleTable") if table.path in tables for c in table.all())
        return next((mode for c in begins for mode in c.refs["OsScheduleTableAppModeRef"]), "")

    def play(self, until: Fraction, coded: Mapping[str, Fraction]) -> list[Act]:
        """Return every action on an OsTask before an instant, in order; of one instant the higher priority first.

        `coded` has the instants (s) at which code starts tables (paths).
        """
        called = {**self._called(), **coded}
        acts = []
        for starter in self._of("OsAlarm", "OsScheduleTable"):
            begin = next((c for c in starter.all() if c.kind == f"{starter.kind}Autostart"), None)
            modes = begin.refs[f"{starter.kind}AppModeRef"] if begin else []
            if modes and self._mode and self._mode not in modes:
                begin = None
            if begin is not None or starter.path in called:
                offset = None if begin is not None else called[starter.path]
                play = self._alarm if starter.kind == "OsAlarm" else self._table
                acts += list(play(starter, offset, until))
        return sorted(acts, key=lambda act: (act.time, -self.priority(act.task), act.task, act.event))

    def _called(self) -> dict[str, Fraction]:
        """Return the alarms and tables that the RTE starts, with their offset (s)."""
        found: dict[str, Fraction] = {}
        for start in self._of("RteUsedOsActivation"):
            offset = start.number("RteExpectedActivationOffset") or Fraction(0)
            for name in ("RteActivationOsAlarmRef", "RteActivationOsSchTblRef"):
                found.update(dict.fromkeys(start.refs[name], offset))
        return found

    def _alarm(self, alarm: Container, offset: Fraction | None, until: Fraction) -> Iterator[Act]:
        in_ns = any(c.values.get("OsTimeUnit") == "NANOSECONDS" for c in alarm.all())
        tick = Fraction(1, 10**9) if in_ns else self._tick(next(iter(alarm.refs["OsAlarmCounterRef"]), ""))
        cycle = alarm.number("OsAlarmCycleTime")
        if not tick or not cycle:
            return
        time = (alarm.number("OsAlarmAlarmTime") or Fraction(0)) * tick if offset is None else offset
        deeds = list(self._deeds(alarm))
        while time < until:
            yield from (Act(time, task, event, alarm.path) for task, event in deeds)
            time += cycle * tick

    def _table(self, table: Container, offset: Fraction | None, until: Fraction) -> Iterator[Act]:
        tick = self._tick(next(iter(table.refs["OsScheduleTableCounterRef"]), ""))
        length = table.number("OsScheduleTableDuration")
        if not tick or not length:
            return
        first = self.begin(table.path) if offset is None else offset
        points = [
            ((point.number("OsScheduleTblExpPointOffset") or Fraction(0)) * tick, list(self._deeds(point)))
            for point in table.all()
            if point.kind == "OsScheduleTableExpiryPoint"
        ]
        repeats = table.values.get("OsScheduleTableRepeating", "false").lower() in ("true", "1")
        while first < until:
            for at, deeds in points:
                if first + at < until:
                    yield from (Act(first + at, task, event, table.path) for task, event in deeds)
            if not repeats:
                return
            first += length * tick

    def begin(self, path: str) -> Fraction:
        """Return the instant (s) at which an autostarted table begins first, 0 for an alarm."""
        starter = self._found[path]
        tick = self._tick(next(iter(starter.refs["OsScheduleTableCounterRef"]), ""))
        return (starter.number("OsScheduleTableStartValue") or Fraction(0)) * (tick or 0)

    def _tick(self, counter: str, seen: tuple[str, ...] = ()) -> Fraction | None:
        """Return the length of a tick (s): stated, by the frequency of the OS, or of the alarm that drives it."""
        if counter not in self._found or counter in seen:
            return None
        stated = self._found[counter].number("OsSecondsPerTick")
        if stated:
            return stated
        module = counter.rpartition("/")[0]
        for system in self._of("OsOS"):
            frequency = system.number("OsTickFrequency") or system.number("ArcOsTickFrequency")
            if frequency and system.path.startswith(f"{module}/"):
                return 1 / frequency
        for alarm in self._of("OsAlarm"):
            if any(counter in c.refs["OsAlarmIncrementCounterRef"] for c in alarm.all()):
                tick = self._tick(next(iter(alarm.refs["OsAlarmCounterRef"]), ""), (*seen, counter))
                cycle = alarm.number("OsAlarmCycleTime")
                return tick * cycle if tick and cycle else None
        return None

    def _deeds(self, starter: Container) -> Iterator[tuple[str, str]]:
        """Yield what actions do: an OsTask, and the event that is set for it, empty for an activation."""
        for inside in starter.all():
            for prefix in ("OsAlarm", "OsScheduleTable"):
                yield from ((task, "") for task in inside.refs[f"{prefix}ActivateTaskRef"])
                for event in inside.refs[f"{prefix}SetEventRef"]:
                    named = inside.refs[f"{prefix}SetEventTaskRef"] or self._waiting[event]
                    yield from ((task, event) for task in named)


OTHERWISE = error(
    "HAL1434",
    "Merged project does not do what the schedule states",
    "The alarms and schedule tables of the project, with the delta and the changed files, are played for three "
    "hyperperiods of the first mode, which begin with the first table of the schedule. In the third, each OsTask of "
    "the schedule is activated, or gets an event, at the starts of its jobs and at no other instant.",
)


def check(target: Target) -> Checked:
    """Play the project of an export, and compare each OsTask with its jobs."""
    findings = Findings()
    roots = list(_roots(target, findings))
    findings.stop_on_errors()
    facts = target.bundle.fields(findings)
    tables, coded = ([each.value for each in facts.texts(name, str)] for name in ("tables", "code"))
    tasks = {
        task: {path: [event.value for event in run.texts(path, str)] for path in run}
        for task, run, _ in facts.entries("tasks")
    }
    findings.stop_on_errors()
    os, mode = Os(roots, tables), target.schedule.modes[0]
    length = mode.hyperperiod.in_unit("s")
    begin = min(map(os.begin, tables), default=Fraction(0))  # all begin together, or jobs are at other instants
    acts = [act._replace(time=act.time - begin) for act in os.play(3 * length + begin, dict.fromkeys(coded, begin))]
    acts = [act for act in acts if act.time >= 2 * length]
    at = Location(target.bundle.path)
    for task, message in sorted(_differences(os, acts, mode, tasks)):
        help = "export the schedule again, and remove what else starts the OsTask"
        findings.add(OTHERWISE(message, at=at, path=named("OsTask", task), help=help))
    return Checked(diagnostics=tuple(findings.items), lines=tuple(_lines(acts, length)))


def _roots(target: Target, findings: Findings) -> Iterator[etree._Element]:
    """Yield the files of the project as they will be: changed ones in place of those that they replace, the delta."""
    bundle = target.bundle
    replaced, project = {}, {}
    for name, stated, _ in bundle.fields(findings).entries("project", ("sha256", "changed")):
        project[name] = stated.text("sha256"), stated.text("changed")
        if project[name][1] not in ("", *bundle.files):
            stated.complain(CHANGED_FILE, f'"changed": "{project[name][1]}" is no file of the bundle', "changed")
    findings.stop_on_errors()
    for name, (digest, changed) in project.items():
        if changed:
            replaced[name] = bundle.files[changed]
            continue
        content = read_bytes(name)
        if sha256(content) != digest:
            message = "is not the file of the project that the schedule was put onto"
            findings.add(CHANGED_FILE(message, at=Location(name), help="export the schedule onto the project again"))
        replaced[name] = content
    for name, content in bundle.files.items():
        if name.endswith(".arxml") and not name.startswith("changed/"):
            replaced[f"{bundle.path}/{name}"] = content
    for name, content in replaced.items():
        yield parse_xml(content, name, long_texts=True)


def _differences(
    os: Os, acts: list[Act], mode: ModeSchedule, tasks: Mapping[str, Mapping[str, list[str]]]
) -> Iterator[tuple[str, str]]:
    """Yield each OsTask of the schedule that something else, or nothing, starts, and when."""
    length = mode.hyperperiod.in_unit("s")
    needed: dict[str, set[Fraction]] = {}
    events: dict[str, set[str]] = {}
    for job in mode.jobs:
        for task, set_events in tasks.get(job.task, {}).items():
            events.setdefault(task, {""}).update(set_events)
            needed.setdefault(task, set()).add(job.start.in_unit("s") % length)
    done: dict[tuple[str, str], Counter[Fraction]] = {}
    for act in acts:
        if act.event in events.get(act.task, ()):  # another event wakes what the model left out, beside the schedule
            done.setdefault((act.task, act.event), Counter())[act.time % length] += 1
    for (task, event), times in done.items():
        what = f"gets {event}" if event else "is activated"
        for time, count in times.items():
            if count > 1:
                yield task, f"{what} {count} times at {seconds(time)}"
            if time not in needed[task]:
                yield task, f"{what} at {seconds(time)}, where no job of it starts"
        if os.is_extended(task) and not event:
            yield task, "waits for events, but is activated"
    for task, times_of in needed.items():
        seen = {time for (other, _), times in done.items() if other == task for time in times}
        for time in sorted(times_of - seen):
            yield task, f"is not started at {seconds(time)}, where a job of it starts"


def _lines(acts: list[Act], length: Fraction) -> Iterator[str]:
    """Yield what happens to each OsTask in one hyperperiod, in the order of the first instants."""
    yield f"{len(acts)} actions on {len({act.task for act in acts})} OsTasks in {seconds(length)}"
    found = grouped(((act.task, act.event, act.by), act.time % length) for act in acts)
    for (task, event, by), times in sorted(found.items(), key=lambda item: (min(item[1]), item[0])):
        times.sort()
        what = f"{event} set" if event else "activated"
        count = "once" if len(times) == 1 else f"{len(times)} times"
        yield f"{task}: {what} {count} by {by}: {few(map(seconds, times), 6, quote='')}"
