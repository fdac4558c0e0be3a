"""Plan of the schedule tables of a project: OsTask or event of each expiry point, its counter, jobs with gaps.

The OS interrupts the OsTask of a job with a gap: it is preemptive, and below the OsTasks of all jobs that start in the
gap (MODEL 8.2, run time). Nothing of that is changed in a project."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, about, named
from halpipe.core.durations import Duration, greatest_common_divisor, seconds
from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.core.suggest import few
from halpipe.exporters.arxml.codes import (
    ACTIVATED_TWICE,
    BASIC_SHARED,
    COUNTER_NEEDED,
    NOT_MAPPED,
    OTHER_RATE,
    SHARED_EVENT,
    SPLIT_JOB,
    UNKNOWN_EVENT,
    WRONG_CORE,
)
from halpipe.exporters.arxml.software import ShortNames, short
from halpipe.exporters.arxml.tables import ExpiryPoint, Table, back_to_back, check_table
from halpipe.exporters.arxml.ticks import Counter, begin_of
from halpipe.exporters.common.priorities import relation_of
from halpipe.models.project import Call, Deed, Project, ProjectCounter, ProjectTask, Starter

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from halpipe.models import Job, Schedule, TaskModel


class _Gaps:
    """Check that the OS of a project interrupts the jobs with gaps."""

    def __init__(self, model: TaskModel, schedule: Schedule, project: Project) -> None:
        self._model = model
        self._schedule = schedule
        self._project = project
        jobs = schedule.all_jobs()
        self._first = {(job.task, job.version): job for job in reversed(jobs) if job.parts}

    def check(self, findings: Findings) -> None:
        """Report every job with a gap in which nothing of the project interrupts it."""
        above = self._above()
        for task, version in sorted(self._first):
            job = self._first[task, version]
            for own in self._os_tasks(task):
                if not own.is_preemptive:
                    self._report(findings, job, own, "is not preemptive", "set OsTaskSchedule to FULL")
                    continue
                for other in sorted(above.get(task, ())):
                    for high in self._os_tasks(other):
                        self._compare(findings, job, own, high)

    def _above(self) -> dict[str, set[str]]:
        """Return the tasks that must be above each, as if the versions with gaps were split anywhere."""
        tasks = tuple(
            replace(
                task,
                versions=tuple(
                    replace(v, split=replace(v.split, anywhere=(task.name, v.name) in self._first))
                    for v in task.versions
                ),
            )
            for task in self._model.tasks
        )
        found: dict[str, set[str]] = {}
        for by_task in relation_of(replace(self._model, tasks=tasks), self._schedule).values():
            for low, highs in by_task.items():
                found.setdefault(low, set()).update(highs)
        return found

    def _os_tasks(self, task: str) -> list[ProjectTask]:
        return [self._project.tasks[path] for path in self._project.os_tasks(task)]

    def _compare(self, findings: Findings, job: Job, low: ProjectTask, high: ProjectTask) -> None:
        if low.priority is not None and high.priority is not None and low.priority < high.priority:
            return
        self._report(
            findings,
            job,
            low,
            f"has the priority {low.priority}, and {high.path} ({self._project.place(high.path)}), "
            f"which starts in its gap, {high.priority}",
            f"give {high.path} a higher OsTaskPriority in the project, import it again, and schedule again",
        )

    def _report(self, findings: Findings, job: Job, own: ProjectTask, message: str, help: str) -> None:
        findings.report(
            SPLIT_JOB,
            f"job {job.index} has {len(job.parts)} parts, but {own.path} {message}",
            at=self._project.place(own.path),
            path=about(task=job.task),
            help=help,
        )


XDM = ".xdm"  # project data of EB tresos
_LONGEST = seconds(1)
_NEW_RANGE = 2**30 - 1


@record
class Action:
    """Action of an expiry point: set an OsEvent of an OsTask, or activate the OsTask if it has none (paths)."""

    os_task: str
    event: str = ""

    @property
    def key(self) -> str:
        """Identity of the action: an OsEvent may be set for several OsTasks."""
        return f"{self.os_task} {self.event}"


@record
class Placed:
    """A table with its counter, and where each task of the model first starts in it.

    `begin` is the value of the counter at which the table begins, which is the same instant for all. `is_reused` says
    that it is a table of the project, which its code starts, and which loses its own expiry points.
    """

    table: Table
    counter: ProjectCounter
    first: dict[str, int]
    begin: int = 0
    is_reused: bool = False


@record
class OntoPlan:
    """The tables, the counters that are new, and the actions by their keys."""

    tables: tuple[Placed, ...]
    new_counters: tuple[ProjectCounter, ...]
    actions: dict[str, Action]


class Planner:
    """Decides the tables of a project."""

    def __init__(self, model: TaskModel, schedule: Schedule, project: Project, findings: Findings) -> None:
        self._model = model
        self._project = project
        self._findings = findings
        self._schedule = schedule
        self._tables = list(_tables(schedule))
        self._first = schedule.modes[0].name
        units = {unit for _, _, _, jobs in self._tables for job in jobs for unit in job.units}
        self._units = [unit.name for unit in model.units if unit.name in units]
        taken = {path.rpartition("/")[2] for path in project.items if path.startswith(project.os_module + "/")}
        self._names = ShortNames(*taken)
        self._gaps = _Gaps(model, schedule, project)
        self._actions: dict[str, Action] = {}

    def plan(self) -> OntoPlan:
        """Return the tables; raise `HalpipeError` with each task that cannot be started where it is scheduled."""
        used: dict[str, set[str]] = {}
        starts: dict[str, tuple[Action, ...]] = {}
        for _, _, _, jobs in self._tables:
            for job in jobs:
                used.setdefault(job.task, set()).update(job.units)
        for task, units in used.items():
            starts[task] = self._starts(task, units)
        self._findings.stop_on_errors()
        self._gaps.check(self._findings)
        self._findings.stop_on_errors()
        self._report_shared(starts)
        self._report_left_out(starts)
        self._report_running(starts)
        self._findings.stop_on_errors()
        self._actions = {action.key: action for found in starts.values() for action in found}
        self._reused = {starter.path: starter for starter in self._project.starters if self._is_reused(starter)}
        self._owner = {Action(d.os_task, d.event): path for path, s in self._reused.items() for d in s.deeds}
        placed, new = [], []
        for unit in self._units:
            counter, is_new = self._counter(unit, starts)
            new += [counter] if is_new else []
            placed += list(self._placed(unit, counter, starts))
        for item in placed:
            check_table(item.table, _ticks_of(item.counter), self._findings)
        self._findings.stop_on_errors()
        return OntoPlan(tuple(self._together(placed)), tuple(new), self._actions)

    def _together(self, placed: Sequence[Placed]) -> Iterator[Placed]:
        """Yield the tables with the value of its counter at which each begins."""
        counters = [_ticks_of(item.counter) for item in placed]
        for item, counter in zip(placed, counters, strict=True):
            yield replace(item, begin=counter.ticks(begin_of(counters)))

    def _is_reused(self, starter: Starter) -> bool:
        """Whether a table of EB tresos can play its part of the schedule, started by the code that starts it today.

        It is started by code of the RTE, concerns nothing else, and its counter can tell every instant of its core.
        """
        at = self._project.items[starter.path].at.file
        if not (starter.is_table and starter.is_coded and at.endswith(XDM)):
            return False
        alone = {call.os_task for call in self._project.alone.values()}
        units = {self._project.tasks[deed.os_task].unit for deed in starter.deeds}
        tick = next((c.tick for c in self._project.counters if c.path == starter.counter), None)
        is_played = all(_key(d) in self._actions and d.os_task not in alone for d in starter.deeds)
        if starter.is_kept or tick is None or len(units) != 1 or not is_played:
            return False
        return not any(time % tick for mode, _, time in self._instants(units.pop()) if mode == self._first)

    # ------------------------------------------------------------------------------------------------- starts

    def _starts(self, task: str, units: Iterable[str]) -> tuple[Action, ...]:
        """Return what starts a job of a task, on the core that its OsTasks are bound to."""
        calls = self._project.calls.get(task, ())
        found: dict[Action, None] = {}
        alone = self._project.alone.get(task)
        if alone is not None:
            self._check_core(task, alone.os_task, units)
            found.update(dict.fromkeys(self._of_call(task, alone)))
        for call in calls:
            if not call.os_task or not call.mapping:
                message = f"its event {call.event} is mapped to no OsTask of the project"
                help = "map its event in the Rte configuration of the project"
                at, path = self._project.place(call.mapping), about(task=task)
                self._findings.report(NOT_MAPPED, message, at=at, path=path, help=help)
                continue
            self._check_core(task, call.os_task, units)
            found.update(dict.fromkeys(self._of_call(task, call)))
        return tuple(found)

    def _of_call(self, task: str, call: Call) -> list[Action]:
        """Return what runs a call: the events that an extended OsTask waits for, or one activation."""
        actions, count = self._actions_of(call), len(self._project.tasks[call.os_task].events)
        if not actions:
            why = f'waits for {count} OsEvents, and nothing states which of them is for "{task}"'
            self._findings.report(
                UNKNOWN_EVENT,
                why if count else f'is of the type EXTENDED, but has no OsEvent to wake it for "{task}"',
                at=self._project.place(call.mapping or call.os_task),
                path=named("OsTask", call.os_task),
                help="run the RTE generator once, or state RteUsedOsEventRef in the mapping",
            )
        return actions

    def _actions_of(self, call: Call) -> list[Action]:
        """Return what runs a call; nothing where no OsEvent of an extended OsTask is known."""
        target = self._project.tasks[call.os_task]
        if not target.is_extended:
            return [Action(call.os_task)]
        events = call.os_events or (target.events if len(target.events) == 1 else ())
        return [Action(call.os_task, event) for event in events]

    def _check_core(self, task: str, os_task: str, units: Iterable[str]) -> None:
        bound = self._project.tasks[os_task].unit
        for unit in sorted(units):
            if unit != bound:
                where = f"is bound to {bound}" if bound else "is bound to no core"
                message = f'runs on {unit}, but OsTask "{os_task}" {where}'
                help = "bind its OsApplication to the core, import again, and schedule again"
                at, path = self._project.items[os_task].at, about(task=task)
                self._findings.report(WRONG_CORE, message, at=at, path=path, help=help)

    def _report_shared(self, starts: dict[str, tuple[Action, ...]]) -> None:
        calls = self._project.calls
        by_action = grouped((action, task) for task, actions in starts.items() if calls.get(task) for action in actions)
        for action, tasks in by_action.items():
            if len(tasks) < 2:
                continue
            shown = few(tasks, quote="")
            code, help = (
                (BASIC_SHARED, "import with --granularity ostask, and schedule again")
                if not action.event
                else (SHARED_EVENT, "run the RTE generator on the merged project, or import with --granularity ostask")
            )
            path = action.event or action.os_task
            self._findings.report(code, f"starts {shown}", path=path, help=help, at=self._project.place(path))

    def _report_left_out(self, starts: dict[str, tuple[Action, ...]]) -> None:
        """Report calls that the model has not, but which run where the schedule starts others, at another rate."""
        tasks = {action: self._model.task(name) for name, actions in starts.items() for action in actions}
        for other in self._project.left_out:
            actions = [action for call in other.calls if call.os_task for action in self._actions_of(call)]
            played = next((tasks[action] for action in actions if action in tasks), None)
            if played is not None and (played.period, played.offset) != (other.period, other.offset):
                message = f"is started with {played.name} every {played.period}, but recurs every {other.period}"
                help = "keep it in the model, with --granularity ostask, or give it an OsTask or OsEvent of its own"
                at, path = self._project.place(next(call.mapping for call in other.calls)), about(task=other.name)
                self._findings.report(OTHER_RATE, message, at=at, path=path, help=help)

    def _report_running(self, starts: dict[str, tuple[Action, ...]]) -> None:
        """Report OsTasks that are activated while they still run, which the OS would drop."""
        queued = back_to_back(self._schedule, lambda job, unit: job.task)
        for os_task in dict.fromkeys(
            a.os_task for task in starts if task in queued for a in starts[task] if not a.event
        ):
            if self._project.tasks[os_task].activations < 2:
                message = "starts where its job before ends, but has one activation only"
                help = "set its OsTaskActivation to 2, or schedule again with a margin (--optimise margin)"
                at, path = self._project.place(os_task), named("OsTask", os_task)
                self._findings.report(ACTIVATED_TWICE, message, at=at, path=path, help=help)

    # ------------------------------------------------------------------------------------------------ counters

    def _counter(self, unit: str, starts: dict[str, tuple[Action, ...]]) -> tuple[ProjectCounter, bool]:
        """Return the first of the project's counters that all instants of a core fit, else a new one."""
        instants = [time for _, _, time in self._instants(unit)]
        of_reused = {starter.counter for starter in self._reused.values()}
        known = [c for c in self._project.counters if c.unit in (unit, "")]
        known.sort(key=lambda c: (c.path not in of_reused, c.unit != unit))
        for counter in known:
            if counter.tick is not None and not any(time % counter.tick for time in instants):
                findings = Findings()
                for item in self._placed(unit, counter, starts, ShortNames()):
                    check_table(item.table, _ticks_of(counter), findings)
                if not findings.has_errors:
                    return counter, False
        tick = greatest_common_divisor(instants) or Duration(10**6)
        tick = greatest_common_divisor([tick, _LONGEST]) if tick > _LONGEST else tick
        name = self._names("Halpipe", "Counter", short(unit))
        path = f"{self._project.os_module}/{name}"
        at = self._project.items[self._project.os_module].at
        added = ProjectCounter(path=path, unit=unit, tick=tick, max_value=_NEW_RANGE, min_cycle=1, at=at)
        self._report_counter(unit, known, added)
        return added, True

    def _report_counter(self, unit: str, known: Sequence[ProjectCounter], added: ProjectCounter) -> None:
        assert added.tick is not None
        usable = [counter for counter in known if counter.tick is not None]
        best = usable[0] if usable else None
        if best is None or best.tick is None:
            message, at = f"no counter of {unit} has a usable OsSecondsPerTick", added.at
            again = ""
        else:
            at = best.at
            off = [f"{what} at {time}" for _, what, time in self._instants(unit) if time % best.tick]
            shown = few(off, quote="")
            message = (
                f"{best.path} has a tick of {best.tick}, of which {shown} is no multiple"
                if off
                else f"{best.path} counts from {best.min_cycle} to {best.max_value}, which gaps or length do not fit"
            )
            again = f", or schedule again with --tick {best.tick}"
        self._findings.report(
            COUNTER_NEEDED,
            f"{message}; a counter with a tick of {added.tick} is needed, and added as {added.path}",
            at=at,
            path=about(unit=unit),
            help=f"give the new counter a timer of the hardware{again}",
        )

    def _instants(self, unit: str) -> Iterator[tuple[str, str, Duration]]:
        for mode, target, length, jobs in self._tables:
            mine = [job for job in jobs if unit in job.units]
            if mine:
                yield mode, f'the end of "{target or mode}"', length
                yield from ((mode, f'job {job.index} of "{job.task}"', job.start) for job in mine)

    # -------------------------------------------------------------------------------------------------- tables

    def _placed(
        self, unit: str, counter: ProjectCounter, starts: dict[str, tuple[Action, ...]], names: ShortNames | None = None
    ) -> Iterator[Placed]:
        names = names or self._names
        ticks = _ticks_of(counter)
        for mode, target, length, jobs in self._tables:
            tables: dict[str, dict[int, dict[str, None]]] = {}  # by the path of what is reused, empty for a new one
            first: dict[str, int] = {}
            for job in sorted((job for job in jobs if unit in job.units), key=lambda job: job.start):
                offset = ticks.ticks(job.start)
                first.setdefault(job.task, offset)
                for action in starts[job.task]:
                    own = self._owner.get(action, "") if (mode, target) == (self._first, "") else ""
                    tables.setdefault(own, {}).setdefault(offset, {})[action.key] = None
            for path, points in tables.items():
                made = names("Halpipe", *([mode, "to", target] if target else [mode]), short(unit)) if not path else ""
                placed = tuple(ExpiryPoint(offset, tuple(points[offset])) for offset in sorted(points))
                table = Table(made or path.rpartition("/")[2], unit, mode, target, ticks.ticks(length), placed)
                yield Placed(table, counter, first, is_reused=bool(path))


def _key(deed: Deed) -> str:
    """Return the identity of what an alarm or expiry point of the project does."""
    return Action(deed.os_task, deed.event).key


def _tables(schedule: Schedule) -> Iterator[tuple[str, str, Duration, tuple[Job, ...]]]:
    """Yield mode, target (empty for a mode itself), length and jobs of every table that takes time."""
    for mode in schedule.modes:
        yield mode.name, "", mode.hyperperiod, mode.jobs
    for switch in schedule.transitions:
        if switch.length:
            yield switch.source, switch.target, switch.length, switch.jobs


def _ticks_of(counter: ProjectCounter) -> Counter:
    assert counter.tick is not None
    return Counter(counter.tick, counter.min_cycle, counter.max_value)
