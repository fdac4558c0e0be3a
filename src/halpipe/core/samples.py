"""Order statistics of samples, exact."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Sequence
    from fractions import Fraction

T = TypeVar("T")


def quantile(ordered: Sequence[T], share: Fraction) -> T:
    """Return the smallest of at least one ordered sample that so large a share of all does not exceed."""
    return ordered[max(0, int(-(-len(ordered) * share // 1)) - 1)]
