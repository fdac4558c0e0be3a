"""Elements common to all parts of an ARXML document: references, special data, times, configuration containers."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from decimal import Context, Decimal
from fractions import Fraction
from typing import TYPE_CHECKING, NamedTuple

from lxml import etree

from halpipe.core.embedding import package_hash
from halpipe.exporters.arxml.options import RELEASES
from halpipe.exporters.common import frozen

if TYPE_CHECKING:
    from halpipe.core.durations import Duration
    from halpipe.models.project import Starter

NAMESPACE = "http://autosar.org/schema/r4.0"
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_NS = f"{{{NAMESPACE}}}"
_ILLEGAL = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_MICROSECONDS = "0"  # the CSE-CODE that all tools know
_DOUBLE = Context(prec=15)
"""What survives the double of other tools: 15 significant digits."""


def document(schema: str) -> etree._Element:
    """Start a document that names a schema (empty: none) for its namespace."""
    root = etree.Element(f"{_NS}AUTOSAR", nsmap={None: NAMESPACE, "xsi": _XSI})
    if schema:
        root.set(f"{{{_XSI}}}schemaLocation", schema)
    return root


def freeze(element: etree._Element, texts: list[bytes]) -> None:
    """Put a complete element into `texts`, and a small one in its place."""
    frozen.freeze(element, texts, package_hash)


def is_from(release: str, first: str) -> bool:
    """Return whether a release is `first` or a later one."""
    known = list(RELEASES)
    return known.index(release) >= known.index(first)


# --------------------------------------------------------------------------------------------------- elements


def add(parent: etree._Element, tag: str, text: str | None = None) -> etree._Element:
    """Append an element."""
    element = etree.SubElement(parent, _NS + tag)
    if text is not None:
        element.text = _ILLEGAL.sub("\ufffd", text)  # file names may hold what XML cannot
    return element


def named(parent: etree._Element, tag: str, short_name: str, description: str = "") -> etree._Element:
    """Append an element with a short name."""
    element = add(parent, tag)
    add(element, "SHORT-NAME", short_name)
    if description:
        add(add(element, "DESC"), "L-2", description).set("L", "EN")
    return element


def package(parent: etree._Element, short_name: str) -> etree._Element:
    """Append a package and return the place of its elements."""
    return add(named(parent, "AR-PACKAGE", short_name), "ELEMENTS")


def ref(parent: etree._Element, tag: str, dest: str, path: str) -> etree._Element:
    """Append a reference to an element by its class and path."""
    element = add(parent, tag, path)
    element.set("DEST", dest)
    return element


# ----------------------------------------------------------------------------------------- special data groups


def special(element: etree._Element, kind: str) -> etree._Element:
    """Append a special data group of halpipe; call it before anything but the short name is in `element`."""
    data = element.find(f"{_NS}ADMIN-DATA")
    groups = add(add(element, "ADMIN-DATA"), "SDGS") if data is None else data[0]
    return group(groups, kind)


def group(parent: etree._Element, kind: str) -> etree._Element:
    """Append a group inside another."""
    element = add(parent, "SDG")
    element.set("GID", f"halpipe:{kind}")
    return element


def sd(parent: etree._Element, key: str, value: object) -> None:
    """Append a value to a group; None is left out."""
    if value is not None:
        add(parent, "SD", str(value)).set("GID", key)


def sdx(parent: etree._Element, dest: str, path: str) -> None:
    """Append a reference to a group, which every tool checks like its own."""
    ref(parent, "SDX-REF", dest, path)


# ------------------------------------------------------------------------------------------------------- times


def seconds_text(time: Duration) -> tuple[str, bool]:
    """Return a time in seconds as a floating point number of 15 digits, and whether that is exact."""
    value = time.in_unit("s")
    found = _DOUBLE.divide(Decimal(value.numerator), Decimal(value.denominator)).normalize(_DOUBLE)
    plain = f"{found:f}"
    return plain if len(plain) <= 20 else str(found), value == Fraction(found)


def add_time(parent: etree._Element, tag: str, time: Duration, *, up: bool) -> None:
    """Append a time in whole microseconds, rounded up or down."""
    value = time.in_unit("us")
    whole = math.ceil(value) if up else math.floor(value)
    element = add(parent, tag)
    add(element, "CSE-CODE", _MICROSECONDS)
    add(element, "CSE-CODE-FACTOR", str(whole))


# ------------------------------------------------------------------------------------------------- containers

CONTAINER = "ECUC-CONTAINER-VALUE"
MODULE = "ECUC-MODULE-CONFIGURATION-VALUES"
MODULE_DEF, PARAMETERS = "ECUC-MODULE-DEF", "ECUC-PARAM-CONF-CONTAINER-DEF"
_REFERENCE = "ECUC-REFERENCE-DEF"


class Reference(NamedTuple):
    """A reference of a container: its name, the path of its target, the classes of its definition and its target."""

    name: str
    path: str
    definition: str = _REFERENCE
    dest: str = CONTAINER


@dataclass(slots=True)
class Box:
    """A configuration of a module, or a container in one: to be written in the order that the schema demands.

    `data` are special data groups; `stopped` are the alarms and tables that a container put onto a project replaces,
    None for any other. What an export puts onto a project repeats the project's containers, with their
    UUID; `repeated` are targets that the project has already, by the name of the reference: a merge knows the values
    of a list by their definition, and takes a second value for a contradiction unless the first stands before it.
    """

    path: str
    definition: str
    dest: str = PARAMETERS
    uuid: str = ""
    is_new: bool = False
    stopped: tuple[Starter, ...] | None = None
    data: list[etree._Element] = field(default_factory=list)
    values: list[tuple[str, str, str, str]] = field(default_factory=list)
    refs: list[Reference] = field(default_factory=list)
    repeated: dict[str, list[str]] = field(default_factory=dict)
    inside: dict[str, Box] = field(default_factory=dict)

    @property
    def is_module(self) -> bool:
        """Whether it is the configuration of a module."""
        return self.dest == MODULE_DEF

    @property
    def kind(self) -> str:
        """The short name of its definition."""
        return self.definition.rpartition("/")[2]

    def new(self, name: str, kind: str) -> Box:
        """Append a new container of a definition, by its short name."""
        box = self.inside[name] = Box(f"{self.path}/{name}", f"{self.definition}/{kind}", is_new=True)
        return box

    def special(self, kind: str) -> etree._Element:
        """Append a special data group of halpipe."""
        element = group(etree.Element(f"{_NS}SDGS"), kind)
        self.data.append(element)
        return element

    def fill(self, **values: int | str) -> Box:
        """Append parameters by their names: booleans, integers and words of enumerations; return the box."""
        for name, value in values.items():
            if isinstance(value, str):
                self.values.append(("TEXTUAL", "ENUMERATION", name, value))
            else:
                kind = "BOOLEAN" if isinstance(value, bool) else "INTEGER"
                self.values.append(("NUMERICAL", kind, name, str(value).lower()))
        return self

    def number(self, name: str, text: str) -> None:
        """Append a floating point parameter."""
        self.values.append(("NUMERICAL", "FLOAT", name, text))

    def text(self, name: str, value: str) -> None:
        """Append a string parameter."""
        self.values.append(("TEXTUAL", "STRING", name, value))

    def refer(self, name: str, path: str, *, definition: str = _REFERENCE, dest: str = CONTAINER) -> None:
        """Append a reference to another container, once."""
        found = Reference(name, path, definition, dest)
        if found not in self.refs and path not in self.repeated.get(name, ()):
            self.refs.append(found)


def write_box(parent: etree._Element, box: Box, texts: list[bytes] | None = None) -> None:
    """Append a module configuration or container with all that is in it; its containers go into `texts`, if given."""
    element = named(parent, MODULE if box.is_module else CONTAINER, box.path.rpartition("/")[2])
    if box.uuid:
        element.set("UUID", box.uuid)
    if box.data:
        add(add(element, "ADMIN-DATA"), "SDGS").extend(box.data)
    ref(element, "DEFINITION-REF", box.dest, box.definition)
    if box.is_module and box.is_new:
        add(element, "IMPLEMENTATION-CONFIG-VARIANT", "VARIANT-PRE-COMPILE")
    if box.values:
        holder = add(element, "PARAMETER-VALUES")
        for form, kind, name, text in box.values:
            value = add(holder, f"ECUC-{form}-PARAM-VALUE")
            ref(value, "DEFINITION-REF", f"ECUC-{kind}-PARAM-DEF", f"{box.definition}/{name}")
            add(value, "VALUE", text)
    if box.refs:
        holder = add(element, "REFERENCE-VALUES")
        names = dict.fromkeys(reference.name for reference in box.refs)
        known = [Reference(name, path) for name in names for path in box.repeated.get(name, ())]
        for reference in (*known, *box.refs):
            value = add(holder, "ECUC-REFERENCE-VALUE")
            ref(value, "DEFINITION-REF", reference.definition, f"{box.definition}/{reference.name}")
            ref(value, "VALUE-REF", reference.dest, reference.path)
    if box.inside or box.is_module:
        holder = add(element, "CONTAINERS" if box.is_module else "SUB-CONTAINERS")
        for inner in box.inside.values():
            write_box(holder, inner)
            if texts is not None:
                freeze(holder[-1], texts)
