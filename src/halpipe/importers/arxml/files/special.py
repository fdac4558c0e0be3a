"""Special data groups of halpipe (``ADMIN-DATA/SDGS/SDG``)."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from halpipe.core.diagnostics import named
from halpipe.core.records import record
from halpipe.importers.arxml.embedded_codes import EDITED
from halpipe.importers.arxml.files.tree import NS, place

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from lxml import etree

    from halpipe.core.diagnostics import Location
    from halpipe.importers.arxml.files.tree import Node, Tree

T = TypeVar("T")
_PREFIX = "halpipe:"
BLANKS = " \t\r\n"  # those of XML, which tools put round values


@record
class Data:
    """A special data group: values by their GID, references by the class of their target, inner groups."""

    tree: Tree
    node: Node
    element: etree._Element
    file: str

    @property
    def at(self) -> Location:
        """Where the group stands."""
        return place(self.element, self.file)

    def texts(self, key: str) -> list[str]:
        """Return every value of `key`, as it stands there."""
        return [sd.text or "" for sd in self.element.iterchildren(NS + "SD") if sd.get("GID") == key]

    def text(self, key: str) -> str | None:
        """Return the first value of `key`, None if there is none."""
        return next(iter(self.texts(key)), None)

    def value(self, key: str, read: Callable[[str], T]) -> T | None:
        """Return the first value of `key` as `read` understands it; None if absent, or bad and reported."""
        text = self.text(key)
        if text is None:
            return None
        try:
            return read(text.strip(BLANKS))
        except ValueError as failure:
            edited(self, f'"{key}" is unusable: {failure}')
            return None

    def targets(self, tag: str) -> list[str]:
        """Return the paths of the existing elements of a class that the group refers to; report those that dangle."""
        what = f'special data of "{self.node.path}"'
        refs = (self.tree.reference(self.node, e, self.file) for e in self.element.iterchildren(NS + "SDX-REF"))
        found = (self.tree.find(ref, what, (tag,)) for ref in refs if ref is not None and ref.dest == tag)
        return [node.path for node in found if node is not None]

    def target(self, tag: str) -> str | None:
        """Return the path of the first existing element of a class that the group refers to."""
        return next(iter(self.targets(tag)), None)

    def groups(self, kind: str) -> Iterator[Data]:
        """Yield the groups of a kind inside this one."""
        for element in self.element.iterchildren(NS + "SDG"):
            if element.get("GID") == _PREFIX + kind:
                yield Data(self.tree, self.node, element, self.file)


def each_data(tree: Tree, node: Node, kind: str) -> Iterator[Data]:
    """Yield the special data of a kind that an element has."""
    for element, file in tree.elements(node, "ADMIN-DATA/SDGS/SDG"):
        if element.get("GID") == _PREFIX + kind:
            yield Data(tree, node, element, file)


def data_of(tree: Tree, node: Node, kind: str) -> Data | None:
    """Return the first special data of a kind that an element has."""
    return next(each_data(tree, node, kind), None)


def edited(data: Data, message: str) -> None:
    """Report special data that cannot be read."""
    help = "export the model again"
    path = named(data.node.tag, data.node.path)
    data.tree.findings.add(EDITED(message, at=data.at, path=path, help=help))
