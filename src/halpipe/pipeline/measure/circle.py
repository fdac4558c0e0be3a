"""Sums of intervals on the circle [0, period): the sweep behind loads and costs."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import TYPE_CHECKING, NamedTuple

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


class Interval(NamedTuple):
    """`height` in force on [start, start + length) of the circle; a length beyond the period covers it repeatedly."""

    start: int
    length: int
    height: int


class Step(NamedTuple):
    """The sum of all heights on [begin, end)."""

    begin: int
    end: int
    level: int


def sweep(intervals: Iterable[Interval], period: int) -> list[Step]:
    """Return the sum of `intervals` as steps that cover [0, period) in order."""
    changes: dict[int, int] = {0: 0}
    for start, length, height in intervals:
        rounds, rest = divmod(length, period)
        begin, end = start % period, start % period + rest
        changes[0] += height * rounds
        changes[begin] = changes.get(begin, 0) + height
        if end > period:
            changes[0] += height
            end -= period
        changes[end] = changes.get(end, 0) - height
    times = sorted(time for time in changes if time < period)
    level = 0
    steps = []
    for begin, end in zip(times, [*times[1:], period], strict=True):
        level += changes[begin]
        steps.append(Step(begin, end, level))
    return steps


@record
class Instants:
    """Recurring instants on the circle, for the search of the next or the last one before an absolute time."""

    times: tuple[int, ...]
    labels: tuple[int, ...]
    period: int

    @classmethod
    def of(cls, instants: Iterable[tuple[int, int]], period: int) -> Instants:
        """Build from (time, label) pairs; times are taken modulo the period."""
        ordered = sorted((time % period, label) for time, label in instants)
        return cls(tuple(time for time, _ in ordered), tuple(label for _, label in ordered), period)

    def at_or_after(self, time: int) -> tuple[int, int]:
        """Return the first instant at or after `time`, absolute, and its label."""
        rounds, rest = divmod(time, self.period)
        index = bisect_left(self.times, rest)
        if index == len(self.times):
            rounds, index = rounds + 1, 0
        return rounds * self.period + self.times[index], self.labels[index]

    def at_or_before(self, time: int) -> tuple[int, int]:
        """Return the last instant at or before `time`, absolute, and its label."""
        rounds, rest = divmod(time, self.period)
        index = bisect_right(self.times, rest) - 1
        if index < 0:
            rounds, index = rounds - 1, len(self.times) - 1
        return rounds * self.period + self.times[index], self.labels[index]

    def __iter__(self) -> Iterator[tuple[int, int]]:
        return iter(zip(self.times, self.labels, strict=True))
