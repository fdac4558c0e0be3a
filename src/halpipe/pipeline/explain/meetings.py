"""Simultaneous demand of strictly periodic tasks, whatever their phases are (greatest common divisors).

Two parts that repeat with D1 and D2 are seen from each other at every multiple of g = gcd(D1, D2) from some first
distance. If their lengths sum to more than g, they meet; they are together for at least (c1 + c2 - g) / 2 at some time,
which repeats with lcm(D1, D2), and further parts meet that in the same way. All lengths are integers, halves are cut.

`find_meeting` lets one part after the other meet those before it; in `crowds`, parts meet in groups first, which finds
more: the tasks of one rate, then groups with each other. And where a task certainly has a unit for itself, the others
that might have used that unit run elsewhere in the meantime, whatever versions they have for it.
"""

from __future__ import annotations

import math
from dataclasses import field
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.core.suggest import few
from halpipe.pipeline.explain import codes
from halpipe.pipeline.explain.facts import Witness
from halpipe.pipeline.validate.context import place

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from halpipe.pipeline.explain.facts import ModeFacts, TaskFacts

MAX_STEPS = 4_000
"""Parts compared in one search; beyond it a meeting may be missed, never invented."""

MAX_SEEDS = 3


@record
class Part:
    """A part of every job of a task, `length` long, that takes `height` of something; it repeats with `period`."""

    task: str
    period: int
    length: int
    height: int | Fraction


@record
class Step:
    """Simultaneous demand of one more part: together for `together`, again after a multiple of `gcd`."""

    part: Part
    gcd: int
    together: int


class Budget:
    """Rest of the effort of a search."""

    def __init__(self, steps: int = MAX_STEPS) -> None:
        self.steps = steps

    def spend(self) -> bool:
        """Take one step; return whether there was one left."""
        self.steps -= 1
        return self.steps >= 0


def find_meeting(parts: Iterable[Part], capacity: int, budget: Budget) -> tuple[Step, ...]:
    """Return parts that certainly meet at some instant and together take more than `capacity`; empty if none is found.

    Every pair is tried that can be enough, and larger sets greedily, so that some may be missed.
    """
    useful = [part for part in parts if part.length > 0]
    if sum(part.height for part in useful) <= capacity:
        return ()
    for pair in _pairs(useful, capacity):
        steps = meet(pair, budget)
        if steps:
            return steps
    longest = sorted(useful, key=lambda part: (-part.length, part.task))
    for order in (
        longest,
        sorted(longest, key=lambda part: (-part.length * 1000 // part.period, part.task)),
    ):
        for first in order[:MAX_SEEDS]:
            found = _grow(first, order, capacity, budget)
            if found:
                return found
    return ()


def meet(parts: Sequence[Part], budget: Budget) -> tuple[Step, ...]:
    """Return how all `parts` meet, one after the other; empty where that is not certain."""
    steps = [Step(parts[0], 0, parts[0].length)]
    period = parts[0].period
    for part in parts[1:]:
        step = _next(part, period, steps[-1].together) if budget.spend() else None
        if step is None:
            return ()
        steps.append(step)
        period = math.lcm(period, part.period)
    return tuple(steps)


def _next(part: Part, period: int, together: int) -> Step | None:
    """Let `part` meet an interval of length `together` that repeats with `period`."""
    common = math.gcd(part.period, period)
    over = part.length + together - common
    if over <= 0:
        return None
    return Step(part, common, min(part.length, together, over // 2))


def _pairs(parts: list[Part], capacity: int) -> Iterator[tuple[Part, Part]]:
    """Yield pairs whose heights are too much together, the longest of every two periods first."""
    by_period = grouped((part.period, part) for part in parts if 2 * part.height > capacity)
    tops = [sorted(same, key=lambda part: (-part.length, part.task))[:2] for same in by_period.values()]
    tops = sorted(tops, key=lambda top: (-top[0].length, top[0].task))[:64]
    for number, top in enumerate(tops):
        if len(top) == 2:
            yield top[0], top[1]
        for other in tops[number + 1 :]:
            yield top[0], other[0]


def _grow(first: Part, order: Sequence[Part], capacity: int, budget: Budget) -> tuple[Step, ...]:
    """Add every part that certainly meets those before it, until they take more than the capacity."""
    chosen, period, together, taken = [first], first.period, first.length, first.height
    for part in order:
        if part is first:
            continue
        if not budget.spend():
            return ()
        step = _next(part, period, together)
        if step is None:
            continue
        chosen.append(part)
        period, together, taken = math.lcm(period, part.period), step.together, taken + part.height
        if taken > capacity:
            return _without_surplus(chosen, capacity)
    return ()


def _without_surplus(parts: list[Part], capacity: int) -> tuple[Step, ...]:
    """Leave out what is not needed to pass the capacity."""
    budget = Budget(len(parts) ** 2)
    for part in list(parts):
        rest = [other for other in parts if other is not part]
        if rest and sum(other.height for other in rest) > capacity and meet(rest, budget):
            parts = rest
    return meet(parts, Budget(len(parts)))


# ------------------------------------------------------------------------------------------------ groups of tasks

MAX_UNITS = 16
"""Beyond so many units, groups that all meet are not looked for."""

MAX_HOLDERS = 8
"""Tasks that have a unit for themselves which are looked at, those that hold it longest first."""

EFFORT = 4_000
"""Pairs of groups compared for one mode."""


@record
class Group:
    """Parts that are all in force for `length`, again and again after `period`; made of two groups, or of one part."""

    parts: tuple[Part, ...]
    period: int
    length: int
    halves: tuple[Group, Group] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The tasks of the group."""
        return tuple(part.task for part in self.parts)

    @property
    def over(self) -> int:
        """By how much the lengths of the halves exceed the gcd of their periods."""
        assert self.halves is not None, "a single part has no halves"
        first, second = self.halves
        return first.length + second.length - math.gcd(first.period, second.period)


@record
class _Held:
    """Units that `holder` has for itself; `elsewhere` are tasks that might use them, which do not start meanwhile."""

    holder: TaskFacts | None = None
    units: frozenset[str] = frozenset()
    elsewhere: tuple[str, ...] = field(default=())
    wait: int = 0


def crowds(facts: ModeFacts) -> Iterator[Witness]:
    """Look for one group of tasks that is too large for the units of the mode."""
    tasks = [task for task in facts.tasks.values() if task.period]
    units = frozenset().union(*(task.units for task in tasks))
    if len(units) > MAX_UNITS:
        return
    budget = Budget(EFFORT)
    holders = sorted((t for t in tasks if t.sure_units()), key=lambda t: (-t.core, t.name))
    for holder in (None, *holders[:MAX_HOLDERS]):
        held, parts = _parts(tasks, units, holder)
        group = meet_in_groups(parts, budget) if parts else None
        if group is not None:
            yield _crowd(facts, sorted(units), held, group)
            return


def _parts(tasks: list[TaskFacts], units: frozenset[str], holder: TaskFacts | None) -> tuple[_Held, list[Part]]:
    """Return the busiest tasks that together need more than the units not held, and the holder; none if too few do.

    A job that would use a held unit while the holder runs cannot start. So of the holder only what is left after the
    longest of the others counts: jobs that run then have started meanwhile, on other units.
    """
    held = holder.sure_units() if holder is not None else frozenset()
    free = len(units) - len(held)
    others = [part for task in tasks if task is not holder and (part := _part(task, held)) is not None]
    others.sort(key=lambda part: (-Fraction(part.length, part.period), part.task))
    chosen: list[Part] = []
    while others and sum(part.height for part in chosen) <= free:
        chosen.append(others.pop(0))
    if sum(part.height for part in chosen) <= free:
        return _Held(), []
    if holder is None:
        return _Held(), chosen
    names = {part.task for part in chosen}
    moved = [task for task in tasks if task.name in names and task.units & held]
    wait = max((_least_elsewhere(task, held) for task in moved), default=0)
    about = _Held(holder, held, tuple(task.name for task in moved), wait)
    if holder.core <= wait:
        return about, []
    return about, [Part(holder.name, holder.period, holder.core - wait, len(held)), *chosen]


def _part(task: TaskFacts, held: frozenset[str]) -> Part | None:
    """Return what every job of a task runs on units that are not held; None where nothing is certain."""
    least = _least_elsewhere(task, held)
    if least <= task.late or any(version.pauses for version in task.versions):
        return None
    gang = min(v.version.gang for v in task.versions if len(v.units - held) >= v.version.gang)
    return Part(task.name, task.period, least - task.late, gang)


def _least_elsewhere(task: TaskFacts, held: frozenset[str]) -> int:
    """Return the least WCET on units that are not held; 0 where there is none."""
    return min((v.wcet for v in task.versions if len(v.units - held) >= v.version.gang), default=0)


# ------------------------------------------------------------------------------------------------ groups that meet


def meet_in_groups(parts: Sequence[Part], budget: Budget) -> Group | None:
    """Return how all parts meet at some instant; None where that is not certain, or was not found.

    Groups of which the period of one divides that of the other are formed first, from those that just so meet; then
    every order of joining them is tried.
    """
    groups = [Group((part,), part.period, part.length) for part in parts]
    while budget.spend():
        pairs = [
            joined
            for number, first in enumerate(groups)
            for second in groups[number + 1 :]
            if math.gcd(first.period, second.period) in (first.period, second.period)
            and (joined := join(first, second)) is not None
        ]
        if not pairs:
            break
        groups = _with(groups, min(pairs, key=lambda joined: (joined.over, joined.names)))
    return _any_order(groups, budget)


def join(first: Group, second: Group) -> Group | None:
    """Return what two groups, strictly periodic each, have in common; None where they need not meet."""
    over = first.length + second.length - math.gcd(first.period, second.period)
    length = min(first.length, second.length, over // 2)
    if length <= 0:
        return None
    return Group((*first.parts, *second.parts), math.lcm(first.period, second.period), length, (first, second))


def _any_order(groups: list[Group], budget: Budget) -> Group | None:
    if len(groups) == 1:
        return groups[0]
    for number, first in enumerate(groups):
        for second in groups[number + 1 :]:
            joined = join(first, second) if budget.spend() else None
            found = _any_order(_with(groups, joined), budget) if joined is not None else None
            if found is not None:
                return found
    return None


def _with(groups: list[Group], joined: Group) -> list[Group]:
    """Put a group in the place of its halves."""
    assert joined.halves is not None, "it was joined"
    return [group for group in groups if all(group is not half for half in joined.halves)] + [joined]


# ------------------------------------------------------------------------------------------------ words


def _crowd(facts: ModeFacts, units: list[str], held: _Held, group: Group) -> Witness:
    names = list(group.names)
    needed = sum(part.height for part in group.parts)
    text = f"{few(names, 20)} need {needed} units at the same time, whatever their phases, and have {len(units)}: "
    text += _without(facts, held) + "; ".join(_group_argument(facts, group))
    help = "necessary: 1 more unit, shorter WCETs, more slack or splits for some of them"
    found = codes.TASKS_MEET(text, at=place(facts.mode.mode), path=facts.mode.path, help=help)
    return Witness(found, tuple(names))


def _without(facts: ModeFacts, held: _Held) -> str:
    if held.holder is None or not held.elsewhere:
        return ""
    left, wait = facts.text(held.holder.core - held.wait), facts.text(held.wait)
    who, where = f'"{held.holder.name}"', few(sorted(held.units))
    return (
        f"while {who} has {where}, {few(list(held.elsewhere))} cannot start there, and whatever is in force {wait} "
        f"after its start has started meanwhile, elsewhere; {left} of it are left for that: "
    )


def _group_argument(facts: ModeFacts, group: Group) -> Iterator[str]:
    """Spell the sums out, groups before what is made of them."""
    if group.halves is None:
        return
    for half in group.halves:
        yield from _group_argument(facts, half)
    first, second = group.halves
    gcd = facts.text(math.gcd(first.period, second.period))
    periods = f"gcd({facts.text(first.period)}, {facts.text(second.period)})"
    yield (
        f"{_named(facts, first)} + {_named(facts, second)} > {gcd} = {periods}, "
        f"so that all of them are together for at least {facts.text(group.length)}"
    )


def _named(facts: ModeFacts, group: Group) -> str:
    return f"{facts.text(group.length)} of {few(list(group.names), 20)}"
