"""Plans, the input of a simulation of earliest deadline first: the first one, moves to others, and releases."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from graphlib import TopologicalSorter
from itertools import groupby, pairwise
from typing import TYPE_CHECKING, TypeVar

from halpipe.core.records import record
from halpipe.pipeline.solve.edf.works import load_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from halpipe.models import Chain
    from halpipe.pipeline.solve.edf.works import Mode, Way, Work
    from halpipe.pipeline.solve.integers import Draws, Ints
    from halpipe.pipeline.solve.lanes import Pins


Span = tuple[int, int, int, int]
"""A part: start, end, and what it executes, from and to."""


@record
class Plan:
    """Input of the simulation: for each task its option, the phase of its releases, and the urgency of its jobs.

    `urgency` is the deadline by which jobs are ordered, from their release; they are held back for `holds` after it.
    With `fresh` a job waits, as long as it can, for the job of its predecessor that was released before it or with it.
    """

    ways: tuple[Way, ...]
    phases: tuple[int, ...]
    urgency: tuple[int, ...]
    holds: tuple[int, ...]
    fresh: bool = True


@record
class Table:
    """One hyperperiod: where the jobs of each task lie, their starts in [0, hyperperiod).

    The jobs of task n are numbers `places[n]` to `places[n + 1]` of the arrays; `indices` are theirs within the task.
    `releases` are the instants of release that belong to those starts. The parts of each are `counts` rows of `parts`
    (start, end, executed from, to) from row `firsts` on; a job that did not start in the hyperperiod has none. `late`
    sums for each task by how much its jobs start or end too late. A table that is not `closed` does not repeat.
    """

    places: Ints
    indices: Ints
    releases: Ints
    starts: Ints
    ends: Ints
    firsts: Ints
    counts: Ints
    parts: Ints
    late: tuple[int, ...]
    closed: bool

    def __len__(self) -> int:
        return len(self.counts) - self.counts.count(0)

    @property
    def part_count(self) -> int:
        """Return the number of parts of all jobs."""
        return sum(self.counts)

    def is_whole(self, task: int) -> bool:
        """Return whether a task has jobs, and each of them started in the hyperperiod."""
        counts = self.counts[self.places[task] : self.places[task + 1]]
        return bool(counts) and 0 not in counts

    def jobs(self, task: int) -> Iterator[tuple[int, tuple[Span, ...]]]:
        """Yield the index and the parts of each job of a task."""
        for place in range(self.places[task], self.places[task + 1]):
            if self.counts[place]:
                yield self.indices[place], self.spans(place)

    def spans(self, place: int) -> tuple[Span, ...]:
        """Return the parts of a job."""
        first = 4 * self.firsts[place]
        flat = self.parts[first : first + 4 * self.counts[place]]
        return tuple(zip(flat[::4], flat[1::4], flat[2::4], flat[3::4], strict=True))

    def slips(self, task: int) -> list[int]:
        """Return how long after their release the jobs of a task start, of those that started."""
        begin, end = self.places[task], self.places[task + 1]
        numbers = range(begin, end)
        return [self.starts[n] - self.releases[n] for n in numbers if self.counts[n]]


Releases = dict[int, int]
"""Release instants by the index of the job."""


def releases_of(mode: Mode, plan: Plan) -> list[list[tuple[int, int]]]:
    """Return the releases of every task within one hyperperiod of its first, ascending, each with the job's index."""
    demanders = {task: {demand[0] for demand in work.demands} for task, work in enumerate(mode.works)}
    found: dict[int, Releases] = {}
    for task in TopologicalSorter(demanders).static_order():
        found[task] = _releases(mode, plan, task, found)
    return [sorted((time, index) for index, time in found[task].items()) for task in range(len(mode.works))]


def _releases(mode: Mode, plan: Plan, task: int, known: dict[int, Releases]) -> Releases:
    """Return those of one task; those of its demanders are known."""
    work = mode.works[task]
    if task in mode.fixed.tasks:
        return {}
    if work.is_cyclic:
        first = plan.phases[task] + plan.holds[task]
        return {index: first + index * work.period for index in range(work.jobs)}
    found: Releases = {}
    for index, (demander, number, slot) in enumerate(work.demands):
        if demander in mode.fixed.tasks:
            wanted = _wanted_by_fixed(mode, demander, number, task)
            if slot < len(wanted):
                found[index] = wanted[slot]
            continue
        asked = sum(1 for window in plan.ways[demander].windows if window.task == task)
        if slot < asked and number in known[demander]:
            found[index] = known[demander][number] + plan.holds[task]
    first = min(found.values(), default=0)
    # Demanders may be phased further apart than a hyperperiod; releases out of order would start jobs in the past.
    return {index: first + (time - first) % mode.hyperperiod for index, time in found.items()}


def _wanted_by_fixed(mode: Mode, demander: int, number: int, task: int) -> list[int]:
    """Return for each demand of a job that stays the earliest instant that serves it: a start of `task`, or an end."""
    [job] = [each for each in mode.fixed.jobs if each.task == demander and each.job.index == number]
    windows = [window for window in job.way.windows if window.task == task]
    shortest = min(way.length for way in mode.works[task].ways)
    return [(job.start - w.most - (shortest if w.from_end else 0)) % mode.hyperperiod for w in windows]


T = TypeVar("T")


def with_item(items: tuple[T, ...], place: int, item: T) -> tuple[T, ...]:
    """Return items with another one in a place."""
    return (*items[:place], item, *items[place + 1 :])


def allowed_ways(mode: Mode, pinned: Mapping[str, Pins]) -> list[tuple[Way, ...]]:
    """Return the ways that each task may take: of those that stay, theirs; of those `pinned`, on their units."""
    stay = {each.task: each.way for each in mode.fixed.jobs}
    return [(stay[task],) if task in stay else _allowed(mode, work, pinned) for task, work in enumerate(mode.works)]


def _allowed(mode: Mode, work: Work, pinned: Mapping[str, Pins]) -> tuple[Way, ...]:
    stay = pinned.get(work.name)
    if stay is None:
        return work.ways
    served = (
        way for way in work.ways if {mode.units[unit] for unit in way.units} <= stay.get(len(way.units), frozenset())
    )
    return tuple(served) or work.ways


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


def adopted(plan: Plan, allowed: Sequence[tuple[Way, ...]]) -> Plan:
    """Return a plan of the same tasks with the ways that are `allowed` now: on the same units, if they still are."""

    def same(way: Way, ways: tuple[Way, ...]) -> Way:
        return next((w for w in ways if (w.version.name, w.units) == (way.version.name, way.units)), ways[0])

    return replace(plan, ways=tuple(map(same, plan.ways, allowed)))


def _spread(mode: Mode, allowed: Sequence[tuple[Way, ...]]) -> tuple[Way, ...]:
    """Give every task the units that are loaded least, the heaviest tasks first."""
    loads = [Fraction(0)] * len(mode.units)
    for unit, service in enumerate(mode.services):
        for distance, time in service:
            loads[unit] += time / distance
    chosen: dict[int, Way] = {}
    weight = [
        max(load_of(work, way, mode.hyperperiod) for way in ways)
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
    return max(_loads(mode, plan)) <= 1


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


class Moves:
    """The moves in one mode; tasks that stay where they are never move."""

    def __init__(self, mode: Mode, allowed: Sequence[tuple[Way, ...]], chains: Sequence[Chain], draws: Draws) -> None:
        self.mode = mode
        self.allowed = allowed
        self.draws = draws
        self.free = [task for task in range(len(mode.works)) if task not in mode.fixed.tasks]
        number = {work.name: task for task, work in enumerate(mode.works)}
        links = [(number[a], number[b]) for c in chains for a, b in pairwise(c.tasks) if a in number and b in number]
        self.beside = {task: [b if a == task else a for a, b in links if task in (a, b)] for task in self.free}
        named = {name for chain in chains for name in chain.tasks}
        self.chained = [task for task in self.free if mode.works[task].name in named]

    # ---- moves

    def repaired(self, plan: Plan, late: Sequence[int]) -> Plan:
        """Return a plan that differs around a task that is late, or around any where only chains are too long."""
        pool = [task for task in self.free if late[task]] or self.chained or self.free
        task = pool[self.draws.below(len(pool))]
        kind = self.draws.below(10)
        if not self.draws.below(20):
            plan = replace(plan, fresh=not plan.fresh)
        if kind in (1, 4, 6, 8):
            task = self._neighbour(plan, task)
        if kind < 3:
            return self._urgent(plan, task)
        if kind < 5:
            return self._elsewhere(plan, task)
        if kind < 7:
            return self._shifted(plan, task)
        return self._held(plan, task)

    def _neighbour(self, plan: Plan, task: int) -> int:
        """Return a task that shares a unit or a resource with `task`, or has a window in common with it."""
        units, resources = set(plan.ways[task].units), _resources(plan.ways[task])
        others = [n for n, way in enumerate(plan.ways) if units & set(way.units) or resources & _resources(way)]
        others += [window.task for window in plan.ways[task].windows]
        others = [other for other in others if other not in self.mode.fixed.tasks] or [task]
        return others[self.draws.below(len(others))]

    def _urgent(self, plan: Plan, task: int) -> Plan:
        work, way = self.mode.works[task], plan.ways[task]
        most = work.deadline if work.is_cyclic else self.mode.hyperperiod
        choice = self.draws.below(6)
        urgency = way.length + self.draws.below(max(1, most)) if choice < 2 else plan.urgency[task] * (2 + choice) // 8
        return replace(plan, urgency=with_item(plan.urgency, task, urgency))

    def _shifted(self, plan: Plan, task: int) -> Plan:
        """Release a task whose phase is free at another phase: where its windows open, near the old one, anywhere."""
        work = self.mode.works[task]
        if work.phase is not None or not work.is_cyclic:
            return self._held(plan, task)
        targets = [0, self.draws.below(work.period), *self._openings(plan, task)]
        targets.append(plan.phases[task] + self.draws.below(2 * work.period // 8 + 1) - work.period // 8)
        phase = targets[self.draws.below(len(targets))]
        return replace(plan, phases=with_item(plan.phases, task, max(0, phase)), holds=with_item(plan.holds, task, 0))

    def _held(self, plan: Plan, task: int) -> Plan:
        """Hold the jobs of a task back, so that they meet a window, or for any time that their slack allows."""
        work = self.mode.works[task]
        most = work.slip if work.is_cyclic else self.mode.hyperperiod
        if not most:
            return self._urgent(plan, task)
        targets = [0, self.draws.below(most + 1)]
        targets += [
            hold for start in self._openings(plan, task) if (hold := (start - plan.phases[task]) % work.period) <= most
        ]
        return replace(plan, holds=with_item(plan.holds, task, targets[self.draws.below(len(targets))]))

    def _openings(self, plan: Plan, task: int) -> list[int]:
        """Return starts at which windows with other tasks begin or end, as far as the plan tells."""
        lengths = [way.length for way in plan.ways]
        starts = [phase + hold for phase, hold in zip(plan.phases, plan.holds, strict=True)]
        found = []
        for window in plan.ways[task].windows:
            lag = lengths[window.task] if window.from_end else 0
            found += [starts[window.task] + lag + window.least, starts[window.task] + lag + window.most]
        for other, way in enumerate(plan.ways):
            for window in way.windows:
                if window.task == task:
                    lag = lengths[task] if window.from_end else 0
                    found += [starts[other] - lag - window.least, starts[other] - lag - window.most]
        return found

    def _elsewhere(self, plan: Plan, task: int) -> Plan:
        ways = self.allowed[task]
        if len(ways) < 2:
            return self._urgent(plan, task)
        return replace(plan, ways=with_item(plan.ways, task, ways[self.draws.below(len(ways))]))

    def varied(self, plan: Plan, slow: Sequence[int] = ()) -> Plan:
        """Return a plan that differs where latencies may depend on it: mostly units beside the next of a chain.

        The `slow` tasks of chains that are too long are those to look at, if there are any that may move.
        """
        for _ in range(1 + self.draws.below(3) // 2):
            pool = [task for task in slow if task in self.beside] or self.chained or self.free
            task = pool[self.draws.below(len(pool))]
            kind = self.draws.below(10)
            if kind < 3:
                plan = self._nearer(plan, task)
            elif kind < 5:
                plan = self._elsewhere(plan, task)
            elif kind < 6:
                plan = self._swapped(plan, task)
            elif kind < 7:
                plan = self._urgent(plan, task)
            else:
                plan = self._shifted(plan, task)
        return plan

    def _nearer(self, plan: Plan, task: int) -> Plan:
        """Put a task on the units of one beside it in a chain."""
        beside = self.beside[task]
        if not beside:
            return self._elsewhere(plan, task)
        return self._onto(plan, task, plan.ways[beside[self.draws.below(len(beside))]].units)

    def _swapped(self, plan: Plan, task: int) -> Plan:
        other = self.free[self.draws.below(len(self.free))]
        here, there = plan.ways[task].units, plan.ways[other].units
        return self._onto(self._onto(plan, task, there), other, here)

    def _onto(self, plan: Plan, task: int, units: tuple[int, ...]) -> Plan:
        way = next((way for way in self.allowed[task] if way.units == units), None)
        return plan if way is None else replace(plan, ways=with_item(plan.ways, task, way))


def _resources(way: Way) -> set[int]:
    return {phase.resource for phase in way.phases}
