"""The file of additions: existing containers are repeated by path, definition and UUID, with new values in them."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from lxml import etree

from halpipe.exporters.arxml.document import NAMESPACE, add, group, named, ref, sd, sdx, serialise
from halpipe.exporters.arxml.onto import DELTA, Change

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

    from halpipe.models.project import Project, Starter

CONTAINER = "ECUC-CONTAINER-VALUE"
_MODULE = "ECUC-MODULE-CONFIGURATION-VALUES"
_STRICT = re.compile(r"(?:_STRICT)?(?:_COMPACT)?\.xsd")  # names of the same release that not all tools know
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_REFERENCE, _PARAMETERS = "ECUC-REFERENCE-DEF", "ECUC-PARAM-CONF-CONTAINER-DEF"


@dataclass(slots=True)
class Box:
    """A container of the delta: what it repeats of the project's, or all of a new one.

    A new one of the module itself is marked, so that imports know it, with the alarms and tables that it has `stopped`.
    `repeated` are targets that the project has already, by the name of the reference: a merge knows the values of a
    list by their definition, and takes a second value for a contradiction unless the first stands before it.
    """

    path: str
    definition: str
    dest: str
    uuid: str = ""
    is_module: bool = False
    is_new: bool = False
    is_marked: bool = False
    stopped: tuple[Starter, ...] = ()
    values: list[tuple[str, str, str, str]] = field(default_factory=list)
    refs: list[tuple[str, str]] = field(default_factory=list)
    repeated: dict[str, list[str]] = field(default_factory=dict)
    inside: dict[str, Box] = field(default_factory=dict)

    def new(self, name: str, kind: str) -> Box:
        """Append a new container of a definition, by its short name."""
        box = Box(f"{self.path}/{name}", f"{self.definition}/{kind}", _PARAMETERS, is_new=True)
        box.is_marked = self.is_module
        self.inside[name] = box
        return box

    def integer(self, name: str, value: int) -> None:
        """Append an integer parameter."""
        self.values.append(("NUMERICAL", "INTEGER", name, str(value)))

    def number(self, name: str, text: str) -> None:
        """Append a floating point parameter."""
        self.values.append(("NUMERICAL", "FLOAT", name, text))

    def flag(self, name: str, *, value: bool) -> None:
        """Append a boolean parameter."""
        self.values.append(("NUMERICAL", "BOOLEAN", name, "true" if value else "false"))

    def choice(self, name: str, value: str) -> None:
        """Append an enumeration parameter."""
        self.values.append(("TEXTUAL", "ENUMERATION", name, value))

    def refer(self, name: str, path: str) -> None:
        """Append a reference to a container, once."""
        if (name, path) not in self.refs and path not in self.repeated.get(name, ()):
            self.refs.append((name, path))


class Delta:
    """Collects additions to containers of a project by their paths."""

    def __init__(self, project: Project) -> None:
        self._project = project
        self._modules: dict[str, Box] = {}

    def box(self, path: str) -> Box:
        """Return the container or module of a path, repeated from the project with all that holds it."""
        item = self._project.items[path]
        if item.is_module:
            box = Box(path, item.definition, item.dest or "ECUC-MODULE-DEF", item.uuid, is_module=True)
            return self._modules.setdefault(path, box)
        holder = self.box(path.rpartition("/")[0])
        if item.name not in holder.inside:
            box = holder.inside[item.name] = Box(path, item.definition, item.dest or _PARAMETERS, item.uuid)
            for value in self._project.references.get(path, ()):
                box.repeated.setdefault(value.name, []).append(value.text)
        return holder.inside[item.name]

    # ------------------------------------------------------------------------------------------------ writing

    def modules(self) -> dict[str, Box]:
        """Return the module configurations (paths) that something is added to."""
        return dict(self._modules)

    def write(self, left_out: Collection[str] = ()) -> bytes:
        """Return the file, with the release of the project, without some of the modules."""
        root = etree.Element(f"{{{NAMESPACE}}}AUTOSAR", nsmap={None: NAMESPACE, "xsi": _XSI})
        if self._project.schema:
            root.set(f"{{{_XSI}}}schemaLocation", _STRICT.sub(".xsd", self._project.schema))
        packages: dict[str, etree._Element] = {"": root}
        for path, module in self._modules.items():
            if path in left_out:
                continue
            elements = _child(self._package(packages, path.rpartition("/")[0]), "ELEMENTS")
            self._write(elements, _MODULE, module)
        return serialise(root)

    def _package(self, packages: dict[str, etree._Element], path: str) -> etree._Element:
        if path not in packages:
            holder, _, name = path.rpartition("/")
            element = named(_child(self._package(packages, holder), "AR-PACKAGES"), "AR-PACKAGE", name)
            if self._project.packages.get(path):
                element.set("UUID", self._project.packages[path])
            packages[path] = element
        return packages[path]

    def _write(self, parent: etree._Element, tag: str, box: Box) -> None:
        element = named(parent, tag, box.path.rpartition("/")[2])
        if box.uuid:
            element.set("UUID", box.uuid)
        if box.is_marked:
            _mark(element, box)
        ref(element, "DEFINITION-REF", box.dest, box.definition)
        if tag == _MODULE:
            holder = add(element, "CONTAINERS")
        else:
            _write_values(element, box)
            holder = add(element, "SUB-CONTAINERS") if box.inside else element
        for inner in box.inside.values():
            self._write(holder, CONTAINER, inner)

    # ------------------------------------------------------------------------------------------------- changes

    def changes(self, files: Mapping[str, str]) -> Iterator[Change]:
        """Yield all that is added, in the order of the file; `files` has those of modules that are changed in place."""
        for path, module in self._modules.items():
            yield from _changes(module, files.get(path, DELTA))


def _changes(box: Box, file: str) -> Iterator[Change]:
    if box.is_new:
        yield Change(file, box.path, "", None, box.definition.rpartition("/")[2])
    for _, _, name, text in box.values:
        yield Change(file, box.path, name, None, text)
    for name, path in box.refs:
        yield Change(file, box.path, name, None, path)
    for inner in box.inside.values():
        yield from _changes(inner, file)


def _child(element: etree._Element, tag: str) -> etree._Element:
    found = element.find(f"{{{NAMESPACE}}}{tag}")
    return add(element, tag) if found is None else found


def _mark(element: etree._Element, box: Box) -> None:
    """Tell imports that a container plays a schedule, and what alarms and tables did that it replaces."""
    data = group(add(add(element, "ADMIN-DATA"), "SDGS"), "delta")
    sd(data, "format", 1)
    for starter in box.stopped:
        inner = group(data, "stopped")
        sd(inner, "cycle", starter.cycle)
        sd(inner, "start", starter.start)
        sdx(inner, CONTAINER, starter.path)


def _write_values(element: etree._Element, box: Box) -> None:
    if box.values:
        holder = add(element, "PARAMETER-VALUES")
        for form, kind, name, text in box.values:
            value = add(holder, f"ECUC-{form}-PARAM-VALUE")
            ref(value, "DEFINITION-REF", f"ECUC-{kind}-PARAM-DEF", f"{box.definition}/{name}")
            add(value, "VALUE", text)
    if box.refs:
        holder = add(element, "REFERENCE-VALUES")
        names = dict.fromkeys(name for name, _ in box.refs)
        known = [(name, path) for name in names for path in box.repeated.get(name, ())]
        for name, path in (*known, *box.refs):
            value = add(holder, "ECUC-REFERENCE-VALUE")
            ref(value, "DEFINITION-REF", _REFERENCE, f"{box.definition}/{name}")
            ref(value, "VALUE-REF", CONTAINER, path)
