"""Small sets that leave little or nothing idle, feasible by construction: each is cut out of a schedule of its own.

They are what a search that goes by small steps finds hardest: nothing can move before much moves at once. All times are
whole ticks of a millisecond, and only whole numbers are drawn.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from random import Random
from typing import TYPE_CHECKING

from halpipe.core.durations import milliseconds
from halpipe.core.records import record
from halpipe.models import Mode, Precedence, Run, Task, TaskModel, Unit, Version

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

PERIOD = 1000
"""Ticks of the hyperperiod of all families but one."""


@record(kw_only=True)
class ManyVersions:
    """`tasks` tasks with `versions` versions each, of which one choice fills `units` unlike units to the last tick."""

    tasks: int
    versions: int
    units: int

    def draw(self, seed: int) -> TaskModel:
        """Return the set of a seed."""
        rng = Random(seed)
        names = _units(self.units)
        placed = [(u, c) for u in range(self.units) for c in _cut(rng, PERIOD, self.tasks // self.units)]
        rng.shuffle(placed)
        tasks = []
        for number, (unit, length) in enumerate(placed):
            choices = [(unit, length)]
            while len(choices) < self.versions:
                choices.append((rng.randrange(self.units), rng.randint(length, min(PERIOD, 2 * length))))
            rng.shuffle(choices)
            tasks.append(_task(number, PERIOD, [_version(n, c, [names[u]]) for n, (u, c) in enumerate(choices)]))
        return _model("many-versions", names, tasks)


@record(kw_only=True)
class FullSlack:
    """Tasks with slack 1 fill `units` units: on each, `slots` stretches of a frame are served by one to three tasks."""

    units: int
    slots: int
    frame: int = 100

    def draw(self, seed: int) -> TaskModel:
        """Return the set of a seed."""
        rng = Random(seed)
        names = _units(self.units)
        drawn = []
        for _ in names:
            for length in _cut(rng, self.frame, self.slots):
                share = rng.randint(1, 3)
                drawn += [(share * self.frame, length)] * share
        rng.shuffle(drawn)
        tasks = [_task(n, period, [_version(0, c, names)], slack=1) for n, (period, c) in enumerate(drawn)]
        return _model("slack-1", names, tasks)


@record(kw_only=True)
class RigidChains:
    """`chains` chains of `length` tasks on `units` units alike, with windows of so many ticks either side (0: none)."""

    chains: int
    length: int
    units: int
    load: Fraction
    width: int = 0

    def draw(self, seed: int) -> TaskModel:
        """Return the set of a seed."""
        rng = Random(seed)
        names, count = _units(self.units), self.chains * self.length
        lengths = _cut(rng, int(PERIOD * self.units * self.load), count)
        starts = self._starts(rng, lengths)
        order = list(range(count))
        rng.shuffle(order)
        tasks: dict[int, Task] = {}
        for chain in range(self.chains):
            members = order[chain :: self.chains]
            before: dict[int, int] = {after: first for first, after in pairwise(members)}
            for number in members:
                rows = [self._window(before[number], starts, number)] if number in before else []
                tasks[number] = _task(number, PERIOD, [_version(0, lengths[number], names, rows)])
        return _model("rigid-chains", names, (tasks[number] for number in range(count)))

    def _starts(self, rng: Random, lengths: Sequence[int]) -> list[int]:
        """Lay the jobs of every unit one after the other, with the idle time in between."""
        starts = [0] * len(lengths)
        free = list(range(len(lengths)))
        rng.shuffle(free)
        for unit in range(self.units):
            own, at = free[unit :: self.units], 0
            idle = PERIOD - sum(lengths[number] for number in own)
            gaps = _cut(rng, idle, len(own) + 1) if idle > 2 * len(own) + 2 else [0] * len(own)
            for number, gap in zip(own, gaps, strict=False):
                starts[number] = at + gap
                at += gap + lengths[number]
        return starts

    def _window(self, before: int, starts: Sequence[int], number: int) -> Precedence:
        distance = (starts[number] - starts[before]) % PERIOD
        low, high = max(0, distance - self.width), distance + self.width
        return Precedence(task=f"t{before}", min=milliseconds(low), max=milliseconds(high))


# ------------------------------------------------------------------------------------------------ pieces


def _cut(rng: Random, whole: int, parts: int) -> list[int]:
    """Cut `whole` into parts, none of them shorter than a third of the mean or than one."""
    least = max(1, whole // (3 * parts))
    marks = sorted(rng.randrange(whole - least * parts + 1) for _ in range(parts - 1))
    return [after - before + least for before, after in pairwise([0, *marks, whole - least * parts])]


def _units(count: int) -> list[str]:
    return [f"u{number}" for number in range(count)]


def _version(number: int, length: int, units: Sequence[str], rows: Sequence[Precedence] = ()) -> Version:
    return Version(name=f"v{number}", wcet=milliseconds(length), units=tuple(units), precedences=tuple(rows))


def _task(number: int, period: int, versions: Sequence[Version], slack: int = 0) -> Task:
    return Task(name=f"t{number}", period=milliseconds(period), slack=Fraction(slack), versions=tuple(versions))


def _model(name: str, units: Iterable[str], tasks: Iterable[Task]) -> TaskModel:
    made = tuple(tasks)
    runs = tuple(Run(task=task.name, versions=tuple(v.name for v in task.versions)) for task in made)
    return TaskModel(
        name=name,
        units=tuple(Unit(name=unit) for unit in units),
        tasks=made,
        modes=(Mode(name="all", runs=runs),),
    )
