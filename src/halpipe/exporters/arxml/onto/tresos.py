"""Changes of EB tresos project data (``.xdm``): what is added and changed goes into the file, every other byte stays.

A value that is touched is enabled, and no longer said to come from an importer, so that a next calculation of the tool
leaves it. A container that is taken away is disabled.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.exporters.arxml.onto.codes import CANNOT_EDIT
from halpipe.exporters.arxml.onto.edit import tag_end

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.exporters.arxml.onto.delta import Box
    from halpipe.exporters.arxml.onto.edit import Edit

_SEVERAL = ("OsSchTblAccessingApplication", "OsScheduleTableAppModeRef")
_TYPES = {"INTEGER": "INTEGER", "FLOAT": "FLOAT", "BOOLEAN": "BOOLEAN", "ENUMERATION": "ENUMERATION"}
_ENABLED = '<a:a name="ENABLE" value="{}"/>'


@dataclass(slots=True)
class _Element:
    """An element of the file: its bytes, those between its tags, and where it says whether it is enabled."""

    tag: str
    name: str
    type: str
    start: int
    opened: int = 0
    closed: int = 0
    end: int = 0
    container: str = ""
    enable: tuple[int, int] | None = None

    @property
    def is_empty(self) -> bool:
        """Whether it is one tag, without content."""
        return self.closed == self.end


@dataclass(slots=True)
class _Index:
    """The elements of a file: containers by path, lists and values by the path of their container and their name."""

    containers: dict[str, _Element] = field(default_factory=dict)
    lists: dict[tuple[str, str], _Element] = field(default_factory=dict)
    values: dict[tuple[str, str], _Element] = field(default_factory=dict)


def apply_to_xdm(data: bytes, file: str, module: Box | None, edits: Sequence[Edit]) -> bytes:
    """Return the file of a module with what a delta adds to it, and with every change."""
    index = _Reader(data).index
    changes: list[tuple[int, int, str]] = []
    if module is not None:
        changes += _additions(index, module, data)
    for edit in edits:
        changes.append(_change(index, edit, data, file))
    result, end = bytearray(), 0
    for start, stop, text in _joined(changes):
        result += data[end:start] + text.encode()
        end = stop
    return bytes(result + data[end:])


def _joined(changes: list[tuple[int, int, str]]) -> list[tuple[int, int, str]]:
    """Put insertions at one place together; replacements of one element are what they are."""
    found: dict[tuple[int, int], str] = {}
    for start, stop, text in changes:
        found[start, stop] = found.get((start, stop), "") + text if start == stop else text
    return [(start, stop, text) for (start, stop), text in sorted(found.items())]


# ------------------------------------------------------------------------------------------------------ additions


def _additions(index: _Index, box: Box, data: bytes) -> Iterator[tuple[int, int, str]]:
    """Yield what a repeated container gets: new containers, and references."""
    holder = index.containers[box.path]
    lists: dict[str, list[str]] = {}
    for inner in box.inside.values():
        if inner.is_new:
            lists.setdefault(inner.definition.rpartition("/")[2], []).append(_container(inner))
        else:
            yield from _additions(index, inner, data)
    for kind, texts in lists.items():
        found = index.lists.get((box.path, kind))
        if found is None:
            yield _inside(holder, f'<d:lst name="{kind}" type="MAP">{"".join(texts)}</d:lst>', data)
        else:
            yield _inside(found, "".join(texts), data)
    several: dict[str, list[str]] = {}
    for name, path in box.refs:
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
    if box.is_marked:
        stopped = ";".join(f"{alarm.path},{alarm.cycle},{alarm.start}" for alarm in box.stopped)
        parts.append(f'<a:a name="IMPORTER_INFO" value={quoteattr(f"halpipe({stopped})")}/>')
    elif box.definition.endswith("/OsScheduleTableAutostart"):
        parts.append(_ENABLED.format("true"))
    for _, kind, name, text in box.values:
        parts.append(
            f'<d:var name="{name}" type="{_TYPES[kind]}" value={quoteattr(text)}>{_ENABLED.format("true")}</d:var>'
        )
    several: dict[str, list[str]] = {}
    for name, path in box.refs:
        if name in _SEVERAL:
            several.setdefault(name, []).append(f'<d:ref type="REFERENCE" value={_path(path)}/>')
        else:
            parts.append(f'<d:ref name="{name}" type="REFERENCE" value={_path(path)}/>')
    parts += [f'<d:lst name="{name}">{"".join(refs)}</d:lst>' for name, refs in several.items()]
    lists: dict[str, list[str]] = {}
    for inner in box.inside.values():
        kind = inner.definition.rpartition("/")[2]
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
        if found.enable is not None:
            return (*found.enable, _ENABLED.format("false"))
        if not found.is_empty:
            return found.opened, found.opened, _ENABLED.format("false")
        return _inside(found, _ENABLED.format("false"), data)
    value = index.values.get((edit.path, edit.name))
    if value is None:
        help = "import the project again, or make the change in the tool that wrote the file"
        message = f"has no {edit.name or 'container'} in {edit.path}"
        raise HalpipeError(CANNOT_EDIT(message, at=Location(file), help=help))
    return value.start, value.end, _reference(edit.name, edit.new)


# -------------------------------------------------------------------------------------------------------- reading


class _Reader:
    """Finds the elements of a file with their bytes."""

    def __init__(self, data: bytes) -> None:
        self.index = _Index()
        self._data = data
        self._stack: list[_Element] = []
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = self._begin
        self._parser.EndElementHandler = self._end
        self._parser.Parse(data, True)

    def _begin(self, tag: str, attributes: dict[str, str]) -> None:
        at = self._parser.CurrentByteIndex
        tag = tag.rpartition(":")[2]
        holder = self._stack[-1] if self._stack else None
        element = _Element(tag, attributes.get("name", ""), attributes.get("type", ""), at, tag_end(self._data, at))
        if holder is not None:
            element.container = self._path(element, holder)
            if tag == "a" and attributes.get("name") == "ENABLE":
                holder.enable = (at, element.opened)
        self._stack.append(element)

    def _path(self, element: _Element, holder: _Element) -> str:
        """Return the path of the container that an element is, or in which it is."""
        if element.type == "AR-PACKAGE":
            return f"/{element.name}"
        if element.type == "AR-ELEMENT" or (element.tag in ("ctr", "chc") and element.type != "MODULE-CONFIGURATION"):
            return f"{holder.container}/{element.name}" if element.name else holder.container
        return holder.container

    def _end(self, _: str) -> None:
        element = self._stack.pop()
        at = self._parser.CurrentByteIndex
        has_end = self._data.startswith(b"</", at)
        element.closed = at if has_end else element.opened
        element.end = tag_end(self._data, at) if has_end else element.opened
        holder = self._stack[-1] if self._stack else None
        if element.tag in ("ctr", "chc"):
            self.index.containers[element.container] = element
        elif element.tag == "lst" and element.name:
            self.index.lists[element.container, element.name] = element
        elif element.tag in ("var", "ref") and element.name and holder is not None and holder.tag != "lst":
            self.index.values[element.container, element.name] = element
