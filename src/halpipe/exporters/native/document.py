"""XML form of both native writers: empty attributes are left out, bytes are canonical."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, cast

from lxml import etree

from halpipe.core.diagnostics import HalpipeError, error
from halpipe.models.attributes import attributes, children, texts
from halpipe.schemas import check, namespace

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

UNWRITABLE = error(
    "HAL0104",
    "Value cannot be written",
    "The model or schedule holds a value that its file format cannot hold: a name with characters that names may not "
    "have, an empty list of names, white space inside an item of a list, or a number with too many digits. Nothing is "
    "written, because it could not be read back.",
)

_ILLEGAL = re.compile("[\0-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")  # all that XML 1.0 has not


def document(kind: str, attributes: Mapping[str, str]) -> etree._Element:
    """Start a document of a kind, with its default namespace."""
    uri = namespace(kind)
    return etree.Element(f"{{{uri}}}{kind}", _legal(attributes), nsmap={None: uri})


def add(parent: etree._Element, tag: str, attributes: Mapping[str, str] | None = None) -> etree._Element:
    """Append a child."""
    return etree.SubElement(parent, parent.tag.rpartition("}")[0] + "}" + tag, _legal(attributes or {}))


class Writer:
    """Writes elements of the model or schedule, each with its attributes and all that it has within it."""

    def attributes(self, value: Any) -> dict[str, str]:
        """Return the attributes of an element."""
        return attributes_of(value)

    def element(self, parent: etree._Element, tag: str, value: Any) -> etree._Element:
        """Append an element as a child."""
        element, kind = add(parent, tag, self.attributes(value)), cast("type", type(value))
        for one in children(kind):
            held = getattr(value, one.field)
            for each in (() if held is None else (held,)) if one.is_single else held:
                self.element(element, one.tag, each)
        return element


def attributes_of(value: Any, element: str = "") -> dict[str, str]:
    """Return the attributes of an element; raise `HalpipeError` for lists that would be read back differently."""
    for stated in attributes(type(value), element):
        if stated.codec.is_list:
            _check_items(getattr(value, stated.field))
    return texts(value, element=element)


def _legal(attributes: Mapping[str, str]) -> dict[str, str]:
    """Return texts without what XML cannot hold: file names may; in a name the replacement is found by the schema."""
    return {name: text if text.isprintable() else _ILLEGAL.sub("\ufffd", text) for name, text in attributes.items()}


def _check_items(items: Iterable[str]) -> None:
    """Raise `HalpipeError` for an item that would be read back as several."""
    for item in items:
        if not item or _BLANK.search(item):
            help = "rename it without white space"
            raise HalpipeError(UNWRITABLE(f"{item!r} cannot be an item of a list of names", help=help))


_BLANK = re.compile(r"[ \t\r\n]")


def serialise(root: etree._Element, kind: str) -> bytes:
    """Return the canonical bytes: UTF-8, two blanks of indentation, one newline at the end.

    Raise `HalpipeError` when they would not follow the schema of `kind`, so that what is written can be read.
    """
    violations = check(root, kind, "")
    if violations:
        help = "rename or repair it where it comes from"
        raise HalpipeError(*(UNWRITABLE(v.message, help=help) for v in violations))
    etree.indent(root, space="  ")
    body: bytes = etree.tostring(root, encoding="UTF-8", xml_declaration=False)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + body + b"\n"
