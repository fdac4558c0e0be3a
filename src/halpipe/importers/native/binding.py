"""Elements of both native formats, read by the tables of `halpipe.models.attributes` from schema-valid XML."""

from __future__ import annotations

from dataclasses import fields
from functools import cache
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Findings, Location, error
from halpipe.core.records import unchecked
from halpipe.models.attributes import Child, Codec, attributes_by_name, children
from halpipe.schemas import line_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from lxml import etree


BAD_VALUE = error(
    "HAL0103",
    "Value cannot be used",
    "The value has the right form but no exact meaning here, such as a size that is not a whole number of bytes.",
)


class Binder:
    """Reads the elements of one file and collects what cannot be read."""

    def __init__(self, file: str, namespace: str) -> None:
        self.file = file
        self.findings = Findings()
        self._namespace = f"{{{namespace}}}"
        self._prefix = len(self._namespace)

    def at(self, element: etree._Element) -> Location:
        """Return the place of an element."""
        return Location(self.file, line_of(element))

    def tag(self, name: str) -> str:
        """Return the tag of the elements of a name."""
        return f"{self._namespace}{name}"

    def element(self, kind: type, element: etree._Element) -> Any:
        """Return an element with all that it has within it, of which only the schema has been checked."""
        make, below, has_place = _plan(kind)
        found = self.values(kind, element)
        if below:
            within: dict[str, list[etree._Element]] = {}
            for child in element if len(element) else ():  # most have none
                within.setdefault(child.tag[self._prefix :], []).append(child)
            for one in below:
                found[one.field] = self._held(one, within)
        if has_place:
            found["at"] = self.at(element)
        return make(**found)

    def _held(self, one: Child, within: dict[str, list[etree._Element]]) -> Any:
        if one.section:
            held = within[one.section][0].findall(self.tag(one.tag)) if one.section in within else ()
        else:
            held = within.get(one.tag, ())
        if one.is_single:
            return self.element(one.kind, held[0]) if held else None
        return tuple([self.element(one.kind, each) for each in held])

    def values(self, kind: type, element: etree._Element, within: str = "") -> dict[str, Any]:
        """Return the attributes of a class that an element has, by field; what cannot be read is a finding."""
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


@cache
def _plan(kind: type) -> tuple[Callable[..., Any], tuple[Child, ...], bool]:
    """Return what makes an element of a class, what it has within it, and whether it knows its place.

    What reads attributes has made the types that a class would else look at again.
    """
    return unchecked(kind), children(kind), any(field.name == "at" for field in fields(kind))
