"""Instants that repeat with the hyperperiod, and time reserved for execution among interrupts, in whole ticks."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.pipeline.verify.tables import Placed

    Found: TypeAlias = tuple[int, Placed] | None


class Listed:
    """Finitely many instants."""

    def __init__(self, points: Sequence[tuple[int, Placed]]) -> None:
        ordered = sorted(points, key=lambda pair: pair[0])
        self._instants = [x for x, _ in ordered]
        self._owners = [p for _, p in ordered]

    def latest(self, until: int) -> Found:
        """Return the last instant at or before `until`, with its job."""
        place = bisect_right(self._instants, until) - 1
        return (self._instants[place], self._owners[place]) if place >= 0 else None

    def earliest(self, since: int) -> Found:
        """Return the first instant at or after `since`, with its job."""
        place = bisect_left(self._instants, since)
        return (self._instants[place], self._owners[place]) if place < len(self._instants) else None


class Recurring:
    """The instants x + q * period for every given x and every integer q.

    Of equal instants the one given first counts as the earlier.
    """

    def __init__(self, points: Sequence[tuple[int, Placed]], period: int) -> None:
        self.points = points
        self.period = period
        self._turn = Listed([(x % period, p) for x, p in points])

    def latest(self, until: int) -> Found:
        """Return the last instant at or before `until`, with its job; None if there is none at all."""
        turn, rest = divmod(until, self.period)
        found = self._turn.latest(rest)
        if found is None:
            turn, found = turn - 1, self._turn.latest(self.period)
        return (turn * self.period + found[0], found[1]) if found else None

    def earliest(self, since: int) -> Found:
        """Return the first instant at or after `since`, with its job; None if there is none at all."""
        turn, rest = divmod(since, self.period)
        found = self._turn.earliest(rest)
        if found is None:
            turn, found = turn + 1, self._turn.earliest(0)
        return (turn * self.period + found[0], found[1]) if found else None


# A job longer than its hyperperiod overlaps itself, so its table is invalid whatever a search finds further off.
_TURNS = 4


class Past:
    """The instants of a mode that ended at time 0: of `cycle`, which has some, only those of q <= -1."""

    def __init__(self, cycle: Recurring) -> None:
        self._cycle = cycle
        self._first = min(x for x, _ in cycle.points)
        floor = self._first - cycle.period
        moved = ((x + q * cycle.period, p) for q in range(-_TURNS, 0) for x, p in cycle.points)
        self._last = Listed([(x, p) for x, p in moved if x >= floor])

    def latest(self, until: int) -> Found:
        """Return the last instant at or before `until`."""
        # before the first instant of cycle 0, an instant of any q <= 0 that is early enough has q <= -1
        return self._cycle.latest(until) if until < self._first else self._last.latest(until)

    def earliest(self, since: int) -> Found:
        """Return the first instant at or after `since`."""
        found = self._cycle.earliest(since)
        return found if found is not None and found[0] < self._first else self._last.earliest(since)


class Future:
    """The instants of a mode that begins at time `origin`: of `cycle`, which has some, only those of q >= 0."""

    def __init__(self, cycle: Recurring, origin: int) -> None:
        self._cycle = cycle
        self._origin = origin
        self._settled = max(x for x, _ in cycle.points)
        moved = ((x + q * cycle.period, p) for q in range(_TURNS) for x, p in cycle.points)
        self._first = Listed([(x, p) for x, p in moved if x <= self._settled])

    def latest(self, until: int) -> Found:
        """Return the last instant at or before `until`."""
        until -= self._origin
        found = (self._cycle if until >= self._settled else self._first).latest(until)
        return (found[0] + self._origin, found[1]) if found else None

    def earliest(self, since: int) -> Found:
        """Return the first instant at or after `since`."""
        since -= self._origin
        # instants of q < 0 lie a whole cycle before the last of cycle 0
        found = (self._cycle if since > self._settled - self._cycle.period else self._first).earliest(since)
        return (found[0] + self._origin, found[1]) if found else None


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
