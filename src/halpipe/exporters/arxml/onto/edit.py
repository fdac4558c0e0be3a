"""Files of a project changed in place: the bytes of a value are replaced, and every other byte stays.

The place of a value is found by the byte offsets of the parser, in any encoding in which markup is ASCII. In EB tresos
project data (``.xdm``), a value that is touched is enabled, and no longer said to come from an importer, so that a next
calculation of the tool leaves it. A container that is taken away is disabled, and additions go into the file itself."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.records import record
from halpipe.exporters.arxml.codes import CANNOT_EDIT

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.exporters.arxml.document import Box

_TAG = re.compile(rb"<(?:[^>'\"]|'[^']*'|\"[^\"]*\")*>")
_ENCODING = re.compile(rb"<\?xml[^>]*encoding=[\"']([A-Za-z0-9._-]+)")


@record
class Edit:
    """A change in a container (path): a reference `name` from `old` to `new` (None: not set), or all of it removed.

    The container is removed where `name` is empty. `at` tells one variant of an element from another (line 0: any).
    """

    at: Location
    path: str
    name: str = ""
    old: str = ""
    new: str | None = None


@dataclass(slots=True)
class _Element:
    """An element of a file: its bytes, those between its tags, and what is known of it so far.

    In ARXML that is its short name, text and definition, and of a reference the bytes of its value; in project data its
    attributes, the path of its container, its value, where it says whether it is enabled, and whether a list holds it.
    """

    tag: str
    start: int
    opened: int
    closed: int = 0
    end: int = 0
    name: str = ""
    type: str = ""
    text: str = ""
    definition: str = ""
    value: _Element | None = None
    container: str = ""
    enable: tuple[int, int] | None = None
    stated: str = ""
    is_listed: bool = False

    @property
    def is_empty(self) -> bool:
        """Whether it is one tag, without content."""
        return self.closed == self.end


class _Walker:
    """Walks the elements of a file, each with its bytes, in the order in which they end."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._stack: list[_Element] = []
        self._parser = expat.ParserCreate(namespace_separator=" ")
        self._parser.StartElementHandler = self._begin
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text
        self._parser.buffer_text = True

    def _begin(self, tag: str, attributes: dict[str, str]) -> None:
        at = self._parser.CurrentByteIndex
        element = _Element(tag.rpartition(" ")[2], at, tag_end(self._data, at))
        self.enter(element, attributes, self._stack[-1] if self._stack else None)
        self._stack.append(element)

    def _text(self, text: str) -> None:
        self._stack[-1].text += text

    def _end(self, _: str) -> None:
        element, at = self._stack.pop(), self._parser.CurrentByteIndex
        is_empty = self._data.endswith(b"/>", element.start, element.opened)  # what follows is the end of another
        element.closed, element.end = (element.opened, element.opened) if is_empty else (at, tag_end(self._data, at))
        self.leave(element, self._stack[-1] if self._stack else None)

    def enter(self, element: _Element, attributes: dict[str, str], holder: _Element | None) -> None:
        """Note what the begin of an element states."""

    def leave(self, element: _Element, holder: _Element | None) -> None:
        """Note a complete element."""


def apply_edits(data: bytes, file: str, edits: Sequence[Edit]) -> bytes:
    """Return the file with every change; raise `HalpipeError` if one of the values is not there."""
    _check_encoding(data, file)
    found = _Finder(data, edits).spans()
    for edit in edits:
        if edit not in found:
            raise _cannot(file, f"has no {edit.name or 'container'} {edit.old} in {edit.path}")
    match = _ENCODING.match(data)  # behind a byte order mark all is UTF-8
    changes = [(*span, escape(edit.new or "")) for edit, span in found.items()]
    return _spliced(data, changes, match[1].decode() if match else "utf-8")


def _spliced(data: bytes, changes: list[tuple[int, int, str]], encoding: str) -> bytes:
    """Return the bytes with texts in place of spans."""
    result, end = bytearray(), 0
    for start, stop, text in sorted(changes):
        result += data[end:start] + text.encode(encoding, "xmlcharrefreplace")
        end = stop
    return bytes(result + data[end:])


def _check_encoding(data: bytes, file: str) -> None:
    if data[:2] in (b"<\0", b"\xff\xfe", b"\xfe\xff") or (data[:1] != b"<" and data[:3] != b"\xef\xbb\xbf"):
        raise _cannot(file, "is not in an encoding in which markup is ASCII")


def _cannot(file: str, message: str) -> HalpipeError:
    help = "import the project again, or make the change in the tool that wrote the file"
    return HalpipeError(CANNOT_EDIT(message, at=Location(file), help=help))


class _Finder(_Walker):
    """Finds the bytes of what is to be changed in ARXML."""

    def __init__(self, data: bytes, edits: Sequence[Edit]) -> None:
        super().__init__(data)
        self._path: list[str] = []
        self._wanted: dict[tuple[str, str, str], list[Edit]] = {}
        for edit in edits:
            self._wanted.setdefault((edit.path, edit.name, edit.old), []).append(edit)
        self._found: dict[Edit, tuple[int, int]] = {}

    def spans(self) -> dict[Edit, tuple[int, int]]:
        """Return the span of bytes of every change that was found."""
        self._parser.Parse(self._data, True)
        return self._found

    def leave(self, element: _Element, holder: _Element | None) -> None:
        text = "".join(element.text.split())
        if element.tag == "SHORT-NAME" and holder is not None and not holder.name:
            holder.name = text
            self._path.append(text)
        elif element.tag == "DEFINITION-REF" and holder is not None:
            holder.definition = text.rpartition("/")[2]
        elif element.tag == "VALUE-REF" and holder is not None:
            holder.value = element
        elif element.tag == "ECUC-REFERENCE-VALUE" and (value := element.value) is not None:
            for edit in self._edits_of(value, element.definition, "".join(value.text.split())):
                span = (value.start, value.end) if edit.new is None else (value.opened, value.closed)
                self._found.setdefault(edit, span)
        if element.name:
            for edit in self._edits_of(element) if element.tag == "ECUC-CONTAINER-VALUE" else ():
                self._found.setdefault(edit, (element.start, element.end))
            self._path.pop()

    def _edits_of(self, element: _Element, name: str = "", old: str = "") -> Iterator[Edit]:
        """Yield the edits of an element of the current path; parsers count its line where its first tag ends."""
        for edit in self._wanted.get(("/" + "/".join(self._path), name, old), ()):
            if not edit.at.line or edit.at.line == 1 + self._data.count(b"\n", 0, element.opened):
                yield edit


def tag_end(data: bytes, start: int) -> int:
    """Return the place after the `>` that ends a tag; one inside an attribute does not."""
    match = _TAG.match(data, start)
    assert match is not None
    return match.end()


_SEVERAL = ("OsSchTblAccessingApplication", "OsScheduleTableAppModeRef")
_ENABLED = '<a:a name="ENABLE" value="{}"/>'


class _Index(_Walker):
    """The elements of project data: containers by path, lists and values by the path of their container and name."""

    def __init__(self, data: bytes) -> None:
        super().__init__(data)
        self.containers: dict[str, _Element] = {}
        self.lists: dict[tuple[str, str], _Element] = {}
        self.values: dict[tuple[str, str], _Element] = {}
        self._parser.Parse(data, True)

    def enter(self, element: _Element, attributes: dict[str, str], holder: _Element | None) -> None:
        element.name, element.type = attributes.get("name", ""), attributes.get("type", "")
        if holder is not None:
            element.is_listed = holder.tag == "lst"
            element.stated = attributes.get("value", "").removeprefix("ASPath:")
            element.container = _path_of(element, holder)
            if element.tag == "a" and element.name == "ENABLE":
                holder.enable = (element.start, element.opened)

    def leave(self, element: _Element, holder: _Element | None) -> None:
        if element.tag in ("ctr", "chc"):
            self.containers[element.container] = element
        elif element.tag == "lst" and element.name:
            self.lists[element.container, element.name] = element
        elif element.tag in ("var", "ref") and holder is not None:
            self.values[element.container, element.name or f"{holder.name} {element.stated}"] = element


def _path_of(element: _Element, holder: _Element) -> str:
    """Return the path of the container that an element is, or in which it is."""
    if element.type == "AR-PACKAGE":
        return f"/{element.name}"
    if element.type == "AR-ELEMENT" or (element.tag in ("ctr", "chc") and element.type != "MODULE-CONFIGURATION"):
        return f"{holder.container}/{element.name}" if element.name else holder.container
    return holder.container


def apply_to_xdm(data: bytes, file: str, module: Box | None, edits: Sequence[Edit]) -> bytes:
    """Return the file of a module with what a delta adds to it, and with every change."""
    _check_encoding(data, file)
    index = _Index(data)
    changes: list[tuple[int, int, str]] = []
    if module is not None:
        changes += _additions(index, module, data)
    changes += (_change(index, edit, data, file) for edit in edits)
    return _spliced(data, _joined(changes), "ascii")  # which is right in any encoding


def _joined(changes: list[tuple[int, int, str]]) -> list[tuple[int, int, str]]:
    """Put insertions at one place together; replacements of one element are what they are."""
    found: dict[tuple[int, int], str] = {}
    for start, stop, text in changes:
        found[start, stop] = found.get((start, stop), "") + text if start == stop else text
    return [(start, stop, text) for (start, stop), text in found.items()]


# ------------------------------------------------------------------------------------------------------ additions


def _additions(index: _Index, box: Box, data: bytes) -> Iterator[tuple[int, int, str]]:
    """Yield what a repeated container gets: new containers, and references."""
    holder = index.containers[box.path]
    lists: dict[str, list[str]] = {}
    for inner in box.inside.values():
        if inner.is_new:
            lists.setdefault(inner.kind, []).append(_container(inner))
        else:
            yield from _additions(index, inner, data)
    for kind, texts in lists.items():
        found = index.lists.get((box.path, kind))
        if found is None:
            yield _inside(holder, f'<d:lst name="{kind}" type="MAP">{"".join(texts)}</d:lst>', data)
        else:
            yield _inside(found, "".join(texts), data)
    several: dict[str, list[str]] = {}
    for name, path, *_ in box.refs:
        if (box.path, name) in index.lists:
            several.setdefault(name, []).append(f'<d:ref type="REFERENCE" value={_path(path)}/>')
            continue
        known = index.values.get((box.path, name))
        text = _reference(name, path)
        yield _inside(holder, text, data) if known is None else (known.start, known.end, text)
    for name, texts in several.items():
        yield _inside(index.lists[box.path, name], "".join(texts), data)


def _inside(element: _Element, text: str, data: bytes) -> tuple[int, int, str]:
    """Return the change that puts text at the end of an element, which may be one tag so far."""
    if not element.is_empty:
        return element.closed, element.closed, text
    tag = data[element.start : element.end].decode().rstrip(">").rstrip("/").rstrip()
    name = tag[1:].split(None, 1)[0]
    return element.start, element.end, f"{tag}>{text}</{name}>"


def _path(path: str) -> str:
    return quoteattr(f"ASPath:{path}")


def _reference(name: str, path: str | None) -> str:
    value = f" value={_path(path)}" if path else ""
    return f'<d:ref name="{name}" type="REFERENCE"{value}>{_ENABLED.format("true" if path else "false")}</d:ref>'


def _container(box: Box) -> str:
    parts = [f'<d:ctr name="{box.path.rpartition("/")[2]}" type="IDENTIFIABLE">']
    if box.stopped is not None:
        stopped = ";".join(f"{alarm.path},{alarm.cycle},{alarm.start}" for alarm in box.stopped)
        parts.append(f'<a:a name="IMPORTER_INFO" value={quoteattr(f"halpipe({stopped})")}/>')
    elif box.definition.endswith("/OsScheduleTableAutostart"):
        parts.append(_ENABLED.format("true"))
    for _, kind, name, text in box.values:
        parts.append(f'<d:var name="{name}" type="{kind}" value={quoteattr(text)}>{_ENABLED.format("true")}</d:var>')
    several: dict[str, list[str]] = {}
    for name, path, *_ in box.refs:
        if name in _SEVERAL:
            several.setdefault(name, []).append(f'<d:ref type="REFERENCE" value={_path(path)}/>')
        else:
            parts.append(f'<d:ref name="{name}" type="REFERENCE" value={_path(path)}/>')
    parts += [f'<d:lst name="{name}">{"".join(refs)}</d:lst>' for name, refs in several.items()]
    lists: dict[str, list[str]] = {}
    for inner in box.inside.values():
        kind = inner.kind
        if kind == inner.path.rpartition("/")[2]:
            parts.append(_container(inner))
        else:
            lists.setdefault(kind, []).append(_container(inner))
    parts += [f'<d:lst name="{kind}" type="MAP">{"".join(texts)}</d:lst>' for kind, texts in lists.items()]
    return "".join((*parts, "</d:ctr>\n"))


# -------------------------------------------------------------------------------------------------------- changes


def _change(index: _Index, edit: Edit, data: bytes, file: str) -> tuple[int, int, str]:
    if not edit.name and edit.path in index.containers:
        found = index.containers[edit.path]
        if found.is_listed:  # what may be there several times is there, or not
            return found.start, found.end, ""
        if found.enable is not None:
            return (*found.enable, _ENABLED.format("false"))
        if not found.is_empty:
            return found.opened, found.opened, _ENABLED.format("false")
        return _inside(found, _ENABLED.format("false"), data)
    value = index.values.get((edit.path, edit.name)) or index.values.get((edit.path, f"{edit.name} {edit.old}"))
    if value is None or value.stated not in ("", edit.old):
        raise _cannot(file, f"has no {edit.name or 'container'} {edit.old} in {edit.path}")
    if value.is_listed:
        return value.start, value.end, ""
    if value.tag == "var":
        return value.start, value.end, f'<d:var name="{edit.name}" type="INTEGER" value={quoteattr(edit.new or "")}/>'
    return value.start, value.end, _reference(edit.name, edit.new)
