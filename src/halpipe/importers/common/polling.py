"""Polling periods for sporadic arrivals: at most the minimum inter-arrival time, and a round number."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.durations import Duration, least_common_multiple

if TYPE_CHECKING:
    from collections.abc import Iterable

_MOST_TRIES = 10_000


def polling_period(distance: Duration, periods: Iterable[Duration]) -> Duration:
    """Return a period that serves arrivals `distance` apart and leaves the hyperperiod of `periods` as it is.

    At most four fifths of the distance, so that a fifth is left to run in: the largest such part of the
    hyperperiod with two significant digits, or else the largest part at all. Without other periods its first digit.
    """
    limit = distance * 4 / 5
    hyperperiod = least_common_multiple(periods)
    if not hyperperiod:
        return _round(limit)
    first = -(-hyperperiod // limit)
    tries = range(first, min(4 * first, first + _MOST_TRIES) + 1)
    return next((part for n in tries if _is_plain(part := hyperperiod / n)), hyperperiod / first)


def _is_plain(period: Duration) -> bool:
    return isinstance(period.ns, int) and len(str(period.ns).rstrip("0")) <= 2


def _round(limit: Duration) -> Duration:
    """Return a limit with its first digit only; as it is, if it is below a nanosecond."""
    power = 10 ** (len(str(int(limit.fraction))) - 1)
    return Duration(int(limit.fraction) // power * power) if limit >= Duration(1) else limit
