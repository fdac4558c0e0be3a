"""Exact time: parse, print, compare and convert to solver ticks.

Every instant and duration of a model is an exact non-negative rational (MODEL: Q+). It is held in
nanoseconds; this module is the only place that knows the units' names and sizes.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Final, overload

from halpipe.core.quantities import format_ratio, parse_rational, quoted, with_point

if TYPE_CHECKING:
    from collections.abc import Iterable

_UNITS_NS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
_TEXT = re.compile(r"(?P<number>[0-9./]+)\s*(?P<unit>ns|us|ms|s)")
_SCHEMA_FORM = re.compile(r"-?[0-9]{1,30}(?:[./][0-9]{1,30})?(?:ns|us|ms|s)")  # the digits that a task model may have
_FORM = "write a number and a unit, such as 25ms, 0.5ms, 40us, 100/3ms or 1/30s"


class Duration:
    """An exact span of time in nanoseconds: an integer where possible, else a ``Fraction``."""

    __slots__ = ("ns",)
    ns: Final[int | Fraction]
    """The value in nanoseconds, exact."""

    def __init__(self, ns: int | Fraction | str) -> None:
        """Take nanoseconds, or a text such as ``5ms``: what `repr` prints reads back."""
        if type(ns) is not int:  # asking for the type first: most values are integers
            if isinstance(ns, str):
                ns = Duration.parse(ns).ns
            if ns.denominator == 1:
                ns = ns.numerator
        self.ns = ns

    @staticmethod
    def parse(text: str) -> Duration:
        """Read ``25ms``, ``0.5ms``, ``100/3ms``, ``1/30s``; raise ``ValueError`` that says what is wrong."""
        match = _TEXT.fullmatch(text.strip())
        if match is None:
            raise ValueError(f"{quoted(text)} is not a duration; {with_point(text, _TEXT) or _FORM}")
        scale = _UNITS_NS[match["unit"]]
        number = match["number"]
        top, slash, bottom = number.partition("/")
        if len(number) <= _SHORT_DIGITS and top.isdigit() and (not slash or (bottom.isdigit() and int(bottom))):
            return Duration(Fraction(int(top) * scale, int(bottom)) if slash else int(top) * scale)  # as most are
        try:
            return Duration(parse_rational(number) * scale)
        except ValueError as error:
            raise ValueError(f"{quoted(text)} is not a duration: {error}; {_FORM}") from None

    @property
    def fraction(self) -> Fraction:
        """The value in nanoseconds as a ``Fraction``."""
        return Fraction(self.ns)

    def in_unit(self, unit: str) -> Fraction:
        """Return the value counted in ``ns``, ``us``, ``ms`` or ``s``, exact."""
        return Fraction(self.ns, _UNITS_NS[unit])

    def __str__(self) -> str:
        return _text(self.ns)

    def __repr__(self) -> str:
        return f"Duration({str(self)!r})"

    def __hash__(self) -> int:
        return hash(self.ns)

    def __eq__(self, other: object) -> bool:
        return self.ns == other.ns if isinstance(other, Duration) else NotImplemented

    def __lt__(self, other: Duration) -> bool:
        return self.ns < other.ns

    def __le__(self, other: Duration) -> bool:
        return self.ns <= other.ns

    def __gt__(self, other: Duration) -> bool:
        return self.ns > other.ns

    def __ge__(self, other: Duration) -> bool:
        return self.ns >= other.ns

    def __bool__(self) -> bool:
        return self.ns != 0

    def __add__(self, other: Duration) -> Duration:
        return Duration(self.ns + other.ns)

    def __sub__(self, other: Duration) -> Duration:
        return Duration(self.ns - other.ns)

    def __neg__(self) -> Duration:
        return Duration(-self.ns)

    def __mul__(self, factor: int | Fraction) -> Duration:
        return Duration(self.ns * factor)

    __rmul__ = __mul__

    @overload
    def __truediv__(self, other: Duration) -> Fraction: ...
    @overload
    def __truediv__(self, other: int | Fraction) -> Duration: ...
    def __truediv__(self, other: Duration | int | Fraction) -> Fraction | Duration:
        if isinstance(other, Duration):
            return Fraction(self.ns, other.ns)
        return Duration(Fraction(self.ns) / other)

    def __floordiv__(self, other: Duration) -> int:
        return int(self.ns // other.ns)

    def __mod__(self, other: Duration) -> Duration:
        return Duration(self.ns % other.ns)


_SHORT_DIGITS = 18
_LARGEST_FIRST = [("s", 10**9, 9), ("ms", 10**6, 6), ("us", 10**3, 3), ("ns", 1, 0)]
"""Units, their nanoseconds, and how many digits these leave behind the point."""

_SHORT = 10**27
"""Nanoseconds below which every whole number of them is short in any unit."""


@lru_cache(maxsize=8192)  # a model states the same few times again and again
def _text(ns: int | Fraction) -> str:
    if ns == 0:
        return "0ms"
    top, bottom = abs(ns.numerator), ns.denominator
    # The largest unit that gives a number of 1 or more; another one where only that keeps the digits few.
    if bottom == 1 and top == ns < _SHORT:
        for unit, size, digits in _LARGEST_FIRST:
            if top >= size:
                whole, rest = divmod(top, size)
                return f"{whole}.{rest:0{digits}d}".rstrip("0") + unit if rest else f"{whole}{unit}"
    first = ""
    reached = [entry for entry in _LARGEST_FIRST if top >= entry[1] * bottom]
    units = [*reached, *_LARGEST_FIRST] if reached else _LARGEST_FIRST[-1:]
    for unit, size, _ in units:
        common = math.gcd(top, size)
        text = format_ratio(ns.numerator // common, bottom * (size // common)) + unit
        if _SCHEMA_FORM.fullmatch(text):
            return text
        first = first or text
    return first


ZERO = Duration(0)


def seconds(value: int | Fraction) -> Duration:
    """Return `value` seconds as an exact duration."""
    return Duration(Fraction(value) * _UNITS_NS["s"])


def milliseconds(value: int | Fraction) -> Duration:
    """Return `value` milliseconds as an exact duration."""
    return Duration(Fraction(value) * _UNITS_NS["ms"])


def greatest_common_divisor(durations: Iterable[Duration]) -> Duration:
    """Return the largest duration that divides every one given; zero when all are zero or none is given."""
    given = {duration.ns for duration in durations}
    common = math.lcm(*(ns.denominator for ns in given))
    return Duration(Fraction(math.gcd(*(int(ns * common) for ns in given)), common))


def least_common_multiple(durations: Iterable[Duration]) -> Duration:
    """Return the smallest positive duration that every (positive) one given divides: the hyperperiod t_P."""
    given = [duration.ns for duration in durations]
    denominator = math.gcd(*(ns.denominator for ns in given))
    return Duration(Fraction(math.lcm(*(ns.numerator for ns in given)), denominator)) if given else ZERO


def divisors(total: Duration, unit: Duration) -> list[Duration]:
    """Return every multiple of `unit` that divides `total`, in order; none if `total` is none or above 10^12 units."""
    count = total / unit
    if count.denominator != 1 or not 0 < count <= 10**12:
        return []
    small = [n for n in range(1, math.isqrt(count.numerator) + 1) if count.numerator % n == 0]
    return [unit * n for n in sorted({*small, *(count.numerator // n for n in small)})]
