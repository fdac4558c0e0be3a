"""Time axis and numbers of a chart, exact: round steps that nest, so that zooming in only adds ticks."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import Duration
from halpipe.core.quantities import format_rational
from halpipe.core.records import record

if TYPE_CHECKING:
    from halpipe.exporters.common.timeline import Window

MAX_TICKS = 10
# Into how many parts a step of 1, 2 or 5 is divided to reach the next finer round step.
_FINER = {1: 5, 2: 4, 5: 5}
# How near (per cent of the width) to either end of the axis no inner label may stand.
_MARGIN = 7


@record
class Tick:
    """A mark at `x` per cent; shown from zoom `level` on; `anchor` is how its text hangs on the mark."""

    x: Fraction
    text: str
    level: int
    anchor: str = "middle"


def ticks(window: Window, *, fine: bool) -> list[Tick]:
    """Return the marks of the axis over `window`: round ones, with `fine` also those for zooming, and both ends."""
    unit = _unit(window.length)
    mantissa, step = _coarse_step(window.length)
    found: dict[int | Fraction, int] = {}
    _mark(found, window, step, 0)
    if fine:
        for level in (2, 4):
            parts = _FINER[mantissa]
            step, mantissa = step / parts, {1: 2, 2: 5, 5: 1}[mantissa]
            _mark(found, window, step, level)
    inner = [
        Tick(x, _text(Duration(at), unit), level)
        for at, level in sorted(found.items())
        if (x := position(at - window.start.ns, window.length.ns)) and _fits(x, level)
    ]
    first = Tick(Fraction(0), _text(window.start, unit), 0, "start")
    last = Tick(Fraction(100), _text(window.end, unit), 0, "end")
    return [first, *inner, last]


def _fits(x: Fraction, level: int) -> bool:
    margin = Fraction(_MARGIN, 2**level)
    return margin < x < 100 - margin


def _unit(length: Duration) -> str:
    return next((unit for unit in ("s", "ms", "us") if length.in_unit(unit) >= 2), "ns")


def _coarse_step(length: Duration) -> tuple[int, Fraction]:
    """Return the smallest step of 1, 2 or 5 times a power of ten ns that gives at most `MAX_TICKS`."""
    power = Fraction(1)
    while length.fraction / power < MAX_TICKS:
        power /= 10
    while True:
        for mantissa in (1, 2, 5):
            if length.fraction / (mantissa * power) <= MAX_TICKS:
                return mantissa, mantissa * power
        power *= 10


def _mark(found: dict[int | Fraction, int], window: Window, step: Fraction, level: int) -> None:
    number = -(-window.start.fraction // step)
    while number * step < window.end.fraction:
        found.setdefault(number * step, level)
        number += 1


def _text(at: Duration, unit: str) -> str:
    return format_rational(at.in_unit(unit)) + unit


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


def elide(name: str, letters: int) -> str:
    """Return a name cut to so many letters."""
    return name if len(name) <= letters else name[: max(letters - 1, 1)] + "…"
