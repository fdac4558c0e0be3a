"""Witnesses about many tasks that certainly all run at one instant, more of them than there are units.

`meeting.py` lets one part after the other meet those before it. Here they meet in groups first, which finds more: the
tasks of one rate, then groups with each other. And where a task certainly has a unit for itself, the others that might
have used that unit do without it in the meantime, whatever versions they have for it.
"""

from __future__ import annotations

import math
from dataclasses import field
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.pipeline.explain import codes
from halpipe.pipeline.explain.pairs_meet import Budget, Part
from halpipe.pipeline.explain.sharing import Witness
from halpipe.pipeline.validate.context import place, quoted

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.pipeline.explain.facts import ModeFacts, TaskFacts

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
    holders = sorted((t for t in tasks if t.sure_units() and t.core > 0), key=lambda t: (-t.core, t.name))
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
    wait = max((_elsewhere(task, held) for task in moved), default=0)
    about = _Held(holder, held, tuple(task.name for task in moved), wait)
    if holder.core <= wait:
        return about, []
    return about, [Part(holder.name, holder.period, holder.core - wait, len(held)), *chosen]


def _part(task: TaskFacts, held: frozenset[str]) -> Part | None:
    """Return what every job of a task runs on units that are not held; None where nothing is certain."""
    least = _elsewhere(task, held)
    if least <= task.late or any(version.pauses for version in task.versions):
        return None
    gang = min(v.version.gang for v in task.versions if len(v.units - held) >= v.version.gang)
    return Part(task.name, task.period, least - task.late, gang)


def _elsewhere(task: TaskFacts, held: frozenset[str]) -> int:
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
    text = f"{quoted(names, 20)} need {needed} units at the same time, whatever their phases, and have {len(units)}: "
    text += _without(facts, held) + "; ".join(_argument(facts, group))
    help = "necessary: 1 more unit, shorter WCETs, more slack or splits for some of them"
    found = codes.TASKS_MEET(text, at=place(facts.mode.mode), path=facts.mode.path, help=help)
    return Witness(found, tuple(names))


def _without(facts: ModeFacts, held: _Held) -> str:
    if held.holder is None or not held.elsewhere:
        return ""
    left, wait = facts.text(held.holder.core - held.wait), facts.text(held.wait)
    who, where = f'"{held.holder.name}"', quoted(sorted(held.units))
    return (
        f"while {who} has {where}, {quoted(list(held.elsewhere))} cannot start there, and whatever is in force {wait} "
        f"after its start has started meanwhile, elsewhere; {left} of it are left for that: "
    )


def _argument(facts: ModeFacts, group: Group) -> Iterator[str]:
    """Spell the sums out, groups before what is made of them."""
    if group.halves is None:
        return
    for half in group.halves:
        yield from _argument(facts, half)
    first, second = group.halves
    gcd = facts.text(math.gcd(first.period, second.period))
    periods = f"gcd({facts.text(first.period)}, {facts.text(second.period)})"
    yield (
        f"{_named(facts, first)} + {_named(facts, second)} > {gcd} = {periods}, "
        f"so that all of them are together for at least {facts.text(group.length)}"
    )


def _named(facts: ModeFacts, group: Group) -> str:
    return f"{facts.text(group.length)} of {quoted(list(group.names), 20)}"
