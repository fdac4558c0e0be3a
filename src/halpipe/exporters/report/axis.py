"""Time axis and numbers of static pictures; exact, and rounded only where they are printed."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import Duration
from halpipe.core.quantities import format_rational
from halpipe.core.records import record

if TYPE_CHECKING:
    from halpipe.exporters.common.timeline import Window

MAX_TICKS = 10
# How near (per cent of the width) to either end of the axis no inner label may stand.
_MARGIN = 7


@record
class Tick:
    """A mark at `x` per cent; `anchor` is how its text hangs on the mark."""

    x: Fraction
    text: str
    anchor: str = "middle"


def ticks(window: Window) -> list[Tick]:
    """Return the marks of the axis over `window`: round ones, and both ends."""
    unit = next((unit for unit in ("s", "ms", "us") if window.length.in_unit(unit) >= 2), "ns")
    step = _coarse_step(window.length)
    first, last = -(-window.start.fraction // step), -(-window.end.fraction // step)
    marks = [
        (position(number * step - window.start.ns, window.length.ns), number * step) for number in range(first, last)
    ]
    return [
        Tick(Fraction(0), _text(window.start, unit), "start"),
        *(Tick(x, _text(Duration(at), unit)) for x, at in marks if _MARGIN < x < 100 - _MARGIN),
        Tick(Fraction(100), _text(window.end, unit), "end"),
    ]


def _coarse_step(length: Duration) -> Fraction:
    """Return the smallest step of 1, 2 or 5 times a power of ten ns that gives at most `MAX_TICKS`."""
    power = Fraction(1)
    while length.fraction / power < MAX_TICKS:
        power /= 10
    while True:
        for mantissa in (1, 2, 5):
            if length.fraction / (mantissa * power) <= MAX_TICKS:
                return mantissa * power
        power *= 10


def _text(at: Duration, unit: str) -> str:
    return format_rational(at.in_unit(unit)) + unit


def decimal(value: Fraction, digits: int) -> str:
    """Return `value` rounded to `digits` decimals, without trailing zeros."""
    scale = 10**digits
    is_exact = not scale % value.denominator  # places are on this grid, and most numbers of a page are places
    number = value.numerator * (scale // value.denominator) if is_exact else round(value * scale)
    whole, part = divmod(abs(number), scale)
    text = f"{whole}.{part:0{digits}}".rstrip("0").rstrip(".")
    return f"-{text}" if number < 0 else text


def approximate(value: Fraction, digits: int = 4) -> str:
    """Return `value` exactly where `digits` decimals suffice, else rounded and marked ``≈``."""
    text = decimal(value, digits)
    return text if Fraction(text) == value else f"≈ {text}"


def percent(share: Fraction) -> str:
    """Return a share as per cent with one decimal."""
    return decimal(share * 100, 1) + "%"


def position(offset: int | Fraction, span: int | Fraction) -> Fraction:
    """Return the place of `offset` within `span` in per cent, on the grid that charts print (1e-4)."""
    return Fraction(round(Fraction(offset * 10**6, span)), 10**4)


def elide(name: str, letters: int) -> str:
    """Return a name cut to so many letters."""
    return name if len(name) <= letters else name[: max(letters - 1, 1)] + "…"
