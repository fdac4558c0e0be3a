"""Documents written as they are made: a complete element becomes text, and a small one takes its place.

A tree takes ten times the bytes that it writes. The hash of a document (`halpipe.core.embedding`) knows the small ones.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from lxml import etree

from halpipe.core.embedding import FROZEN

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

_STAND_IN = re.compile(rb'<frozen n="(\d+)" hash="[0-9a-f]+"/>')
_DECLARATIONS = re.compile(rb'(?: xmlns(?::\w+)?="[^"]*")+')  # what only the root needs


def freeze(element: etree._Element, texts: list[bytes], hash_of: Callable[[etree._Element], str]) -> None:
    """Put a complete element into `texts`, and a small one in its place."""
    hash = hash_of(element)
    etree.indent(element, space="  ", level=sum(1 for _ in element.iterancestors()))
    text: bytes = etree.tostring(element, encoding="UTF-8", xml_declaration=False, with_tail=False)
    holder = element.getparent()
    assert holder is not None
    stand_in = etree.SubElement(
        holder, etree.QName(etree.QName(element).namespace, FROZEN), n=str(len(texts)), hash=hash
    )
    holder.replace(element, stand_in)
    texts.append(_DECLARATIONS.sub(b"", text, count=1))


def freeze_children(parent: etree._Element, texts: list[bytes], hash_of: Callable[[etree._Element], str]) -> None:
    """Freeze the last children that are not yet, all of which are complete, as one."""
    fresh = []
    for child in parent.iterchildren(reversed=True):
        if child.tag == FROZEN:
            break
        fresh.append(child)
    if not fresh:
        return
    fresh.reverse()
    hashes = b"\0".join(bytes.fromhex(hash_of(child)) for child in fresh)
    holder = etree.SubElement(parent, FROZEN)
    holder.extend(fresh)
    etree.indent(holder, space="  ", level=sum(1 for _ in parent.iterancestors()))
    text: bytes = etree.tostring(holder, encoding="UTF-8", xml_declaration=False, with_tail=False)
    parent.remove(holder)
    etree.SubElement(parent, FROZEN, n=str(len(texts)), hash=hashes.hex())
    texts.append(text[text.index(b">") + 1 : text.rindex(b"</")].strip())


def serialise(root: etree._Element, texts: Sequence[bytes] = ()) -> bytes:
    """Return the canonical bytes: UTF-8, two blanks of indentation, one newline at the end; `texts` are the frozen."""
    etree.indent(root, space="  ")
    body: bytes = etree.tostring(root, encoding="UTF-8", xml_declaration=False)
    parts = [b'<?xml version="1.0" encoding="UTF-8"?>\n']
    for number, part in enumerate(_STAND_IN.split(body)):
        parts.append(texts[int(part)] if number % 2 else part)
    return b"".join((*parts, b"\n"))
