"""Access phases on the line of time: what of each resource is taken, and when there is room again."""

from __future__ import annotations

from bisect import bisect_left
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence


FEW = 64
"""Claims of a resource that are remembered before any are forgotten."""


class Claim(NamedTuple):
    """`height` quanta of `resource` on [begin, end)."""

    resource: int
    begin: int
    end: int
    height: int

    def moved(self, by: int) -> Claim:
        """Return the claim `by` ticks later."""
        return self._replace(begin=self.begin + by, end=self.end + by)


class Resources:
    """The claims that may still matter, by resource; those that ended before all running parts are forgotten."""

    def __init__(self, capacity: Sequence[int], standing: Iterable[Claim] = (), cycle: int = 1) -> None:
        """Begin with `standing` claims, which come again with every `cycle`."""
        self._capacity = capacity
        self._claims: list[list[Claim]] = [[] for _ in capacity]
        self._most = [FEW] * len(capacity)
        self._standing: list[list[Claim]] = [[] for _ in capacity]
        self._cycle = cycle
        for claim in standing:
            turn = claim.begin // cycle * cycle
            self._standing[claim.resource].append(claim.moved(-turn))
        for claims in self._standing:
            claims.sort(key=lambda claim: claim.begin)
        self._longest = [max((c.end - c.begin for c in claims), default=0) for claims in self._standing]

    def collision(self, claims: Iterable[Claim]) -> int | None:
        """Return None if all `claims` fit, also beside each other, else an instant up to which one of them does not.

        Those of one piece may lie over each other where interrupts stretch its phases.
        """
        before: list[Claim] = []
        for claim in claims:
            until = self._first_free(claim, before)
            if until is not None:
                return until
            before.append(claim)
        return None

    def _first_free(self, claim: Claim, others: Iterable[Claim]) -> int | None:
        room = self._capacity[claim.resource] - claim.height
        taken = (*self._claims[claim.resource], *(c for c in others if c.resource == claim.resource))
        near = [c for c in taken if c.begin < claim.end and claim.begin < c.end]
        near += self._standing_near(claim)
        for instant in sorted({max(claim.begin, other.begin) for other in near}):
            if sum(c.height for c in near if c.begin <= instant < c.end) > room:
                return min(c.end for c in near if c.begin <= instant < c.end)
        return None

    def _standing_near(self, claim: Claim) -> Iterator[Claim]:
        """Yield those that stay as they lie around `claim`."""
        standing = self._standing[claim.resource]
        earliest = claim.begin - self._longest[claim.resource]
        for turn in range(earliest // self._cycle, claim.end // self._cycle + 1) if standing else ():
            shift = turn * self._cycle
            for place in range(bisect_left(standing, earliest - shift, key=lambda c: c.begin), len(standing)):
                other = standing[place].moved(shift)
                if other.begin >= claim.end:
                    break
                if claim.begin < other.end:
                    yield other

    def take(self, claims: Iterable[Claim]) -> None:
        """Take what `claims` ask for."""
        for claim in claims:
            self._claims[claim.resource].append(claim)

    def give_back(self, claims: Iterable[Claim]) -> None:
        """Give back what was taken and is not needed now."""
        for claim in list(claims):
            self._claims[claim.resource].remove(claim)

    def is_crowded(self) -> bool:
        """Return whether so many claims are remembered that it is time to forget some."""
        return any(len(claims) > most for claims, most in zip(self._claims, self._most, strict=True))

    def forget(self, before: int) -> None:
        """Forget what ended at or before an instant."""
        for number, claims in enumerate(self._claims):
            claims[:] = [claim for claim in claims if claim.end > before]
            self._most[number] = max(FEW, 2 * len(claims))

    def in_force(self, since: int) -> tuple[Claim, ...]:
        """Return the claims that end after an instant, relative to it."""
        return tuple(
            sorted(
                Claim(c.resource, c.begin - since, c.end - since, c.height)
                for claims in self._claims
                for c in claims
                if c.end > since
            )
        )
