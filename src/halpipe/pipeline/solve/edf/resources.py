"""Access phases on the line of time: what of each resource is taken."""

from __future__ import annotations

from typing import NamedTuple


class Claim(NamedTuple):
    """`height` quanta of `resource` on [begin, end)."""

    resource: int
    begin: int
    end: int
    height: int

    def moved(self, by: int) -> Claim:
        """Return the claim `by` ticks later."""
        return self._replace(begin=self.begin + by, end=self.end + by)
