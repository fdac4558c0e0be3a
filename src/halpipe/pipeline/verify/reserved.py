"""The time reserved for execution on units that serve interrupts (MODEL 8.2), in ticks.

Written from the specification alone, with nothing of what the search or the exporters use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

MAX_STEPS = 100_000
"""Steps towards a reserved length; interrupts that need more take all but a sliver of the unit."""


class Service:
    """The interrupts of a set of units, together: pairs of distance T and time c, in ticks."""

    def __init__(self, interrupts: Iterable[tuple[int, int]] = ()) -> None:
        self.interrupts = tuple((distance, time) for distance, time in interrupts if time)
        self._known: dict[int, int | None] = {}
        self.is_full = False
        """Whether a length was asked for that does not exist."""

    def length(self, work: int) -> int | None:
        """Return L(x) for `work` x, the least L with L = x + sum ceil(L/T) c; None where there is none.

        No work takes no time. A length that is not reached within `MAX_STEPS` counts as none.
        """
        if not self.interrupts or work <= 0:
            return work
        if self.is_full:
            return None
        if work not in self._known:
            self._known[work] = self._least(work)
            self.is_full = self._known[work] is None
        return self._known[work]

    def _least(self, work: int) -> int | None:
        whole, taken = 1, 0  # sum of c/T = taken / whole
        for distance, time in self.interrupts:
            whole, taken = whole * distance, taken * distance + time * whole
        if taken >= whole:
            return None
        length = work * whole // (whole - taken)  # no solution lies below x / (1 - sum c/T)
        for _ in range(MAX_STEPS):
            longer = work + sum(-(-length // distance) * time for distance, time in self.interrupts)
            if longer == length:
                return length
            length = longer
        return None


UNDISTURBED = Service()


class Platform:
    """The interrupts of every unit of a model, in ticks, by name."""

    def __init__(self, interrupts: dict[str, tuple[tuple[int, int], ...]]) -> None:
        self._interrupts = interrupts
        self._services: dict[tuple[str, ...], Service] = {}

    def service(self, units: tuple[str, ...]) -> Service:
        """Return the interrupts of all of `units`: the members of a gang wait for each other."""
        if not self._interrupts:
            return UNDISTURBED
        if units not in self._services:
            rows = [row for unit in dict.fromkeys(units) for row in self._interrupts.get(unit, ())]
            self._services[units] = Service(rows) if rows else UNDISTURBED
        return self._services[units]
