"""Typed access of both native readers to the attributes of a schema-valid element, with findings."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias

from halpipe.core.diagnostics import Findings, Location, error
from halpipe.models.attributes import attributes_by_name
from halpipe.schemas import line_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from lxml import etree

    from halpipe.models.attributes import Codec

Children: TypeAlias = "dict[str, list[etree._Element]]"  # noqa: SLF001 - lxml's only name for it
"""The children of an element by their names."""

BAD_VALUE = error(
    "HAL0103",
    "Value cannot be used",
    "The value has the right form but no exact meaning here, such as a size that is not a whole number of bytes.",
)


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

    def values(self, kind: type, element: etree._Element | None, within: str = "") -> dict[str, Any]:
        """Return the attributes of a class that an element has, by field; what cannot be read is a finding."""
        if element is None:
            return {}
        table, found = _readers(kind, within), {}
        for name, text in element.items():
            if name in table:
                field, parse = table[name]
                try:
                    found[field] = parse(text)
                except ValueError as failure:
                    found[field] = self._refused(element, name, failure, attributes_by_name(kind, within)[name].codec)
        return found

    def read(self, element: etree._Element, name: str, text: str, codec: Codec) -> Any:
        """Return what an attribute says; a blank value, with a finding, where it cannot be read."""
        try:
            return codec.parse(text)
        except ValueError as failure:
            return self._refused(element, name, failure, codec)

    def _refused(self, element: etree._Element, name: str, failure: ValueError, codec: Codec) -> Any:
        tag = element.tag[self._prefix :]
        self.findings.add(BAD_VALUE(str(failure), at=self.at(element), path=f'{tag} attribute "{name}"'))
        return codec.blank


@cache
def _readers(kind: type, within: str) -> dict[str, tuple[str, Callable[[str], Any]]]:
    """Return the field of each attribute of a class, and what reads it."""
    return {name: (stated.field, stated.codec.parse) for name, stated in attributes_by_name(kind, within).items()}


def only(children: Children, name: str) -> etree._Element | None:
    """Return the only child called `name`, if any."""
    found = children.get(name)
    return found[0] if found else None
