"""Arrays and tables of 64-bit integers, and pseudo-random numbers of the searches written in Python."""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    Ints = array[int]
    from collections.abc import Iterable, Iterator, Sequence


Row = tuple[int, ...]


def ints(values: Iterable[int] = ()) -> Ints:
    """Return an array of values; raise `OverflowError` for one that has more than 64 bits."""
    return array("q", values)


def filled(length: int, value: int = 0) -> Ints:
    """Return an array of equal values."""
    return array("q", (value,)) * length


class Table:
    """Rows of equal length, one after the other in `flat`."""

    __slots__ = ("flat", "width")

    def __init__(self, flat: Ints, width: int) -> None:
        self.flat = flat
        self.width = width

    @classmethod
    def of(cls, rows: Iterable[Sequence[int]], width: int) -> Table:
        """Return a table of rows, each of which has as many values as the table is wide."""
        return cls(ints(value for row in rows for value in row), width)

    def copy(self) -> Table:
        """Return a table of its own with the same values."""
        return Table(self.flat[:], self.width)

    def __len__(self) -> int:
        return len(self.flat) // self.width

    def __iter__(self) -> Iterator[Row]:
        return self.rows(0, len(self))

    def rows(self, begin: int, end: int) -> Iterator[Row]:
        """Yield the rows from `begin` up to `end`."""
        return (tuple(self.flat[place : place + self.width]) for place in self._places(begin, end))

    def column(self, number: int) -> Ints:
        """Return one value of each row."""
        return self.flat[number :: self.width]

    def _places(self, begin: int, end: int) -> range:
        return range(begin * self.width, end * self.width, self.width)

    def __getitem__(self, place: tuple[int, int]) -> int:
        row, column = place
        return self.flat[row * self.width + column]

    def __setitem__(self, place: tuple[int, int], value: int) -> None:
        row, column = place
        self.flat[row * self.width + column] = value


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
