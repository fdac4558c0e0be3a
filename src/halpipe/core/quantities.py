"""Exact numbers other than time: rationals, shares, sizes in bytes and bandwidths in bytes per second."""

from __future__ import annotations

import re
from fractions import Fraction
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

_RATIONAL = re.compile(r"[0-9]+(?:\.[0-9]+)?|[0-9]+/[0-9]+")
_MAX_LENGTH = 1000  # metrics of schedules are sums of many fractions; what people write is short
_SHOWN = 80
_WHOLE = re.compile("-?[0-9]+")
_DIGITS = 20  # as many as 2^64 has; int() takes time that grows with their square
_SIZE = re.compile(r"(?P<number>[0-9]{1,30}(?:\.[0-9]{1,30})?)\s*(?P<unit>[kMG]?B|[KMG]iB)")
_BYTES = {"GiB": 2**30, "GB": 10**9, "MiB": 2**20, "MB": 10**6, "KiB": 2**10, "kB": 10**3, "B": 1}
_FREQUENCY = re.compile(r"([0-9]{1,12}(?:\.[0-9]{1,12})?)\s*(Hz|kHz|MHz|GHz)")
_HERTZ = {"Hz": 1, "kHz": 10**3, "MHz": 10**6, "GHz": 10**9}


def quoted(text: str) -> str:
    """Return a value in quotes for a message, cut where it is so long that it would hide the message."""
    return repr(text) if len(text) <= _SHOWN else f"{text[:_SHOWN]!r}..."


def with_point(text: str, form: re.Pattern[str]) -> str:
    """Return the advice to write a decimal point if a comma is all that keeps a text from its form, else nothing."""
    point = text.strip().replace(",", ".")
    return f"write {point}, with a decimal point" if "," in text and form.fullmatch(point) else ""


def parse_rational(text: str) -> Fraction:
    """Read a non-negative ``12``, ``0.35`` or ``1/3`` exactly; raise ``ValueError`` that says what is wrong."""
    stripped = text.strip()
    if len(stripped) > _MAX_LENGTH:
        raise ValueError(f"{quoted(text)} has more than {_MAX_LENGTH} characters")
    if _RATIONAL.fullmatch(stripped) is None:
        advice = with_point(text, _RATIONAL) or "write it as 0.35, 1/3 or 1"
        raise ValueError(f"{quoted(text)} is not a number; {advice}")
    top, slash, bottom = stripped.partition("/")
    try:
        return Fraction(int(top), int(bottom)) if slash else Fraction(stripped)
    except ZeroDivisionError:
        raise ValueError(f"{quoted(text)} divides by zero") from None


def is_writable(value: Fraction) -> bool:
    """Return whether a rational is short enough to be written and read again."""
    size = value.numerator.bit_length() + value.denominator.bit_length()  # of longer ones no text is made
    return size < 4 * _MAX_LENGTH and len(format_rational(value)) < _MAX_LENGTH


def parse_signed(text: str) -> Fraction:
    """Read a number as `parse_rational` does, with a sign before it if it is negative."""
    stripped = text.strip()
    return -parse_rational(stripped[1:]) if stripped.startswith("-") else parse_rational(stripped)


def parse_share(text: str) -> Fraction:
    """Read ``0.35``, ``7/20`` or ``35%`` exactly; raise ``ValueError`` that says what is wrong."""
    stripped = text.strip()
    if stripped.endswith("%"):
        return parse_rational(stripped[:-1]) / 100
    return parse_rational(stripped)


def format_rational(value: Fraction) -> str:
    """Print a rational as an integer, a terminating decimal, or ``n/d`` where no decimal terminates."""
    return format_ratio(value.numerator, value.denominator)


def format_percent(share: Fraction, *, is_bound: bool = False) -> str:
    """Format a share in tenths of a percent, an upper bound rounded up, else down, though not to 0."""
    tenths = -int(-share * 1000 // 1) if is_bound else int(share * 1000)
    return f"{format_rational(Fraction(tenths, 10))} %" if tenths or not share else "less than 0.1 %"


def format_ratio(top: int, bottom: int) -> str:
    """Print a rational in lowest terms, with a positive denominator."""
    if bottom == 1:
        return str(top)
    twos = fives = 0
    rest = bottom
    while rest % 2 == 0:
        rest, twos = rest // 2, twos + 1
    while rest % 5 == 0:
        rest, fives = rest // 5, fives + 1
    digits = max(twos, fives)
    if rest != 1 or digits > 30:
        return f"{top}/{bottom}"
    scaled = abs(top) * 10**digits // bottom
    sign = "-" if top < 0 else ""
    return f"{sign}{scaled // 10**digits}.{scaled % 10**digits:0{digits}d}"


def whole(least: int, most: int | None = None, what: str = "whole number") -> Callable[[str], int]:
    """Return a reader of whole numbers from `least` to `most`; it calls what it reads `what` where it refuses it."""
    bounds = f"from {least} to {most}" if most is not None else f"from {least} on"

    def read(text: str) -> int:
        number = text.strip()
        if _WHOLE.fullmatch(number) is None:
            raise ValueError(f"{quoted(text)} is no {what}; write a number {bounds}")
        if number.startswith("-") or (len(number) <= _DIGITS and int(number) < least):
            raise ValueError(f"{quoted(text)} is too small; write a number {bounds}")
        if len(number) > _DIGITS or (most is not None and int(number) > most):
            limit = f"at most {_DIGITS} digits" if most is None else f"a number {bounds}"
            raise ValueError(f"{quoted(text)} is too large; write {limit}")
        return int(number)

    return read


_ADDRESS = re.compile(r"0[xX](?P<hex>[0-9a-fA-F]{1,16})|[0-9]{1,19}")


def parse_address(text: str) -> int:
    """Read an address such as ``0x80000000``."""
    match = _ADDRESS.fullmatch(text.strip())
    if match is None:
        raise ValueError(f"{quoted(text)} is no address; write it as 0x80000000")
    return int(match["hex"], 16) if match["hex"] else int(text)


def parse_size(text: str) -> int:
    """Read a size such as ``4320B`` or ``64KiB`` into whole bytes."""
    return _whole_bytes(text, text.strip(), "a size; write it as 4320B, 64KiB or 1.5MB")


def parse_bandwidth(text: str) -> int:
    """Read a bandwidth such as ``19.2GB/s`` into whole bytes per second, more than none."""
    stripped = text.strip()
    what = "a bandwidth; write it as 400MB/s or 19.2GB/s"
    if not stripped.endswith("/s"):
        raise ValueError(f"{quoted(text)} is not {what}")
    if not (rate := _whole_bytes(text, stripped[:-2], what)):
        raise ValueError(f"{quoted(text)} moves nothing; write a bandwidth above zero")
    return rate


def _whole_bytes(text: str, stripped: str, what: str) -> int:
    match = _SIZE.fullmatch(stripped)
    if match is None:
        raise ValueError(f"{quoted(text)} is not {what}")
    value = Fraction(match["number"]) * _BYTES[match["unit"]]
    if value.denominator != 1:
        raise ValueError(f"{quoted(text)} is not a whole number of bytes")
    return value.numerator


def parse_frequency(text: str) -> int:
    """Read ``250MHz`` into whole Hz; raise ``ValueError`` that says what is wrong."""
    match = _FREQUENCY.fullmatch(text.strip())
    if match is None:
        raise ValueError(f"{quoted(text)} is not a frequency; write it as 250MHz or 533333333Hz")
    hertz = Fraction(match[1]) * _HERTZ[match[2]]
    if hertz.denominator != 1 or not hertz:
        raise ValueError(f"{quoted(text)} is not a whole number of Hz above zero; round it down")
    if hertz >= 2**32:
        raise ValueError(f"{quoted(text)} does not fit into 32 bits; state at most 4.2GHz")
    return hertz.numerator


def format_size(value: int) -> str:
    """Print whole bytes in the largest unit that needs at most one decimal; `parse_size` gives them back."""
    unit = next((u for u, size in _BYTES.items() if value >= size and value * 10 % size == 0), "B")
    return format_rational(Fraction(value, _BYTES[unit])) + unit


def format_bandwidth(value: int) -> str:
    """Print bytes per second so that `parse_bandwidth` gives them back."""
    return format_size(value) + "/s"
