"""Parts of strictly periodic tasks that meet whatever the phases are: the argument from greatest common divisors.

Two parts that repeat with D1 and D2 are seen from each other at every multiple of g = gcd(D1, D2) from some first
distance. If their lengths sum to more than g, they meet; they are together for at least (c1 + c2 - g) / 2 at some time,
which repeats with lcm(D1, D2), and further parts meet that in the same way. All lengths are integers, halves are cut.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from fractions import Fraction

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
    """How one more part meets those before it: they are together for `together`, again after a multiple of `gcd`."""

    part: Part
    gcd: int
    together: int


class Budget:
    """What is left of the effort of a search."""

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
    useful = [part for part in parts if part.length > 0 and part.period > 0]
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
    by_period: dict[int, list[Part]] = {}
    for part in parts:
        if 2 * part.height > capacity:
            by_period.setdefault(part.period, []).append(part)
    tops = [sorted(same, key=lambda part: (-part.length, part.task))[:2] for same in by_period.values()]
    tops = sorted(tops, key=lambda top: (-top[0].length, top[0].task))[:64]
    for place, top in enumerate(tops):
        if len(top) == 2:
            yield top[0], top[1]
        for other in tops[place + 1 :]:
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
    budget = Budget(len(parts) ** 2 + len(parts))
    for part in list(parts):
        rest = [other for other in parts if other is not part]
        if rest and sum(other.height for other in rest) > capacity and meet(rest, budget):
            parts = rest
    return meet(parts, Budget(len(parts)))
