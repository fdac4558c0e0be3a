"""Value of a simulated table, and its jobs in exact time."""

from __future__ import annotations

from operator import sub
from typing import TYPE_CHECKING

from halpipe.pipeline.parts import job_of
from halpipe.pipeline.solve.edf.fixed import window_excess

if TYPE_CHECKING:
    from halpipe.core.durations import Duration
    from halpipe.models import Job
    from halpipe.pipeline.solve.edf.jobs import Plan, Span, Table
    from halpipe.pipeline.solve.edf.works import Mode, Way, Work


def lateness(mode: Mode, table: Table) -> list[int]:
    """Return by how many ticks the jobs of each task start and end too late, all together, under their best phase."""
    return [
        _lateness(work, table, task, mode.hyperperiod) if work.is_cyclic and table.is_whole(task) else late
        for task, (work, late) in enumerate(zip(mode.works, table.late, strict=True))
    ]


def _lateness(work: Work, table: Table, task: int, cycle: int) -> int:
    """Return that of a task with a period, all of whose jobs have started."""
    own = slice(table.places[task], table.places[task + 1])
    starts, ends, releases = table.starts[own], table.ends[own], table.releases[own]
    slips = list(map(sub, starts, releases))
    shift = 0 if work.phase is not None else min(slips, default=0)
    if work.arrivals is not None:
        late = _beyond(slips, shift + work.slip)
        return late + _arrival_lateness(sorted(zip(starts, ends, strict=True)), work.arrivals, cycle)
    return _beyond(slips, shift + work.latest) + _beyond(list(map(sub, ends, releases)), shift + work.deadline)


def _beyond(delays: list[int], most: int) -> int:
    """Return by how much delays are longer than they may be, all together."""
    if max(delays, default=most) <= most:
        return 0
    return sum(max(0, delay - most) for delay in delays)


def _arrival_lateness(spans: list[tuple[int, int]], arrivals: tuple[int, int], cycle: int) -> int:
    """Return by how much jobs start and end too late after the start of the job before, round the hyperperiod."""
    apart, answer = arrivals
    before = [spans[-1][0] - cycle, *(start for start, _ in spans[:-1])]
    pairs = zip(before, spans, strict=True)
    return sum(max(0, start - since - apart) + max(0, end - since - answer) for since, (start, end) in pairs)


def followed(mode: Mode, plan: Plan, table: Table) -> tuple[int, ...]:
    """Return the phases of a table's first starts, for tasks whose phase is free."""
    return tuple(
        phase if work.phase is not None or not work.is_cyclic else phase + min(table.slips(task), default=0)
        for task, (work, phase) in enumerate(zip(mode.works, plan.phases, strict=True))
    )


def named(mode: Mode, plan: Plan, table: Table) -> tuple[Job, ...]:
    """Return the jobs of a table with their names, in exact time, and those that stay."""
    services = {way.units: _service(mode, way) for way in plan.ways}
    jobs = []
    for task, (work, way) in enumerate(zip(mode.works, plan.ways, strict=True)):
        units = tuple(mode.units[unit] for unit in way.units)
        for index, spans in sorted(table.jobs(task)):
            exact = [_exact(mode, way, span) for span in spans]
            jobs.append(job_of(work.name, index, way.version, units, exact, services[way.units]))
    return tuple(jobs) + tuple(each.job for each in mode.fixed.jobs)


def _service(mode: Mode, way: Way) -> tuple[tuple[Duration, Duration], ...]:
    return tuple(interrupt for unit in way.units for interrupt in mode.services[unit])


def _exact(mode: Mode, way: Way, span: Span) -> tuple[Duration, Duration, Duration]:
    """Return the start of a part, and what it executes, in exact time."""
    start, _, first, last = span
    return mode.tick * start, _executed(mode, way, first), _executed(mode, way, last)


def _executed(mode: Mode, way: Way, where: int) -> Duration:
    """Return an execution time of the grid in exact time: a split point where the version has a list of them."""
    if not way.anywhere:
        ends = (0, *way.ends)
        return way.bounds[ends.index(where)]
    return way.bounds[-1] if where >= way.wcet else mode.tick * where


def missed_by_fixed(mode: Mode, table: Table) -> dict[int, int]:
    """Return by how much tasks miss the windows of jobs that stay."""
    if not any(each.way.windows for each in mode.fixed.jobs):
        return {}
    instants: dict[int, list[tuple[int, int]]] = {}
    for task in range(len(mode.works)):
        instants[task] = [(spans[0][0], spans[-1][1]) for _, spans in table.jobs(task)]
    for each in mode.fixed.jobs:
        instants[each.task].append((each.start, each.end))
    return window_excess(mode.fixed.jobs, instants, mode.hyperperiod)
