"""Moves from one plan to another: around what is late, or anywhere along chains that could be shorter."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.pipeline.solve.edf.plans import with_item

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.models import Chain
    from halpipe.pipeline.solve.edf.jobs import Plan
    from halpipe.pipeline.solve.edf.works import Mode, Way
    from halpipe.pipeline.solve.integers import Draws


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
