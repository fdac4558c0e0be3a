"""Assignment of executions to the jobs of the tables that were played, on columns: a recording has millions of them."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from halpipe.core.durations import Duration
from halpipe.core.records import record
from halpipe.models.trace import NONE, column, groups, plain
from halpipe.pipeline.compare.tables import Due, Lines, Starts, Table, repeated_table

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from halpipe.models import Job
    from halpipe.models.trace import Column, Execution, Executions, Instant

SAMPLE = 2000
"""Executions by which the zero of the schedule is sought; more would not change it and cost time."""
_FEW = 10
"""Executions of which fewer have no strays."""
_MOST_STRAYS = 100
_NOTHING = -1
"""Row, slot or line of what has none; no other is below 0."""


@record
class Match:
    """An execution and the job it is: `start` is the scheduled one, after the origin."""

    row: int
    origin: Duration
    execution: Execution
    table: Table
    cycle: int
    job: Job
    start: Duration
    reserved: Duration

    @property
    def began(self) -> Duration:
        """The start, after the origin."""
        return self.execution.start - self.origin

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

    `slots` has the row of each slot, -1 where none ran; `slot` has the slot of each row, -1 for an extra one.
    """

    executions: Executions
    lines: Lines
    origin: Instant
    slots: Column = field(init=False)
    slot: Column = field(init=False)
    extra: Column = field(init=False)
    missing: Column = field(init=False)
    is_joined: bool = False

    def __post_init__(self) -> None:
        self.slots = np.full(self.lines.slot[-1], _NOTHING, dtype=np.int32)
        self.slot = np.full(len(self.executions.task), _NOTHING, dtype=np.int32)

    @property
    def jobs(self) -> list[tuple[Table, Due]]:
        """The jobs of all tables, numbered."""
        return self.lines.table[0].jobs if self.lines.table else []

    def located(self, slots: Column) -> tuple[Column, Column]:
        """Return the lines of slots, and the numbers of their jobs."""
        bounds, first = np.array(self.lines.slot), np.array([table.first for table in self.lines.table], dtype=np.int64)
        lines = np.searchsorted(bounds, slots, side="right") - 1
        return lines, first[lines] + slots - bounds[lines]

    def of_jobs(self, name: str) -> Column:
        """Return a time of each job as a column by its number: its start, its length or what is reserved for it."""
        return column([getattr(due, name) for _, due in self.jobs])

    def starts(self, lines: Column, jobs: Column) -> Column:
        """Return the scheduled starts of jobs in lines, after the origin."""
        found: Column = column(self.lines.start)[lines] + self.of_jobs("start")[jobs]
        return found

    def at(self, slot: int) -> tuple[int, Due]:
        """Return the line and the job of a slot."""
        line = bisect_right(self.lines.slot, slot) - 1
        return line, self.lines.table[line].due[slot - self.lines.slot[line]]

    def match(self, row: int) -> Match:
        """Return a row with its job as objects."""
        line, due = self.at(int(self.slot[row]))
        table, cycle = self.lines.table[line], self.lines.cycle[line]
        start = Duration(self.lines.start[line] + due.start)
        origin, seen = Duration(self.origin), self.executions.row(row)
        return Match(row, origin, seen, table, cycle, due.job, start, Duration(due.reserved))

    @classmethod
    def of(
        cls, executions: Executions, lines: Lines, origin: Instant, parts: list[_Part], *, is_whole: bool = False
    ) -> Matching:
        """Assign executions to the jobs at some places of lines, in the order of the rows.

        Where several jobs of a task start at once, the place is that of any of them, unless it is exact. What was
        scheduled within the time that the executions cover, or at all (`is_whole`), and did not run is missing.
        """
        self, rows = cls(executions, lines, origin), executions.order
        line, place = (np.full(len(rows), _NOTHING, dtype=np.int32) for _ in range(2))
        is_exact = np.zeros(len(rows), dtype=bool)
        for part in parts:
            line[part.at], place[part.at], is_exact[part.at] = part.line, part.place, part.is_exact
        parts.clear()  # which frees their columns
        due = np.flatnonzero(line >= 0)
        job = np.array([table.first for table in lines.table], dtype=np.int32)[line[due]] + place[due]
        slot = np.array(lines.slot)[line[due]]
        lead = slot + np.array([each.together[0] for _, each in self.jobs], dtype=np.int64)[job]
        is_single = np.array([len(each.together) == 1 for _, each in self.jobs], dtype=bool)[job]
        is_alone = (np.bincount(lead)[lead] == 1) & (is_exact[due] | is_single)
        del job, lead
        slot += place[due]
        self.slots[slot[is_alone]] = rows[due[is_alone]]
        self.slot[rows[due[is_alone]]] = slot[is_alone]
        left = rows.copy()
        left[due] = _NOTHING
        for at in due[~is_alone].tolist():
            own = int(place[at])
            places = (own,) if is_exact[at] else self.lines.table[line[at]].due[own].together
            left[at] = self._keep(int(rows[at]), int(line[at]), places)
        self.extra = left[left >= 0]
        self.missing = np.flatnonzero(self.slots < 0)
        if not is_whole and len(self.missing):
            of, jobs = self.located(self.missing)
            begin, last = column([*covered(executions)])
            start = self.starts(of, jobs) + column([origin])
            self.missing = self.missing[(start >= begin) & (start + self.of_jobs("length")[jobs] < last)]
        return self

    def _keep(self, row: int, line: int, places: Sequence[int]) -> int:
        """Assign an execution to the best of some jobs of a line that start at once; return the row that has none.

        Of two executions of one job, keep the one that is closer to its instant, unless they are parts of a gang.
        """
        table, first = self.lines.table[line], self.lines.slot[line]
        place = min(places, key=lambda at: self._others(row, table.due[at], first + at))
        former = int(self.slots[first + place])
        if former >= 0:
            units, more = (self.executions.units[self.executions.on[at]] for at in (former, row))
            # Recorders that know one core per job show a gang as an execution on each of its units.
            if units and more and not {*units} & {*more} and table.due[place].units.issuperset((*units, *more)):
                self._join(former, row)
                return _NOTHING
            due = self.lines.start[line] + table.due[place].start + self.origin
            late, before = (self.executions.start[at] - due for at in (row, former))
            if late * late >= before * before:
                return row
            self.slot[former] = _NOTHING
        self.slots[first + place], self.slot[row] = row, first + place
        return former

    def _others(self, row: int, due: Due, slot: int) -> tuple[bool, bool, int]:
        """Return how badly a job fits an execution: not on its units, or with an execution already."""
        units = self.executions.units[self.executions.on[row]]
        return not due.units.issuperset(units), bool(self.slots[slot] >= 0), due.job.index

    def _join(self, former: int, row: int) -> None:
        """Let an execution of a gang run from when its last unit starts until its last unit ends."""
        seen = self.executions
        if not self.is_joined:
            seen.detach()
        self.is_joined = True
        seen.run_on(former, (*seen.units[seen.on[former]], *seen.units[seen.on[row]]))
        seen.start[former] = max(seen.start[former], seen.start[row])  # type: ignore[assignment]
        for times in (seen.end, seen.busy):
            both = (times[former], times[row])
            times[former] = NONE if NONE in both else max(both)  # type: ignore[assignment]
        if seen.stretches.get(former) != seen.stretches.get(row):
            seen.stretches.pop(former, None)


class Ran:
    """The executions with a job as columns, by the slots of their jobs; times that they were seen at are gathered."""

    def __init__(self, matching: Matching) -> None:
        slots = np.flatnonzero(matching.slots >= 0)
        line, job = matching.located(slots)
        self._seen, self.row = matching.executions, matching.slots[slots]
        self.line, self.job = line.astype(np.int32), job.astype(np.int32)
        self.due = matching.starts(line, job)
        """The scheduled start after the origin."""
        self._origin = column([matching.origin])

    @property
    def late(self) -> Column:
        """The distance of each start from its scheduled instant; negative: before."""
        late: Column = self.start - self._origin - self.due
        return late

    @property
    def start(self) -> Column:
        """The start of each job."""
        return column(self._seen.start)[self.row]

    @property
    def end(self) -> Column:
        """The end of each job; ``NONE`` where it has none."""
        return column(self._seen.end)[self.row]

    @property
    def has_end(self) -> Column:
        """Whether each job ended."""
        return np.not_equal(self.end, NONE)

    @property
    def length(self) -> Column:
        """The time in which each job really ran, of no meaning where it has no end."""
        busy = column(self._seen.busy)[self.row]
        return np.where(busy == NONE, self.end - self.start, busy)

    def by_task(self) -> dict[str, Column]:
        """Return the places of the jobs of each task, by the first of them."""
        names, task = self._seen.names, np.asarray(self._seen.task)[self.row]
        found = sorted(groups(task), key=lambda group: int(group[1][0]))
        return {names[number]: places for number, places in found}


@record(eq=False)
class _Part:
    """Executions of one task in one table, by their places in `rows`, with the starts of the task.

    `after` is when they started after their line, or of a mode that is repeated after the zero of the trace. They are
    assigned to places of lines, or of cycles; the `distance` is from these starts, with an origin. An exact place is
    the one that the trace states.
    """

    at: Column
    starts: Starts
    after: Column
    line: Column
    place: Column
    is_exact: Column
    distance: Column


def match_stated(executions: Executions, lines: Lines, origin: Instant | None, *, is_whole: bool) -> Matching:
    """Match the executions of a trace that names tables and cycles; `is_whole`: all jobs of the tables are due.

    Without an `origin`, it is the one with which no job is early, one on time, and the others least late.
    """
    parts_of = partial(_stated, executions, lines)
    zero = _origin(executions, parts_of, covered(executions)[0]) if origin is None else origin
    is_whole = is_whole and origin is not None
    return Matching.of(executions, lines, zero, parts_of(executions.order, zero), is_whole=is_whole)


def match_nearest(executions: Executions, table: Table, origin: Instant | None) -> Matching:
    """Match the executions of a trace in which one mode is repeated and no cycle is stated; `origin` as above."""
    parts_of = partial(_repeated, executions, table)
    zero = _origin(executions, parts_of, 0) if origin is None else origin
    parts = parts_of(executions.order, zero)
    lines = repeated_table(table, np.unique(np.concatenate([part.line for part in parts] or [np.arange(0)])))
    played = column(lines.cycle)
    lines_of = (np.searchsorted(played, part.line).astype(np.int32) for part in parts)
    parts = [replace(p, line=of, after=of, distance=of) for p, of in zip(parts, lines_of, strict=True)]
    return Matching.of(executions, lines, zero, parts)


def _repeated(executions: Executions, table: Table, rows: Column, origin: Instant) -> list[_Part]:
    start, length, found = column(executions.start)[rows], column([table.length]), []
    for number, at in groups(np.asarray(executions.task)[rows]):
        if (starts := table.starts.get(executions.names[number])) is not None:
            after = start[at] - column([origin])
            cycle, nearest = starts.nearest_of_cycles(after, table.length)
            distance, is_exact = after - cycle * length - starts.at[nearest], np.zeros(len(at), dtype=bool)
            found.append(_Part(at, starts, start[at], cycle, starts.first[nearest], is_exact, distance))
    return found


_UNSTATED, _NO_JOB = -1, -2
"""Places of jobs of which the trace states no number, or one that the table does not have."""


def _stated(executions: Executions, lines: Lines, rows: Column, origin: Instant) -> list[_Part]:
    task, cycle = (np.asarray(each)[rows] for each in (executions.task, executions.cycle))
    cycles, names = np.array([*lines.cycle, NONE]), executions.names
    line = np.searchsorted(cycles[:-1], cycle)
    known = np.flatnonzero(cycles[line] == cycle)
    table = np.array([2 * table.first + bool(table.due) for table in lines.table], dtype=np.int64)
    stated = np.full(len(executions.task), _UNSTATED)
    stated[[*executions.job]] = [job if 0 <= job < 2**31 else _NO_JOB for job in executions.job.values()]
    start, begins, found = column(executions.start)[rows], column(lines.start), []
    for _, among in groups(table[line[known]] * len(names) + task[known]):
        at = known[among]
        own = lines.table[line[at[0]]]
        if (starts := own.starts.get(names[task[at[0]]])) is not None:
            jobs, inverse = np.unique(stated[rows[at]], return_inverse=True)
            places = {_UNSTATED: _UNSTATED, **starts.numbered}
            place = np.array([places.get(job, _NO_JOB) for job in jobs.tolist()])[inverse]
            after, is_exact = start[at] - begins[line[at]], place >= 0
            near = starts.first[starts.nearest(after - column([origin]))]
            of, place = np.where(place == _NO_JOB, _NOTHING, line[at]), np.where(is_exact, place, near)
            distance = after - column([origin]) - own.begins[place]
            found.append(_Part(at, starts, after, of, place, is_exact, distance))
    return found


def covered(executions: Executions) -> tuple[Instant, Instant]:
    """Return the first and the last instant of which a trace with executions tells."""
    rows = executions.order
    start, end = (column(times)[rows] for times in (executions.start, executions.end))
    return plain(start[0]), plain(np.where(end == NONE, start, end).max())


def _sample(task: Column, parts_at: Callable[[Column], list[_Part]]) -> Column:
    """Return the places of the first executions, and of the first ones of the rarest tasks, which may come later."""
    firsts = np.sort(np.unique(task, return_index=True)[1])
    counted = [(part.starts.count, firsts[at]) for part in parts_at(firsts) for at in part.at.tolist()]
    least = min(counted)[0]
    rarest = [at for count, at in counted if count == least][:SAMPLE]
    places: Column = np.union1d(np.arange(min(SAMPLE, len(task))), rarest)
    return places


def _origin(executions: Executions, parts_of: Callable[[Column, Instant], list[_Part]], otherwise: Instant) -> Instant:
    """Return where the zero of the schedule lies in the trace: no job early, one on time, the others least late.

    The first execution of the rarest task is laid onto each of its jobs in turn, and the one that leaves the smallest
    sum of distances is taken, exactly; `otherwise`, if there is none. At most one in a hundred is left out: those that
    lie further before the first of the others than that one before the median, if their tasks ran more than twice as
    often on time. A stray start would else make all others late.
    """

    def distances(rows: Column, origin: Instant) -> Column:
        parts = parts_of(rows, origin)
        places, values = (np.concatenate(each) for each in zip(*((p.at, p.distance) for p in parts), strict=True))
        return values[np.argsort(places)]

    order = executions.order
    if not (places := [part.at for part in parts_of(order, 0)]):
        return otherwise
    known = order[np.sort(np.concatenate(places))]
    sample = known[_sample(np.asarray(executions.task)[known], lambda at: parts_of(known[at], 0))]
    rarest = min(
        parts_of(sample, 0),
        key=lambda part: (part.starts.count, executions.names[executions.task[sample[part.at[0]]]], part.at[0]),
    )
    candidates = (rarest.distance[:1] if rarest.is_exact[0] else rarest.after[0] - rarest.starts.at).tolist()
    origin = min(candidates, key=lambda origin: (sum(np.abs(distances(sample, origin)).tolist()), origin))
    most = min(max(1, len(known) // 100), _MOST_STRAYS) if len(known) >= _FEW else 0
    known = np.sort(known)
    every = distances(known, origin)
    nearest = np.argpartition(every, most)[: most + 1]  # of equal distances any: there is no gap between them
    nearest = nearest[np.argsort(every[nearest])]
    first: list[Instant] = every[nearest].tolist()
    gap, place = max(((first[at] - first[at - 1], at) for at in range(1, len(first))), default=(0, 0))
    task = np.asarray(executions.task)[known]
    strays = Counter(task[nearest[:place]].tolist())
    is_rare = all(np.count_nonzero(task == number) > 3 * count for number, count in strays.items())
    typical = plain(np.sort(distances(sample, origin))[(len(sample) - 1) // 2])
    zero: Instant = origin + first[place if is_rare and gap > typical - first[place] else 0]
    return zero
