"""What both writers share: elements whose empty attributes are left out, and one canonical form of bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lxml import etree

if TYPE_CHECKING:
    from halpipe.durations import Duration


def document(tag: str, namespace: str) -> etree._Element:
    """Start a document with its default namespace."""
    return etree.Element(f"{{{namespace}}}{tag}", nsmap={None: namespace})


def add(parent: etree._Element, tag: str, **attributes: str | int | Duration | None) -> etree._Element:
    """Append a child; attributes that are None are left out, and ``_`` in their names stands for ``-``.

    A trailing ``_`` escapes a Python keyword: ``from_`` writes ``from``.
    """
    child = etree.SubElement(parent, parent.tag.rpartition("}")[0] + "}" + tag)
    for name, value in attributes.items():
        if value is not None:
            child.set(name.rstrip("_").replace("_", "-"), str(value))
    return child


def serialise(root: etree._Element) -> bytes:
    """Return the canonical bytes: UTF-8, two blanks of indentation, one newline at the end."""
    etree.indent(root, space="  ")
    body: bytes = etree.tostring(root, encoding="UTF-8", xml_declaration=False)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + body + b"\n"
