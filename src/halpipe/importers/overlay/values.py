"""Readers of single values of an overlay; they raise ``ValueError("what is wrong; what to do")``."""

from __future__ import annotations

import re
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.durations import ZERO, Duration
from halpipe.importers.overlay.patterns import is_glob
from halpipe.models.attributes import (
    BANDWIDTH,
    BOUND,
    DURATION,
    GANG,
    GAPS,
    NAME,
    NAMES,
    POSITIVE,
    SHARE,
    SIZE,
    TEXTS,
    TIMES,
    TOKEN,
    WEIGHT,
    Codec,
)
from halpipe.quantities import parse_bandwidth, parse_rational, parse_size
from halpipe.settings import Words

if TYPE_CHECKING:
    from collections.abc import Callable

_NAME = re.compile(r"[A-Za-z0-9_./:~+@$%-]{1,1000}")
_ONE = Fraction(1)


def name(text: str) -> str:
    """Read the name of a model element."""
    if _NAME.fullmatch(text) is None:
        hint = "globs are not possible here" if is_glob(text) else "use letters, digits and _ . / : ~ + @ $ % -"
        raise ValueError(f"{text[:80]!r} is not a name; {hint}")
    return text


def pattern(text: str) -> str:
    """Read a name or a glob of names."""
    if not text:
        raise ValueError("the pattern is empty; write a name or a glob such as /sensing/*")
    return text


def word(text: str) -> str:
    """Read a text without white space, such as a file name."""
    if len(text.split()) != 1 or text.split()[0] != text:
        raise ValueError(f"{text[:80]!r} is not a single word; remove the white space")
    return text


def positive(text: str) -> Duration:
    """Read a duration above zero."""
    duration = Duration.parse(text)
    if duration == ZERO:
        raise ValueError(f"{text} is not above zero; write a positive duration")
    return duration


def share(text: str) -> Fraction:
    """Read a number in [0, 1]."""
    number = parse_rational(text)
    if number > _ONE:
        raise ValueError(f"{text} is above 1; write a share between 0 and 1")
    return number


def bound(text: str) -> Fraction:
    """Read a number in (0, 1]."""
    number = share(text)
    if not number:
        raise ValueError(f"{text} is not above 0; write a share above 0, up to 1")
    return number


def count(text: str) -> int:
    """Read a whole number from 1 to a million."""
    if not (text.isascii() and text.isdigit() and len(text) <= 7 and 1 <= int(text) <= 1_000_000):
        raise ValueError(f"{text[:80]!r} is not a count; write a whole number from 1 to 1000000")
    return int(text)


def times(text: str) -> int:
    """Read a whole number from 1 to 255."""
    if not (text.isascii() and text.isdigit() and len(text) <= 3 and 1 <= int(text) <= 255):
        raise ValueError(f"{text[:80]!r} is not a number of times; write a whole number from 1 to 255")
    return int(text)


def number(text: str) -> int:
    """Read a whole number from 0 to a million."""
    return 0 if text == "0" else count(text)


def splitting(text: str) -> Duration | str:
    """Read a split point, or where else jobs may be split: ``anywhere`` or ``none``."""
    return text if text in ("anywhere", "none") else positive(text)


def reader(codec: Codec) -> Callable[[str], Any]:
    """Return what reads a value of an attribute, of a list one item, and takes only what makes sense there."""
    kind = codec.words
    if kind is None:
        return _READERS[codec]
    return Words(*(str(known) for known in kind.__members__.values()), mean=kind)


_READERS: dict[Codec, Callable[[str], Any]] = {
    NAME: name,
    NAMES: name,
    TOKEN: word,
    TEXTS: word,
    DURATION: Duration.parse,
    POSITIVE: positive,
    SHARE: share,
    BOUND: bound,
    GANG: count,
    GAPS: number,
    TIMES: times,
    WEIGHT: parse_rational,
    SIZE: parse_size,
    BANDWIDTH: parse_bandwidth,
}
