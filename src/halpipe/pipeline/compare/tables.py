"""Tables of a schedule, and the sequence of them in which a trace belongs."""

from __future__ import annotations

import itertools
from bisect import bisect_left
from collections import defaultdict
from dataclasses import field
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import NOWHERE, about
from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.models.trace import NONE
from halpipe.pipeline.compare.codes import Kind

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from halpipe.models import Job, Schedule
    from halpipe.models.trace import Executions, Instant
    from halpipe.pipeline.compare.judging import Judge


@record
class Due:
    """A job of a table with what its executions are compared with, in nanoseconds.

    `reserved` is the time that the schedule reserves for it: all but its gaps.
    """

    job: Job
    start: Instant
    length: Instant
    reserved: Instant
    units: frozenset[str]

    @classmethod
    def of(cls, job: Job) -> Due:
        """Return what is due for a job."""
        reserved = sum((end - start for start, end in job.occupations()), ZERO)
        return cls(job, job.start.ns, (job.end - job.start).ns, reserved.ns, frozenset(job.units))


class Starts:
    """The jobs of one task in a table by their starts; several may start at once, on different units."""

    def __init__(self, places: Sequence[int], due: Sequence[Due]) -> None:
        self.at: dict[Instant, list[int]] = defaultdict(list)
        self.numbered: dict[int, int] = {}
        for place in places:
            self.at[due[place].start].append(place)
            self.numbered.setdefault(due[place].job.index, place)
        self._instants = list(self.at)

    def nearest(self, at: Instant) -> Instant:
        """Return the start nearest to `at`; of two the earlier."""
        after = bisect_left(self._instants, at)
        if not after or after == len(self._instants):
            return self._instants[min(after, len(self._instants) - 1)]
        low, high = self._instants[after - 1], self._instants[after]
        return low if at - low <= high - at else high

    def nearest_of_cycles(self, at: Instant, period: Instant) -> tuple[int, Instant]:
        """Return the cycle and the start nearest to `at`, where all are repeated with `period`."""
        cycle, phase = divmod(at, period)
        instants = self._instants
        after = bisect_left(instants, phase)
        low = instants[after - 1] if after else instants[-1] - period
        high = instants[after] if after < len(instants) else instants[0] + period
        if phase - low <= high - phase:
            return (int(cycle), low) if after else (int(cycle) - 1, instants[-1])
        return (int(cycle), high) if after < len(instants) else (int(cycle) + 1, instants[0])


@record
class Table:
    """A mode or a transition table: what is played as one piece; `due` by start, `starts` by task."""

    name: str
    length: Instant
    due: tuple[Due, ...]
    starts: Mapping[str, Starts]
    successors: frozenset[str]


@record
class Lines:
    """Tables that were played, as columns by row: each with its cycle, its start after the origin, and its first slot.

    A pause is the last cycle in which something ran, and the next one, where too many lie between them.
    """

    table: list[Table] = field(default_factory=list)
    cycle: list[int] = field(default_factory=list)
    start: list[Instant] = field(default_factory=list)
    slot: list[int] = field(default_factory=lambda: [0])
    pauses: list[tuple[int, int]] = field(default_factory=list)

    def play(self, table: Table, cycle: int, start: Instant) -> None:
        """Append a table."""
        self.table.append(table)
        self.cycle.append(cycle)
        self.start.append(start)
        self.slot.append(self.slot[-1] + len(table.due))


def tables_of(schedule: Schedule) -> dict[str, Table]:
    """Return the tables of a schedule by name."""
    switches = {t.name: t for t in schedule.transitions}
    found = {}
    for mode in schedule.modes:
        after = {name for name, table in switches.items() if table.source == mode.name}
        direct = {table.target for table in switches.values() if table.source == mode.name and not table.length}
        found[mode.name] = _table(mode.name, mode.hyperperiod.ns, mode.jobs, {mode.name} | after | direct)
    for name, switch in switches.items():
        found[name] = _table(name, switch.length.ns, switch.jobs, {switch.target})
    return found


def _table(name: str, length: Instant, jobs: Iterable[Job], successors: set[str]) -> Table:
    due = tuple(map(Due.of, sorted(jobs, key=lambda job: (job.start.ns, job.task, job.index))))
    places: dict[str, list[int]] = defaultdict(list)
    for place, each in enumerate(due):
        places[each.job.task].append(place)
    return Table(name, length, due, {task: Starts(own, due) for task, own in places.items()}, frozenset(successors))


MOST_SILENT = 100_000
"""Jobs of cycles in which nothing ran that are counted as missing, one by one."""


def played_tables(executions: Executions, tables: Mapping[str, Table], judge: Judge, first: str = "") -> Lines:
    """Return the tables that the labels of `executions` name, in order.

    Cycles in which nothing ran are filled in, from cycle 0 on where the `first` table is known. Report tables that
    cannot follow each other.
    """
    stated: dict[int, int] = {}
    of_number = [tables.get(name) for name in executions.names]
    cycles, numbers = executions.cycle, executions.table
    for row in executions.order:
        cycle, number = cycles[row], numbers[row]
        if cycle != NONE and of_number[number] is not None and stated.setdefault(cycle, number) != number:
            one, other = (executions.names[of] for of in (stated[cycle], number))
            path, help = about(task=executions.names[executions.task[row]]), "check how the recorder counts cycles"
            message = f'cycle {cycle} is both "{one}" and "{other}"'
            judge.add(Kind.SEQUENCE, path, 0, message, executions.row(row).at, help)
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
                lines.pauses.append((before, cycle))
            else:
                number = lines.cycle[-1] + 1 if lines.cycle else 0
                for i in range(times):
                    lines.play(between, number + i, now + between.length * i)
            now += between.length * times
        lines.play(table, cycle, now)
        now += table.length
        last, before = table, cycle
    return lines


def repeated_table(table: Table, cycles: Sequence[int]) -> Lines:
    """Return the rows of a mode that is repeated, from the first to the last of the cycles in which something ran."""
    lines = Lines(pauses=_pauses(cycles, len(table.due)))
    for cycle in _without(cycles, lines.pauses):
        lines.play(table, cycle, table.length * cycle)
    return lines


def _pauses(cycles: Sequence[int], jobs: int) -> list[tuple[int, int]]:
    """Return between which cycles so many are silent that their jobs are not counted: the longest of all gaps."""
    pauses, left = [], MOST_SILENT // max(1, jobs)
    gaps = (gap for gap in itertools.pairwise(cycles) if gap[1] - gap[0] > 1)
    for before, after in sorted(gaps, key=lambda gap: (gap[1] - gap[0], gap)):
        left -= after - before - 1
        if left < 0:
            pauses.append((before, after))
    return sorted(pauses)


def _without(cycles: Sequence[int], pauses: Sequence[tuple[int, int]]) -> Iterator[int]:
    """Yield all cycles from the first to the last but those of the pauses."""
    if cycles:
        begins = [cycles[0], *(after for _, after in pauses)]
        ends = [*(before for before, _ in pauses), cycles[-1]]
        for begin, end in zip(begins, ends, strict=True):
            yield from range(begin, end + 1)


def _between(last: Table, steps: int, table: Table, tables: Mapping[str, Table]) -> list[tuple[Table, int]] | None:
    """Return the tables, and how often each, of the silent cycles before `table`, `steps` after `last`.

    A mode is kept as long as possible, then comes the switch; None: the schedule has no such sequence.
    """
    found: list[tuple[Table, int]] = []
    if last.name not in last.successors and steps > 1:  # a switch, after which comes its target
        last, steps = tables[min(last.successors)], steps - 1
        found.append((last, 1))
    # Not by way of a third mode, though one may follow at once by a switch of length zero.
    switches = (name for name in sorted(last.successors) if name not in tables[name].successors)
    switch = next((name for name in switches if table.name in tables[name].successors), None)
    if switch is not None and steps > 1 and table.name != last.name:
        return [*found, (last, steps - 2), (tables[switch], 1)]
    return [*found, (last, steps - 1)] if table.name in last.successors else None


def unknown_tables(executions: Executions, tables: Mapping[str, Table], judge: Judge) -> None:
    """Report, once each, the tables that a trace names and the schedule does not have."""
    for number in sorted(set(executions.table)):
        name = executions.names[number]
        if name and name not in tables:
            row = next((row for row in executions.order if executions.table[row] == number), None)
            help = did_you_mean(name, sorted(tables), "compare with the schedule that was loaded")
            message = f'the schedule has no table "{name[:60]}"'
            if row is not None:
                judge.add(Kind.UNKNOWN_TABLE, "", 0, message, executions.row(row).at, help)
