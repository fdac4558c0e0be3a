"""The file of additions: existing containers are repeated by path, definition and UUID, with new values in them."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from halpipe.exporters.arxml.document import (
    CONTAINER,
    MODULE_DEF,
    NAMESPACE,
    PARAMETERS,
    Box,
    add,
    document,
    group,
    named,
    sd,
    sdx,
    write_box,
)
from halpipe.exporters.arxml.onto import DELTA, Change
from halpipe.exporters.common.frozen import serialise

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping

    from lxml import etree

    from halpipe.models.project import Project, Starter

_STRICT = re.compile(r"(?:_STRICT)?(?:_COMPACT)?\.xsd")  # names of the same release that not all tools know


class Delta:
    """Collects additions to containers of a project by their paths."""

    def __init__(self, project: Project) -> None:
        self._project = project
        self._modules: dict[str, Box] = {}

    def box(self, path: str) -> Box:
        """Return the container or module of a path, repeated from the project with all that holds it."""
        item = self._project.items[path]
        if item.is_module:
            return self._modules.setdefault(path, Box(path, item.definition, MODULE_DEF, item.uuid))
        holder = self.box(path.rpartition("/")[0])
        if item.name not in holder.inside:
            box = holder.inside[item.name] = Box(path, item.definition, item.dest or PARAMETERS, item.uuid)
            for value in self._project.references.get(path, ()):
                box.repeated.setdefault(value.name, []).append(value.text)
        return holder.inside[item.name]

    # ------------------------------------------------------------------------------------------------ writing

    def modules(self) -> dict[str, Box]:
        """Return the module configurations (paths) that something is added to."""
        return dict(self._modules)

    def write(self, left_out: Collection[str] = ()) -> bytes:
        """Return the file, with the release of the project, without some of the modules."""
        root = document(_STRICT.sub(".xsd", self._project.schema))
        packages: dict[str, etree._Element] = {"": root}
        for path, module in self._modules.items():
            if path in left_out:
                continue
            elements = _child(self._package(packages, path.rpartition("/")[0]), "ELEMENTS")
            write_box(elements, module)
        return serialise(root)

    def _package(self, packages: dict[str, etree._Element], path: str) -> etree._Element:
        if path not in packages:
            holder, _, name = path.rpartition("/")
            element = named(_child(self._package(packages, holder), "AR-PACKAGES"), "AR-PACKAGE", name)
            if self._project.packages.get(path):
                element.set("UUID", self._project.packages[path])
            packages[path] = element
        return packages[path]

    # ------------------------------------------------------------------------------------------------- changes

    def changes(self, files: Mapping[str, str]) -> Iterator[Change]:
        """Yield all that is added, in the order of the file; `files` has those of modules that are changed in place."""
        for path, module in self._modules.items():
            yield from _changes(module, files.get(path, DELTA))


def _changes(box: Box, file: str) -> Iterator[Change]:
    if box.is_new:
        yield Change(file, box.path, "", None, box.kind)
    for _, _, name, text in box.values:
        yield Change(file, box.path, name, None, text)
    for reference in box.refs:
        yield Change(file, box.path, reference.name, None, reference.path)
    for inner in box.inside.values():
        yield from _changes(inner, file)


def _child(element: etree._Element, tag: str) -> etree._Element:
    found = element.find(f"{{{NAMESPACE}}}{tag}")
    return add(element, tag) if found is None else found


def mark(box: Box, stopped: Iterable[Starter]) -> None:
    """Mark for imports that a container plays a schedule, with what the alarms and tables did that it replaces."""
    box.stopped = tuple(stopped)
    data = box.special("delta")
    sd(data, "format", 1)
    for starter in box.stopped:
        inner = group(data, "stopped")
        sd(inner, "cycle", starter.cycle)
        sd(inner, "start", starter.start)
        sdx(inner, CONTAINER, starter.path)
