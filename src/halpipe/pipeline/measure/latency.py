"""End-to-end figures of cause-effect chains (MODEL 3 and 10.7): latency, reaction time and data age.

A job of the next task reads what the newest job of the previous task had written when it read. Jobs read at their start
and write at their end, or at their release and their release + LET. All figures are worst cases over one hyperperiod,
followed over as many as it takes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from halpipe.models import ChainLatency
from halpipe.pipeline.measure.placement import Instants

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from halpipe.models import Chain
    from halpipe.pipeline.measure.placement import PlacedJob, Placement


class Passage(NamedTuple):
    """Instants at which a job reads and writes, and the events from and to which the figures of a chain count."""

    read: int
    write: int
    begin: int
    end: int


Members = list[list[Passage]]
"""The passages of a chain, task by task."""

Measure: TypeAlias = "Callable[[Members, int], int | None]"
"""A worst figure in ticks of the passages of a chain on a circle; None where no data arrives."""


def members_of(placement: Placement, chain: Chain) -> Members | None:
    """Return the passages of a chain; None if a task of it does not run."""
    if not all(name in placement.by_task for name in chain.tasks):
        return None
    return [[_passage(placement, job, chain) for job in placement.by_task[name]] for name in chain.tasks]


def _passage(placement: Placement, job: PlacedJob, chain: Chain) -> Passage:
    if job.active.task.let is None and chain.anchor is None and chain.to is None:
        return Passage(job.start, job.end, job.start, job.end)
    read, write = placement.data(job)
    begin = read if chain.anchor is None else placement.instant(job, chain.anchor)
    return Passage(read, write, begin, write if chain.to is None else placement.instant(job, chain.to))


def chain_latencies(
    placement: Placement, chains: Iterable[Chain], *, complete: bool = False
) -> tuple[ChainLatency, ...]:
    """Return the figures of the chains whose tasks are all active; None where no data arrives.

    Latencies are stated where the model refers to them, or for all chains if the figures are to be `complete`.
    """
    result = []
    for chain in chains:
        members = members_of(placement, chain)
        if members is None:
            continue
        measures: list[Measure] = [worst_reaction, worst_age]
        if complete or has_latency(placement, chain):
            measures.append(worst_latency)
        times = [measure(members, placement.hyperperiod) for measure in measures]
        reaction, age, latency = (
            None if time is None else placement.tick * time for time in (times if len(times) == 3 else [*times, None])
        )
        result.append(ChainLatency(name=chain.name, reaction=reaction, age=age, latency=latency))
    return tuple(result)


def has_latency(placement: Placement, chain: Chain) -> bool:
    """Tell whether the model refers to the latency of a chain: by a limit, events, or logical execution times."""
    tasks = (placement.expansion.by_name[name].task for name in chain.tasks)
    stated = (chain.max_latency, chain.anchor, chain.to)
    return stated != (None, None, None) or any(task.let is not None for task in tasks)


def _reads(members: Members, hyperperiod: int) -> list[Instants]:
    return [Instants.of(((job.read, n) for n, job in enumerate(jobs)), hyperperiod) for jobs in members]


def _follow(first: Passage, time: int, members: Sequence[Sequence[Passage]], reads: Sequence[Instants]) -> int:
    """Return the time from the event of `first` to that of the last job that data written at `time` lead to."""
    last, by = first, 0
    for jobs, instants in zip(members, reads, strict=True):
        read, reached = instants.at_or_after(time)
        last = jobs[reached]
        by = read - last.read
        time = last.write + by
    return last.end + by - first.begin


def worst_latency(members: Members, hyperperiod: int) -> int | None:
    """Return the worst latency in ticks: from a job of the first task to the first of the last that has its data."""
    if not all(members):
        return None
    reads = _reads(members, hyperperiod)
    return max(_follow(first, first.write, members[1:], reads[1:]) for first in members[0])


def worst_reaction(members: Members, hyperperiod: int) -> int | None:
    """Return the worst reaction time in ticks: of a stimulus that a job of the first task just missed."""
    if not all(members):
        return None
    reads = _reads(members, hyperperiod)
    return max(_follow(missed, missed.read + 1, members, reads) for missed in members[0])


def worst_age(members: Members, hyperperiod: int) -> int | None:
    """Return the worst data age in ticks: back from the jobs of the last task."""
    if not all(members):
        return None
    # of jobs that write together, the one that read later is the newer
    ordered = [sorted(jobs, key=lambda job: job.read - job.write) for jobs in members[:-1]]
    writes = [Instants.of(((job.write, n) for n, job in enumerate(jobs)), hyperperiod) for jobs in ordered]
    worst = 0
    for last in members[-1]:
        first, by = last, 0
        for jobs, instants in zip(reversed(ordered), reversed(writes), strict=True):
            write, reached = instants.at_or_before(first.read + by)
            first = jobs[reached]
            by = write - first.write
        worst = max(worst, last.end - first.begin - by)
    return worst
