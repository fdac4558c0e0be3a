"""Assignment of executions to scheduled jobs: by stated instance, otherwise the nearest of the task."""

from __future__ import annotations

import itertools
from bisect import bisect_left
from collections import defaultdict
from dataclasses import field, replace
from typing import TYPE_CHECKING, TypeVar

from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.pipeline.compare.expected import MOST_SILENT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from fractions import Fraction

    from halpipe.models import Job
    from halpipe.models.trace import Execution
    from halpipe.pipeline.compare.expected import Played, Table

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


def match_stated(
    executions: Sequence[Execution], played: Sequence[Played], origin: Duration, *, is_whole: bool = False
) -> Matching:
    """Match the executions of a trace that names tables and cycles; `is_whole`: all jobs of the tables are due."""
    by_cycle = {entry.cycle: entry for entry in played}
    best: dict[Key, Match] = {}
    extra: list[Execution] = []
    for execution in executions:
        entry = by_cycle.get(-1 if execution.cycle is None else execution.cycle)
        jobs = entry.table.jobs.get(execution.task, ()) if entry else ()
        job = _stated_job(execution, jobs, entry.start + origin) if entry and jobs else None
        if entry is None or job is None:
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


def _stated_job(execution: Execution, jobs: Sequence[Job], start: Duration) -> Job | None:
    if execution.job is not None:
        return next((job for job in jobs if job.index == execution.job), None)
    return min(jobs, key=lambda job: (_size((execution.start - start - job.start).ns), job.index))


def match_nearest(executions: Sequence[Execution], table: Table, origin: Duration) -> Matching:
    """Match the executions of a trace in which one mode is repeated and no cycle is stated."""
    rings = {task: [job.start.ns for job in jobs] for task, jobs in table.jobs.items()}
    best: dict[Key, Match] = {}
    extra: list[Execution] = []
    for execution in executions:
        ring = rings.get(execution.task)
        if ring is None:
            extra.append(execution)
            continue
        cycle, position = _nearest(ring, (execution.start - origin).ns, table.length.ns)
        job = table.jobs[execution.task][position]
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


def _nearest(ring: Sequence[int | Fraction], at: int | Fraction, period: int | Fraction) -> tuple[int, int]:
    """Return cycle and position of the start nearest to `at` among `ring`, repeated with `period`."""
    cycle, phase = int(at // period), at % period
    after = bisect_left(ring, phase)
    if after == 0:
        before, below = ring[-1] - period, (cycle - 1, len(ring) - 1)
    else:
        before, below = ring[after - 1], (cycle, after - 1)
    if after == len(ring):
        behind, above = ring[0] + period, (cycle + 1, 0)
    else:
        behind, above = ring[after], (cycle, after)
    return below if phase - before <= behind - phase else above


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
    rings = {task: [job.start.ns for job in jobs] for task, jobs in table.jobs.items()}
    first = _rarest((e, table) for e in known[:SAMPLE])[0]
    candidates = [first.start - job.start for job in table.jobs[first.task]]

    def distance(execution: Execution, origin: Duration) -> int | Fraction:
        ring, at = rings[execution.task], (execution.start - origin).ns
        cycle, position = _nearest(ring, at, table.length.ns)
        return at - cycle * table.length.ns - ring[position]

    return _least_late(known, candidates, distance)


def find_stated_origin(executions: Sequence[Execution], played: Sequence[Played]) -> Duration:
    """Return the same for a trace that names tables and cycles, where each execution is of a job of its table."""
    by_cycle = {entry.cycle: entry for entry in played}
    entries = ((e, by_cycle.get(-1 if e.cycle is None else e.cycle)) for e in executions)
    known = [(e, entry) for e, entry in entries if entry is not None and e.task in entry.table.jobs]
    if not known:
        return executions[0].start
    rings: dict[tuple[str, str, int | None], list[int | Fraction]] = defaultdict(list)
    for table in {entry.table.name: entry.table for entry in played}.values():
        for job in itertools.chain.from_iterable(table.jobs.values()):
            for index in (None, job.index):
                rings[table.name, job.task, index].append(job.start.ns)

    def ring(execution: Execution, table: Table) -> list[int | Fraction]:
        stated = rings.get((table.name, execution.task, execution.job))
        return stated or rings[table.name, execution.task, None]

    def distance(known: tuple[Execution, Played], origin: Duration) -> int | Fraction:
        execution, entry = known
        starts, at = ring(execution, entry.table), (execution.start - entry.start - origin).ns
        after = bisect_left(starts, at)
        return min((at - start for start in starts[max(0, after - 1) : after + 1]), key=_size)

    first, table = _rarest((e, entry.table) for e, entry in known[:SAMPLE])
    zero = first.start - by_cycle[first.cycle or 0].start
    candidates = [zero - Duration(start) for start in ring(first, table)]
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
