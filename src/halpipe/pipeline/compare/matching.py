"""Assignment of executions to the jobs of the tables that were played, on columns: a recording has millions of them."""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections import Counter
from dataclasses import dataclass, field
from heapq import nsmallest
from statistics import median_low
from typing import TYPE_CHECKING

from halpipe.core.durations import Duration
from halpipe.core.records import record
from halpipe.models.trace import NONE
from halpipe.pipeline.compare.tables import repeated_table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from halpipe.models import Job
    from halpipe.models.trace import Execution, Executions, Instant, Times
    from halpipe.pipeline.compare.tables import Due, Lines, Starts, Table

SAMPLE = 2000
"""Executions by which the zero of the schedule is sought; more would not change it and cost time."""
_FEW = 10
"""Executions of which fewer have no strays."""
_MOST_STRAYS = 100


@record
class Match:
    """An execution and the job it is: `start` is the scheduled one, after the origin."""

    row: int
    execution: Execution
    table: Table
    cycle: int
    job: Job
    start: Duration
    reserved: Duration

    @property
    def end(self) -> Duration:
        """The scheduled end, after the origin."""
        return self.start + (self.job.end - self.job.start)

    def due(self) -> list[tuple[Duration, Duration]]:
        """Return when the job is to run, after the origin."""
        by = self.start - self.job.start
        return [(start + by, end + by) for start, end in self.job.occupations()]


@dataclass(slots=True)
class Matching:
    """Executions by the slots of the jobs in the lines; `extra` are rows without a job, `missing` slots without a row.

    `slots` has the row of each slot, -1 where none ran; `line` and `place` say the same by row, -1 for an extra one.
    """

    executions: Executions
    lines: Lines
    origin: Instant
    slots: array[int] = field(init=False)
    line: array[int] = field(init=False)
    place: array[int] = field(init=False)
    extra: list[int] = field(default_factory=list)
    missing: list[tuple[int, int]] = field(default_factory=list)
    is_joined: bool = False

    def __post_init__(self) -> None:
        self.slots = array("q", [-1]) * self.lines.slot[-1]
        self.line = array("q", [-1]) * len(self.executions.task)
        self.place = array("i", [-1]) * len(self.executions.task)

    def due(self, row: int) -> Due:
        """Return the job of a row."""
        return self.lines.table[self.line[row]].due[self.place[row]]

    def start(self, row: int) -> Instant:
        """Return the scheduled start of a row, after the origin."""
        line = self.line[row]
        return self.lines.start[line] + self.lines.table[line].due[self.place[row]].start

    def lateness(self, row: int) -> Instant:
        """Return how long after its scheduled instant a job started; negative: before."""
        return self.executions.start[row] - self.origin - self.start(row)

    def rows(self) -> Iterator[int]:
        """Yield the rows with a job, by its scheduled start."""
        return (row for row in self.slots if row >= 0)

    def match(self, row: int) -> Match:
        """Return a row with its job as objects."""
        line, due = self.line[row], self.due(row)
        table, cycle = self.lines.table[line], self.lines.cycle[line]
        start = Duration(self.start(row))
        return Match(row, self.executions.row(row), table, cycle, due.job, start, Duration(due.reserved))

    def keep(self, row: int, line: int, places: Sequence[int]) -> None:
        """Assign an execution to a job of a line, the best of those that start at once.

        Of two executions of one job, keep the one that is closer to its instant, unless they are parts of a gang.
        """
        table, first = self.lines.table[line], self.lines.slot[line]
        place = (
            places[0] if len(places) == 1 else min(places, key=lambda at: self._others(row, table.due[at], first + at))
        )
        former = self.slots[first + place]
        if former < 0:
            self._take(row, line, place)
        elif self._is_gang(former, row, table.due[place]):
            self._join(former, row)
        else:
            due = self.lines.start[line] + table.due[place].start + self.origin
            starts = self.executions.start
            if _size(starts[row] - due) < _size(starts[former] - due):
                self._take(row, line, place)
                self.line[former] = -1
                self.extra.append(former)
            else:
                self.extra.append(row)

    def _take(self, row: int, line: int, place: int) -> None:
        self.slots[self.lines.slot[line] + place] = row
        self.line[row], self.place[row] = line, place

    def _others(self, row: int, due: Due, slot: int) -> tuple[bool, bool, int]:
        """Return how badly a job fits an execution: not on its units, or with an execution already."""
        units = self.executions.units[self.executions.on[row]]
        return not due.units.issuperset(units), self.slots[slot] >= 0, due.job.index

    def _is_gang(self, former: int, row: int, due: Due) -> bool:
        """Whether two executions are one job on several units, as recorders that know one core per job show it."""
        units, more = (self.executions.units[self.executions.on[at]] for at in (former, row))
        return bool(units and more) and not set(units) & set(more) and due.units.issuperset((*units, *more))

    def _join(self, former: int, row: int) -> None:
        """Let an execution of a gang run from when its last unit starts until its last unit ends."""
        seen = self.executions
        seen.run_on(former, (*seen.units[seen.on[former]], *seen.units[seen.on[row]]))
        seen.start[former] = max(seen.start[former], seen.start[row])  # type: ignore[assignment]
        for column in (seen.end, seen.busy):
            both = (column[former], column[row])
            column[former] = NONE if NONE in both else max(both)  # type: ignore[assignment]
        if seen.stretches.get(former) != seen.stretches.get(row):
            seen.stretches.pop(former, None)
        self.is_joined = True


def match_stated(executions: Executions, lines: Lines, origin: Instant, *, is_whole: bool = False) -> Matching:
    """Match the executions of a trace that names tables and cycles; `is_whole`: all jobs of the tables are due."""
    found = Matching(executions, lines, origin)
    first, last = covered(executions)
    line_of = {cycle: line for line, cycle in enumerate(lines.cycle)}
    numbered = bool(executions.job)
    for row in executions.order:
        line = line_of.get(executions.cycle[row], -1)
        starts = lines.table[line].starts.get(executions.names[executions.task[row]]) if line >= 0 else None
        job = executions.job.get(row) if numbered else None
        if starts is None:
            found.extra.append(row)
        elif job is None:
            instant = starts.nearest(executions.start[row] - lines.start[line] - origin)
            found.keep(row, line, starts.at[instant])
        elif job in starts.numbered:
            found.keep(row, line, (starts.numbered[job],))
        else:
            found.extra.append(row)
    _complete(found, None if is_whole else (first, last))
    return found


def match_nearest(executions: Executions, table: Table, origin: Instant) -> Matching:
    """Match the executions of a trace in which one mode is repeated and no cycle is stated."""
    first, last = covered(executions)
    period, starts_of = table.length, [table.starts.get(name) for name in executions.names]
    cycles: Times = array("q")
    instants: list[Instant] = []
    for row in executions.order:
        starts = starts_of[executions.task[row]]
        cycle, instant = starts.nearest_of_cycles(executions.start[row] - origin, period) if starts else (NONE, 0)
        try:
            cycles.append(cycle)
        except OverflowError:
            cycles = [*cycles, cycle]
        instants.append(instant)
    lines = repeated_table(table, sorted({*cycles} - {NONE}))
    found = Matching(executions, lines, origin)
    line_of: dict[Instant, int] = {cycle: line for line, cycle in enumerate(lines.cycle)}
    for row, line, instant in zip(executions.order, map(line_of.get, cycles), instants, strict=True):
        starts = starts_of[executions.task[row]]
        if starts is None or line is None:
            found.extra.append(row)
        else:
            found.keep(row, line, starts.at[instant])
    _complete(found, (first, last))
    return found


def _complete(found: Matching, within: tuple[Instant, Instant] | None) -> None:
    """Add what was scheduled within the time that the executions cover, or at all, and did not run."""
    lines, slot = found.lines, 0
    while True:
        try:
            slot = found.slots.index(-1, slot)
        except ValueError:
            return
        line = line_at(lines, slot)
        place = slot - lines.slot[line]
        due = lines.table[line].due[place]
        start = lines.start[line] + due.start + found.origin
        if within is None or (within[0] <= start and start + due.length < within[1]):
            found.missing.append((line, place))
        slot += 1


def line_at(lines: Lines, slot: int) -> int:
    """Return the line of a slot."""
    return bisect_right(lines.slot, slot) - 1


def _size(distance: Instant) -> Instant:
    return distance if distance >= 0 else -distance


def covered(executions: Executions) -> tuple[Instant, Instant]:
    """Return the first and the last instant that a trace tells of."""
    if not executions.order:
        return 0, 0
    ends = (executions.start[row] if (end := executions.end[row]) == NONE else end for row in executions.order)
    return executions.start[executions.order[0]], max(ends)


def find_origin(executions: Executions, table: Table) -> Instant:
    """Return where the zero of a repeated mode lies in the trace: no job early, one on time, the others least late.

    The first execution of the rarest task is laid onto each of its jobs in turn, and the one that leaves the smallest
    sum of distances is taken, exactly.
    """

    def starts_of(row: int) -> Starts:
        return table.starts[executions.names[executions.task[row]]]

    numbers = {number for number, name in enumerate(executions.names) if name in table.starts}
    known = array("q", (row for row in executions.order if executions.task[row] in numbers))
    if not known:
        return 0
    first = _rarest(executions, known, starts_of)
    candidates = [executions.start[first] - at for at in starts_of(first).at]

    def distance(row: int, origin: Instant) -> Instant:
        at = executions.start[row] - origin
        cycle, start = starts_of(row).nearest_of_cycles(at, table.length)
        return at - cycle * table.length - start

    return _least_late(executions, known, candidates, distance)


def find_stated_origin(executions: Executions, lines: Lines) -> Instant:
    """Return the same for a trace that names tables and cycles, where each execution is of a job of its table."""
    line_of = {cycle: line for line, cycle in enumerate(lines.cycle)}

    def table_of(row: int) -> Table:
        return lines.table[line_of[executions.cycle[row]]]

    def starts_of(row: int) -> Starts:
        return table_of(row).starts[executions.names[executions.task[row]]]

    def is_known(row: int) -> bool:
        return executions.cycle[row] in line_of and executions.names[executions.task[row]] in table_of(row).starts

    known = array("q", filter(is_known, executions.order))
    if not known:
        return executions.start[executions.order[0]]

    def distance(row: int, origin: Instant) -> Instant:
        starts, at = starts_of(row), executions.start[row] - lines.start[line_of[executions.cycle[row]]] - origin
        place = starts.numbered.get(executions.job.get(row, -1))
        return at - (starts.nearest(at) if place is None else table_of(row).due[place].start)

    first = _rarest(executions, known, starts_of)
    zero = executions.start[first] - lines.start[line_of[executions.cycle[first]]]
    place = starts_of(first).numbered.get(executions.job.get(first, -1))
    stated = starts_of(first).at if place is None else (table_of(first).due[place].start,)
    return _least_late(executions, known, [zero - at for at in stated], distance)


def _rarest(executions: Executions, known: Sequence[int], starts_of: Callable[[int], Starts]) -> int:
    """Return the first execution of the task with the fewest jobs in a table."""

    def jobs(row: int) -> tuple[int, str]:
        return sum(map(len, starts_of(row).at.values())), executions.names[executions.task[row]]

    return min(known[:SAMPLE], key=jobs)


def _least_late(
    executions: Executions,
    known: Sequence[int],
    candidates: Sequence[Instant],
    distance: Callable[[int, Instant], Instant],
) -> Instant:
    """Return the candidate with the smallest sum of distances, moved so that one execution is on time and none early.

    At most one in a hundred is left out: those that lie further before the first of the others than that one before
    the median, if their tasks ran more than twice as often on time. A stray start would else make all others late.
    """
    sample = known[:SAMPLE]
    origin = min(candidates, key=lambda origin: (sum(_size(distance(row, origin)) for row in sample), origin))
    most = min(max(1, len(known) // 100), _MOST_STRAYS) if len(known) >= _FEW else 0
    first = nsmallest(most + 1, ((distance(row, origin), row) for row in known))
    gap, place = max(((first[at][0] - first[at - 1][0], at) for at in range(1, len(first))), default=(0, 0))
    strays = Counter(executions.task[row] for _, row in first[:place])
    ran = Counter(executions.task[row] for row in known) if strays else strays
    is_rare = all(ran[task] > 3 * count for task, count in strays.items())
    if is_rare and gap > median_low(distance(row, origin) for row in sample) - first[place][0]:
        return origin + first[place][0]
    return origin + first[0][0]
