"""Expected executions, the tables of a schedule in sequence, and the assignment of what ran to scheduled jobs."""

from __future__ import annotations

import itertools
from bisect import bisect_left
from collections import defaultdict
from dataclasses import field, replace
from typing import TYPE_CHECKING, TypeVar

from halpipe.core.diagnostics import NOWHERE, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.pipeline.compare.codes import Kind

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from fractions import Fraction

    from halpipe.models import Job, Schedule
    from halpipe.models.trace import Execution
    from halpipe.pipeline.compare.judging import Judge


@record
class Table:
    """A mode or a transition table: what is played as one piece; `jobs` by task, by start."""

    name: str
    length: Duration
    jobs: dict[str, tuple[Job, ...]]
    successors: frozenset[str]


@record
class Played:
    """A table that was played: the `cycle`-th, from `start` after the origin."""

    table: Table
    cycle: int
    start: Duration


def tables_of(schedule: Schedule) -> dict[str, Table]:
    """Return the tables of a schedule by name."""
    switches = {t.name: t for t in schedule.transitions}
    found = {}
    for mode in schedule.modes:
        after = {name for name, table in switches.items() if table.source == mode.name}
        direct = {table.target for table in switches.values() if table.source == mode.name and not table.length}
        found[mode.name] = Table(
            mode.name, mode.hyperperiod, _by_task(mode.jobs), frozenset({mode.name} | after | direct)
        )
    for name, switch in switches.items():
        found[name] = Table(name, switch.length, _by_task(switch.jobs), frozenset({switch.target}))
    return found


def _by_task(jobs: Iterable[Job]) -> dict[str, tuple[Job, ...]]:
    grouped: dict[str, list[Job]] = defaultdict(list)
    for job in sorted(jobs, key=lambda job: (job.start.ns, job.index)):
        grouped[job.task].append(job)
    return {task: tuple(found) for task, found in grouped.items()}


MOST_SILENT = 100_000
"""Jobs of cycles in which nothing ran that are counted as missing, one by one."""


def played_tables(
    executions: Sequence[Execution], tables: Mapping[str, Table], judge: Judge, first: str = ""
) -> tuple[list[Played], list[tuple[int, int]]]:
    """Return the tables that the labels of `executions` name, in order, and pauses as in `Matching`.

    Cycles in which nothing ran are filled in, from cycle 0 on where the `first` table is known. Report tables that
    cannot follow each other.
    """
    stated: dict[int, str] = {}
    for execution in executions:
        if execution.cycle is None or execution.table not in tables:
            continue
        former = stated.setdefault(execution.cycle, execution.table)
        if former != execution.table:
            message = f'cycle {execution.cycle} is both "{former}" and "{execution.table}"'
            path, help = about(task=execution.task), "check how the recorder counts cycles"
            judge.add(Kind.SEQUENCE, path, ZERO, message, execution.at, help)
    played: list[Played] = []
    pauses: list[tuple[int, int]] = []
    now, left = ZERO, MOST_SILENT
    last, before = (tables[first], -1) if first else (None, 0)
    for cycle in sorted(stated):
        table = tables[stated[cycle]]
        silent = _between(last, cycle - before, table, tables) if last else []
        if silent is None and last:
            message = f'cycle {cycle} is "{table.name}", {cycle - before} after "{last.name}" in cycle {before}'
            help = f"after it may come: {', '.join(sorted(last.successors))}"
            judge.add(Kind.SEQUENCE, about(table=last.name), ZERO, message, NOWHERE, help)
        for between, times in silent or ():
            jobs = times * sum(map(len, between.jobs.values()))
            left -= jobs
            if jobs and left < 0:
                pauses.append((before, cycle))
            else:
                number = played[-1].cycle + 1 if played else 0
                starts = (now + between.length * i for i in range(times))
                played += [Played(between, number + i, start) for i, start in enumerate(starts)]
            now += between.length * times
        played.append(Played(table, cycle, now))
        now += table.length
        last, before = table, cycle
    return played, pauses


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


def unknown_tables(executions: Iterable[Execution], tables: Mapping[str, Table], judge: Judge) -> None:
    """Report, once each, the tables that a trace names and the schedule does not have."""
    unknown = {e.table: e for e in reversed(list(executions)) if e.table and e.table not in tables}
    for name, execution in unknown.items():
        help = did_you_mean(name, sorted(tables), "compare with the schedule that was loaded")
        judge.add(Kind.UNKNOWN_TABLE, "", ZERO, f'the schedule has no table "{name[:60]}"', execution.at, help)


SAMPLE = 2000
"""Executions by which the zero of the schedule is sought; more would not change it and cost time."""


@record
class Match:
    """An execution and the job it is: `start` is the scheduled one, after the origin."""

    execution: Execution
    table: Table
    cycle: int
    job: Job
    start: Duration

    @property
    def end(self) -> Duration:
        """The scheduled end, after the origin."""
        return self.start + (self.job.end - self.job.start)

    @property
    def reserved(self) -> Duration:
        """The time that the schedule reserves for the job: all but its gaps."""
        return sum((end - start for start, end in self.job.occupations()), ZERO)

    def due(self) -> list[tuple[Duration, Duration]]:
        """Return when the job is to run, after the origin."""
        by = self.start - self.job.start
        return [(start + by, end + by) for start, end in self.job.occupations()]


@record
class Matching:
    """All matches, by scheduled start; what ran without being scheduled; and what was scheduled and did not run.

    A pause is the last cycle in which something ran, and the next one, where too many lie between them.
    """

    matches: list[Match]
    extra: list[Execution]
    missing: list[tuple[Table, int, Job, Duration]]
    pauses: list[tuple[int, int]] = field(default_factory=list)


Key = tuple[int, str, int]


class _Starts:
    """The jobs of one task in a table by their starts; several may start at once, on different units."""

    def __init__(self, jobs: Sequence[Job]) -> None:
        self.at: dict[int | Fraction, list[Job]] = {
            start: list(equals) for start, equals in itertools.groupby(jobs, key=lambda job: job.start.ns)
        }
        self.numbered = {job.index: job for job in reversed(jobs)}
        self._instants = list(self.at)

    def nearest(self, at: int | Fraction) -> int | Fraction:
        """Return the start nearest to `at`; of two the earlier."""
        after = bisect_left(self._instants, at)
        return min(self._instants[max(0, after - 1) : after + 1], key=lambda start: _size(at - start))

    def nearest_of_cycles(self, at: int | Fraction, period: int | Fraction) -> tuple[int, int | Fraction]:
        """Return the cycle and the start nearest to `at`, where all are repeated with `period`."""
        cycle, phase = int(at // period), at % period
        first, last, near = self._instants[0], self._instants[-1], self.nearest(phase)
        found = [(cycle - 1, last), (cycle, near), (cycle + 1, first)]
        return min(found, key=lambda place: _size(at - place[0] * period - place[1]))

    def job(self, start: int | Fraction, execution: Execution, cycle: int, best: dict[Key, Match]) -> Job:
        """Return the job of a start: of several, the one on the units of the execution, or that has none yet."""
        if len(self.at[start]) == 1:
            return self.at[start][0]

        def others(job: Job) -> tuple[bool, bool, int]:
            return not set(execution.units) <= set(job.units), (cycle, job.task, job.index) in best, job.index

        return min(self.at[start], key=others)


def _starts(table: Table) -> dict[str, _Starts]:
    return {task: _Starts(jobs) for task, jobs in table.jobs.items()}


def match_stated(
    executions: Sequence[Execution], played: Sequence[Played], origin: Duration, *, is_whole: bool = False
) -> Matching:
    """Match the executions of a trace that names tables and cycles; `is_whole`: all jobs of the tables are due."""
    by_cycle = {entry.cycle: entry for entry in played}
    rings = {entry.table.name: _starts(entry.table) for entry in played}
    best: dict[Key, Match] = {}
    extra: list[Execution] = []
    for execution in executions:
        entry = by_cycle.get(-1 if execution.cycle is None else execution.cycle)
        starts = rings[entry.table.name].get(execution.task) if entry else None
        if entry is None or starts is None:
            extra.append(execution)
            continue
        if execution.job is not None:
            job = starts.numbered.get(execution.job)
        else:
            start = starts.nearest((execution.start - entry.start - origin).ns)
            job = starts.job(start, execution, entry.cycle, best)
        if job is None:
            extra.append(execution)
        else:
            _keep(best, Match(execution, entry.table, entry.cycle, job, entry.start + job.start), origin, extra)
    expected = (
        (entry.table, entry.cycle, job, entry.start + job.start)
        for entry in played
        for jobs in entry.table.jobs.values()
        for job in jobs
    )
    return _complete(best, extra, expected, None if is_whole else executions, origin)


def match_nearest(executions: Sequence[Execution], table: Table, origin: Duration) -> Matching:
    """Match the executions of a trace in which one mode is repeated and no cycle is stated."""
    rings = _starts(table)
    best: dict[Key, Match] = {}
    extra: list[Execution] = []
    for execution in executions:
        starts = rings.get(execution.task)
        if starts is None:
            extra.append(execution)
            continue
        cycle, start = starts.nearest_of_cycles((execution.start - origin).ns, table.length.ns)
        job = starts.job(start, execution, cycle, best)
        _keep(best, Match(execution, table, cycle, job, table.length * cycle + job.start), origin, extra)
    cycles = sorted({cycle for cycle, _, _ in best})
    pauses = _pauses(cycles, sum(map(len, table.jobs.values())))
    expected = (
        (table, cycle, job, table.length * cycle + job.start)
        for cycle in _without(cycles, pauses)
        for jobs in table.jobs.values()
        for job in jobs
    )
    return replace(_complete(best, extra, expected, executions, origin), pauses=pauses)


def _pauses(cycles: Sequence[int], jobs: int) -> list[tuple[int, int]]:
    """Return between which cycles so many are silent that their jobs are not counted: the longest of all gaps."""
    pauses, left = [], MOST_SILENT // max(1, jobs)
    for before, after in sorted(itertools.pairwise(cycles), key=lambda gap: (gap[1] - gap[0], gap)):
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


def _keep(best: dict[Key, Match], match: Match, origin: Duration, extra: list[Execution]) -> None:
    """Keep of two executions of one job the one that is closer to its instant, unless they are parts of a gang."""
    key = (match.cycle, match.execution.task, match.job.index)
    former = best.setdefault(key, match)
    if former is match:
        return
    if _is_gang(former, match):
        best[key] = replace(former, execution=_joined(former.execution, match.execution))
    elif _size(lateness(match, origin).ns) < _size(lateness(former, origin).ns):
        best[key] = match
        extra.append(former.execution)
    else:
        extra.append(match.execution)


def _is_gang(former: Match, match: Match) -> bool:
    """Whether two executions are one job on several units, as recorders that know one core per job show it."""
    units, more = former.execution.units, match.execution.units
    due = match.job.units
    return bool(units and more) and not set(units) & set(more) and {*units, *more} <= set(due)


def _joined(first: Execution, second: Execution) -> Execution:
    """Return the execution of a gang: it runs from when its last unit starts until its last unit ends."""
    ends = [execution.end for execution in (first, second) if execution.end is not None]
    busy = [execution.busy for execution in (first, second) if execution.busy is not None]
    return replace(
        first,
        units=(*first.units, *second.units),
        start=max(first.start, second.start),
        end=max(ends) if len(ends) == 2 else None,
        busy=max(busy) if len(busy) == 2 else None,
        stretches=first.stretches if first.stretches == second.stretches else (),
    )


def _size(distance: int | Fraction) -> int | Fraction:
    return distance if distance >= 0 else -distance


def lateness(match: Match, origin: Duration) -> Duration:
    """Return how long after its scheduled instant a job started; negative: before."""
    return match.execution.start - origin - match.start


def _complete(
    best: dict[Key, Match],
    extra: list[Execution],
    expected: Iterable[tuple[Table, int, Job, Duration]],
    executions: Sequence[Execution] | None,
    origin: Duration,
) -> Matching:
    """Add what was scheduled within the time that the executions cover, or at all, and did not run."""
    first, last = covered(executions) if executions else (ZERO, None)
    missing = [
        (table, cycle, job, start)
        for table, cycle, job, start in expected
        if (cycle, job.task, job.index) not in best
        and (last is None or (first <= start + origin and start + origin + (job.end - job.start) < last))
    ]
    matches = sorted(best.values(), key=lambda match: (match.start.ns, match.execution.task))
    return Matching(matches, extra, missing)


def covered(executions: Sequence[Execution]) -> tuple[Duration, Duration]:
    """Return the first and the last instant that a trace tells of."""
    ends = [execution.end or execution.start for execution in executions]
    return min(e.start for e in executions), max(ends)


def find_origin(executions: Sequence[Execution], table: Table) -> Duration:
    """Return where the zero of a repeated mode lies in the trace: no job early, one on time, the others least late.

    The first execution of the rarest task is laid onto each of its jobs in turn, and the one that leaves the smallest
    sum of distances is taken, exactly.
    """
    known = [execution for execution in executions if execution.task in table.jobs]
    if not known:
        return ZERO
    rings = _starts(table)
    first = _rarest((e, table) for e in known[:SAMPLE])[0]
    candidates = [first.start - job.start for job in table.jobs[first.task]]

    def distance(execution: Execution, origin: Duration) -> int | Fraction:
        at = (execution.start - origin).ns
        cycle, start = rings[execution.task].nearest_of_cycles(at, table.length.ns)
        return at - cycle * table.length.ns - start

    return _least_late(known, candidates, distance)


def find_stated_origin(executions: Sequence[Execution], played: Sequence[Played]) -> Duration:
    """Return the same for a trace that names tables and cycles, where each execution is of a job of its table."""
    by_cycle = {entry.cycle: entry for entry in played}
    entries = ((e, by_cycle.get(-1 if e.cycle is None else e.cycle)) for e in executions)
    known = [(e, entry) for e, entry in entries if entry is not None and e.task in entry.table.jobs]
    if not known:
        return executions[0].start
    rings = {entry.table.name: _starts(entry.table) for entry in played}

    def distance(known: tuple[Execution, Played], origin: Duration) -> int | Fraction:
        execution, entry = known
        starts, at = rings[entry.table.name][execution.task], (execution.start - entry.start - origin).ns
        stated = starts.numbered.get(-1 if execution.job is None else execution.job)
        return at - (stated.start.ns if stated else starts.nearest(at))

    first, table = _rarest((e, entry.table) for e, entry in known[:SAMPLE])
    zero = first.start - by_cycle[first.cycle or 0].start
    jobs = [job for job in table.jobs[first.task] if first.job in (None, job.index)] or table.jobs[first.task]
    candidates = [zero - job.start for job in jobs]
    return _least_late(known, candidates, distance)


def _rarest(known: Iterable[tuple[Execution, Table]]) -> tuple[Execution, Table]:
    """Return the first execution of the task with the fewest jobs in a table."""
    return min(known, key=lambda pair: (len(pair[1].jobs[pair[0].task]), pair[0].task))


Seen = TypeVar("Seen")


def _least_late(
    known: Sequence[Seen], candidates: Sequence[Duration], distance: Callable[[Seen, Duration], int | Fraction]
) -> Duration:
    """Return the candidate with the smallest sum of distances, moved so that no execution is early and one on time."""

    def total(origin: Duration) -> tuple[int | Fraction, int | Fraction]:
        return sum(_size(distance(execution, origin)) for execution in known[:SAMPLE]), origin.ns

    origin = min(candidates, key=total)
    return origin + Duration(min(distance(execution, origin) for execution in known))
