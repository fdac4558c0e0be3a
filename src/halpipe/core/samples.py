"""Order statistics of samples, and WCETs by one formula for every recording; exact."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeVar

from halpipe.core.durations import Duration
from halpipe.core.quantities import parse_share, quoted

if TYPE_CHECKING:
    from fractions import Fraction

    from _typeshed import SupportsLenAndGetItem

T = TypeVar("T")


def quantile(ordered: SupportsLenAndGetItem[T], share: Fraction) -> T:
    """Return the smallest of at least one ordered sample that so large a share of all does not exceed."""
    return ordered[max(0, int(-(-len(ordered) * share // 1)) - 1)]


def with_margin(sample: int | Fraction, margin: Fraction) -> Duration:
    """Return a WCET from the nanoseconds of a sample: a share more, rounded up to whole nanoseconds."""
    return Duration(math.ceil(sample * (1 + margin)))


def quantile_of(text: str) -> Fraction:
    """Read a quantile, above 0 and up to 1."""
    value = parse_share(text)
    if not 0 < value <= 1:
        raise ValueError(f"{quoted(text)} is no quantile; write a number above 0, up to 1")
    return value
