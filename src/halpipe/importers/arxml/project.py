"""The project that a model was imported from, as its export needs it: `halpipe.models.project`.

The project is read again and its model made anew, so that what changed since the import is noticed.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, Location, about
from halpipe.core.durations import Duration, seconds
from halpipe.core.grouping import grouped
from halpipe.core.suggest import counted
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.build import Built, assemble
from halpipe.importers.arxml.codes import SKIPPED_FILE, VARIANT
from halpipe.importers.arxml.files.tree import Tree, place
from halpipe.importers.arxml.files.variants import Choice
from halpipe.importers.arxml.files.words import NS, listed
from halpipe.importers.arxml.options import GRANULARITIES, ArxmlImportOptions
from halpipe.importers.arxml.system.containers import Container, Containers, standard_modules
from halpipe.importers.arxml.system.ecuc import (
    Ticks,
    autostart_of,
    chosen_mode,
    deeds_of,
    replaced,
    started_elsewhere,
)
from halpipe.importers.arxml.system.reading import read_system, read_tree
from halpipe.importers.arxml.tasks.versions import FULL
from halpipe.importers.overlay import Overlay, OverlayUse
from halpipe.models.project import Call, Deed, Item, LeftOut, Project, ProjectCounter, ProjectTask, Starter, Value

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.importers.arxml.system.values import Trigger
    from halpipe.importers.arxml.tasks.activation import Activation, Draft
    from halpipe.models import Task, TaskModel

_MODULE, _CONTAINER = "ECUC-MODULE-CONFIGURATION-VALUES", "ECUC-CONTAINER-VALUE"
_SCHEMA = "{http://www.w3.org/2001/XMLSchema-instance}schemaLocation"
_GENERATED = ("DV:RTE", "@CALC")
_OLD_SCHEMA = re.compile(r"http://(?:www\.)?autosar\.org/[23]")
_LONGEST_TICK = seconds(1)
_MAPPINGS = ("RteEventToTaskMapping", "RteBswEventToTaskMapping")
_ALARMS = ("RteUsedOsAlarmRef", "RteBswUsedOsAlarmRef")
_CAUSES = (SKIPPED_FILE.id, VARIANT.id)


class _OfModel(OverlayUse):
    """Stands in for the overlay of the import: leaves out what the model has not, and gives its periods again."""

    def __init__(self, model: TaskModel, *, is_dropping: bool) -> None:
        super().__init__(Overlay())
        self._periods, self._is_dropping = {task.name: task.period for task in model.tasks}, is_dropping

    def drops(self, name: str) -> bool:
        return self._is_dropping and name not in self._periods

    def source_period(self, name: str) -> Duration | None:
        return self._periods.get(name)

    def task_period(self, name: str) -> Duration | None:
        return self._periods.get(name)

    def states_interrupt(self, name: str) -> bool:
        """Leave interrupts to the model."""
        return True


def read_project(paths: Sequence[str], model: TaskModel, options: ArxmlImportOptions, findings: Findings) -> Project:
    """Read the project that `model` was imported from; report what is not as the model has it.

    Raise `HalpipeError` with every difference, if the project is another one or changed.
    """
    tree = read_tree(sorted(paths), Findings(), Choice(options.variant, options.conditions), marks=True)
    if tree.removed:
        others = listed([removed.path for removed in tree.removed])
        message = f"{len(tree.removed)} elements are not in the variant of the model: {others}"
        help = "add the delta, and the changed files, to a build of this variant only"
        findings.report(codes.ONE_VARIANT, message, at=tree.removed[0].at, help=help)
    built, rest = _again(tree, model, paths, options, findings)
    _compare(model, built.model, findings)
    findings.stop_on_errors()
    return _Reader(tree, built, rest, findings).project()


def _again(
    tree: Tree, model: TaskModel, paths: Sequence[str], options: ArxmlImportOptions, findings: Findings
) -> tuple[Built, list[Draft]]:
    """Return the model of the project at the granularity of the given one, without what that has not, and the rest."""
    system = read_system(tree, options.ecu)
    tree.findings.stop_on_errors()

    def made(granularity: str, *, is_dropping: bool) -> Built:
        chosen = replace(options, overlay=_OfModel(model, is_dropping=is_dropping), granularity=granularity)
        return assemble(tree, system, paths, chosen)

    found: dict[str, Built] = {}
    failures = []
    for granularity in GRANULARITIES:
        try:
            found[granularity] = made(granularity, is_dropping=False)
        except HalpipeError as failure:
            failures.append(failure)
    if not found:
        raise failures[0]
    findings.extend(dict.fromkeys(read for read in tree.findings.items if read.code in _CAUSES))
    wanted = {task.name for task in model.tasks}
    origins = {_path(task) for task in model.tasks}
    granularity = max(found, key=lambda known: _likeness(found[known].model, wanted, origins))
    _report_others(model, found[granularity].model, paths, findings)
    findings.stop_on_errors()
    tree.findings = Findings()  # what the other granularities found does not count
    built = made(granularity, is_dropping=True)
    tree.findings.stop_on_errors()
    return built, [draft for draft in found[granularity].drafts if draft.name not in wanted]


def _likeness(model: TaskModel, names: set[str], origins: set[str]) -> tuple[int, int]:
    """Return how many tasks have one of the names, and how many were imported from one of the origins."""
    return sum(task.name in names for task in model.tasks), sum(_path(task) in origins for task in model.tasks)


def _report_others(model: TaskModel, project: TaskModel, paths: Sequence[str], findings: Findings) -> None:
    """Report the tasks that only the model has, or only the project; the name of a task may tell its period."""
    wanted = {task.name for task in model.tasks}
    tasks = {task.name: task for task in project.tasks}
    new = [task for name, task in sorted(tasks.items()) if name not in wanted]
    for task in model.tasks:
        if task.name in tasks:
            continue
        now = next((other for other in new if _path(other) == _path(task)), None)
        if now is None:
            message = f"is in none of its files; it was imported from {_path(task) or 'nowhere'}"
            help = "name the project that the model was imported from"
            at, path = task.origin.location if task.origin else Location(), about(task=task.name)
            findings.report(codes.FOREIGN_PROJECT, message, at=at, path=path, help=help)
        else:
            new.remove(now)
            periods = f", with the period {now.period} for {task.period}" if now.period != task.period else ""
            _report_changed(task, now, f'is "{now.name}" in the project{periods}', findings)
    if new:
        message = f"not in the model, {counted(len(new), 'task')} of the project: {listed([task.name for task in new])}"
        help = "import the project again if they are new"
        findings.report(codes.MORE_IN_PROJECT, message, at=Location(paths[0]), help=help)


def _path(task: Task) -> str:
    return task.origin.path if task.origin else ""


# -------------------------------------------------------------------------------------------------- differences


def _compare(model: TaskModel, fresh: TaskModel, findings: Findings) -> None:
    for task in model.tasks:
        now = fresh.task(task.name)
        for message in _differences(task, now):
            _report_changed(task, now, message, findings)


def _report_changed(task: Task, now: Task, message: str, findings: Findings) -> None:
    origin = now.origin or task.origin
    findings.report(
        codes.CHANGED_PROJECT,
        f"{message}, imported from {task.origin.location if task.origin else 'nowhere'}",
        at=origin.location if origin else Location(),
        path=about(task=task.name),
        help="import the project again, and schedule it again, or put into the project what an overlay replaced",
    )


def _differences(task: Task, now: Task) -> Iterator[str]:
    if task.period != now.period:
        yield f"has the period {now.period} in the project, but {task.period} in the model"
    path, old = _path(now), _path(task)
    if old.startswith("/") and path != old:
        yield f'is "{path}" in the project, but "{old}" in the model'
    units, allowed = ({unit for version in t.versions for unit in version.units} for t in (task, now))
    if not units <= allowed:
        yield f"may run on {listed(sorted(allowed))} in the project, but on {listed(sorted(units))} in the model"
    before, after = _orders(task), _orders(now)
    if before and before != after:
        gone, new = sorted(before - after), sorted(after - before)
        changes = [f'no more after "{name}"' for name in gone] + [f'after "{name}"' for name in new]
        yield f"runs {listed(changes)} in the project, which is not the order of the model"


def _orders(task: Task) -> set[str]:
    """Return the predecessors that the project states; what an overlay states has no path of AUTOSAR."""
    return {
        precedence.task
        for version in task.versions
        for precedence in version.precedences
        if precedence.origin is not None and precedence.origin.path.startswith("/")
    }


# ------------------------------------------------------------------------------------------------------- reading


class _Reader:
    """Collects what an export needs to know of the containers of Os, Rte and EcuC."""

    def __init__(self, tree: Tree, built: Built, others: Sequence[Draft], findings: Findings) -> None:
        self._tree = tree
        self._built = built
        self._drafts = (*built.drafts, *others)
        self._others = {draft.name: (draft.period, draft.offset) for draft in others}
        self._findings = findings
        self._containers = Containers(tree)
        self._standard = standard_modules(tree)
        self._app_mode = chosen_mode(self._containers)
        units = [unit.name for unit in built.model.units]
        self._only = units[0] if len(units) == 1 else ""
        self._waits = self._containers.waits
        self._applications = {
            c.node.path: built.platform.core_of.get(c.node.path, self._only)
            for c in self._containers.of("OsApplication")
        }

    def project(self) -> Project:
        """Return the project; raise `HalpipeError` if it has no configuration that a schedule could be put onto."""
        calls = {
            draft.name: tuple(self._call(member) for member in draft.members if member.event is not None)
            for draft in self._drafts
        }
        alone = {
            draft.name: self._alone(member, member.os_task.place.path)
            for draft in self._built.drafts
            for member in draft.members
            if member.event is None and member.os_task is not None
        }
        tasks = {c.node.path: self._task(c) for c in self._containers.of("OsTask")}
        calls = self._woken(calls)
        others = tuple(LeftOut(name, *rate, calls.pop(name)) for name, rate in self._others.items())
        used = {call.os_task for found in calls.values() for call in found if call.os_task}
        used |= {call.os_task for call in alone.values()}
        os_module = self._module("Os", used)
        rte = {call.mapping for found in calls.values() for call in found if call.mapping}
        if rte:
            self._module("Rte", rte)
        return Project(
            schema=self._schema(os_module),
            os_module=os_module,
            items=self._items(),
            packages={node.path: node.parts[0].element.get("UUID") or "" for node in self._tree.tagged("AR-PACKAGE")},
            calls=calls,
            left_out=others,
            alone=alone,
            tasks=tasks,
            counters=tuple(self._counters(os_module)),
            starters=tuple(self._starters()),
            references={c.node.path: self._references(c) for c in self._containers.of("OsApplication", "OsTask")},
            applications=self._applications,
            files=tuple(
                dict.fromkeys(
                    part.file
                    for node in self._tree.tagged(_MODULE)
                    if self._standard.get(node.path) in ("Os", "Rte")
                    for part in node.parts
                )
            ),
            definitions=tuple(dict.fromkeys(node.at.file for node in self._tree.tagged("ECUC-MODULE-DEF"))),
            app_mode=self._app_mode,
        )

    def _woken(self, calls: dict[str, tuple[Call, ...]]) -> dict[str, tuple[Call, ...]]:
        """Return the calls of each task; where no OsEvent is named, with those of the other calls of the period."""
        rates = _rates(self._built.triggers)
        periods = {draft.name: draft.period for draft in self._drafts}
        known: dict[tuple[str, Duration | None], set[str]] = {}
        tasks: dict[tuple[str, Duration | None], set[str]] = {}
        for name, call in ((name, call) for name, found in calls.items() for call in found):
            known.setdefault((call.os_task, periods[name]), set()).update(call.os_events)
            tasks.setdefault((call.os_task, periods[name]), set()).add(name)

        def with_events(name: str, call: Call) -> Call:
            group = call.os_task, periods[name]
            if call.os_events or group not in known:
                return call
            of_rate = {event for event in self._waits.get(call.os_task, ()) if rates.get(event) == periods[name]}
            found = known[group] or of_rate
            return replace(call, os_events=tuple(sorted(found))) if 1 in (len(found), len(tasks[group])) else call

        return {name: tuple(with_events(name, call) for call in found) for name, found in calls.items()}

    def _references(self, container: Container) -> tuple[Value, ...]:
        stated = container.node.elements("REFERENCE-VALUES/*/DEFINITION-REF")
        names = dict.fromkeys("".join((e.text or "").split()).rpartition("/")[2] for e, _ in stated)
        return tuple(value for name in names for value in self._values(container, name))

    # ------------------------------------------------------------------------------------------------ modules

    def _module(self, name: str, inside: set[str]) -> str:
        """Return the path of the module configuration that holds containers, which must be one."""
        known = [node for node in self._tree.tagged(_MODULE) if self._standard.get(node.path) == name]
        holders = [node for node in known if any(_in(path, node.path) for path in inside)] or known
        if len(holders) != 1:
            what = listed([node.path for node in holders]) if holders else "none"
            message = f"there must be one configuration of {name} for the tasks of the model, but there is {what}"
            help = "name the project of one ECU, with its ECU configuration"
            at = holders[1].at if len(holders) > 1 else Location()
            self._findings.report(codes.NO_CONFIGURATION, message, at=at, help=help)
            self._findings.stop_on_errors()
        return holders[0].path

    def _schema(self, module: str) -> str:
        node = next(node for node in self._tree.tagged(_MODULE) if node.path == module)
        schema = node.parts[0].element.getroottree().getroot().get(_SCHEMA) or ""
        if _OLD_SCHEMA.match(schema):
            message = f"is of an older release than 4 ({schema.split()[0]}), to which nothing can be added"
            help = "export the project as release 4 first"
            self._findings.report(codes.NO_CONFIGURATION, message, at=node.at, path=module, help=help)
            self._findings.stop_on_errors()
        return schema

    def _items(self) -> dict[str, Item]:
        found = {}
        for node in self._tree.tagged(_MODULE, _CONTAINER):
            definition = self._tree.ref(node, "DEFINITION-REF")
            found[node.path] = Item(
                path=node.path,
                is_module=node.tag == _MODULE,
                definition=definition.path if definition else "",
                dest=definition.dest if definition else "",
                uuid=next((part.element.get("UUID") or "" for part in node.parts), ""),
                at=node.at,
                is_added=node.path in self._containers.added,
                places=tuple(place(part.element, part.file) for part in node.parts),
            )
        return found

    # --------------------------------------------------------------------------------------------- containers

    def _task(self, task: Container) -> ProjectTask:
        path = task.node.path
        owner = next(
            (
                c.node.path
                for c in self._containers.of("OsApplication")
                if path in {r.path for r in c.refs("OsAppTaskRef")}
            ),
            "",
        )
        kind = task.value("OsTaskType")
        begins = autostart_of(self._containers, task)
        unit = self._applications.get(owner, "") or self._only
        priority, schedule = task.number("OsTaskPriority"), task.value("OsTaskSchedule")
        return ProjectTask(
            path=path,
            unit=unit,
            application=owner,
            is_extended=bool(self._waits[path]) or (kind is not None and kind.text == "EXTENDED"),
            autostart=begins.node.path if begins else "",
            events=tuple(sorted(self._waits[path])),
            priority=int(priority) if priority is not None else None,
            is_preemptive=schedule is not None and schedule.text == FULL,
            activations=int(task.number("OsTaskActivation") or 1),
        )

    def _call(self, member: Activation) -> Call:
        mapping, event = member.mapping, member.event
        assert event is not None
        container = self._containers.by_path.get(mapping.place.path) if mapping is not None else None
        prefix = "RteBsw" if event.place.kind.startswith("BSW-") else "Rte"
        os_task = member.os_task.place.path if member.os_task is not None else ""
        alarms = tuple(self._values(container, f"{prefix}UsedOsAlarmRef"))
        points = tuple(self._values(container, f"{prefix}UsedOsSchTblExpiryPointRef"))
        events = [value.text for value in self._values(container, f"{prefix}UsedOsEventRef")]
        return Call(
            mapping=mapping.place.path if mapping is not None else "",
            event=event.place.path,
            is_bsw=event.place.kind.startswith("BSW-"),
            os_task=os_task,
            os_events=tuple(events or self._set_by((*alarms, *points), os_task)),
            alarms=alarms,
            points=points,
            has_period=event.period is not None and not member.used,
        )

    def _set_by(self, triggers: Sequence[Value], os_task: str) -> dict[str, None]:
        """Return the OsEvents of an OsTask that the alarms and expiry points set which a mapping uses."""
        found: dict[str, None] = {}
        for trigger in triggers:
            container = self._containers.by_path.get(trigger.text)
            deeds = deeds_of(self._containers, container) if container is not None else ()
            found.update(dict.fromkeys(d.event for d in deeds if d.event in self._waits.get(os_task, ())))
        return found

    def _alone(self, member: Activation, path: str) -> Call:
        """Return an OsTask that hosts no events as a call: it is activated, or woken by what recurs."""
        used = {place.path for place in member.used}
        triggers = [t for t in self._built.triggers if t.place.path in used and path in t.wakes]
        events = dict.fromkeys(event for t in triggers for event in t.events if event in self._waits[path])
        return Call(mapping="", event="", is_bsw=False, os_task=path, os_events=tuple(events))

    def _values(self, container: Container | None, name: str) -> Iterator[Value]:
        if container is None:
            return
        for ref in container.refs(name):
            holder = ref.element.getparent()
            generated = _is_generated(container.node.parts[0].element) or (holder is not None and _is_generated(holder))
            yield Value(name, ref.path, place(ref.element, ref.file), generated)

    def _counters(self, module: str) -> Iterator[ProjectCounter]:
        ticks = Ticks(self._containers)
        for counter in self._containers.of("OsCounter"):
            if not _in(counter.node.path, module):
                continue
            tick = ticks.of(counter)
            numbers = (counter.number("OsCounterMaxAllowedValue"), counter.number("OsCounterMinCycle"))
            largest, least = (int(number) if number else None for number in numbers)
            yield ProjectCounter(
                path=counter.node.path,
                unit=self._counter_unit(counter.node.path),
                tick=tick if tick is not None and tick <= _LONGEST_TICK else None,
                max_value=largest or 2**30 - 1,
                min_cycle=least or 1,
                at=counter.node.at,
            )

    def _counter_unit(self, path: str) -> str:
        """Return the unit of the OsApplication that has a counter, or of the tasks that its alarms concern."""
        for application in self._containers.of("OsApplication"):
            if path in {ref.path for ref in application.refs("OsAppCounterRef")}:
                return self._applications[application.node.path]
        units = {
            self._task(self._containers.by_path[task]).unit
            for alarm in self._containers.of("OsAlarm")
            if path in {ref.path for ref in alarm.refs("OsAlarmCounterRef")}
            for task in (deed.os_task for deed in self._deeds(alarm))
            if task in self._containers.by_path
        }
        return units.pop() if len(units) == 1 else ""

    def _deeds(self, starter: Container) -> tuple[Deed, ...]:
        return tuple(deed for deed in deeds_of(self._containers, starter) if deed.os_task)

    def _starters(self) -> Iterator[Starter]:
        called = grouped(
            (ref.path, start.node.path)
            for start in self._containers.of("RteUsedOsActivation")
            if not _is_generated(start.node.parts[0].element)
            for ref in start.refs("RteActivationOsAlarmRef", "RteActivationOsSchTblRef")
        )
        elsewhere = started_elsewhere(self._containers)
        others = replaced(self._containers, self._containers.of("OsScheduleTable"))
        used = {t for mapping in self._containers.of(*_MAPPINGS) for t in mapping.targets(*_ALARMS)}
        for starter in self._containers.of("OsAlarm", "OsScheduleTable"):
            path = starter.node.path
            deeds = self._deeds(starter)
            if not deeds or (starter in elsewhere and path not in called):
                continue  # one of another application mode starts nothing in that which is played
            is_table = starter.kind == "OsScheduleTable"
            begins = autostart_of(self._containers, starter)
            length = starter.value("OsScheduleTableDuration") if is_table else None
            cycle = length or (begins.value("OsAlarmCycleTime") if begins else None)
            first = begins.value("OsScheduleTableStartValue" if is_table else "OsAlarmAlarmTime") if begins else None
            yield Starter(
                path=path,
                is_table=is_table,
                deeds=deeds,
                autostart=begins.node.path if begins else "",
                cycle=cycle.text if cycle else "0",
                start=first.text if first else "0",
                calls=tuple(called.get(path, ())),
                mode=self._mode(begins, starter.kind) if begins else None,
                is_kept=starter in others and path not in called,
                counter=next((ref.path for ref in starter.refs(f"{starter.kind}CounterRef")), ""),
                is_used=path in used or _is_generated(starter.node.parts[0].element),
            )

    def _mode(self, begins: Container, kind: str) -> Value | None:
        """Return the reference of an autostart to the mode of the schedule, if it has another one, too."""
        modes = list(self._values(begins, f"{kind}AppModeRef"))
        return next((m for m in modes if m.text == self._app_mode), None) if len(modes) > 1 else None


def _rates(triggers: Sequence[Trigger]) -> dict[str, Duration]:
    """Return the mean time between two settings of each OsEvent (path) that one alarm or table sets."""
    sources = grouped((event, (t.table or t.place.path, t.period)) for t in triggers for event in t.events)
    return {event: found[0][1] / len(found) for event, found in sources.items() if len(dict(found)) == 1}


def _in(path: str, holder: str) -> bool:
    return path.startswith(holder + "/")


def _is_generated(element: object) -> bool:
    """Whether the vendor's generator owns a container or value, by its annotations."""
    origins = element.iterfind(f"{NS}ANNOTATIONS/{NS}ANNOTATION/{NS}ANNOTATION-ORIGIN")  # type: ignore[attr-defined]
    return any((origin.text or "").strip() in _GENERATED for origin in origins)
