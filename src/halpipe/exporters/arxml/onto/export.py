"""A schedule put onto a project: the delta, the files changed in place, and the list of both.

Other starters of the scheduled OsTasks are disabled in the files of the project, or the export refuses. An alarm or a
table is stopped by taking away what starts it. A table that does more loses the actions that are doubled. One that only
code starts cannot be stopped in a configuration."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Code, Findings, named
from halpipe.core.files import MANIFEST, MANIFEST_KEY, sha256
from halpipe.core.grouping import grouped
from halpipe.exporters.arxml.codes import (
    CODE_STARTS,
    DOUBLE_START,
    IN_THE_WAY,
    NEVER_STARTED,
    PHASE,
    RUNS_BESIDE,
    STARTS_ONCE,
)
from halpipe.exporters.arxml.document import Box, seconds_text
from halpipe.exporters.arxml.onto import CHANGES, DELTA, Change, Onto
from halpipe.exporters.arxml.onto.delta import Delta, mark
from halpipe.exporters.arxml.onto.edit import Edit, apply_edits, apply_to_xdm
from halpipe.exporters.arxml.onto.plan import XDM, Action, OntoPlan, Placed, Planner
from halpipe.exporters.arxml.osconfig import autostart, fill_counter, point_name
from halpipe.exporters.native import paired

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from halpipe.exporters.arxml.tables import Table
    from halpipe.models import Schedule, TaskModel
    from halpipe.models.project import Call, Deed, Project, ProjectCounter, Starter


_POINT = "OsScheduleTableExpiryPoint"


class _Stopper:
    """Stops what does what the schedule does, beside tables that are reused; reports the rest.

    `edits` are the changes of files, `stopped` the alarms and tables that are stopped whole.
    """

    def __init__(
        self, project: Project, actions: Collection[Action], reused: Collection[str], findings: Findings
    ) -> None:
        self._project = project
        self._played = {action.os_task for action in actions}
        self._events = {(action.os_task, action.event) for action in actions}
        self._reused = reused
        self._findings = findings
        self._removed: list[str] = []
        self.edits: list[Edit] = []
        self.stopped: list[Starter] = []

    def run(self) -> None:
        for starter in self._project.starters:
            doubled = [deed for deed in starter.deeds if self._is_doubled(deed)]
            if starter.path in self._reused:
                inside = (item for item in self._project.items.values() if item.path.startswith(f"{starter.path}/"))
                self._removed += (item.path for item in inside if item.definition.endswith(f"/{_POINT}"))
            elif doubled and (starter.is_kept or (starter.is_coded and not starter.is_table and not starter.is_used)):
                self._leave(starter)
            elif doubled and len(doubled) == len(starter.deeds):
                self._stop(starter)
            elif doubled and starter.is_table:
                self._cut(starter, doubled)
            elif doubled and not starter.is_coded:
                self._refuse(starter, "does more than that", "stop it by hand for what the schedule starts")
            if starter.path not in self._reused and not starter.is_coded:
                self._report_rest(starter)
        for path in sorted(self._played):
            task = self._project.tasks[path]
            if task.autostart and not task.is_extended:
                at = self._project.items[task.autostart].at
                message = "is activated once when the OS starts, before its jobs of the schedule"
                self._findings.report(
                    STARTS_ONCE, message, at=at, path=named("OsTask", path), help="nothing, if meant so"
                )
        self.edits[:0] = [Edit(at, path) for path in self._removed for at in self._project.items[path].places]

    def _is_doubled(self, deed: Deed) -> bool:
        """Whether the schedule does the same: an OsEvent that it never sets wakes something else."""
        return deed.os_task in self._played and (not deed.event or (deed.os_task, deed.event) in self._events)

    def _report_rest(self, starter: Starter) -> None:
        """Report the OsEvents that an alarm or table still sets for OsTasks of the schedule."""
        rest = {d.event for d in starter.deeds if d.os_task in self._played and not self._is_doubled(d)}
        if rest:
            text = f"still sets {', '.join(sorted(rest))}, for which no task of the schedule waits"
            self._report(RUNS_BESIDE, starter, text, "keep what the OsEvent wakes in the model, so that it has time")

    def _leave(self, starter: Starter) -> None:
        """Report a table of another mode, or an alarm, that only code of the project starts."""
        text = f"is left as it is, and starts {self._started(starter)} when code of the project starts it"
        remedy = "stop the tables of the schedule in the code that starts it, or start it nowhere"
        self._report(CODE_STARTS, starter, text, remedy)

    def _stop(self, starter: Starter) -> None:
        """Take away what starts an alarm or table that only does what the schedule plays."""
        mode = starter.mode
        if not starter.is_coded:
            begins = [starter.autostart] if starter.autostart and mode is None else []
            self._removed += [*begins, *starter.calls]
            if mode is not None:  # it starts in other application modes as before
                self.edits.append(Edit(mode.at, starter.autostart, mode.name, mode.text, None))
            self.stopped.append(starter)
        elif starter.is_table:
            self._refuse(
                starter,
                "is started by code, not by the OS or by the Rte configuration",
                "remove the table, and the code that starts it, from the project",
            )

    def _cut(self, starter: Starter, doubled: list[Deed]) -> None:
        """Take actions from a table; an expiry point goes with its last one."""
        rest = [deed for deed in starter.deeds if deed not in doubled]
        kept, shared = {deed.point for deed in rest}, {deed.path for deed in rest}
        if any(deed.path in shared for deed in doubled):
            self._refuse(starter, "sets an event for other OsTasks, too", "give each OsTask an event of its own")
            return
        self._removed += dict.fromkeys(deed.path if deed.point in kept else deed.point for deed in doubled)

    def _refuse(self, starter: Starter, why: str, remedy: str) -> None:
        self._report(DOUBLE_START, starter, f"starts {self._started(starter)} beside the schedule, and {why}", remedy)

    def _started(self, starter: Starter) -> str:
        """Return the names of the OsTasks of the schedule that an alarm or a table starts."""
        return ", ".join(sorted({deed.os_task for deed in starter.deeds if self._is_doubled(deed)}))

    def _report(self, code: Code, starter: Starter, text: str, remedy: str) -> None:
        path = named("OsScheduleTable" if starter.is_table else "OsAlarm", starter.path)
        self._findings.report(code, text, at=self._project.items[starter.path].at, path=path, help=remedy)


def put_onto(model: TaskModel, schedule: Schedule, project: Project, files: Mapping[str, tuple[str, bytes]]) -> Onto:
    """Return what to write; raise `HalpipeError` with every reason why the schedule cannot be put onto the project.

    `files` has the name inside the project, and the content, of each file by the name that places have.
    """
    findings = Findings()
    _refuse_earlier(project, findings)
    plan = Planner(model, schedule, project, findings).plan()
    writer = _Writer(schedule, project, plan, findings)
    writer.run()
    by_file = grouped((edit.at.file, edit) for edit in writer.edits)
    modules = writer.delta.modules()
    in_place = {path: file for path in modules if (file := project.items[path].at.file).endswith(XDM)}
    contents = {DELTA: writer.delta.write(in_place)} if len(in_place) < len(modules) else {}
    for file in sorted({*by_file, *in_place.values()}):
        name, data = files[file]
        edits = by_file.get(file, [])
        if not file.endswith(XDM):
            contents[f"changed/{name}"] = apply_edits(data, name, edits)
            continue
        module = next((modules[path] for path in in_place if in_place[path] == file), None)
        contents[f"changed/{name}"] = apply_to_xdm(data, name, module, edits)
    changes = [Change(files[e.at.file][0], e.path, e.name, e.old or "container", e.new) for e in writer.edits]
    changes += writer.delta.changes({path: files[file][0] for path, file in in_place.items()})
    keys = {"file": "file", "path": "path", "parameter": "name", "old": "old", "new": "new"}
    listed = [{key: getattr(change, name) for key, name in keys.items()} for change in changes]
    contents[CHANGES] = (json.dumps(listed, indent=1) + "\n").encode()
    contents |= paired(model, schedule)
    manifest = {
        MANIFEST_KEY: 1,
        "kind": "arxml-onto",
        "project": {file: _state(*files[file], contents) for file in project.files},
        "code": [writer.path(placed) for placed in plan.tables if placed.is_reused],
        "tables": [writer.path(placed) for placed in plan.tables if writer.begins(placed)],
        "tasks": {task: _os_tasks(project, task, plan) for task in sorted({*project.calls, *project.alone})},
        "files": {name: sha256(contents[name]) for name in sorted(contents)},
    }
    contents[MANIFEST] = (json.dumps(manifest, indent=1) + "\n").encode()
    return Onto(contents, writer.delta.write(), tuple(changes), tuple(findings.items))


def _state(name: str, data: bytes, contents: Mapping[str, bytes]) -> dict[str, str]:
    """Return what tells a file of the project from another, and by which file it is to be replaced."""
    changed = f"changed/{name}"
    return {"sha256": sha256(data), "changed": changed if changed in contents else ""}


def _os_tasks(project: Project, task: str, plan: OntoPlan) -> dict[str, list[str]]:
    """Return the OsTasks (paths) that run a task of the model, with the OsEvents of each that the schedule sets."""
    events: dict[str, list[str]] = {}
    for action in plan.actions.values():
        events.setdefault(action.os_task, []).extend([action.event] if action.event else [])
    return {path: sorted(events.get(path, ())) for path in sorted(project.os_tasks(task))}


def _refuse_earlier(project: Project, findings: Findings) -> None:
    """Stop if a delta of an export before is part of the project: a second one beside it would play both."""
    for item in project.items.values():
        if item.is_added:
            message = f"was put onto {project.items[project.os_module].at} by another export; {DELTA} would be a second"
            help = "remove the delta of that export, and the changes that it lists, from the project"
            findings.report(IN_THE_WAY, message, at=item.at, path=item.path, help=help)
    findings.stop_on_errors()


class _Writer:
    """Fills the delta, and lists what must change for it."""

    def __init__(self, schedule: Schedule, project: Project, plan: OntoPlan, findings: Findings) -> None:
        self.delta = Delta(project)
        self.edits: list[Edit] = []
        self._schedule = schedule
        self._project = project
        self._plan = plan
        self._findings = findings
        self._os = self.delta.box(project.os_module)

    def run(self) -> None:
        """Write counters, tables and references; stop what starts the same tasks otherwise."""
        reused = [self.path(placed) for placed in self._plan.tables if placed.is_reused]
        stopper = _Stopper(self._project, self._plan.actions.values(), reused, self._findings)
        stopper.run()
        self._findings.stop_on_errors()
        self.edits += stopper.edits
        if not self._project.app_mode:
            at, path = self._project.items[self._project.os_module].at, self._project.os_module
            message, help = "has no OsAppMode", "add an OsAppMode, or start the tables by code"
            self._findings.report(NEVER_STARTED, message, at=at, path=path, help=help)
        for counter in self._plan.new_counters:
            self._counter(counter)
        self._report_phases()
        for index, placed in enumerate(self._plan.tables):
            if placed.is_reused:
                self._reuse(placed)
            else:
                self._table(placed, stopper.stopped if index == 0 else ())
        for task, calls in self._project.calls.items():
            point = self._first_point(task)
            for call in calls if point else ():
                self._call(call, point)

    # -------------------------------------------------------------------------------------------------- tables

    def _counter(self, counter: ProjectCounter) -> None:
        assert counter.tick is not None
        box = self._os.new(counter.path.rpartition("/")[2], "OsCounter")
        mark(box, ())
        fill_counter(box, counter.max_value, counter.min_cycle, seconds_text(counter.tick)[0])
        application = self._application(counter.unit)
        if application:
            self.delta.box(application).refer("OsAppCounterRef", counter.path)

    def _application(self, unit: str) -> str:
        """Return the first OsApplication of a unit that has an OsTask which a table starts, empty if there is none."""
        started = {self._project.tasks[action.os_task].application for action in self._plan.actions.values()}
        found = [path for path, bound in self._project.applications.items() if bound == unit]
        return next((path for path in found if path in started), next(iter(found), ""))

    def _table(self, placed: Placed, stopped: Sequence[Starter]) -> None:
        table = placed.table
        box = self._os.new(table.name, "OsScheduleTable")
        mark(box, stopped)
        box.fill(OsScheduleTableDuration=table.duration, OsScheduleTableRepeating=table.is_repeating)
        box.refer("OsScheduleTableCounterRef", placed.counter.path)
        application = self._application(table.unit)
        if application:
            box.refer("OsSchTblAccessingApplication", application)
            self.delta.box(application).refer("OsAppScheduleTableRef", box.path)
        if self.begins(placed):
            autostart(box, placed.begin, [self._project.app_mode])
        self._points(box, table, application)

    def _points(self, box: Box, table: Table, application: str) -> None:
        for point in table.points:
            at = box.new(point_name(point.offset), _POINT).fill(OsScheduleTblExpPointOffset=point.offset)
            for number, key in enumerate(point.tasks):
                self._action(at, number, key, application)

    def _reuse(self, placed: Placed) -> None:
        """Give a table of the project other expiry points, and the length of the schedule."""
        path, name = self.path(placed), "OsScheduleTableDuration"
        starter = next(starter for starter in self._project.starters if starter.path == path)
        at = self._project.items[path].at
        self.edits.append(Edit(at, path, name, starter.cycle, str(placed.table.duration)))
        self._points(self.delta.box(path), placed.table, "")

    def _report_phases(self) -> None:
        """Report tables of which code decides when they begin, if they are not alone."""
        reused = [self.path(placed) for placed in self._plan.tables if placed.is_reused]
        if reused and len(self._plan.tables) > 1:
            self._findings.report(
                PHASE,
                f"{', '.join(reused)} begin when code starts them, and the schedule needs all tables to begin together",
                at=self._project.items[reused[0]].at,
                path=reused[0],
                help="let the code start them at one value of the counter (StartScheduleTableAbs)",
            )

    def begins(self, placed: Placed) -> bool:
        """Whether the OS starts a table: one of the first mode."""
        table = placed.table
        return (
            not placed.is_reused
            and table.is_repeating
            and table.mode == self._schedule.modes[0].name
            and bool(self._project.app_mode)
        )

    def path(self, placed: Placed) -> str:
        """Return the path of a table."""
        return f"{self._project.os_module}/{placed.table.name}"

    def _action(self, at: Box, number: int, key: str, application: str) -> None:
        action = self._plan.actions[key]
        kind = "EventSetting" if action.event else "TaskActivation"
        box = at.new(f"Action{number}", f"OsScheduleTable{kind}")
        if action.event:
            box.refer("OsScheduleTableSetEventRef", action.event)
            box.refer("OsScheduleTableSetEventTaskRef", action.os_task)
        else:
            box.refer("OsScheduleTableActivateTaskRef", action.os_task)
        owner = self._project.tasks[action.os_task].application
        if application and owner and owner != application:
            self.delta.box(action.os_task).refer("OsTaskAccessingApplication", application)

    # ---------------------------------------------------------------------------------------------- references

    def _first_point(self, task: str) -> str:
        """Return the path of the expiry point at which a task first starts in the first mode that has it.

        A mapping has none in a reused table, as before.
        """
        for placed in self._plan.tables:
            if placed.table.is_repeating and task in placed.first:
                return "" if placed.is_reused else f"{self.path(placed)}/{point_name(placed.first[task])}"
        return ""

    def _call(self, call: Call, point: str) -> None:
        """Name the expiry point that starts an event; an alarm chosen by hand excludes it (SWS_Rte_07808)."""
        name = f"Rte{'Bsw' if call.is_bsw else ''}UsedOsSchTblExpiryPointRef"
        if call.points:
            first = next((value for value in call.points if not value.is_generated), None)
            if first is not None:
                self.edits.append(Edit(first.at, call.mapping, name, first.text, point))
        else:
            self.delta.box(call.mapping).refer(name, point)
        for alarm in call.alarms if call.has_period else ():
            if not alarm.is_generated:
                self.edits.append(Edit(alarm.at, call.mapping, alarm.name, alarm.text, None))
