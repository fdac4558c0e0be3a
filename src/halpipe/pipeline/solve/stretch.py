"""The largest WCET margin of a given order of jobs: starts between the ticks of the search, in exact arithmetic.

On each unit the order stays; whole tasks move. The margin of a cycle of orders is a ratio of sums of times, and that of
the schedule is the least of them: from above, one cycle after the other is found that allows no more (Bellman-Ford).
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.durations import Duration
from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.models import Job, TaskModel
    from halpipe.pipeline.jobs import Expansion

MOST_WORK = 300_000
"""Movable tasks times pairs of neighbours up to which an order is stretched."""


@record
class _Edge:
    """A stay on a unit of a job of task `before`, and how long after its start the next one begins, of task `after`."""

    before: int
    after: int
    length: Fraction
    distance: Fraction


def stretched(model: TaskModel, expansion: Expansion, jobs: tuple[Job, ...], most: Fraction) -> tuple[Job, ...]:
    """Return the jobs in the same order on all units, with the largest margin up to `most` that the order allows.

    Tasks with offsets, and those that windows, resources or chains bind to others, stay where they are.
    """
    nodes = _nodes(model, expansion)
    edges = _edges(expansion, jobs, nodes)
    movable = max(nodes.values(), default=0)
    if not movable or movable * len(edges) > MOST_WORK or any(job.parts for job in jobs):
        return jobs
    margin = min([most, *(edge.distance / edge.length - 1 for edge in edges if edge.before == edge.after)])
    while True:
        shifts, cycle = _shifts(edges, movable + 1, margin)
        if not cycle:
            break
        distance = sum((edge.distance for edge in cycle), Fraction(0))
        margin = distance / sum((edge.length for edge in cycle), Fraction(0)) - 1
    return tuple(_moved(job, shifts[nodes[job.task]] - shifts[0], expansion.hyperperiod) for job in jobs)


def _nodes(model: TaskModel, expansion: Expansion) -> dict[str, int]:
    """Number the tasks that may move from 1 on; all others are 0."""
    named = {row.task for active in expansion.tasks for v in active.versions for row in v.precedences}
    chained = {name for chain in model.chains for name in chain.tasks}
    nodes: dict[str, int] = {}
    count = 0
    for active in expansion.tasks:
        task = active.task
        is_bound = any(version.precedences or version.accesses for version in active.versions)
        is_free = task.period is not None and task.offset is None and task.let is None
        is_free = is_free and not is_bound and active.name not in named | chained
        count += is_free
        nodes[active.name] = count if is_free else 0
    return nodes


def _edges(expansion: Expansion, jobs: tuple[Job, ...], nodes: Mapping[str, int]) -> list[_Edge]:
    by_unit: dict[str, list[Job]] = {}
    for job in jobs:
        for unit in job.units:
            by_unit.setdefault(unit, []).append(job)
    edges = []
    for own in by_unit.values():
        own.sort(key=lambda job: job.start)
        again = replace(own[0], start=own[0].start + expansion.hyperperiod)
        for job, following in pairwise([*own, again]):
            length, distance = Fraction((job.end - job.start).ns), Fraction((following.start - job.start).ns)
            edges.append(_Edge(nodes[job.task], nodes[following.task], length, distance))
    return edges


def _shifts(edges: list[_Edge], count: int, margin: Fraction) -> tuple[list[Fraction], list[_Edge]]:
    """Return by how much the tasks move so that all stays have the margin; or a cycle of edges that forbids it."""
    shifts = [Fraction(0)] * count
    came: list[_Edge | None] = [None] * count
    last = 0
    for _ in range(count):
        is_settled = True
        for edge in edges:
            least = shifts[edge.before] + edge.length * (1 + margin) - edge.distance
            if edge.before != edge.after and least > shifts[edge.after]:
                shifts[edge.after], came[edge.after], last, is_settled = least, edge, edge.after, False
        if is_settled:
            return shifts, []
    for _ in range(count):  # whatever was moved in the last round leads back into a cycle
        last = _before(came, last)
    cycle: list[_Edge] = []
    at = last
    while not cycle or at != last:
        edge_before = came[at]
        assert edge_before is not None, "all tasks of a cycle were moved"
        cycle.append(edge_before)
        at = edge_before.before
    return shifts, cycle


def _before(came: list[_Edge | None], task: int) -> int:
    edge = came[task]
    return task if edge is None else edge.before


def _moved(job: Job, shift: Fraction, hyperperiod: Duration) -> Job:
    start = Duration(job.start.ns + shift) % hyperperiod
    return replace(job, start=start, end=start + (job.end - job.start))
