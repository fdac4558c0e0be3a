"""Exact numbers in the notations of traces."""

from __future__ import annotations

import re
from fractions import Fraction

_NUMBER = re.compile(r"-?[0-9]{1,30}(?:\.[0-9]{1,15}|/[0-9]{1,18})?")
_WHOLE = re.compile(r"-?[0-9]{1,18}")

_SHORT = 30
_POWERS = [10**digits for digits in range(_SHORT)]

SCALES_NS: dict[str, int | Fraction] = {"ps": Fraction(1, 1000), "ns": 1, "us": 10**3, "ms": 10**6, "s": 10**9}
"""Units of time by the name that traces give them, in nanoseconds."""


def instant(text: str, scale_ns: int | Fraction) -> int | Fraction:
    """Return nanoseconds of an instant in units of `scale_ns`; raise ``ValueError`` if `text` is no exact number."""
    whole, _, part = text.partition(".")
    digits = whole + part
    if digits.isdecimal() and digits.isascii() and whole and len(text) <= _SHORT and text[-1] != ".":  # as most are
        ns, rest = divmod(int(digits) * scale_ns, _POWERS[len(part)])
        if not rest:
            return int(ns)
    if not _NUMBER.fullmatch(text):
        raise ValueError(f"{text[:40]!r} is no time")
    try:
        value = Fraction(text) if "." in text or "/" in text else int(text)
    except ZeroDivisionError:
        raise ValueError(f"{text[:40]!r} is no time") from None
    return plain(value * scale_ns)


def plain(ns: int | Fraction) -> int | Fraction:
    """Return a whole number as an integer."""
    return ns.numerator if ns.denominator == 1 else ns


def whole(text: str) -> int:
    """Return a whole number; raise ``ValueError`` if `text` is none."""
    if not _WHOLE.fullmatch(text):
        raise ValueError(f"{text[:40]!r} is no whole number")
    return int(text)


def separator_of(header: str) -> str:
    """Return what separates the columns of a CSV: the one of comma, semicolon and tabulator that occurs most."""
    return max(",;\t", key=header.count)


class DecimalSign:
    """Decimal sign of a table: a point or a comma, but not both, since one of them might separate thousands."""

    def __init__(self, separator: str) -> None:
        self._separator, self._sign = separator, ""

    def point(self, text: str) -> str:
        """Return a number with a decimal point; raise ``ValueError`` if it has another sign than one before."""
        sign = ("." if "." in text else "") + ("," if "," in text else "")
        if sign and sign != self._sign:
            if self._sign or sign not in (".", ",") or sign == self._separator:
                raise ValueError(f"{text[:40]!r} has another decimal sign than the rows before")
            self._sign = sign
        return text.replace(",", ".") if sign == "," else text
