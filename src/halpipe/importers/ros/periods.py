"""Periods that were measured or typed with a slip, brought back to the ones that were meant.

Taken literally, timers of 19999999 ns and 100001000 ns have a hyperperiod of 23 days. A period is moved to the first
grid below that has a value within tolerance, from coarse to fine. All values are exact: a 30 Hz source is 1/30 s.
"""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import Duration, milliseconds, seconds
from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Iterator

_SECOND = seconds(1)
_USUAL_RATES = (1, 2, 4, 5, 8, 10, 12, 15, 16, 20, 24, 25, 30, 40, 50, 60, 75, 80, 90, 100, 120, 125, 150, 200, 240)
_FAST_RATES = (250, 400, 500, 800, 1000)
_MILLISECOND_GRIDS = tuple(milliseconds(step) for step in (100, 10, 1))
_FINE_GRIDS = tuple(Duration(step) for step in (100_000, 10_000, 1_000))


@record
class Tolerance:
    """How far a period may be moved: a share of it, or an absolute amount (at most 1/1000 of it) if that is more."""

    relative: Fraction
    absolute: Duration
    rates_first: bool

    def of(self, period: Duration) -> Duration:
        """Return the largest deviation allowed for `period`."""
        return max(period * self.relative, min(self.absolute, period / 1000))


STATED = Tolerance(Fraction(1, 10_000), Duration(1_000), rates_first=False)
"""For timers and deadlines, whose values come from a clock: jitter only."""

MEASURED = Tolerance(Fraction(1, 50), Duration(0), rates_first=True)
"""For rates counted in a recording, where messages get lost and the ends are ragged."""


def snap(period: Duration, tolerance: Tolerance) -> Duration:
    """Return the roundest period within `tolerance` of `period`, or `period` itself; it may be 0 or less."""
    if period <= Duration(0):
        return period
    limit = tolerance.of(period)
    for candidate in _candidates(period, tolerance.rates_first):
        deviation = candidate - period if candidate > period else period - candidate
        if deviation <= limit:
            return candidate
    return period


def _candidates(period: Duration, rates_first: bool) -> Iterator[Duration]:
    if rates_first:
        usual = (_SECOND / rate for rate in _USUAL_RATES + _FAST_RATES)
        yield min(usual, key=lambda rate: abs((rate - period).fraction))
        yield _nearest_multiple(period, _SECOND)
    yield from (_nearest_multiple(period, grid) for grid in _MILLISECOND_GRIDS)
    rate = round(_SECOND / period)
    if 1 <= rate <= 1000:
        yield _SECOND / rate
    yield from (_nearest_multiple(period, grid) for grid in _FINE_GRIDS)


def _nearest_multiple(period: Duration, grid: Duration) -> Duration:
    return grid * max(1, round(period / grid))
