"""Access phases on the line of time: what of each resource is taken, and when there is room again."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


class Claim(NamedTuple):
    """`height` quanta of `resource` on [begin, end)."""

    resource: int
    begin: int
    end: int
    height: int


class Resources:
    """The claims that may still matter, by resource; those that ended before all running parts are forgotten."""

    def __init__(self, capacity: Sequence[int]) -> None:
        self._capacity = capacity
        self._claims: list[list[Claim]] = [[] for _ in capacity]

    def collision(self, claims: Iterable[Claim]) -> int | None:
        """Return None if all `claims` fit, else an instant up to which one of them does not."""
        for claim in claims:
            until = self._first_free(claim)
            if until is not None:
                return until
        return None

    def _first_free(self, claim: Claim) -> int | None:
        room = self._capacity[claim.resource] - claim.height
        near = [c for c in self._claims[claim.resource] if c.begin < claim.end and claim.begin < c.end]
        for instant in sorted({max(claim.begin, other.begin) for other in near}):
            if sum(c.height for c in near if c.begin <= instant < c.end) > room:
                return min(c.end for c in near if c.begin <= instant < c.end)
        return None

    def take(self, claims: Iterable[Claim]) -> None:
        """Take what `claims` ask for."""
        for claim in claims:
            self._claims[claim.resource].append(claim)

    def give_back(self, claims: Iterable[Claim]) -> None:
        """Give back what was taken and is not needed now."""
        for claim in list(claims):
            self._claims[claim.resource].remove(claim)

    def forget(self, before: int) -> None:
        """Forget what ended at or before an instant."""
        for claims in self._claims:
            if len(claims) > 64:
                claims[:] = [claim for claim in claims if claim.end > before]

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
