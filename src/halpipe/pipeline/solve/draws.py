"""Pseudo-random numbers of the searches that are written in Python; the kernel has its own."""

from __future__ import annotations


class Draws:
    """Pseudo-random numbers, the same everywhere (splitmix64)."""

    def __init__(self, seed: int) -> None:
        self._state = seed % 2**64

    @property
    def state(self) -> int:
        """All that the next numbers depend on."""
        return self._state

    def below(self, limit: int) -> int:
        """Return a number in [0, limit)."""
        self._state = (self._state + 0x9E3779B97F4A7C15) % 2**64
        word = self._state
        word = (word ^ (word >> 30)) * 0xBF58476D1CE4E5B9 % 2**64
        word = (word ^ (word >> 27)) * 0x94D049BB133111EB % 2**64
        return (word ^ (word >> 31)) % limit
