"""From groups to units: who of the interchangeable units of a group gets which job."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.pipeline.solve.kernel.arc_colouring import Arc, assign_units

if TYPE_CHECKING:
    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.problem import Problem

Units = dict[int, tuple[str, ...]]


def deal(problem: Problem, start: Ints, option: Ints) -> Units | None:
    """Deal the units of every group out to its jobs; None where that fails for some group."""
    arrays = problem.arrays
    arcs: list[list[Arc]] = [[] for _ in problem.groups]
    for job, chosen in enumerate(option):
        for group, count in problem.options[chosen].groups:
            reserved = arrays.rect[arrays.rect_first[chosen], 2]
            arcs[group].append(Arc(job, start[job], reserved, count))
    units: Units = {}
    for group, (names, members) in enumerate(zip(problem.groups, arcs, strict=True)):
        if not members:
            continue
        assigned = assign_units(members, arrays.lane_capacity[group], arrays.hyperperiod)
        if assigned is None:
            return None
        for job, places in assigned.items():
            units[job] = units.get(job, ()) + tuple(names[place] for place in places)
    return units


def deal_anyhow(problem: Problem, start: Ints, option: Ints) -> Units:
    """Deal units out in turn, overlaps or not: for reporting the best placement of a search that failed."""
    units: Units = {}
    turn = [0] * len(problem.groups)
    for job in sorted(range(len(start)), key=start.__getitem__):
        taken: tuple[str, ...] = ()
        for group, count in problem.options[option[job]].groups:
            names = problem.groups[group]
            taken += tuple(names[(turn[group] + place) % len(names)] for place in range(count))
            turn[group] += count
        units[job] = taken
    return units
