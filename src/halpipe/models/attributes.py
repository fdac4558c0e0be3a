"""The one statement of each scalar attribute of models and schedules: its type, default, name in files and meaning.

A field of a dataclass carries it as metadata. Readers, writers, overlays and the XML schemas go by these tables, so
that a new attribute is one field::

    period: Duration | None = field(default=None, metadata=attribute(POSITIVE, "Absent: runs on demand."))
"""

from __future__ import annotations

import re
from dataclasses import MISSING, Field, fields
from fractions import Fraction
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from halpipe.core.durations import ZERO, Duration
from halpipe.core.quantities import (
    format_bandwidth,
    format_rational,
    format_size,
    parse_bandwidth,
    parse_rational,
    parse_signed,
    parse_size,
)
from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from enum import Enum

_ITEM = re.compile(r"[^ \t\r\n]+")
_KEY, _HELD = "attribute", "held"


@record(eq=False)
class Codec:
    """A type of attributes: `schema` is its simple type in the XML schemas, `blank` a value where one must stand.

    `parse` raises ``ValueError`` for what it cannot read; `words` is the enumeration, if the type is one.
    """

    schema: str
    parse: Callable[[str], Any]
    text: Callable[[Any], str] = str
    blank: Any = ""
    words: type[Enum] | None = None
    is_list: bool = False


@lru_cache(maxsize=4096)  # in large models the same units stand in thousands of versions
def _items(text: str) -> tuple[str, ...]:
    """Split a list; only what is white space in XML separates its items."""
    return tuple(_ITEM.findall(text))


_duration = lru_cache(maxsize=4096)(Duration.parse)  # a model states few distinct durations many times
_number = lru_cache(maxsize=4096)(parse_signed)

NAME = Codec("name", str)
TEXT = Codec("xs:string", str)
TOKEN = Codec("xs:token", lambda text: " ".join(_items(text)))
DIGEST = Codec("digest", str.strip)
DURATION = Codec("duration", _duration, blank=ZERO)
POSITIVE = Codec("duration", _duration, blank=ZERO)
"""A duration that makes sense above zero only; validate judges it, and settings refuse others at once."""
SHARE = Codec("share", _number, format_rational, Fraction(0))
BOUND = Codec("share", _number, format_rational, Fraction(1))
"""A share above zero."""
WEIGHT = Codec("share", parse_rational, format_rational, Fraction(1))
"""Weight among others of the same kind; 0: does not count."""
NUMBER = Codec("number", _number, format_rational, Fraction(0))
INDEX = Codec("xs:nonNegativeInteger", int, blank=0)
GAPS = Codec("gaps", int, blank=0)
TIMES = Codec("times", int, blank=1)
GANG = Codec("gang", int, blank=1)
SIZE = Codec("size", parse_size, format_size, 0)
BANDWIDTH = Codec("bandwidth", parse_bandwidth, format_bandwidth, 0)
DURATIONS = Codec("split", lambda text: tuple(map(_duration, _items(text))), lambda held: " ".join(map(str, held)), ())
"""Split points; the simple type allows words for them, too."""
NAMES = Codec("names", _items, " ".join, (), is_list=True)
TEXTS = Codec("texts", _items, " ".join, (), is_list=True)


def _dashed(kind: type) -> str:
    return re.sub("(?<!^)(?=[A-Z])", "-", kind.__name__).lower()


@cache
def word(kind: type[Enum]) -> Codec:
    """Return the codec of an enumeration, whose simple type has its name."""
    return Codec(_dashed(kind), lambda text: kind(text.strip()), str, next(iter(kind)), kind)


@record
class Attribute:
    """A scalar attribute: `field` in Python, `name` in files, there in the child called `element` if that is given.

    It is written where it differs from `default`, or always. One that is required stands in every file, whatever a
    Python program may leave out. A common one may be stated once for a list of elements.
    """

    field: str
    name: str
    codec: Codec
    default: Any
    meaning: str
    element: str
    is_always_written: bool
    is_common: bool
    is_required: bool


def attribute(
    codec: Codec,
    meaning: str = "",
    *,
    name: str = "",
    element: str = "",
    always: bool = False,
    common: bool = False,
    required: bool = False,
) -> Any:
    """Return the metadata of a field: what it is, and, for the reader of a schema, what it means."""
    return {_KEY: (codec, meaning, name, element, always, common, required)}


@record
class Child:
    """Elements within those of a class: `field` in Python, `tag` in files, there in a `section` if that is given."""

    field: str
    tag: str
    kind: type
    section: str
    is_single: bool


def held(kind: type, tag: str = "", *, section: str = "") -> Any:
    """Return the metadata of a field of other elements; their tag is the name of the class, if no other is stated."""
    return {_HELD: (tag or _dashed(kind), kind, section)}


@cache
def children(kind: type) -> tuple[Child, ...]:
    """Return which elements those of a class have within them, in the order of its fields."""
    stated: list[tuple[Field[Any], tuple[str, type, str]]]
    stated = [(each, each.metadata[_HELD]) for each in fields(kind) if _HELD in each.metadata]
    return tuple(Child(each.name, *where, each.default is None) for each, where in stated)


def codec_of(field: Field[Any]) -> Codec | None:
    """Return the type of the attribute that a field is, None if it is none."""
    return field.metadata[_KEY][0] if _KEY in field.metadata else None


def attributes(kind: type, element: str = "") -> tuple[Attribute, ...]:
    """Return the scalar attributes of a class in the order of its fields: its own, or those in the child `element`."""
    return _attributes(kind, element)


@cache
def _attributes(kind: type, element: str) -> tuple[Attribute, ...]:
    found = [_attribute(field, *field.metadata[_KEY]) for field in fields(kind) if _KEY in field.metadata]
    return tuple(stated for stated in found if stated.element == element)


def _attribute(
    field: Field[Any],
    codec: Codec,
    meaning: str,
    name: str,
    element: str,
    always: bool,
    common: bool,
    required: bool,
) -> Attribute:
    name, required = name or field.name.replace("_", "-"), required or field.default is MISSING
    return Attribute(field.name, name, codec, field.default, meaning, element, always or required, common, required)


@cache
def attributes_by_name(kind: type, element: str = "") -> dict[str, Attribute]:
    """Return the scalar attributes of a class by their names in files."""
    return {stated.name: stated for stated in attributes(kind, element)}


def texts(value: Any, *without: str, element: str = "") -> dict[str, str]:
    """Return the attributes of a value as files have them, by name, without those that need not be written."""
    found = {}
    for stated in attributes(type(value), element):
        held = getattr(value, stated.field)
        if (stated.is_always_written or held != stated.default) and stated.name not in without:
            found[stated.name] = stated.codec.text(held)
    return found


class Named(Protocol):
    """An element of a model or a schedule."""

    @property
    def name(self) -> str:
        """Its name, unique among its like."""


N = TypeVar("N")
E = TypeVar("E", bound=Named)
R = TypeVar("R")


def named(elements: Iterable[E], name: str) -> E:
    """Return the element called `name`, of equal ones the first; raise ``KeyError`` with the names that there are."""
    if isinstance(elements, tuple) and len(elements) > LONG:
        found: E | None = kept(elements, _by_name).get(name)
        if found is not None:
            return found
    known = []
    for element in elements:
        if element.name == name:
            return element
        known.append(element.name)
    raise KeyError(f'there is no "{name}"; there are {", ".join(known[:9]) or "none"}')


LONG = 32
"""Elements from which on an index is quicker than a look at each."""

KEPT = 6
"""Answers about tuples that are kept: records have no place for what is worked out once."""

_KEPT: list[tuple[tuple[Any, ...], Any, Any]] = []


def kept(elements: tuple[N, ...], make: Callable[[tuple[N, ...]], R]) -> R:
    """Return what `make` says of the elements, without asking anew where they are those of one of the last calls."""
    for known, how, answer in list(_KEPT):
        if known is elements and how is make:
            said: R = answer
            return said
    made = make(elements)
    _KEPT[:] = [(elements, make, made), *_KEPT[: KEPT - 1]]
    return made


def _by_name(elements: tuple[Any, ...]) -> dict[str, Any]:
    return {element.name: element for element in reversed(elements)}
