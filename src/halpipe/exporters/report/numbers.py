"""Exact values as text for a page: shares as per cent, positions as short decimals. No floating point."""

from __future__ import annotations

from fractions import Fraction

from halpipe.core.quantities import format_rational


def decimal(value: Fraction, digits: int) -> str:
    """Return `value` rounded to `digits` decimals, without trailing zeros."""
    scale = 10**digits
    return format_rational(Fraction(round(value * scale), scale))


def approximate(value: Fraction, digits: int = 4) -> str:
    """Return `value` exactly where `digits` decimals suffice, else rounded and marked ``≈``."""
    text = decimal(value, digits)
    return text if Fraction(text) == value else f"≈ {text}"


def percent(share: Fraction) -> str:
    """Return a share as per cent with one decimal."""
    return decimal(share * 100, 1) + "%"


def position(offset: int | Fraction, span: int | Fraction) -> Fraction:
    """Return the place of `offset` within `span` in per cent, on the grid that charts print (1e-4)."""
    return Fraction(round(Fraction(offset) * 10**6 / span), 10**4)
