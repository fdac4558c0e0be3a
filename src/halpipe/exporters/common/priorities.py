"""Priority relation of tasks on a unit that makes fixed priorities reproduce the preemptions of a table.

Task i is above task k wherever a job of i starts in a gap of a job of k, over all modes and tables (MODEL 8.2, run
time). Then every part is over in time, also where jobs end early and interrupts stay away.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.grouping import grouped
from halpipe.exporters.common.codes import PRIORITY_CYCLE
from halpipe.exporters.common.timeline import versions_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.models import Job, ModeSchedule, Schedule, TaskModel

Relation = dict[str, dict[str, set[str]]]
"""For every unit, the tasks that must be above each of its tasks that are split anywhere."""


def relation_of(model: TaskModel, schedule: Schedule) -> Relation:
    """Return who must be above whom, per unit, over all modes and switches of a schedule."""
    anywhere = {key for key, version in versions_of(model).items() if version.split.anywhere}
    found: Relation = defaultdict(lambda: defaultdict(set))
    if not anywhere:
        return {}
    modes = {mode.name: mode for mode in schedule.modes}
    for mode in schedule.modes:
        _note(found, anywhere, mode.jobs, _occurrences(mode, range(_cycles(mode.jobs, mode.hyperperiod) + 1)))
    for table in schedule.transitions:
        source, target = modes[table.source], modes[table.target]
        past = range(-_cycles(source.jobs, source.hyperperiod), 0)
        open_jobs = [(job, at) for job, at in _occurrences(source, past) if at + (job.end - job.start) > ZERO]
        open_jobs += [(job, job.start) for job in table.jobs]
        longest = max((at + (job.end - job.start) for job, at in open_jobs), default=ZERO) - table.length
        future = range(max(0, -(-longest // target.hyperperiod)))
        line = [*open_jobs, *((job, at + table.length) for job, at in _occurrences(target, future))]
        for job, at in open_jobs:
            _note_one(found, anywhere, job, at, _starts_by_unit(line))
    return {unit: {task: set(above) for task, above in by_task.items()} for unit, by_task in found.items()}


def levels_of(relation: Relation) -> dict[str, dict[str, int]]:
    """Return the level of every related task per unit (empty: of all units together), 0 for the lowest.

    Raise `HalpipeError` with a cycle of every unit on which no fixed priorities play the schedule.
    """
    findings = Findings()
    found: dict[str, dict[str, int]] = {}
    for unit, above in relation.items():
        below: dict[str, set[str]] = defaultdict(set)
        for low, highs in above.items():
            for high in highs:
                below[high].add(low)
        levels: dict[str, int] = {}
        try:
            order = list(TopologicalSorter(below).static_order())
        except CycleError as failure:
            names = " above ".join(f'"{name}"' for name in reversed(failure.args[1]))
            message = f"no fixed priorities play the table: {names}"
            help = "state split points as a list for one of them, or bind what it waits for to its own unit"
            findings.add(PRIORITY_CYCLE(message, path=about(unit=unit) if unit else "", help=help))
            continue
        for task in order:
            levels[task] = max((levels[low] + 1 for low in below.get(task, ())), default=0)
        found[unit] = levels
    findings.stop_on_errors()
    return found


def _cycles(jobs: Iterable[Job], period: Duration) -> int:
    """Return how many hyperperiods after its own a job may still be in progress, at most."""
    return max((-(-job.end // period) for job in jobs), default=0)


def _occurrences(mode: ModeSchedule, cycles: range) -> Iterator[tuple[Job, Duration]]:
    for cycle in cycles:
        for job in mode.jobs:
            yield job, job.start + mode.hyperperiod * cycle


def _note(
    found: Relation, anywhere: set[tuple[str, str]], jobs: Iterable[Job], line: Iterable[tuple[Job, Duration]]
) -> None:
    starts = _starts_by_unit(line)
    for job in jobs:
        _note_one(found, anywhere, job, job.start, starts)


def _starts_by_unit(line: Iterable[tuple[Job, Duration]]) -> dict[str, list[tuple[Duration, str]]]:
    starts = grouped((unit, (at, job.task)) for job, at in line for unit in job.units)
    return {unit: sorted(found, key=lambda start: start[0].ns) for unit, found in starts.items()}


def _note_one(
    found: Relation,
    anywhere: set[tuple[str, str]],
    job: Job,
    at: Duration,
    starts: dict[str, list[tuple[Duration, str]]],
) -> None:
    """Note all tasks of which a job starts in a gap of one job, which starts at `at`."""
    if not job.parts or (job.task, job.version) not in anywhere:
        return
    by = at - job.start
    for (_, pause), (again, _) in pairwise(job.occupations()):
        for unit in job.units:
            known = starts.get(unit, [])
            first = bisect_left(known, (pause + by).ns, key=lambda start: start[0].ns)
            for start, task in known[first:]:
                if start >= again + by:
                    break
                if task != job.task:
                    found[unit][job.task].add(task)
