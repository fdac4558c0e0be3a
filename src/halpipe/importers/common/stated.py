"""Attributes of elements of the model as people state them: in overlays and in tables.

Readers of single values raise ``ValueError("what is wrong; what to do")``. They take only what makes sense, where the
reader of our own XML leaves the judgement to validate.
"""

from __future__ import annotations

import re
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import Duration
from halpipe.core.options import positive_duration
from halpipe.core.quantities import parse_bandwidth, parse_rational, parse_size, whole
from halpipe.core.settings import Fields, Stated, Words
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
    attributes,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from halpipe.models.attributes import Attribute

_NAME = re.compile(r"[A-Za-z0-9_./:~+@$%-]{1,1000}")
_GLOB_CHARACTERS = re.compile(r"[*?\[]")
_ONE = Fraction(1)


def is_glob(pattern: str) -> bool:
    """Return whether `pattern` is a glob, not a name: names of elements have no glob characters."""
    return _GLOB_CHARACTERS.search(pattern) is not None


def name(text: str) -> str:
    """Read the name of a model element."""
    if _NAME.fullmatch(text) is None:
        hint = "globs are not possible here" if is_glob(text) else "use A to Z, a to z, digits and _ . / : ~ + @ $ % -"
        raise ValueError(f"{text[:80]!r} is not a name; {hint}")
    return text


def word(text: str) -> str:
    """Read a text without white space, such as a file name."""
    if text.split() != [text]:
        raise ValueError(f"{text[:80]!r} is not a single word; remove the white space")
    return text


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


count = whole(1, 1_000_000, "count")
times = whole(1, 255, "number of times")


def number(text: str) -> int:
    """Read a whole number from 0 to a million."""
    return 0 if text == "0" else count(text)


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
    POSITIVE: positive_duration,
    SHARE: share,
    BOUND: bound,
    GANG: count,
    GAPS: number,
    TIMES: times,
    WEIGHT: parse_rational,
    SIZE: parse_size,
    BANDWIDTH: parse_bandwidth,
}


def keys_of(kind: type, *without: str) -> tuple[str, ...]:
    """Return the keys of the attributes of a class, which are their names in files."""
    own, units = attributes(kind), attributes(kind, "units")
    return tuple(_key(one) for one in (*own, *units) if one.field not in without)


def _key(one: Attribute) -> str:
    return "units" if one.field == "units" else one.name


def stated_attributes(
    f: Fields, kind: type, *without: str, keys: Mapping[str, str] | None = None, **readers: Callable[[str], Any]
) -> dict[str, Stated[Any]]:
    """Return what a mapping states of the attributes of a class, by field.

    `keys` has the keys that are not the names of the attributes, `readers` what reads some fields differently.
    """
    found = {}
    for one in (*attributes(kind), *attributes(kind, "units")):
        if one.field in without:
            continue
        key = (keys or {}).get(one.field, _key(one))
        read = readers[one.field] if one.field in readers else reader(one.codec)
        stated = f.texts_of(key, read) if one.codec.is_list else f.get(key, read)
        if stated is not None:
            found[one.field] = stated
    return found


def complete_attributes(f: Fields, kind: type, keys: Mapping[str, str] | None = None) -> dict[str, Any] | None:
    """Return the attributes of an element by field; None where one that it must have is missing or wrong."""
    found = stated_attributes(f, kind, keys=keys)
    needed = [one for one in attributes(kind) if one.is_required]
    is_there = f.require(*((keys or {}).get(one.field, one.name) for one in needed))
    if not is_there or any(one.field not in found for one in needed):
        return None
    return {field: stated.value for field, stated in found.items()}
