"""A schedule as schedule tables of an AUTOSAR OS: for each core one per mode and per switch, checked against SWS_Os.

A core on which a table has no job gets one all the same, which activates an idle task: OS tables are never empty
(SWS_Os_00401, SWS_Os_00407), and every core then switches in the same way.
"""

from __future__ import annotations

from collections import Counter as Counts
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.diagnostics import Findings
from halpipe.exporters.arxml.codes import ACTIVATED_TWICE, COUNTER_RANGE, MIN_CYCLE, TOO_MANY_POINTS
from halpipe.exporters.arxml.layout import ShortNames

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.exporters.arxml.layout import Layout
    from halpipe.exporters.arxml.ticks import Counter
    from halpipe.models import Job, Schedule, TaskModel

SYSTEM, DEFAULT_START = "OsOS", "OSDEFAULTAPPMODE"
"""Containers of the Os that have these names whatever the model."""

Work = tuple[str, str, str]
"""What an OsTask executes: a task, in a version, on a unit."""


@dataclass(frozen=True, slots=True)
class ExpiryPoint:
    """An offset from the beginning of a table, in ticks, and the OsTasks activated there."""

    offset: int
    tasks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
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
    def path(self) -> str:
        """The table in messages."""
        of = f'transition from "{self.mode}" to "{self.target}"' if self.target else f'mode "{self.mode}"'
        return f'{of} on "{self.unit}"'


@dataclass(frozen=True, slots=True)
class Plan:
    """All that an OS needs: its cores, the OsTasks and idle tasks by name, the tables, and the switches without one."""

    counter: Counter
    units: tuple[str, ...]
    tasks: dict[str, Work]
    idle: dict[str, str]
    tables: tuple[Table, ...]
    switches: tuple[tuple[str, str], ...]

    def table(self, unit: str, mode: str, target: str = "") -> Table | None:
        """Return the table of a mode or switch on a core; None for a switch that takes no time."""
        wanted = (unit, mode, target)
        return next((t for t in self.tables if (t.unit, t.mode, t.target) == wanted), None)


def make_plan(
    model: TaskModel, schedule: Schedule, layout: Layout, counter: Counter, max_points: int | None = None
) -> Plan:
    """Return the tables of a schedule; raise `HalpipeError` with every rule of the OS that one of them breaks."""
    jobs = [job for mode in schedule.modes for job in mode.jobs]
    jobs += [job for switch in schedule.transitions for job in switch.jobs]
    used = {unit for job in jobs for unit in job.units}
    units = tuple(unit.name for unit in model.units if unit.name in used)
    names = ShortNames(SYSTEM, DEFAULT_START)
    tasks = _tasks(jobs, model, layout, names)
    idle = {unit: names("Idle", layout.units[unit]) for unit in units if _is_ever_idle(unit, schedule)}
    tables = []
    by_work = {work: name for name, work in tasks.items()}
    for unit in units:
        writer = _Writer(unit, by_work, idle.get(unit, ""), counter)
        for mode in schedule.modes:
            name = names("Mode", layout.modes[mode.name], layout.units[unit])
            points = writer.points(mode.jobs)
            tables.append(Table(name, unit, mode.name, "", counter.ticks(mode.hyperperiod), points))
        for switch in schedule.transitions:
            if switch.length:
                ends = layout.modes[switch.source], "to", layout.modes[switch.target]
                name = names("Switch", *ends, layout.units[unit])
                points = writer.points(switch.jobs)
                length = counter.ticks(switch.length)
                tables.append(Table(name, unit, switch.source, switch.target, length, points))
    findings = Findings()
    for table in tables:
        check_table(table, counter, findings)
        if max_points is not None and len(table.points) > max_points:
            findings.add(
                TOO_MANY_POINTS(
                    f"has {len(table.points)} expiry points, but the OS allows {max_points}",
                    path=table.path,
                    help="choose a longer tick so that starts coincide, or split the mode",
                )
            )
    findings.stop_on_errors()
    switches = tuple((switch.source, switch.target) for switch in schedule.transitions)
    return Plan(counter, units, tasks, idle, tuple(tables), switches)


def _tasks(jobs: Iterable[Job], model: TaskModel, layout: Layout, names: ShortNames) -> dict[str, Work]:
    """Name an OsTask for every task, version and unit that occur: an OsTask runs one thing on one core."""
    order = {task.name: index for index, task in enumerate(model.tasks)}
    units = {unit.name: index for index, unit in enumerate(model.units)}
    found = {(job.task, job.version, unit) for job in jobs for unit in job.units}
    works = sorted(found, key=lambda work: (order[work[0]], work[1], units[work[2]]))
    versions = Counts(task for task, _ in {work[:2] for work in works})
    places = Counts(task for task, _ in {(work[0], work[2]) for work in works})
    named = {}
    for work in works:
        task, version, unit = work
        parts = [layout.tasks[task]]
        parts += [version] if versions[task] > 1 else []
        parts += [layout.units[unit]] if places[task] > 1 else []
        named[names(*parts)] = work
    return named


def _is_ever_idle(unit: str, schedule: Schedule) -> bool:
    """Return whether a mode, or a switch that takes time, has no job on a unit."""
    tables = [mode.jobs for mode in schedule.modes]
    tables += [switch.jobs for switch in schedule.transitions if switch.length]
    return not all(any(unit in job.units for job in jobs) for jobs in tables)


class _Writer:
    """Makes the expiry points of the tables of one core."""

    def __init__(self, unit: str, names: dict[Work, str], idle: str, counter: Counter) -> None:
        self._unit = unit
        self._names = names
        self._idle = idle
        self._counter = counter

    def points(self, jobs: Iterable[Job]) -> tuple[ExpiryPoint, ...]:
        """Return one expiry point for each instant at which jobs start on the core."""
        found: dict[int, list[str]] = {}
        for job in jobs:
            if self._unit in job.units:
                name = self._names[job.task, job.version, self._unit]
                found.setdefault(self._counter.ticks(job.start), []).append(name)
        if not found:
            found[0] = [self._idle]
        return tuple(ExpiryPoint(offset, tuple(found[offset])) for offset in sorted(found))


# ------------------------------------------------------------------------------------------------------ checks


def check_table(table: Table, counter: Counter, findings: Findings) -> None:
    """Report every rule of the OS that a table breaks on a counter."""
    if table.duration > counter.max_value + 1:
        tick = counter.tick
        findings.add(
            COUNTER_RANGE(
                f"lasts {tick * table.duration}, {table.duration} ticks of {tick}, but the counter has only "
                f"{counter.max_value + 1} values",
                path=table.path,
                help=f"set the maximal value to {table.duration - 1} or more, or schedule again with a tick of "
                f"{tick * -(-table.duration // (counter.max_value + 1))} or more",
            )
        )
    _check_gaps(table, counter, findings)
    for point in table.points:
        for task, count in Counts(point.tasks).items():
            if count > 1:
                findings.add(
                    ACTIVATED_TWICE(
                        f'OsTask "{task}" is activated {count} times at {counter.tick * point.offset}',
                        path=table.path,
                        help="give its version an execution time above 0, and schedule again",
                    )
                )


def _check_gaps(table: Table, counter: Counter, findings: Findings) -> None:
    """Check the first offset (0 is allowed), the gaps, and the final delay, which switches with jobs always have."""
    offsets = [point.offset for point in table.points]
    spans = [("the first expiry point is at", offsets[0])] if offsets[0] else []
    spans += [(f"after {counter.tick * a} the next expiry point follows in", b - a) for a, b in pairwise(offsets)]
    spans.append((f"after {counter.tick * offsets[-1]} the table ends in", table.duration - offsets[-1]))
    least = min(span for _, span in spans)
    for text, span in spans:
        if span < counter.min_cycle:
            findings.add(
                MIN_CYCLE(
                    f"{text} {span} ticks ({counter.tick * span}), fewer than the minimal cycle {counter.min_cycle}",
                    path=table.path,
                    help=f"a minimal cycle of {least} would do for this table; or schedule again with --tick "
                    f"{counter.tick * counter.min_cycle}",
                )
            )
