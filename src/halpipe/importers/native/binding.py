"""What both readers share: typed access to the attributes of a schema-valid element, with findings."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import TYPE_CHECKING, TypeAlias, TypeVar

from halpipe.diagnostics import Findings, Location, error
from halpipe.durations import Duration
from halpipe.quantities import parse_rational
from halpipe.schemas import line_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from fractions import Fraction

    from lxml import etree

Children: TypeAlias = "dict[str, list[etree._Element]]"  # noqa: SLF001 - lxml's only name for it
"""The children of an element by their names."""

T = TypeVar("T")

BAD_VALUE = error(
    "HAL0103",
    "Value cannot be used",
    "The value has the right form but no exact meaning here, such as a size that is not a whole number of bytes.",
)

_ITEM = re.compile(r"[^ \t\r\n]+")

# A model states few distinct durations many times.
duration = lru_cache(maxsize=4096)(Duration.parse)


def durations(text: str) -> tuple[Duration, ...]:
    """Read blank-separated durations."""
    return tuple(map(duration, _items(text)))


@lru_cache(maxsize=4096)
def rational(text: str) -> Fraction:
    """Read an exact number, which may carry a minus sign."""
    stripped = text.strip()
    return -parse_rational(stripped[1:]) if stripped.startswith("-") else parse_rational(text)


class Binder:
    """Reads attributes of the elements of one file and collects what cannot be read."""

    def __init__(self, file: str, namespace: str) -> None:
        self.file = file
        self.findings = Findings()
        self._prefix = len(f"{{{namespace}}}")

    def at(self, element: etree._Element) -> Location:
        """Return the place of an element."""
        return Location(self.file, line_of(element))

    def children(self, element: etree._Element) -> Children:
        """Return the children by their names, those of each name in order."""
        found: Children = {}
        if len(element):  # most have none
            for child in element.iterchildren("*"):
                found.setdefault(child.tag[self._prefix :], []).append(child)
        return found

    def names(self, element: etree._Element, name: str) -> tuple[str, ...]:
        """Return an attribute's blank-separated names; only what is white space in XML separates them."""
        return _items(element.get(name, ""))

    def read(self, element: etree._Element, name: str, parse: Callable[[str], T], default: T) -> T:
        """Return what `parse` makes of an attribute, `default` when it is absent; what it refuses is a finding."""
        text = element.get(name)
        if text is None:
            return default
        try:
            return parse(text)
        except ValueError as failure:
            tag = element.tag[self._prefix :]
            self.findings.add(BAD_VALUE(str(failure), at=self.at(element), path=f'{tag} attribute "{name}"'))
            return default


def only(children: Children, name: str) -> etree._Element | None:
    """Return the only child called `name`, if any."""
    found = children.get(name)
    return found[0] if found else None


@lru_cache(maxsize=4096)
def _items(text: str) -> tuple[str, ...]:
    """Split a list of names; in large models the same units stand in thousands of versions."""
    return tuple(_ITEM.findall(text))
