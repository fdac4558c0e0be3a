"""A schedule as schedule tables of an AUTOSAR OS: for each core one per mode and per switch, checked against SWS_Os.

A core on which a table has no job gets one all the same, which activates an idle task: OS tables are never empty
(SWS_Os_00401, SWS_Os_00407), and every core then switches in the same way.
"""

from __future__ import annotations

from collections import Counter as Counts
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from halpipe.core.diagnostics import Findings, Path, about, named
from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.exporters.arxml.codes import ACTIVATED_TWICE, COUNTER_RANGE, MIN_CYCLE, TOO_MANY_EVENTS, TOO_MANY_POINTS
from halpipe.exporters.arxml.software import Layout, ShortNames
from halpipe.exporters.common.priorities import levels_of, relation_of
from halpipe.models import Binding, Job, Schedule, TaskModel

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Sequence

    from halpipe.exporters.arxml.ticks import Counter, Hold, Holds

SYSTEM, DEFAULT_START = "OsOS", "OSDEFAULTAPPMODE"
"""Containers of the Os that have these names whatever the model."""

MOST_EVENTS = 64


class Work(NamedTuple):
    """Work of an OsTask: a task, in a version, on a unit; a bound task in whatever version the table means."""

    task: str
    versions: tuple[str, ...]
    unit: str


@record
class ExpiryPoint:
    """An offset from the beginning of a table, in ticks, the OsTasks activated there, and then the events set.

    `versions` are those of the jobs that are activated, in their order; an event is named with its OsTask.
    """

    offset: int
    tasks: tuple[str, ...]
    versions: tuple[str, ...] = ()
    events: tuple[tuple[str, str], ...] = ()


@record
class Table:
    """A table of one core. `mode` is played repeatedly; with `target` it is the switch there, played once."""

    name: str
    unit: str
    mode: str
    target: str
    duration: int
    points: tuple[ExpiryPoint, ...]

    @property
    def is_repeating(self) -> bool:
        """Whether the table is of a mode."""
        return not self.target

    @property
    def path(self) -> Path:
        """The table in messages."""
        of = about(transition_from=(self.mode, self.target)) if self.target else about(mode=self.mode)
        return about(of, on=self.unit)


@record
class Plan:
    """All that an OS needs: its cores, the OsTasks and idle tasks by name, the tables, and the switches without one.

    `events` are those that an OsTask waits for, with the position of each; `above` are the OsTasks that must be above
    one that is preempted, and `priorities` what follows from that. Those `queued` are activated while they still run.
    """

    counter: Counter
    units: tuple[str, ...]
    tasks: dict[str, Work]
    idle: dict[str, str]
    tables: tuple[Table, ...]
    switches: tuple[tuple[str, str], ...]
    events: dict[str, dict[Hold, str]]
    above: dict[str, tuple[str, ...]]
    priorities: dict[str, int]
    queued: Collection[str]

    def table(self, unit: str, mode: str, target: str = "") -> Table | None:
        """Return the table of a mode or switch on a core; None for a switch that takes no time."""
        wanted = (unit, mode, target)
        return next((t for t in self.tables if (t.unit, t.mode, t.target) == wanted), None)


@record
class _Played:
    """A table as it is played on all cores: its jobs, each moved by some time, and whether it starts them.

    A switch lasts as many cycles of the mode after as jobs in progress are held in, since only it knows of them.
    """

    mode: str
    target: str
    length: Duration
    jobs: tuple[tuple[Job, Duration, bool], ...]


def make_plan(
    model: TaskModel,
    schedule: Schedule,
    layout: Layout,
    holds: Holds,
    counter: Counter,
    max_points: int | None = None,
) -> Plan:
    """Return the tables of a schedule; raise `HalpipeError` with every rule of the OS that one of them breaks."""
    jobs = schedule.all_jobs()
    used = {unit for job in jobs for unit in job.units}
    units = tuple(unit.name for unit in model.units if unit.name in used)
    names = ShortNames(SYSTEM, DEFAULT_START)
    tasks = _tasks(jobs, model, layout, names)
    played = list(_played(schedule, holds))
    busy = [{unit for job, _, starts in table.jobs if starts for unit in job.units} for table in played]
    idle = {unit: names("Idle", layout.units[unit]) for unit in units if not all(unit in table for table in busy)}
    events = {name: _events(name, holds.of(work.task, work.versions), names) for name, work in tasks.items()}
    above, priorities = _priorities(model, schedule, tasks, holds)
    tables = []
    for unit in units:
        writer = _Writer(unit, tasks, events, idle.get(unit, ""), counter, holds)
        for run in played:
            mode = layout.modes[run.mode]
            own = ("Switch", mode, "to", layout.modes[run.target]) if run.target else ("Mode", mode)
            name = names(*own, layout.units[unit])
            length = counter.ticks(run.length)
            tables.append(Table(name, unit, run.mode, run.target, length, writer.points(run)))
    names_of = {(work.task, version, work.unit): name for name, work in tasks.items() for version in work.versions}
    queued = back_to_back(schedule, lambda job, unit: names_of[job.task, job.version, unit])
    findings = Findings()
    for name, found in events.items():
        if found and name in queued:
            help = "schedule again with a margin (--optimise margin), so that its jobs do not touch"
            message = "starts where its job before ends; one that waits for events has no second activation"
            findings.report(ACTIVATED_TWICE, message, path=named("OsTask", name), help=help)
        if len(found) > MOST_EVENTS:
            help = "allow fewer gaps (max-gaps), or fewer split points, and schedule again"
            message = f"would wait for {len(found)} events; a mask has {MOST_EVENTS}"
            findings.report(TOO_MANY_EVENTS, message, path=named("OsTask", name), help=help)
    for table in tables:
        check_table(table, counter, findings)
        if max_points is not None and len(table.points) > max_points:
            message = f"has {len(table.points)} expiry points, but the OS allows {max_points}"
            help = "choose a longer tick so that starts coincide, or split the mode"
            findings.report(TOO_MANY_POINTS, message, path=table.path, help=help)
    findings.stop_on_errors()
    switches = tuple((switch.source, switch.target) for switch in schedule.transitions)
    return Plan(counter, units, tasks, idle, tuple(tables), switches, events, above, priorities, queued)


def _played(schedule: Schedule, holds: Holds) -> Iterator[_Played]:
    """Yield the tables of all modes, then of all switches that take time."""
    modes = {mode.name: mode for mode in schedule.modes}
    for mode in schedule.modes:
        yield _Played(mode.name, "", mode.hyperperiod, tuple((job, ZERO, True) for job in mode.jobs))
    for switch in schedule.transitions:
        source, target = modes[switch.source], modes[switch.target]
        held = [job for job in source.jobs if holds.instants(job)]
        cycles = max((-(-job.end // source.hyperperiod) for job in held), default=0)
        late = [(job, -source.hyperperiod * number, False) for number in range(1, cycles) for job in held]
        own = [(job, ZERO, True) for job in switch.jobs]
        ends = [job.end + by for job, by, _ in (*late, *own) if holds.instants(job)]
        more = max(0, -(-(max(ends, default=ZERO) - switch.length) // target.hyperperiod)) if ends else 0
        first = [
            (job, switch.length + target.hyperperiod * number, True) for number in range(more) for job in target.jobs
        ]
        length = switch.length + target.hyperperiod * more
        if length:
            yield _Played(switch.source, switch.target, length, (*late, *own, *first))


def back_to_back(schedule: Schedule, name_of: Callable[[Job, str], str]) -> set[str]:
    """Return what has a job on a unit that starts where another one ends, in a mode or over a switch.

    An OS activates its OsTask before the job before has terminated, if that takes its whole WCET.
    """

    def ends_of(jobs: Iterable[Job]) -> set[tuple[str, Duration]]:
        return {(name_of(job, unit), job.end) for job in jobs for unit in job.units if job.end > job.start}

    def starts_of(jobs: Iterable[Job]) -> set[tuple[str, Duration]]:
        return {(name_of(job, unit), job.start) for job in jobs for unit in job.units}

    found, starts, lengths, late = set(), {}, {}, {}
    for mode in schedule.modes:
        length, ends = mode.hyperperiod, ends_of(mode.jobs)
        lengths[mode.name], starts[mode.name] = length, starts_of(mode.jobs)
        found |= {name for name, end in ends if (name, end % length) in starts[mode.name]}
        late[mode.name] = [(name, end - length * (n + 1)) for name, end in ends for n in range(end // length)]
    for switch in schedule.transitions:
        begun, after, cycle = starts_of(switch.jobs), starts[switch.target], lengths[switch.target]
        for name, end in (*late[switch.source], *ends_of(switch.jobs)):
            over = end - switch.length
            if (name, end) in begun or (over >= ZERO and (name, over % cycle) in after):
                found.add(name)
    return found


def _events(name: str, holds: Sequence[Hold], names: ShortNames) -> dict[Hold, str]:
    """Name the events that an OsTask waits for."""
    return {hold: names("Hold", name, str(number)) for number, hold in enumerate(holds, 1)}


def _priorities(
    model: TaskModel, schedule: Schedule, tasks: dict[str, Work], holds: Holds
) -> tuple[dict[str, tuple[str, ...]], dict[str, int]]:
    """Return the OsTasks above each that is preempted, and the priority of every OsTask."""
    relation = relation_of(model, schedule)
    levels = levels_of(relation)
    above: dict[str, tuple[str, ...]] = {}
    for name, work in tasks.items():
        if holds.is_preempted(work.task, work.versions):
            higher = relation.get(work.unit, {}).get(work.task, set())
            above[name] = tuple(n for n, other in tasks.items() if other.unit == work.unit and other.task in higher)
    return above, {name: 1 + levels.get(work.unit, {}).get(work.task, 0) for name, work in tasks.items()}


def _tasks(jobs: Iterable[Job], model: TaskModel, layout: Layout, names: ShortNames) -> dict[str, Work]:
    """Name an OsTask for every task, version and unit that occur: an OsTask runs one thing on one core.

    A task that is bound to its unit has one OsTask for all its versions there.
    """
    bound = {task.name for task in model.tasks if task.binding is not Binding.JOB}
    order = {task.name: index for index, task in enumerate(model.tasks)}
    units = {unit.name: index for index, unit in enumerate(model.units)}
    found = {(job.task, job.version, unit) for job in jobs for unit in job.units}
    single = sorted(found, key=lambda work: (order[work[0]], work[1], units[work[2]]))
    together: dict[tuple[str, str, str], tuple[str, ...]] = {}
    for task, version, unit in single:
        key = (task, "" if task in bound else version, unit)
        together[key] = (*together.get(key, ()), version)
    works = [Work(task, versions, unit) for (task, _, unit), versions in together.items()]
    versions = Counts(task for task, _ in {work[:2] for work in works})
    places = Counts(task for task, _ in {(work[0], work[2]) for work in works})
    named = {}
    for work in works:
        parts = [layout.tasks[work.task]]
        parts += work.versions if versions[work.task] > 1 and len(work.versions) == 1 else []
        parts += [layout.units[work.unit]] if places[work.task] > 1 else []
        named[names(*parts)] = work
    return named


class _Writer:
    """Makes the expiry points of the tables of one core."""

    def __init__(
        self,
        unit: str,
        tasks: dict[str, Work],
        events: dict[str, dict[Hold, str]],
        idle: str,
        counter: Counter,
        holds: Holds,
    ) -> None:
        self._unit = unit
        own = [(name, work) for name, work in tasks.items() if work.unit == unit]
        self._names = {(work.task, version): name for name, work in own for version in work.versions}
        self._events = events
        self._idle = idle
        self._counter = counter
        self._holds = holds

    def points(self, table: _Played) -> tuple[ExpiryPoint, ...]:
        """Return one expiry point for each instant at which jobs start on the core, or go on after they were held."""
        found: dict[int, list[tuple[str, str]]] = {}
        events: dict[int, list[tuple[str, str]]] = {}
        for job, by, starts in table.jobs:
            if self._unit not in job.units:
                continue
            name = self._names[job.task, job.version]
            if starts:
                found.setdefault(self._counter.ticks(job.start + by), []).append((name, job.version))
            for hold, until in self._holds.instants(job):
                at = (until + by) % table.length if not table.target else until + by
                if ZERO <= at < table.length:
                    events.setdefault(self._counter.ticks(at), []).append((name, self._events[name][hold]))
        if not found:
            found[0] = [(self._idle, "")]
        return tuple(
            ExpiryPoint(
                offset,
                tuple(name for name, _ in found.get(offset, ())),
                tuple(version for _, version in found.get(offset, ())),
                tuple(events.get(offset, ())),
            )
            for offset in sorted({*found, *events})
        )


# ------------------------------------------------------------------------------------------------------ checks


def check_table(table: Table, counter: Counter, findings: Findings) -> None:
    """Report every rule of the OS that a table breaks on a counter."""
    if table.duration > counter.max_value + 1:
        tick = counter.tick
        findings.report(
            COUNTER_RANGE,
            f"lasts {tick * table.duration}, {table.duration} ticks of {tick}, but the counter has only "
            f"{counter.max_value + 1} values",
            path=table.path,
            help=f"set the maximal value to {table.duration - 1} or more, or schedule again with a tick of "
            f"{tick * -(-table.duration // (counter.max_value + 1))} or more",
        )
    _check_gaps(table, counter, findings)
    for point in table.points:
        for task, count in Counts(point.tasks).items():
            if count > 1:
                message = f'OsTask "{task}" is activated {count} times at {counter.tick * point.offset}'
                help = "give its version an execution time above 0, and schedule again"
                findings.report(ACTIVATED_TWICE, message, path=table.path, help=help)


def _check_gaps(table: Table, counter: Counter, findings: Findings) -> None:
    """Check the first offset (0 is allowed), the gaps, and the final delay, which switches with jobs always have."""
    offsets = [point.offset for point in table.points]
    spans = [("the first expiry point is at", offsets[0])] if offsets[0] else []
    spans += [(f"after {counter.tick * a} the next expiry point follows in", b - a) for a, b in pairwise(offsets)]
    spans.append((f"after {counter.tick * offsets[-1]} the table ends in", table.duration - offsets[-1]))
    least = min(span for _, span in spans)
    for text, span in spans:
        if span < counter.min_cycle:
            message = f"{text} {span} ticks ({counter.tick * span}), fewer than the minimal cycle {counter.min_cycle}"
            help = (
                f"a minimal cycle of {least} would do for this table; or schedule again with --tick "
                f"{counter.tick * counter.min_cycle}"
            )
            findings.report(MIN_CYCLE, message, path=table.path, help=help)
