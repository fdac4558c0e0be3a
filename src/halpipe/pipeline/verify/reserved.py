"""The time reserved for execution on units that serve interrupts (MODEL 8.2), in ticks.

Written from the specification alone, with nothing of what the search or the exporters use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

MAX_STEPS = 100_000
"""Steps towards a reserved length; interrupts that need more take all but a sliver of the unit."""


MAX_EFFORT = 5_000_000
"""Steps for all lengths of one check together, so that no file keeps it busy for hours."""

FEW_STEPS = 1000
"""Steps that a length may take even then; interrupts of 99 % of a unit need fewer."""


class Effort:
    """The steps that are left for the lengths of one check."""

    def __init__(self) -> None:
        self.left = MAX_EFFORT


class Service:
    """The interrupts of a set of units, together: pairs of distance T and time c, in ticks."""

    def __init__(self, interrupts: Iterable[tuple[int, int]] = (), effort: Effort | None = None) -> None:
        self._effort = effort or Effort()
        self.interrupts = tuple((distance, time) for distance, time in interrupts if time)
        self._known: dict[int, int | None] = {}
        self.is_full = False
        """Whether a length was asked for that does not exist."""

    def length(self, work: int) -> int | None:
        """Return L(x) for `work` x, the least L with L = x + sum ceil(L/T) c; None where there is none.

        No work takes no time. A length that is not reached within `MAX_STEPS`, or the effort left, counts as none.
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
        most = min(MAX_STEPS, max(self._effort.left, FEW_STEPS))
        for step in range(most):
            longer = work + sum(-(-length // distance) * time for distance, time in self.interrupts)
            if longer == length:
                self._effort.left -= step
                return length
            length = longer
        self._effort.left -= most
        return None


UNDISTURBED = Service()


class Platform:
    """The interrupts of every unit of a model, in ticks, by name."""

    def __init__(self, interrupts: dict[str, tuple[tuple[int, int], ...]]) -> None:
        self._interrupts = interrupts
        self._services: dict[tuple[str, ...], Service] = {}
        self._effort = Effort()

    def service(self, units: tuple[str, ...]) -> Service:
        """Return the interrupts of all of `units`: the members of a gang wait for each other."""
        if not self._interrupts:
            return UNDISTURBED
        if units not in self._services:
            rows = [row for unit in dict.fromkeys(units) for row in self._interrupts.get(unit, ())]
            self._services[units] = Service(rows, self._effort) if rows else UNDISTURBED
        return self._services[units]
