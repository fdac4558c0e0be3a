"""Elements common to all parts of an AMALTHEA document: ids, references, quantities, properties of halpipe."""

from __future__ import annotations

from typing import TYPE_CHECKING
from urllib.parse import quote_plus

from lxml import etree

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.core.durations import Duration

XSI = "http://www.w3.org/2001/XMLSchema-instance"
XMI = "http://www.omg.org/XMI"
_NAMESPACE = "http://app4mc.eclipse.org/amalthea/"
_TIME_UNITS = ("s", "ms", "us", "ns")


def document(release: str) -> etree._Element:
    """Start a document."""
    uri = _NAMESPACE + release
    root = etree.Element(f"{{{uri}}}Amalthea", nsmap={"am": uri, "xmi": XMI, "xsi": XSI})
    root.set(f"{{{XMI}}}version", "2.0")
    return root


def serialise(root: etree._Element) -> bytes:
    """Return the canonical bytes: UTF-8, two blanks of indentation, one newline at the end."""
    etree.indent(root, space="  ")
    body: bytes = etree.tostring(root, encoding="UTF-8", xml_declaration=False)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + body + b"\n"


def add(parent: etree._Element, tag: str, kind: str = "", **attributes: str | int) -> etree._Element:
    """Append an element, with its class where its tag does not tell it."""
    element = etree.SubElement(parent, tag)
    if kind:
        element.set(f"{{{XSI}}}type", f"am:{kind}")
    for name, value in attributes.items():
        element.set(name, str(value))
    return element


def named(parent: etree._Element, tag: str, kind: str, name: str, *, typed: bool = False) -> etree._Element:
    """Append an element that can be referred to; `typed` where its tag does not tell its class."""
    element = add(parent, tag, kind if typed else "")
    element.set(f"{{{XMI}}}id", ref(kind, name))
    element.set("name", name)
    return element


def ref(kind: str, *path: str) -> str:
    """Return a reference to an element by its class and name (encoded as Java's URLEncoder does)."""
    encoded = "/".join(quote_plus(name, safe="").replace("~", "%7E") for name in path)
    return f"{encoded}?type={kind}"


def refs(kind: str, names: Iterable[str]) -> str:
    """Return references to several elements of a class."""
    return " ".join(ref(kind, name) for name in names)


def add_time(parent: etree._Element, tag: str, time: Duration) -> None:
    """Append a time in the largest unit in which it is whole; others are cut to whole picoseconds."""
    for unit in _TIME_UNITS:
        if (value := time.in_unit(unit)).denominator == 1:
            add(parent, tag, value=value.numerator, unit=unit)
            return
    add(parent, tag, value=max(1, int(time.in_unit("ns") * 1000)), unit="ps")


def add_property(parent: etree._Element, key: str, value: str) -> None:
    """Append a custom property of halpipe."""
    holder = add(parent, "customProperties", key=f"halpipe:{key}")
    add(holder, "value", "StringObject", value=value)


class Unique:
    """Hands out names that are unique among those of one class."""

    def __init__(self) -> None:
        self._taken: set[str] = set()
        self._last: dict[str, int] = {}

    def __call__(self, name: str) -> str:
        """Return `name`, with a number behind it if it is taken."""
        chosen = name
        while chosen in self._taken:
            self._last[name] = self._last.get(name, 1) + 1
            chosen = f"{name}~{self._last[name]}"
        self._taken.add(chosen)
        return chosen
