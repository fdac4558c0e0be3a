"""Witnesses about tasks that each stay on one unit: no assignment of them keeps every unit at most full.

Every assignment is tried, with bounds, up to an effort; of equal units only one is. Two strictly periodic tasks whose
jobs must meet share no unit. What is left out of the set that is named makes it assignable.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.models import Binding
from halpipe.pipeline.explain import codes
from halpipe.pipeline.explain.pairs_meet import Budget
from halpipe.pipeline.explain.sharing import Witness
from halpipe.pipeline.validate.context import place, quoted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.pipeline.explain.facts import ModeFacts, TaskFacts

MAX_ITEMS = 32
"""Tasks that are looked at, those with the largest loads."""

EFFORT = 20_000
"""Units tried for tasks in one search."""


@record
class _Item:
    """A task that keeps to one of some units; its jobs take `load` of it, `core` of every `period` at one time."""

    task: TaskFacts
    load: Fraction
    units: tuple[str, ...]

    def excludes(self, other: _Item) -> bool:
        """Return whether the jobs of two tasks must meet if they are on one unit."""
        gcd = math.gcd(self.task.period, other.task.period)
        return self.task.core > 0 and other.task.core > 0 and self.task.core + other.task.core > gcd


def packings(facts: ModeFacts) -> Iterator[Witness]:
    """Look for a set of tasks that cannot be assigned to their units."""
    items = sorted(_items(facts), key=lambda item: (-item.load, item.task.name))[:MAX_ITEMS]
    if not _is_impossible(items):
        return
    for item in reversed(items.copy()):
        rest = [other for other in items if other is not item]
        if _is_impossible(rest):
            items = rest
    if len(items) > 2:  # two tasks and single units have witnesses of their own
        yield _witness(facts, items)


def _items(facts: ModeFacts) -> Iterator[_Item]:
    for task in facts.tasks.values():
        is_single = all(version.version.gang == 1 for version in task.versions)
        if task.period and is_single and (task.task.binding is not Binding.JOB or len(task.units) == 1):
            yield _Item(task, Fraction(task.least, task.period), tuple(sorted(task.units)))


def _is_impossible(items: list[_Item]) -> bool:
    """Return whether no assignment exists; False where the effort was spent."""
    budget = Budget(EFFORT)
    held: dict[str, list[_Item]] = {unit: [] for item in items for unit in item.units}
    users = {unit: frozenset(item.task.name for item in items if unit in item.units) for unit in held}
    return not _assign(items, 0, held, users, budget) and budget.steps >= 0


def _assign(
    items: list[_Item],
    number: int,
    held: dict[str, list[_Item]],
    users: dict[str, frozenset[str]],
    budget: Budget,
) -> bool:
    """Assign the items from `number` on; True also where the effort is spent, since nothing is known then."""
    if number == len(items):
        return True
    item, empty = items[number], set()
    for unit in item.units:
        others = held[unit]
        if not others and users[unit] in empty:
            continue
        empty |= set() if others else {users[unit]}
        if sum((other.load for other in others), item.load) > 1 or any(item.excludes(other) for other in others):
            continue
        if not budget.spend():
            return True
        others.append(item)
        if _assign(items, number + 1, held, users, budget):
            return True
        others.pop()
    return False


def _witness(facts: ModeFacts, items: list[_Item]) -> Witness:
    names = [item.task.name for item in items]
    units = sorted({unit for item in items for unit in item.units})
    takes = ", ".join(
        f'"{item.task.name}" takes {facts.text(item.task.least)} of every {facts.text(item.task.period)}'
        for item in items
    )
    text = (
        f"{takes}; each stays on one of its units, and no assignment to {quoted(units)} keeps every unit at most full"
    )
    pairs = sum(one.excludes(other) for at, one in enumerate(items) for other in items[at + 1 :])
    if pairs:
        text += f" ({pairs} pairs share no unit: their times exceed the gcd of their periods)"
    help = "necessary: another unit, shorter WCETs, or a binding by job for some of them"
    found = codes.NO_ASSIGNMENT(text, at=place(facts.mode.mode), path=facts.mode.path, help=help)
    return Witness(found, tuple(names))
