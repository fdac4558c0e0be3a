"""What a simulated table is worth, and its jobs in exact time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.pipeline.parts import job_of
from halpipe.pipeline.solve.edf.fixed import window_excess

if TYPE_CHECKING:
    from halpipe.durations import Duration
    from halpipe.models import Job
    from halpipe.pipeline.solve.edf.jobs import Plan, Span, Table
    from halpipe.pipeline.solve.edf.works import Mode, Way, Work


def lateness(mode: Mode, table: Table) -> list[int]:
    """Return by how many ticks the jobs of each task start and end too late, all together, under their best phase."""
    placed: list[list[tuple[int, int, int]]] = [[] for _ in mode.works]
    for key, spans in table.jobs.items():
        placed[key[0]].append((spans[0][0], spans[-1][1], table.releases[key]))
    return [
        _lateness(work, jobs, mode.hyperperiod) if work.is_cyclic and len(jobs) == work.jobs else late
        for work, jobs, late in zip(mode.works, placed, table.late, strict=True)
    ]


def _lateness(work: Work, jobs: list[tuple[int, int, int]], cycle: int) -> int:
    """Return that of a task with a period, of whose jobs all start, end and release are known."""
    slips = [(start - release, end - release) for start, end, release in jobs]
    shift = 0 if work.phase is not None else min(start for start, _ in slips)
    if work.arrivals is not None:
        late = sum(max(0, start - shift - work.slip) for start, _ in slips)
        return late + _arrival_lateness(sorted((start, end) for start, end, _ in jobs), work.arrivals, cycle)
    return sum(max(0, start - shift - work.latest) + max(0, end - shift - work.deadline) for start, end in slips)


def _arrival_lateness(spans: list[tuple[int, int]], arrivals: tuple[int, int], cycle: int) -> int:
    """Return by how much jobs start and end too late after the start of the job before, round the hyperperiod."""
    apart, answer = arrivals
    before = [spans[-1][0] - cycle, *(start for start, _ in spans[:-1])]
    pairs = zip(before, spans, strict=True)
    return sum(max(0, start - since - apart) + max(0, end - since - answer) for since, (start, end) in pairs)


def followed(mode: Mode, plan: Plan, table: Table) -> tuple[int, ...]:
    """Return the phases of a table's first starts, for tasks whose phase is free."""
    first: dict[int, int] = {}
    for (task, index), spans in table.jobs.items():
        slip = spans[0][0] - table.releases[task, index]
        first[task] = min(slip, first.get(task, slip))
    return tuple(
        phase if work.phase is not None or not work.is_cyclic else phase + first.get(task, 0)
        for task, (work, phase) in enumerate(zip(mode.works, plan.phases, strict=True))
    )


def named(mode: Mode, plan: Plan, table: Table) -> tuple[Job, ...]:
    """Return the jobs of a table with their names, in exact time, and those that stay."""
    services = {way.units: _service(mode, way) for way in plan.ways}
    jobs = []
    for (task, index), spans in sorted(table.jobs.items()):
        way = plan.ways[task]
        units = tuple(mode.units[unit] for unit in way.units)
        exact = [_exact(mode, way, span) for span in spans]
        jobs.append(job_of(mode.works[task].name, index, way.version, units, exact, services[way.units]))
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
    for (task, _), spans in table.jobs.items():
        instants.setdefault(task, []).append((spans[0][0], spans[-1][1]))
    for each in mode.fixed.jobs:
        instants.setdefault(each.task, []).append((each.start, each.end))
    return window_excess(mode.fixed.jobs, instants, mode.hyperperiod)
