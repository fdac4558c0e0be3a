"""What both writers share: elements whose empty attributes are left out, and one canonical form of bytes."""

from __future__ import annotations

import re
from functools import cache
from typing import TYPE_CHECKING

from lxml import etree

from halpipe.diagnostics import HalpipeError, error
from halpipe.schemas import check, namespace

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from halpipe.durations import Duration


UNWRITABLE = error(
    "HAL0104",
    "Value cannot be written",
    "The model or schedule holds a value that its file format cannot hold: a name with characters that names may not "
    "have, an empty list of names, white space inside an item of a list, or a number with too many digits. Nothing is "
    "written, because it could not be read back.",
)

_ILLEGAL = re.compile("[\0-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")  # all that XML 1.0 has not


def document(kind: str, **attributes: str | int | Duration | None) -> etree._Element:
    """Start a document of a kind, with its default namespace."""
    uri = namespace(kind)
    return etree.Element(f"{{{uri}}}{kind}", _texts(attributes), nsmap={None: uri})


def add(parent: etree._Element, tag: str, **attributes: str | int | Duration | None) -> etree._Element:
    """Append a child; attributes that are None are left out, and ``_`` in their names stands for ``-``.

    A trailing ``_`` escapes a Python keyword: ``from_`` writes ``from``.
    """
    return etree.SubElement(parent, parent.tag.rpartition("}")[0] + "}" + tag, _texts(attributes))


def _texts(attributes: Mapping[str, str | int | Duration | None]) -> dict[str, str]:
    return {_attribute(name): _legal(str(value)) for name, value in attributes.items() if value is not None}


@cache
def _attribute(name: str) -> str:
    return name.rstrip("_").replace("_", "-")


def _legal(text: str) -> str:
    """Return `text` without what XML cannot hold: file names may; in a name the replacement is found by the schema."""
    return text if text.isprintable() else _ILLEGAL.sub("\ufffd", text)


def listed(items: Iterable[str]) -> str:
    """Return a blank-separated list; raise `HalpipeError` for an item that would be read back as several."""
    found = list(items)
    for item in found:
        if not item or _BLANK.search(item):
            help = "rename it without white space"
            raise HalpipeError(UNWRITABLE(f"{item!r} cannot be an item of a list of names", help=help))
    return " ".join(found)


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
