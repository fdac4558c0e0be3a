"""From groups to units: who of the interchangeable units of a group gets which job.

Unit assignment for groups of identical units (circular-arc colouring).

The kernel keeps the load of a group within its size. On a line that would be enough to give every job its own
units; on a circle it may fail, because the jobs that cross the cut must end up on the units they began on. The
sweep resolves that by renaming idle units on the way, and gives up only where no renaming helps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

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


class Arc(NamedTuple):
    """A job on the circle: it takes `width` units of the group on [start, start + length)."""

    job: int
    start: int
    length: int
    width: int


@dataclass(slots=True)
class _Step:
    """One arc met in the sweep: when, on which tracks, and which tracks were idle just before."""

    arc: Arc
    crossing: bool
    idle: list[int]
    tracks: list[int]


def assign_units(arcs: list[Arc], units: int, hyperperiod: int) -> dict[int, tuple[int, ...]] | None:
    """Give every job its units 0..units-1, or return None where neither way to sweep finds one."""
    return _assign(arcs, units, hyperperiod, keep_homes=False) or _assign(arcs, units, hyperperiod, keep_homes=True)


def _assign(arcs: list[Arc], units: int, hyperperiod: int, *, keep_homes: bool) -> dict[int, tuple[int, ...]] | None:
    cut = _lightest_cut(arcs, hyperperiod)
    crossing = [arc for arc in arcs if 0 < (cut - arc.start) % hyperperiod < arc.length]
    home: dict[int, list[int]] = {}
    taken = 0
    for arc in crossing:
        home[arc.job] = list(range(taken, taken + arc.width))
        taken += arc.width
    if taken > units:
        return None
    homes = frozenset(track for tracks in home.values() for track in tracks) if keep_homes else frozenset()
    steps = _sweep(arcs, home, homes, units, cut, hyperperiod)
    if steps is None:
        return None
    target = _targets(steps, home, units)
    result = _rename(steps, target, units)
    if result is None:
        return None
    result.update({job: tuple(tracks) for job, tracks in home.items()})
    return result


def _lightest_cut(arcs: list[Arc], hyperperiod: int) -> int:
    """Return the start of an arc at which the fewest units are busy with others."""
    changes: dict[int, int] = {}
    load = 0
    for arc in arcs:
        end = arc.start + arc.length
        changes[arc.start] = changes.get(arc.start, 0) + arc.width
        changes[end % hyperperiod] = changes.get(end % hyperperiod, 0) - arc.width
        if end > hyperperiod:
            load += arc.width
    starting: dict[int, int] = {}
    for arc in arcs:
        starting[arc.start] = starting.get(arc.start, 0) + arc.width
    best, cut = None, 0
    for time in sorted(changes):
        load += changes[time]
        if time in starting and (best is None or load - starting[time] < best):
            best, cut = load - starting[time], time
    return cut


def _sweep(
    arcs: list[Arc], home: dict[int, list[int]], avoided: frozenset[int], units: int, cut: int, hyperperiod: int
) -> list[_Step] | None:
    """Go once round from the cut, giving each arc the tracks that became idle last; crossing arcs come last again.

    Tracks `avoided` are given only where no others are idle.
    """
    idle_since = [0] * units
    for arc in arcs:
        for track in home.get(arc.job, ()):
            idle_since[track] = (arc.start + arc.length - cut) % hyperperiod
    steps = []
    for arc in sorted(arcs, key=lambda a: ((a.start - cut) % hyperperiod, a.job)):
        begin = (arc.start - cut) % hyperperiod
        idle = [track for track in range(units) if idle_since[track] <= begin]
        if len(idle) < arc.width:
            return None
        wanted = [track for track in home.get(arc.job, ()) if track in idle]
        others = sorted((t for t in idle if t not in wanted), key=lambda t: (t in avoided, -idle_since[t]))
        tracks = (wanted + others)[: arc.width]
        for track in tracks:
            idle_since[track] = begin + arc.length
        steps.append(_Step(arc, arc.job in home, idle, tracks))
    return steps


def _targets(steps: list[_Step], home: dict[int, list[int]], units: int) -> list[int]:
    """Return for every track the unit it must be at the end of the sweep, so that crossing arcs close."""
    target = [-1] * units
    for step in steps:
        if step.crossing:
            for track, unit in zip(sorted(step.tracks), home[step.arc.job], strict=True):
                target[track] = unit
    spare = sorted(set(range(units)) - set(target))
    for track in range(units):
        if target[track] < 0 and track in spare:
            target[track] = track
            spare.remove(track)
    for track in range(units):
        if target[track] < 0:
            target[track] = spare.pop()
    return target


def _rename(steps: list[_Step], target: list[int], units: int) -> dict[int, tuple[int, ...]] | None:
    """Follow the sweep with units as names of tracks, swapping the names of idle tracks towards their targets."""
    name = list(range(units))
    result: dict[int, tuple[int, ...]] = {}
    for step in steps:
        for track in step.idle:
            while name[track] != target[track]:
                cycle = _cycle(track, name, target)
                partners = [t for t in step.idle if t in cycle and t != track]
                if not partners:
                    break
                partner = next((t for t in partners if name[t] == target[track]), partners[0])
                name[track], name[partner] = name[partner], name[track]
                if name[track] != target[track]:
                    break  # the swap only split the cycle
        if not step.crossing:
            result[step.arc.job] = tuple(name[track] for track in step.tracks)
    return result if name == target else None


def _cycle(track: int, name: list[int], target: list[int]) -> set[int]:
    """Return the tracks among which names must rotate for `track` to get its own."""
    holder = {unit: t for t, unit in enumerate(name)}
    cycle: set[int] = set()
    while track not in cycle:
        cycle.add(track)
        track = holder[target[track]]
    return cycle
