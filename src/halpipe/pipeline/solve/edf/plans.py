"""Plans: the first one, whose units are chosen by load, and one that keeps what follows each other on one unit."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import groupby
from typing import TYPE_CHECKING, TypeVar

from halpipe.pipeline.solve.edf.jobs import Plan
from halpipe.pipeline.solve.edf.works import load_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from halpipe.models import Chain
    from halpipe.pipeline.solve.edf.works import Mode, Way, Work

T = TypeVar("T")


def with_item(items: tuple[T, ...], place: int, item: T) -> tuple[T, ...]:
    """Return items with another one in a place."""
    return (*items[:place], item, *items[place + 1 :])


def allowed_ways(mode: Mode, pinned: Mapping[str, tuple[str, ...]]) -> list[tuple[Way, ...]]:
    """Return the ways that each task may take: of those that stay, theirs; of those `pinned`, on their units."""
    stay = {each.task: each.way for each in mode.fixed.jobs}
    return [(stay[task],) if task in stay else _allowed(mode, work, pinned) for task, work in enumerate(mode.works)]


def _allowed(mode: Mode, work: Work, pinned: Mapping[str, tuple[str, ...]]) -> tuple[Way, ...]:
    stay = pinned.get(work.name)
    if stay is None:
        return work.ways
    return tuple(way for way in work.ways if {mode.units[unit] for unit in way.units} == set(stay)) or work.ways


def first_plan(mode: Mode, allowed: Sequence[tuple[Way, ...]]) -> Plan:
    """Return the plan to begin with: units by load, releases at their offsets, deadlines back along windows."""
    ways = _spread(mode, allowed)
    urgency = []
    for work, way in zip(mode.works, ways, strict=True):
        if work.is_cyclic:
            urgency.append(min(work.deadline, work.latest + way.length))
        else:
            urgency.append(mode.hyperperiod)
    for _ in mode.works:
        before = list(urgency)
        for work, way, due in zip(mode.works, ways, before, strict=True):
            for window in way.windows:
                other = mode.works[window.task]
                if not other.is_cyclic or other.period == work.period:
                    lag = way.length if window.from_end else way.length - ways[window.task].length
                    urgency[window.task] = min(urgency[window.task], due - lag - window.least)
        if urgency == before:
            break
    phases = tuple(fixed_phase(mode, task) or work.phase or 0 for task, work in enumerate(mode.works))
    return Plan(ways, phases, tuple(urgency), (0,) * len(phases))


def _spread(mode: Mode, allowed: Sequence[tuple[Way, ...]]) -> tuple[Way, ...]:
    """Give every task the units that are loaded least, the heaviest tasks first."""
    loads = [Fraction(0)] * len(mode.units)
    for unit, service in enumerate(mode.services):
        for distance, time in service:
            loads[unit] += time / distance
    chosen: dict[int, Way] = {}
    weight = [
        max((load_of(work, way, mode.hyperperiod) for way in ways), default=Fraction(0))
        for work, ways in zip(mode.works, allowed, strict=True)
    ]
    for task in sorted(range(len(mode.works)), key=lambda task: (len(allowed[task]) > 1, -weight[task], task)):
        work = mode.works[task]
        costs = [
            (max(loads[unit] for unit in way.units) + load_of(work, way, mode.hyperperiod), number)
            for number, way in enumerate(allowed[task])
        ]
        way = allowed[task][min(costs)[1]]
        chosen[task] = way
        for unit in way.units:
            loads[unit] += load_of(work, way, mode.hyperperiod)
    return tuple(chosen[task] for task in range(len(mode.works)))


def fixed_phase(mode: Mode, task: int) -> int | None:
    """Return the least start of the jobs of a task that stays, less the periods before each; None for other tasks."""
    work = mode.works[task]
    starts = [
        (each.start - each.job.index * work.period) % mode.hyperperiod for each in mode.fixed.jobs if each.task == task
    ]
    return min(starts, default=None)


def fits(mode: Mode, plan: Plan) -> bool:
    """Return whether no unit has more work than time."""
    return max(_loads(mode, plan), default=0) <= 1


def _loads(mode: Mode, plan: Plan) -> list[Fraction]:
    loads = [sum((time / distance for distance, time in service), Fraction(0)) for service in mode.services]
    for work, way in zip(mode.works, plan.ways, strict=True):
        for unit in way.units:
            loads[unit] += Fraction(way.wcet * work.jobs, mode.hyperperiod)
    return loads


def together(mode: Mode, plan: Plan, allowed: Sequence[tuple[Way, ...]], chains: Iterable[Chain]) -> Plan:
    """Return the plan with what follows each other in a chain, at one period, on the unit of the heaviest of them.

    Such a run of tasks then starts each job where the one before it has ended, and nothing comes between.
    """
    number = {work.name: task for task, work in enumerate(mode.works)}
    for chain in chains:
        tasks = [number[name] for name in chain.tasks if name in number]
        for _, run in groupby(tasks, lambda task: mode.works[task].period):
            members = list(run)
            heaviest = max(members, key=lambda task: load_of(mode.works[task], plan.ways[task], mode.hyperperiod))
            for task in members:
                way = next((w for w in allowed[task] if w.units == plan.ways[heaviest].units), None)
                moved = plan if way is None else replace(plan, ways=with_item(plan.ways, task, way))
                plan = moved if fits(mode, moved) else plan
    return plan
