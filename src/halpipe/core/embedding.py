"""Native models inside documents of other formats, with a hash that shows later changes of the document.

Exporter and importer of a format share these rules: the text in pieces, and the content that the hash covers.
"""

from __future__ import annotations

from hashlib import sha256
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterator

    from lxml import etree

FROZEN = "frozen"
"""Tag of an element that stands for complete ones, which were written already, with their hashes between zero bytes."""

PIECE = 2**20
"""Characters of one piece: parsers refuse texts of more than 10 MB."""


def pieces(document: bytes) -> Iterator[str]:
    """Yield the text of an XML document without its declaration, in pieces that end with a line."""
    text = document.decode("utf-8")
    if text.startswith("<?xml"):
        text = text[text.index("?>") + 2 :].lstrip()
    begin = 0
    while len(text) - begin > PIECE:
        end = text.rfind("\n", begin, begin + PIECE) + 1 or begin + PIECE
        yield text[begin:end]
        begin = end
    yield text[begin:]


def joined(texts: list[str], line: int) -> bytes:
    """Return the document of `pieces` that begins in a line of another one, so that messages name lines there."""
    return ("\n" * max(0, line - 1) + "".join(texts).lstrip()).encode("utf-8")


def package_hash(package: etree._Element) -> str:
    """Return the hash of an AUTOSAR package: its system, without the configuration that follows from a schedule.

    Special data are of tools, and the order of packages and of their elements means nothing.
    """
    return content_hash(
        package,
        leaves_out=lambda element: (tag := _local(element.tag)) == "ADMIN-DATA" or tag.startswith("ECUC-"),
        unordered=("AR-PACKAGES", "ELEMENTS"),
        volatile=("UUID", "T", "S"),
    )


def properties_hash(root: etree._Element) -> str:
    """Return the hash of an AMALTHEA model without the custom properties of halpipe."""
    return content_hash(root, leaves_out=lambda element: (element.get("key") or "").startswith("halpipe:"))


def content_hash(
    element: etree._Element,
    *,
    leaves_out: Callable[[etree._Element], bool],
    unordered: Container[str] = (),
    volatile: Container[str] = (),
) -> str:
    """Return the hash of an element, whatever blanks, prefixes and comments a tool writes.

    Elements that `leaves_out` names and `volatile` attributes do not count, nor does the order inside `unordered`.
    """
    return _hash(element, leaves_out, unordered, volatile).hex()


def _hash(
    element: etree._Element,
    leaves_out: Callable[[etree._Element], bool],
    unordered: Container[str],
    volatile: Container[str],
) -> bytes:
    tag = _local(element.tag)
    if tag == FROZEN:
        return bytes.fromhex(element.get("hash") or "")
    attributes = sorted((_local(name), value) for name, value in element.items() if _local(name) not in volatile)
    children = [
        _hash(child, leaves_out, unordered, volatile) for child in element.iterchildren("{*}*") if not leaves_out(child)
    ]
    if tag in unordered:
        children.sort()
    head = repr((tag, attributes, " ".join((element.text or "").split())))
    return sha256(b"\0".join([head.encode("utf-8", "replace"), *children])).digest()


def _local(name: object) -> str:
    return str(name).rpartition("}")[2]
