"""What both readers share: typed access to the attributes of a schema-valid element, with findings."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import TYPE_CHECKING, TypeVar

from halpipe.diagnostics import Findings, Location, error
from halpipe.durations import Duration
from halpipe.quantities import parse_bandwidth, parse_rational, parse_size
from halpipe.schemas import line_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from fractions import Fraction

    from lxml import etree

T = TypeVar("T")

BAD_VALUE = error(
    "HAL0103",
    "Value cannot be used",
    "The value has the right form but no exact meaning here, such as a size that is not a whole number of bytes.",
)

_ITEM = re.compile(r"[^ \t\r\n]+")

# A model states few distinct durations many times.
_duration = lru_cache(maxsize=4096)(Duration.parse)


@lru_cache(maxsize=4096)
def _rational(text: str) -> Fraction:
    stripped = text.strip()
    return -parse_rational(stripped[1:]) if stripped.startswith("-") else parse_rational(text)


class Binder:
    """Reads attributes of the elements of one file and collects what cannot be read."""

    def __init__(self, file: str, namespace: str) -> None:
        self.file = file
        self.findings = Findings()
        self._prefix = f"{{{namespace}}}"

    def at(self, element: etree._Element) -> Location:
        """Return the place of an element."""
        return Location(self.file, line_of(element))

    def children(self, element: etree._Element, tag: str) -> list[etree._Element]:
        """Return the children called `tag`, in order."""
        return list(element.iterchildren(self._prefix + tag)) if len(element) else []  # most elements have none

    def child(self, element: etree._Element, tag: str) -> etree._Element | None:
        """Return the only child called `tag`, if any."""
        return next(element.iterchildren(self._prefix + tag), None) if len(element) else None

    def text(self, element: etree._Element, name: str) -> str:
        """Return an attribute's text, empty when absent."""
        return element.get(name) or ""

    def names(self, element: etree._Element, name: str) -> tuple[str, ...]:
        """Return an attribute's blank-separated names; only what is white space in XML separates them."""
        return _items(self.text(element, name))

    def integer(self, element: etree._Element, name: str, default: int = 0) -> int:
        """Return an integer attribute."""
        return self._value(element, name, int, default)

    def duration(self, element: etree._Element, name: str, default: Duration) -> Duration:
        """Return a duration attribute, `default` when absent."""
        return self._value(element, name, _duration, default)

    def optional_duration(self, element: etree._Element, name: str) -> Duration | None:
        """Return a duration attribute, None when absent."""
        return self._value(element, name, _duration, None)

    def rational(self, element: etree._Element, name: str, default: Fraction) -> Fraction:
        """Return an exact number, which may carry a minus sign."""
        return self._value(element, name, _rational, default)

    def size(self, element: etree._Element, name: str) -> int:
        """Return a size in bytes."""
        return self._value(element, name, parse_size, 0)

    def optional_bandwidth(self, element: etree._Element, name: str) -> int | None:
        """Return a bandwidth in bytes per second, None when absent."""
        return self._value(element, name, parse_bandwidth, None)

    def _value(self, element: etree._Element, name: str, read: Callable[[str], T], default: T) -> T:
        text = element.get(name)
        if text is None:
            return default
        try:
            return read(text)
        except ValueError as failure:
            tag = element.tag.removeprefix(self._prefix)
            self.findings.add(BAD_VALUE(str(failure), at=self.at(element), path=f'{tag} attribute "{name}"'))
            return default


@lru_cache(maxsize=4096)
def _items(text: str) -> tuple[str, ...]:
    """Split a list of names; in large models the same units stand in thousands of versions."""
    return tuple(_ITEM.findall(text))
