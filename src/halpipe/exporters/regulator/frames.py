"""Bandwidth demand of each unit over time: the exact access phases of every table, on the span that it covers.

A table is a mode (a circle: jobs that wrap come in again at its start) or a transition (a line that begins at the last
hyperperiod's end of the mode before). Times are integers: ticks that divide every time of the schedule and the window.
"""

from __future__ import annotations

import math
from collections import defaultdict
from fractions import Fraction
from typing import TYPE_CHECKING, NamedTuple

from halpipe.core.diagnostics import NOWHERE, Location, Path, named
from halpipe.core.records import record
from halpipe.exporters.common.timeline import PhaseTimes
from halpipe.exporters.regulator.platform import READ, WRITE
from halpipe.models import Access, AccessKind, Job, ModeSchedule, Schedule, TaskModel, TransitionTable

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.core.durations import Duration

MODE, TRANSITION = "mode", "transition"


class Row(NamedTuple):
    """Regulated row: one direction of one unit."""

    unit: str
    direction: str


@record
class Phase:
    """An access phase of one job on one of its units, in ticks of its table.

    A gang shares its bound equally, so `bound` is the part of this unit. On the circle of a mode `begin` lies on it. In
    a transition it is negative for what began before; `end` may be beyond the end of the table.
    """

    job: Job
    access: Access
    row: Row
    begin: int
    end: int
    bound: Fraction


@record
class Frame:
    """A table to be filled: what it covers, in ticks, and the phases in it.

    A transition covers its `length`, and as many `cycles` of the mode after as it takes until that mode's own table
    grants what is needed. `at` is its place in the schedule file.
    """

    name: str
    kind: str
    source: str
    target: str
    length: int
    cycles: int
    span: int
    phases: tuple[Phase, ...]
    at: Location = NOWHERE

    @property
    def path(self) -> Path:
        """Name of the table in messages."""
        return named(self.kind, self.name)


@record
class Grid:
    """The ticks: `per_ns` of them are a nanosecond, `window` of them a window."""

    per_ns: int
    window: int

    def ticks(self, ns: int | Fraction) -> int:
        """Return a time of the schedule in ticks, exact."""
        return int(ns * self.per_ns)

    def ns(self, ticks: int) -> Fraction:
        """Return ticks in nanoseconds."""
        return Fraction(ticks, self.per_ns)


def grid_of(model: TaskModel, schedule: Schedule, window: Duration) -> Grid:
    """Return ticks that divide every start, part, phase, interrupt, hyperperiod, transition and the window."""
    times = [window.ns]
    times += [mode.hyperperiod.ns for mode in schedule.modes]
    times += [table.length.ns for table in schedule.transitions]
    jobs = schedule.all_jobs()
    times += [time.ns for job in jobs for time in (job.start, *(edge for span in job.occupations() for edge in span))]
    times += [part.executed_from.ns for job in jobs for part in job.parts]
    versions = [version for task in model.tasks for version in task.versions]
    times += [edge.ns for version in versions for a in version.accesses for edge in (a.start, a.end)]
    times += [version.split.resume.ns for version in versions]
    times += [interrupt.wcet.ns for unit in model.units for interrupt in unit.interrupts]
    per_ns = math.lcm(*{time.denominator for time in times})
    return Grid(per_ns, int(window.ns * per_ns))


class Framer:
    """Makes the frames of a schedule for one resource; accesses of no kind use the direction `unspecified`.

    With `every` a transition has a frame even where it needs none, of one cycle of the mode after, so that the tables
    of several resources have the same numbers.
    """

    def __init__(
        self, model: TaskModel, schedule: Schedule, resource: str, grid: Grid, unspecified: str, *, every: bool = False
    ) -> None:
        self.every = every
        self.schedule = schedule
        self.grid = grid
        self.resource = resource
        self.directions = {AccessKind.WRITE: WRITE, None: unspecified}
        self.times = PhaseTimes(model)

    def frames(self) -> list[Frame]:
        """Return the frames of all modes, then of the transitions that need a table."""
        modes = {mode.name: mode for mode in self.schedule.modes}
        found = [self._mode(mode) for mode in self.schedule.modes]
        for table in self.schedule.transitions:
            frame = self._transition(table, modes[table.source], modes[table.target])
            if frame.span:
                found.append(frame)
        return found

    def _mode(self, mode: ModeSchedule) -> Frame:
        span = self.grid.ticks(mode.hyperperiod.ns)
        phases = tuple(_moved(p, -(p.begin // span) * span) for p in self._phases(mode.jobs, 0))
        return Frame(mode.name, MODE, mode.name, mode.name, span, 1, span, phases, mode.at)

    def _transition(self, table: TransitionTable, source: ModeSchedule, target: ModeSchedule) -> Frame:
        length, cycle = self.grid.ticks(table.length.ns), self.grid.ticks(target.hyperperiod.ns)
        before = self._before(source)
        foreign = [p for p in (*before, *self._phases(table.jobs, 0)) if p.end > 0]
        own = list(self._phases(target.jobs, length))
        cycles = _cycles(foreign, own, length, cycle) or int(self.every and not length)
        after = [_moved(phase, number * cycle) for number in range(cycles) for phase in own]
        return Frame(
            name=table.name,
            kind=TRANSITION,
            source=table.source,
            target=table.target,
            length=length,
            cycles=cycles,
            span=length + cycles * cycle,
            phases=(*foreign, *after),
            at=table.at,
        )

    def _before(self, source: ModeSchedule) -> Iterator[Phase]:
        """Yield the phases of a mode that are in force after its last cycle; jobs may last several cycles."""
        cycle = self.grid.ticks(source.hyperperiod.ns)
        for phase in self._phases(source.jobs, -cycle):
            yield phase
            for number in range(1, -(-phase.end // cycle)):
                yield _moved(phase, -number * cycle)

    def _phases(self, jobs: Iterable[Job], shift: int) -> Iterator[Phase]:
        for job in jobs:
            start = self.grid.ticks(job.start.ns) + shift
            for access, first, last in self.times.of(job):
                if access.resource == self.resource:
                    begin, end = self.grid.ticks(first.ns), self.grid.ticks(last.ns)
                    direction, bound = self.directions.get(access.kind, READ), access.bound / len(job.units)
                    for unit in job.units:
                        yield Phase(job, access, Row(unit, direction), start + begin, start + end, bound)


def _moved(phase: Phase, by: int) -> Phase:
    return Phase(phase.job, phase.access, phase.row, phase.begin + by, phase.end + by, phase.bound)


def _cycles(foreign: list[Phase], own: list[Phase], length: int, cycle: int) -> int:
    """Return how many cycles of the mode after belong to the transition.

    In its first cycle the parts of its jobs that wrap in from before were never started, while jobs of the mode
    before or of the transition may still be at work. None, if what wraps in covers for those at every instant.
    """
    tails = [phase for phase in foreign if phase.end > length]
    idle = [_moved(phase, -cycle) for phase in own if phase.end - cycle > length]
    if _covered(tails, idle, length):
        return 0
    return -(-(max(phase.end for phase in tails) - length) // cycle)


def _covered(phases: list[Phase], cover: list[Phase], begin: int) -> bool:
    """Return whether from `begin` on no row needs more for `phases` than it has for `cover`."""
    changes: dict[Row, dict[int, Fraction]] = defaultdict(lambda: defaultdict(Fraction))
    for sign, several in ((1, phases), (-1, cover)):
        for phase in several:
            changes[phase.row][max(phase.begin, begin)] += sign * phase.bound
            changes[phase.row][phase.end] -= sign * phase.bound
    for steps in changes.values():
        rate = Fraction(0)
        for instant in sorted(steps):
            rate += steps[instant]
            if rate > 0:
                return False
    return True
