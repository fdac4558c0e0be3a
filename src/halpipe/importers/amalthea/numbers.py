"""Quantities as AMALTHEA writes them, read exactly: a number and a unit in two attributes.

Numbers are integers or Java doubles (``2.0``, ``1.0E8``); a unit that is left out has the default of older versions.
"""

from __future__ import annotations

import re
from fractions import Fraction

_NUMBER = re.compile(
    r"(?P<sign>[+-]?)(?P<digits>[0-9]{1,60}(?:\.[0-9]{0,60})?|\.[0-9]{1,60})(?:[eE](?P<exp>[+-]?[0-9]{1,3}))?"
)
_MAX_EXPONENT = 60

TIME_NS = {
    "s": Fraction(10**9),
    "ms": Fraction(10**6),
    "us": Fraction(10**3),
    "ns": Fraction(1),
    "ps": Fraction(1, 1000),
}
HERTZ = {"Hz": 1, "kHz": 10**3, "MHz": 10**6, "GHz": 10**9}
_DECIMAL = {"": 1, "k": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}
_BINARY = {"Ki": 2**10, "Mi": 2**20, "Gi": 2**30, "Ti": 2**40}
_PREFIXES = _DECIMAL | _BINARY
BYTES = {f"{prefix}B": Fraction(size) for prefix, size in _PREFIXES.items()}
BYTES |= {f"{prefix}bit": Fraction(size, 8) for prefix, size in _PREFIXES.items()}
RATES = {f"{unit}PerSecond": size for unit, size in BYTES.items()}


def parse_number(text: str) -> Fraction | None:
    """Read an integer or a double exactly, never through a binary float; None if it is none, or INF or NaN."""
    match = _NUMBER.fullmatch(text.strip())
    if match is None or abs(int(match["exp"] or 0)) > _MAX_EXPONENT:
        return None
    whole, _, decimals = match["digits"].partition(".")
    value = Fraction(int((whole + decimals) or "0"), 10 ** len(decimals)) * Fraction(10) ** int(match["exp"] or 0)
    return -value if match["sign"] == "-" else value
