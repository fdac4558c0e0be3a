"""How often to poll for sporadic arrivals: within their least distance, at a period that a person would write."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.durations import Duration, least_common_multiple

if TYPE_CHECKING:
    from collections.abc import Iterable

_MOST_TRIES = 10_000


def polling_period(distance: Duration, periods: Iterable[Duration]) -> Duration:
    """Return a period that serves arrivals `distance` apart and leaves the hyperperiod of `periods` as it is.

    At most three quarters of the distance, so that a quarter is left to run in: the largest such part of the
    hyperperiod with two significant digits, or else the largest part at all. Without other periods 1, 2 or 5 of a unit.
    """
    limit = distance * 3 / 4
    hyperperiod = least_common_multiple(periods)
    if not hyperperiod:
        return _round(limit)
    first = -(-hyperperiod // limit)
    tries = range(first, min(4 * first, first + _MOST_TRIES) + 1)
    return next((part for n in tries if _is_plain(part := hyperperiod / n)), hyperperiod / first)


def _is_plain(period: Duration) -> bool:
    return isinstance(period.ns, int) and len(str(period.ns).rstrip("0")) <= 2


def _round(limit: Duration) -> Duration:
    """Return the largest of 1, 2 and 5 nanoseconds times a power of ten up to a limit; the limit, if it is below."""
    power = 10 ** (len(str(int(limit.fraction))) - 1)
    fitting = [number * power for number in (1, 2, 5) if number * power <= limit.fraction]
    return Duration(max(fitting)) if fitting else limit
