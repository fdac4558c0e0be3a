"""Special data groups of halpipe (``ADMIN-DATA/SDGS/SDG``), and times that they give exactly and elements rounded."""

from __future__ import annotations

import math
from decimal import Context, Decimal
from fractions import Fraction
from typing import TYPE_CHECKING, Any, TypeVar

from halpipe.core.diagnostics import named
from halpipe.core.durations import Duration
from halpipe.core.records import record
from halpipe.importers.arxml.files.numbers import parse_number, parse_seconds
from halpipe.importers.arxml.files.tree import NS, place
from halpipe.importers.arxml.own.codes import EDITED
from halpipe.models import Origin
from halpipe.models.attributes import attributes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from lxml import etree

    from halpipe.core.diagnostics import Location
    from halpipe.importers.arxml.files.tree import Node, Tree

T = TypeVar("T")
_PREFIX = "halpipe:"
BLANKS = " \t\r\n"  # those of XML, which tools put round values
_DOUBLE = Context(prec=15)  # the digits that the export writes


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

    def attributes(self, kind: type, *without: str) -> dict[str, Any]:
        """Return the attributes of a class that the group has, by field; without those that are bad and reported."""
        wanted = (one for one in attributes(kind) if one.name not in without)
        found = {one.field: self.value(one.name, one.codec.parse) for one in wanted}
        return {field: value for field, value in found.items() if value is not None}

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

    def origin(self) -> Origin | None:
        """Return where the element was imported from before it was exported."""
        for data in self.groups("origin"):
            line = data.value("line", whole)
            return Origin(data.text("file") or "", line or 0, data.text("path") or "")
        return None


def each_data(tree: Tree, node: Node, kind: str) -> Iterator[Data]:
    """Yield the special data of a kind that an element has."""
    for element, file in tree.elements(node, "ADMIN-DATA/SDGS/SDG"):
        if element.get("GID") == _PREFIX + kind:
            yield Data(tree, node, element, file)


def data_of(tree: Tree, node: Node, kind: str) -> Data | None:
    """Return the first special data of a kind that an element has."""
    return next(each_data(tree, node, kind), None)


def edited(data: Data, message: str) -> None:
    """Report special data that disagree with the element that has them, or cannot be read."""
    help = "nothing to do if the change was meant; otherwise export the model again"
    path = named(data.node.tag, data.node.path)
    data.tree.findings.add(EDITED(message, at=data.at, path=path, help=help))


def whole(text: str) -> int:
    """Read a whole number of at most 20 digits; raise ``ValueError`` that says what is wrong."""
    if not (text.isascii() and text.isdigit() and len(text) <= 30):
        raise ValueError(f"{text[:40]!r} is no whole number")
    return int(text)


# ------------------------------------------------------------------------------------------------------- times


def microseconds(tree: Tree, node: Node, path: str, data: Data, key: str, *, up: bool) -> Duration | None:
    """Return a time that an element has in whole microseconds: the exact one of `key`, if it rounds to that."""
    code, factor = tree.text(node, f"{path}/CSE-CODE"), tree.text(node, f"{path}/CSE-CODE-FACTOR")
    number = parse_number(factor.value) if code and factor and parse_number(code.value) == 0 else None
    exact = data.value(key, Duration.parse)
    if number is None or number < 0:
        edited(data, f"{path} of {node.path} is no time in microseconds (CSE-CODE 0)")
        return exact
    if exact is None:
        return Duration(number * 1000)
    value = exact.in_unit("us")
    if (math.ceil(value) if up else math.floor(value)) == number:
        return exact
    edited(data, f'{path} of {node.path} is {number}us, which is not "{key}", {exact}, rounded')
    return Duration(number * 1000)


def seconds_of(tree: Tree, node: Node, path: str, data: Data, key: str) -> Duration | None:
    """Return a time that an element has in seconds: the exact one of `key`, if it rounds to that; None if absent."""
    text = tree.text(node, path)
    exact = data.value(key, Duration.parse)
    if text is None:
        return None
    stated = parse_seconds(text.value)
    if stated is None:
        edited(data, f'{path} of {node.path}, "{text.value}", is no time in seconds')
        return exact
    if exact is None:
        return stated
    value = exact.in_unit("s")
    rounded = _DOUBLE.divide(Decimal(value.numerator), Decimal(value.denominator))
    if Fraction(rounded) == stated.in_unit("s"):
        return exact
    edited(data, f'{path} of {node.path} is {text.value}, which is not "{key}", {exact}, in seconds')
    return stated
