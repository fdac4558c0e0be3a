"""End-to-end latencies of cause-effect chains (MODEL 3).

A job of the next task reads what the newest job of the previous task had finished when it started. Reaction
time follows a stimulus that just missed a job of the first task forward; data age traces a job of the last task
back. Both are worst cases over one hyperperiod, followed over as many as it takes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.models import ChainLatency
from halpipe.pipeline.measure.circle import Instants

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.models import Chain
    from halpipe.pipeline.measure.placement import PlacedJob, Placement


def chain_latencies(placement: Placement, chains: Iterable[Chain]) -> tuple[ChainLatency, ...]:
    """Return reaction time and data age of the chains whose tasks are all active; None where no data arrives."""
    result = []
    for chain in chains:
        if not all(name in placement.by_task for name in chain.tasks):
            continue
        members = [placement.by_task[name] for name in chain.tasks]
        reaction, age = worst_reaction(members, placement.hyperperiod), worst_age(members, placement.hyperperiod)
        result.append(
            ChainLatency(
                name=chain.name,
                reaction=None if reaction is None else placement.tick * reaction,
                age=None if age is None else placement.tick * age,
            )
        )
    return tuple(result)


def worst_reaction(members: list[list[PlacedJob]], hyperperiod: int) -> int | None:
    """Return the worst reaction time in ticks of a chain given by the jobs of its tasks, first to last."""
    if not all(members):
        return None
    starts = [Instants.of(((job.start, n) for n, job in enumerate(jobs)), hyperperiod) for jobs in members]
    worst = 0
    for missed in members[0]:
        time = missed.start + 1
        for jobs, instants in zip(members, starts, strict=True):
            begin, reached = instants.at_or_after(time)
            time = begin + jobs[reached].length
        worst = max(worst, time - missed.start)
    return worst


def worst_age(members: list[list[PlacedJob]], hyperperiod: int) -> int | None:
    """Return the worst data age in ticks of a chain given by the jobs of its tasks, first to last."""
    if not all(members):
        return None
    # of jobs that end together, the one that started later is the newer: it has the greater label, less its length
    ends = [Instants.of(((job.end, -job.length) for job in jobs), hyperperiod) for jobs in members[:-1]]
    worst = 0
    for last in members[-1]:
        time = last.start
        for instants in reversed(ends):
            end, started = instants.at_or_before(time)
            time = end + started
        worst = max(worst, last.end - time)
    return worst
