"""Elements common to all parts of an ARXML document: references, special data, times, configuration containers."""

from __future__ import annotations

import math
import re
from decimal import Context, Decimal
from fractions import Fraction
from typing import TYPE_CHECKING

from lxml import etree

from halpipe.exporters.arxml.options import RELEASES

if TYPE_CHECKING:
    from halpipe.core.durations import Duration

NAMESPACE = "http://autosar.org/schema/r4.0"
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_NS = f"{{{NAMESPACE}}}"
_ILLEGAL = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_MICROSECONDS = "0"  # the CSE-CODE that all tools know
_DOUBLE = Context(prec=15)
"""What survives the double of other tools: 15 significant digits."""


def document(release: str) -> tuple[etree._Element, etree._Element]:
    """Start a document of a release; return its root and the element for its packages."""
    root = etree.Element(f"{_NS}AUTOSAR", nsmap={None: NAMESPACE, "xsi": _XSI})
    root.set(f"{{{_XSI}}}schemaLocation", f"{NAMESPACE} {RELEASES[release]}")
    return root, add(root, "AR-PACKAGES")


def serialise(root: etree._Element) -> bytes:
    """Return the canonical bytes: UTF-8, two blanks of indentation, one newline at the end."""
    etree.indent(root, space="  ")
    body: bytes = etree.tostring(root, encoding="UTF-8", xml_declaration=False)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + body + b"\n"


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


CONTAINER = "ECUC-CONTAINER-VALUE"
_REFERENCE, _FOREIGN = "ECUC-REFERENCE-DEF", "ECUC-FOREIGN-REFERENCE-DEF"


class Module:
    """The configuration of one module; `prefix` is where the definitions of modules are, `base` its package."""

    def __init__(self, elements: etree._Element, name: str, prefix: str, base: str) -> None:
        self._definition = f"{prefix}/{name}"
        self._path = f"{base}/{name}"
        element = named(elements, "ECUC-MODULE-CONFIGURATION-VALUES", name)
        ref(element, "DEFINITION-REF", "ECUC-MODULE-DEF", self._definition)
        add(element, "IMPLEMENTATION-CONFIG-VARIANT", "VARIANT-PRE-COMPILE")
        self._containers = add(element, "CONTAINERS")

    def container(self, kind: str, short_name: str) -> Container:
        """Append a container of the definition `kind`."""
        element = named(self._containers, CONTAINER, short_name)
        return Container(element, f"{self._path}/{short_name}", f"{self._definition}/{kind}")


class Container:
    """A container; whatever is appended must come in the order special data, parameters, references, containers.

    `definition` is the class of the definition that a value or reference has beside the one expected.
    """

    def __init__(self, element: etree._Element, path: str, definition: str) -> None:
        self.element = element
        self.path = path
        self._definition = definition

    def define(self) -> None:
        """Append the definition; special data stand before it."""
        ref(self.element, "DEFINITION-REF", "ECUC-PARAM-CONF-CONTAINER-DEF", self._definition)

    def integer(self, name: str, value: int) -> None:
        """Append an integer parameter."""
        self._value("NUMERICAL", "INTEGER", name, str(value))

    def number(self, name: str, text: str) -> None:
        """Append a floating point parameter."""
        self._value("NUMERICAL", "FLOAT", name, text)

    def flag(self, name: str, *, value: bool) -> None:
        """Append a boolean parameter."""
        self._value("NUMERICAL", "BOOLEAN", name, "true" if value else "false")

    def choice(self, name: str, value: str) -> None:
        """Append an enumeration parameter."""
        self._value("TEXTUAL", "ENUMERATION", name, value)

    def text(self, name: str, value: str) -> None:
        """Append a string parameter."""
        self._value("TEXTUAL", "STRING", name, value)

    def refer(self, name: str, path: str, *, definition: str = _REFERENCE, dest: str = CONTAINER) -> None:
        """Append a reference to another container."""
        element = add(self._list("REFERENCE-VALUES"), "ECUC-REFERENCE-VALUE")
        ref(element, "DEFINITION-REF", definition, f"{self._definition}/{name}")
        ref(element, "VALUE-REF", dest, path)

    def refer_outside(self, name: str, path: str, dest: str) -> None:
        """Append a reference to an element of the system."""
        self.refer(name, path, definition=_FOREIGN, dest=dest)

    def inside(self, kind: str, short_name: str, *, defined: bool = True) -> Container:
        """Append a container inside this one, with its definition unless special data are to come before."""
        element = named(self._list("SUB-CONTAINERS"), CONTAINER, short_name)
        inner = Container(element, f"{self.path}/{short_name}", f"{self._definition}/{kind}")
        if defined:
            inner.define()
        return inner

    def _value(self, form: str, kind: str, name: str, text: str) -> None:
        element = add(self._list("PARAMETER-VALUES"), f"ECUC-{form}-PARAM-VALUE")
        ref(element, "DEFINITION-REF", f"ECUC-{kind}-PARAM-DEF", f"{self._definition}/{name}")
        add(element, "VALUE", text)

    def _list(self, tag: str) -> etree._Element:
        last = self.element[-1]
        return last if last.tag == f"{{{NAMESPACE}}}{tag}" else add(self.element, tag)
