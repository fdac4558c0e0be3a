"""Tables of a schedule, and the sequence of them in which a trace belongs."""

from __future__ import annotations

import itertools
from collections import defaultdict
from dataclasses import field
from typing import TYPE_CHECKING

import numpy as np

from halpipe.core.diagnostics import NOWHERE, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.models.trace import NONE, column, groups
from halpipe.pipeline.compare.codes import Kind

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from halpipe.models import Job, Schedule
    from halpipe.models.trace import Column, Executions, Instant
    from halpipe.pipeline.compare.judging import Judge


@record
class Due:
    """A job of a table with what its executions are compared with, in nanoseconds.

    `reserved` is the time that the schedule reserves for it: all but its gaps. `together` has the places of all jobs of
    its task that start with it.
    """

    job: Job
    start: Instant
    length: Instant
    reserved: Instant
    units: frozenset[str]
    together: tuple[int, ...]

    @classmethod
    def of(cls, job: Job, together: Sequence[int]) -> Due:
        """Return what is due for a job."""
        reserved = sum((end - start for start, end in job.occupations()), ZERO)
        length, units = (job.end - job.start).ns, frozenset(job.units)
        return cls(job, job.start.ns, length, reserved.ns, units, tuple(together))


class Starts:
    """The jobs of one task in a table by their starts; several may start at once, on different units."""

    def __init__(self, places: Sequence[int], due: Sequence[Due]) -> None:
        at: dict[Instant, int] = {}
        self.numbered: dict[int, int] = {}
        for place in places:
            at.setdefault(due[place].start, place)
            self.numbered.setdefault(due[place].job.index, place)
        self.count, self.at = len(places), column([*at])
        self.first = np.array([*at.values()], dtype=np.int32)
        """The first place of each start."""

    def nearest(self, at: Column) -> Column:
        """Return the start nearest to each instant, by its number; of two the earlier."""
        after = np.searchsorted(self.at, at)
        low, high = np.maximum(after - 1, 0), np.minimum(after, len(self.at) - 1)
        return np.where(at - self.at[low] <= self.at[high] - at, low, high)

    def nearest_of_cycles(self, at: Column, period: Instant) -> tuple[Column, Column]:
        """Return the cycle and the start nearest to each instant, where all are repeated with `period`."""
        length, own = column([period]), self.at
        cycle = at // length
        phase, around = at - cycle * length, np.concatenate((own[-1:] - length, own, own[:1] + length))
        after = np.searchsorted(own, phase)
        nearest = after + (phase - around[after] > around[after + 1] - phase)
        return cycle - (nearest == 0) + (nearest > len(own)), (nearest - 1) % len(own)


@record(eq=False)
class Table:
    """A mode or a transition table: what is played as one piece; `due` by start (`begins`), `starts` by task.

    `jobs` are those of all tables of the schedule, numbered; `first` is the number of the first in this table.
    """

    name: str
    length: Instant
    due: tuple[Due, ...]
    begins: Column
    starts: Mapping[str, Starts]
    successors: frozenset[str]
    first: int
    jobs: list[tuple[Table, Due]]


@record(eq=False)
class Lines:
    """Tables that were played, as columns by row: each with its cycle, its start after the origin, and its first slot.

    `pauses` has the next cycle in which something ran by the last one before it, where too many lie between them.
    """

    table: list[Table] = field(default_factory=list)
    cycle: list[int] = field(default_factory=list)
    start: list[Instant] = field(default_factory=list)
    slot: list[int] = field(default_factory=lambda: [0])
    pauses: dict[int, int] = field(default_factory=dict)

    def play(self, table: Table, cycle: int, start: Instant) -> None:
        """Append a table."""
        self.table.append(table)
        self.cycle.append(cycle)
        self.start.append(start)
        self.slot.append(self.slot[-1] + len(table.due))


def tables_of(schedule: Schedule) -> dict[str, Table]:
    """Return the tables of a schedule by name."""
    switches = {t.name: t for t in schedule.transitions}
    found: dict[str, Table] = {}
    known: list[tuple[Table, Due]] = []

    def put(name: str, length: Duration, jobs: Iterable[Job], successors: set[str]) -> None:
        ordered = sorted(jobs, key=lambda job: (job.start.ns, job.task, job.index))
        places: dict[str, list[int]] = defaultdict(list)
        at_once: dict[tuple[str, Instant], list[int]] = defaultdict(list)
        for place, job in enumerate(ordered):
            places[job.task].append(place)
            at_once[job.task, job.start.ns].append(place)
        due = tuple(Due.of(job, at_once[job.task, job.start.ns]) for job in ordered)
        starts = {task: Starts(own, due) for task, own in places.items()}
        found[name] = Table(
            name, length.ns, due, column([each.start for each in due]), starts, frozenset(successors), len(known), known
        )
        known.extend((found[name], each) for each in due)

    for mode in schedule.modes:
        after = {name for name, table in switches.items() if table.source == mode.name}
        direct = {table.target for table in switches.values() if table.source == mode.name and not table.length}
        put(mode.name, mode.hyperperiod, mode.jobs, {mode.name} | after | direct)
    for name, switch in switches.items():
        put(name, switch.length, switch.jobs, {switch.target})
    return found


MOST_SILENT = 100_000
"""Jobs of cycles in which nothing ran that are counted as missing, one by one."""


def played_tables(executions: Executions, tables: Mapping[str, Table], judge: Judge, first: str = "") -> Lines:
    """Return the tables that the labels of `executions` name, in order.

    Cycles in which nothing ran are filled in, from cycle 0 on where the `first` table is known. Report tables that
    cannot follow each other.
    """
    cycles, numbers = (np.asarray(each)[executions.order] for each in (executions.cycle, executions.table))
    is_known = np.array([name in tables for name in executions.names], dtype=bool)
    known = np.flatnonzero((cycles != NONE) & is_known[numbers])
    of, first_of = np.unique(cycles[known], return_index=True)
    stated = dict(zip(of.tolist(), numbers[known[first_of]].tolist(), strict=True))
    differs = numbers[known] != numbers[known[first_of]][np.searchsorted(of, cycles[known])]
    for place in known[differs].tolist():
        row, cycle = executions.order[place], int(cycles[place])
        one, other = executions.names[stated[cycle]], executions.names[numbers[place]]
        path, message = (
            about(task=executions.names[executions.task[row]]),
            f'cycle {cycle} is both "{one}" and "{other}"',
        )
        judge.add(Kind.SEQUENCE, path, 0, message, executions.row(row).at)
    lines = Lines()
    now: Instant = 0
    left = MOST_SILENT
    last, before = (tables[first], -1) if first else (None, 0)
    for cycle in sorted(stated):
        table = tables[executions.names[stated[cycle]]]
        silent = _between(last, cycle - before, table, tables) if last else []
        if silent is None and last:
            message = f'cycle {cycle} is "{table.name}", {cycle - before} after "{last.name}" in cycle {before}'
            help = f"after it may come: {', '.join(sorted(last.successors))}"
            judge.add(Kind.SEQUENCE, about(table=last.name), 0, message, NOWHERE, help)
        for between, times in silent or ():
            jobs = times * len(between.due)
            left -= jobs
            if jobs and left < 0:
                lines.pauses[before] = cycle
            else:
                number = lines.cycle[-1] + 1 if lines.cycle else 0
                for i in range(times):
                    lines.play(between, number + i, now + between.length * i)
            now += between.length * times
        lines.play(table, cycle, now)
        now += table.length
        last, before = table, cycle
    return lines


def repeated_table(table: Table, cycles: Column) -> Lines:
    """Return the rows of a mode that is repeated, from the first to the last of the cycles in which something ran.

    Of the longest pauses only the ends are there, so that the jobs that are counted as missing have a limit.
    """
    jobs, gaps = len(table.due), np.flatnonzero(np.diff(cycles) > 1)
    pauses, left = [], MOST_SILENT // max(1, jobs)
    ends = zip(cycles[gaps].tolist(), cycles[gaps + 1].tolist(), strict=True)
    for before, after in sorted(ends, key=lambda gap: (gap[1] - gap[0], gap)):
        left -= after - before - 1
        if left < 0:
            pauses.append((before, after))
    edges = sorted([*cycles[:1].tolist(), *itertools.chain(*pauses), *cycles[-1:].tolist()])
    played = [each for a, b in zip(edges[::2], edges[1::2], strict=True) for each in range(a, b + 1)]
    slots = [number * jobs for number in range(len(played) + 1)]
    return Lines([table] * len(played), played, [cycle * table.length for cycle in played], slots, dict(sorted(pauses)))


def _between(last: Table, steps: int, table: Table, tables: Mapping[str, Table]) -> list[tuple[Table, int]] | None:
    """Return the tables, and how often each, of the silent cycles before `table`, `steps` after `last`.

    A mode is kept as long as possible, then comes the switch; None: the schedule has no such sequence.
    """
    found: list[tuple[Table, int]] = []
    if last.name not in last.successors and steps > 1:  # a switch, after which comes its target
        last, steps = tables[next(iter(last.successors))], steps - 1
        found.append((last, 1))
    # Not by way of a third mode, though one may follow at once by a switch of length zero.
    switches = (name for name in sorted(last.successors) if name not in tables[name].successors)
    switch = next((name for name in switches if table.name in tables[name].successors), None)
    if switch is not None and steps > 1 and table.name != last.name:
        return [*found, (last, steps - 2), (tables[switch], 1)]
    return [*found, (last, steps - 1)] if table.name in last.successors else None


def unknown_tables(executions: Executions, tables: Mapping[str, Table], judge: Judge) -> None:
    """Report, once each, the tables that a trace names and the schedule does not have."""
    for number, rows in groups(np.asarray(executions.table)[executions.order]):
        name = executions.names[number]
        if name and name not in tables:
            help = did_you_mean(name, sorted(tables), "compare with the schedule that was loaded")
            message = f'the schedule has no table "{name[:60]}"'
            judge.add(Kind.UNKNOWN_TABLE, "", 0, message, executions[int(rows[0])].at, help)
