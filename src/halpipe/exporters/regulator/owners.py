"""Exclusive properties of units, such as a bus port: the present owner, and the nearest free value."""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

T = TypeVar("T", int, str)


class Free(Generic[T]):
    """Free numbers: `taken` has an owner; `near` yields the others, from the nearest to one on."""

    def __init__(self, taken: Iterable[T], near: Callable[[T], Iterator[T]]) -> None:
        self._taken: set[T] = set(taken)
        self._near: Callable[[T], Iterator[T]] = near
        self._tried: dict[T, Iterator[T]] = {}

    def nearest(self, owned: T) -> T | None:
        """Return what is free and nearest to `owned`, a different one each time; None if nothing is left."""
        for other in self._tried.setdefault(owned, self._near(owned)):
            if other not in self._taken:
                self._taken.add(other)
                return other
        return None

    def help(self, what: str, owned: T) -> str:
        """Return what a unit should do that states `owned` as its `what`, which another unit has."""
        other = self.nearest(owned)
        merge = f"model what shares a {what} as one unit"
        if other is None:
            return f"{merge}; no {what} is free"
        return f'state "{what}: {other}", the nearest that is free, or {merge}'


def outward(choices: Sequence[T]) -> Callable[[T], Iterator[T]]:
    """Return what yields `choices` by their distance from one of them, of two the earlier first."""

    def near(owned: T) -> Iterator[T]:
        place = choices.index(owned) if owned in choices else len(choices)
        for distance in range(1, len(choices) + 1):
            yield from (choices[n] for n in (place - distance, place + distance) if 0 <= n < len(choices))

    return near
