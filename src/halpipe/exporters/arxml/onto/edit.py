"""Values changed in place: the bytes of a value are replaced, and every other byte of the file stays.

The place of a value is found by the byte offsets of the parser, in any encoding in which markup is ASCII.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.parsers import expat
from xml.sax.saxutils import escape

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.records import record
from halpipe.exporters.arxml.onto.codes import CANNOT_EDIT

if TYPE_CHECKING:
    from collections.abc import Sequence

_TAG = re.compile(rb"<(?:[^>'\"]|'[^']*'|\"[^\"]*\")*>")
_ENCODING = re.compile(rb"<\?xml[^>]*encoding=[\"']([A-Za-z0-9._-]+)")


@record
class Edit:
    """A change in a container (path): a reference `name` from `old` to `new` (None: not set), or all of it removed.

    The container is removed where `name` is empty.
    """

    file: str
    path: str
    name: str = ""
    old: str = ""
    new: str | None = None


@dataclass(slots=True)
class _Element:
    tag: str
    start: int
    name: str = ""
    text: str = ""
    definition: str = ""
    value: tuple[int, int, int, int, str] | None = None
    inner: int = 0


def apply_edits(data: bytes, file: str, edits: Sequence[Edit]) -> bytes:
    """Return the file with every change; raise `HalpipeError` if one of the values is not there."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff") or (data[:1] != b"<" and data[:3] != b"\xef\xbb\xbf"):
        raise _cannot(file, "is not in an encoding in which markup is ASCII")
    found = _Finder(data, edits).spans()
    for edit in edits:
        if edit not in found:
            raise _cannot(file, f"has no {edit.name or 'container'} {edit.old} in {edit.path}")
    match = _ENCODING.match(data[3:] if data[:3] == b"\xef\xbb\xbf" else data)
    encoding = match[1].decode() if match else "utf-8"
    result, end = bytearray(), 0
    for (start, stop), edit in sorted((span, edit) for edit, span in found.items()):
        result += data[end:start]
        if edit.new is not None:
            result += escape(edit.new).encode(encoding, "xmlcharrefreplace")
        end = stop
    return bytes(result + data[end:])


def _cannot(file: str, message: str) -> HalpipeError:
    help = "import the project again, or make the change in the tool that wrote the file"
    return HalpipeError(CANNOT_EDIT(message, at=Location(file), help=help))


class _Finder:
    """Walks a file and notes the bytes of what is to be changed."""

    def __init__(self, data: bytes, edits: Sequence[Edit]) -> None:
        self._data = data
        self._stack: list[_Element] = []
        self._path: list[str] = []
        self._wanted: dict[tuple[str, str, str], Edit] = {(e.path, e.name, e.old): e for e in edits}
        self._found: dict[Edit, tuple[int, int]] = {}
        self._parser = expat.ParserCreate(namespace_separator=" ")
        self._parser.StartElementHandler = self._begin
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text
        self._parser.buffer_text = True

    def spans(self) -> dict[Edit, tuple[int, int]]:
        """Return the span of bytes of every change that was found."""
        self._parser.Parse(self._data, True)
        return self._found

    def _begin(self, tag: str, _: object) -> None:
        self._stack.append(_Element(tag.rpartition(" ")[2], self._parser.CurrentByteIndex))

    def _text(self, text: str) -> None:
        self._stack[-1].text += text

    def _end(self, _: str) -> None:
        element = self._stack.pop()
        at = self._parser.CurrentByteIndex
        stop = tag_end(self._data, at) if self._data.startswith(b"</", at) else at  # after <a/> it is at its end
        holder = self._stack[-1] if self._stack else None
        text = "".join(element.text.split())
        if element.tag == "SHORT-NAME" and holder is not None and not holder.name:
            holder.name = text
            self._path.append(text)
        elif element.tag == "DEFINITION-REF" and holder is not None:
            holder.definition = text.rpartition("/")[2]
        elif element.tag == "VALUE-REF" and holder is not None:
            opened = tag_end(self._data, element.start)
            holder.value = (element.start, stop, opened, at, text)
        elif element.tag == "ECUC-REFERENCE-VALUE" and element.value is not None:
            self._note_value(element)
        if element.name:
            edit = self._wanted.get(("/" + "/".join(self._path), "", ""))
            if edit is not None and element.tag == "ECUC-CONTAINER-VALUE":
                self._found.setdefault(edit, (element.start, stop))
            self._path.pop()

    def _note_value(self, element: _Element) -> None:
        assert element.value is not None
        start, stop, opened, closed, text = element.value
        edit = self._wanted.get(("/" + "/".join(self._path), element.definition, text))
        if edit is not None:
            self._found.setdefault(edit, (start, stop) if edit.new is None else (opened, closed))


def tag_end(data: bytes, start: int) -> int:
    """Return the place after the `>` that ends a tag; one inside an attribute does not."""
    match = _TAG.match(data, start)
    assert match is not None
    return match.end()
