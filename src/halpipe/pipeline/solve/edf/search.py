"""The search over what earliest deadline first is told: units, phases and urgencies, until the table is valid.

The first plan is often enough: deadlines propagated back along windows, units by load. Where jobs come too late, the
plan changes around them: they become more urgent, are released at another phase, or move to other units.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING, TypeVar

from halpipe.pipeline.measure.latency import chain_latencies
from halpipe.pipeline.measure.placement import Placement
from halpipe.pipeline.parts import job_of
from halpipe.pipeline.solve.edf.simulate import Plan, Table, simulate
from halpipe.pipeline.solve.edf.works import load_of

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from halpipe.durations import Duration
    from halpipe.models import Chain, Job
    from halpipe.pipeline.solve.edf.simulate import Span
    from halpipe.pipeline.solve.edf.works import Mode, Way, Work
    from halpipe.pipeline.solve.goals import Polish

T = TypeVar("T")

SETTLING = 4
"""Simulations in which the phases of the first plan follow where its jobs start."""


class Draws:
    """Pseudo-random numbers, the same everywhere (splitmix64)."""

    def __init__(self, seed: int) -> None:
        self._state = seed % 2**64

    def below(self, limit: int) -> int:
        """Return a number in [0, limit)."""
        self._state = (self._state + 0x9E3779B97F4A7C15) % 2**64
        word = self._state
        word = (word ^ (word >> 30)) * 0xBF58476D1CE4E5B9 % 2**64
        word = (word ^ (word >> 27)) * 0x94D049BB133111EB % 2**64
        return (word ^ (word >> 31)) % limit


@dataclass(frozen=True, slots=True)
class Found:
    """The best table of a search; `excess` is zero if no job in it is late and no chain beyond its limit."""

    jobs: tuple[Job, ...]
    excess: int
    placed: int
    stopped: bool
    unimproved: bool


@dataclass(frozen=True, slots=True)
class _Try:
    plan: Plan
    table: Table
    late: tuple[int, ...]
    excess: int


@dataclass(frozen=True, slots=True)
class Effort:
    """How long to search, in jobs placed, and then to improve; `go_on` is told of jobs placed and the least excess."""

    budget: int
    polish: int
    go_on: Callable[[int, int], bool]


def search(
    mode: Mode,
    chains: Sequence[Chain],
    seed: int,
    pinned: Mapping[str, tuple[str, ...]],
    effort: Effort,
    polish: Polish | None = None,
) -> Found:
    """Look for a valid table of `mode`; `pinned` tasks stay on their units; with `polish` it goes on to better ones."""
    limited = [chain for chain in chains if chain.max_reaction is not None or chain.max_age is not None]
    names = {name for chain in chains for name in chain.tasks}
    return _Search(mode, limited, names, Draws(seed), effort, pinned, polish).run()


class _Search:
    def __init__(
        self,
        mode: Mode,
        chains: Sequence[Chain],
        chained: Collection[str],
        draws: Draws,
        effort: Effort,
        pinned: Mapping[str, tuple[str, ...]],
        polish: Polish | None,
    ) -> None:
        self.mode = mode
        self.chains = chains
        self.chained = [task for task, work in enumerate(mode.works) if work.name in chained]
        self.draws = draws
        self.effort = effort
        self.polish = polish
        self.allowed = [_allowed(mode, work, pinned) for work in mode.works]
        self.placed = 0
        self.stopped = False

    def run(self) -> Found:
        best = self._settle(first_plan(self.mode, self.allowed))
        current = best
        while best.excess and self.placed < self.effort.budget and not self.stopped:
            moved = self._evaluate(self._moved(current))
            if moved.excess <= current.excess or not self.draws.below(50):
                current = moved
            if current.excess < best.excess:
                best = current
        unimproved = False
        if not best.excess and self.polish is not None and not self.stopped:
            best = self._improved(best, self.polish)
            unimproved, self.stopped = self.stopped, False
        jobs = named(self.mode, best.plan, best.table)
        return Found(jobs, best.excess, self.placed, self.stopped, unimproved)

    def _improved(self, best: _Try, polish: Polish) -> _Try:
        """Climb to tables that are worth more, from a valid one; none of the objectives gets worse than in that."""
        judge = polish.judge
        jobs = named(self.mode, best.plan, best.table)
        first = worth = judge.worth(jobs)
        end = self.placed + self.effort.polish
        while self.placed < end and not self.stopped and not polish.is_enough(jobs):
            moved = self._evaluate(self._moved(best))
            if moved.excess:
                continue
            found = named(self.mode, moved.plan, moved.table)
            other = judge.worth(found)
            if judge.keeps(first, other) and other.values <= worth.values:
                best, jobs, worth = moved, found, other
        return best

    def _settle(self, plan: Plan) -> _Try:
        """Let the phases that are free follow the first starts, as long as that makes less late."""
        best = self._evaluate(plan)
        for _ in range(SETTLING):
            if not best.excess:
                break
            phases = _followed(self.mode, best)
            if phases == best.plan.phases:
                break
            tried = self._evaluate(replace(best.plan, phases=phases))
            if tried.excess >= best.excess:
                break
            best = tried
        return best

    def _evaluate(self, plan: Plan) -> _Try:
        table = simulate(self.mode, plan)
        self.placed += max(1, len(table.jobs))
        late = tuple(lateness(self.mode, table, task) for task in range(len(self.mode.works)))
        excess = sum(late)
        if not table.closed:
            excess += self.mode.hyperperiod
        elif not excess:
            excess = self._chain_excess(plan, table)
        if not self.effort.go_on(self.placed, excess):
            self.stopped = True
        return _Try(plan, table, late, excess)

    def _chain_excess(self, plan: Plan, table: Table) -> int:
        if not self.chains:
            return 0
        placement = Placement.of(self.mode.expansion, named(self.mode, plan, table), self.mode.platform)
        found = {latency.name: latency for latency in chain_latencies(placement, self.chains)}
        excess = 0
        for chain in self.chains:
            if chain.name in found:
                excess += self._beyond(found[chain.name].reaction, chain.max_reaction)
                excess += self._beyond(found[chain.name].age, chain.max_age)
        return excess

    def _beyond(self, latency: Duration | None, limit: Duration | None) -> int:
        if limit is None:
            return 0
        if latency is None:
            return self.mode.hyperperiod
        return max(0, -((limit - latency) // self.mode.tick))

    # ---- moves

    def _moved(self, current: _Try) -> Plan:
        """Return a plan that differs around a task that is late, or around any where only chains are too long."""
        late = [task for task, amount in enumerate(current.late) if amount]
        pool = late or self.chained or list(range(len(self.mode.works)))
        task = pool[self.draws.below(len(pool))]
        plan = current.plan
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
        """Return a task that shares a unit with `task`, or has a window in common with it."""
        units = set(plan.ways[task].units)
        others = [number for number, way in enumerate(plan.ways) if units & set(way.units)]
        others += [window.task for window in plan.ways[task].windows]
        return others[self.draws.below(len(others))]

    def _urgent(self, plan: Plan, task: int) -> Plan:
        work, way = self.mode.works[task], plan.ways[task]
        most = work.deadline if work.is_cyclic else self.mode.hyperperiod
        choice = self.draws.below(6)
        urgency = way.length + self.draws.below(max(1, most)) if choice < 2 else plan.urgency[task] * (2 + choice) // 8
        return replace(plan, urgency=_with(plan.urgency, task, urgency))

    def _shifted(self, plan: Plan, task: int) -> Plan:
        """Release a task whose phase is free at another phase: where its windows open, near the old one, anywhere."""
        work = self.mode.works[task]
        if work.phase is not None or not work.is_cyclic:
            return self._held(plan, task)
        targets = [0, self.draws.below(work.period), *self._openings(plan, task)]
        targets.append(plan.phases[task] + self.draws.below(2 * work.period // 8 + 1) - work.period // 8)
        phase = targets[self.draws.below(len(targets))]
        return replace(plan, phases=_with(plan.phases, task, max(0, phase)), holds=_with(plan.holds, task, 0))

    def _held(self, plan: Plan, task: int) -> Plan:
        """Hold the jobs of a task back, so that they meet a window, or for any time that their slack allows."""
        work = self.mode.works[task]
        most = work.latest if work.is_cyclic else self.mode.hyperperiod
        if not most:
            return self._urgent(plan, task)
        targets = [0, self.draws.below(most + 1)]
        targets += [
            hold for start in self._openings(plan, task) if (hold := (start - plan.phases[task]) % work.period) <= most
        ]
        return replace(plan, holds=_with(plan.holds, task, targets[self.draws.below(len(targets))]))

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
        return replace(plan, ways=_with(plan.ways, task, ways[self.draws.below(len(ways))]))


def _with(items: tuple[T, ...], place: int, item: T) -> tuple[T, ...]:
    return (*items[:place], item, *items[place + 1 :])


def _allowed(mode: Mode, work: Work, pinned: Mapping[str, tuple[str, ...]]) -> tuple[Way, ...]:
    stay = pinned.get(work.name)
    if stay is None:
        return work.ways
    return tuple(way for way in work.ways if {mode.units[unit] for unit in way.units} == set(stay)) or work.ways


# ---------------------------------------------------------------------------------------------- the first plan


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
    phases = tuple(work.phase or 0 for work in mode.works)
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


# ---------------------------------------------------------------------------------------------- what a table is worth


def lateness(mode: Mode, table: Table, task: int) -> int:
    """Return by how many ticks the jobs of a task start and end too late, all together, under their best phase."""
    work = mode.works[task]
    if not work.is_cyclic:
        return table.late[task]
    slips = [
        (spans[0][0] - table.releases[key], spans[-1][1] - table.releases[key])
        for key, spans in table.jobs.items()
        if key[0] == task
    ]
    if len(slips) < work.jobs:
        return table.late[task]
    shift = 0 if work.phase is not None else min(start for start, _ in slips)
    return sum(max(0, start - shift - work.latest) + max(0, end - shift - work.deadline) for start, end in slips)


def _followed(mode: Mode, tried: _Try) -> tuple[int, ...]:
    """Return the phases of a table's first starts, for tasks whose phase is free."""
    first: dict[int, int] = {}
    for (task, index), spans in tried.table.jobs.items():
        slip = spans[0][0] - tried.table.releases[task, index]
        first[task] = min(slip, first.get(task, slip))
    return tuple(
        phase if work.phase is not None or not work.is_cyclic else phase + first.get(task, 0)
        for task, (work, phase) in enumerate(zip(mode.works, tried.plan.phases, strict=True))
    )


def named(mode: Mode, plan: Plan, table: Table) -> tuple[Job, ...]:
    """Return the jobs of a table with their names, in exact time."""
    services = {way.units: _service(mode, way) for way in plan.ways}
    jobs = []
    for (task, index), spans in sorted(table.jobs.items()):
        way = plan.ways[task]
        units = tuple(mode.units[unit] for unit in way.units)
        exact = [_exact(mode, way, span) for span in spans]
        jobs.append(job_of(mode.works[task].name, index, way.version, units, exact, services[way.units]))
    return tuple(jobs)


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
