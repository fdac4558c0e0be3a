"""Execution order constraints: orders of runnables and events, also of nested groups of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.tree import local
from halpipe.importers.arxml.system.swc import place_of
from halpipe.importers.arxml.system.values import Order, Ordered

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.importers.arxml.files.tree import Node, Tree

_EOC = "EXECUTION-ORDER-CONSTRAINT"
_POINT = "SYNCHRONIZATION-POINT-CONSTRAINT"
_ENTITY = "EOC-EXECUTABLE-ENTITY-REF"
_EVENT = "EOC-EVENT-REF"
_GROUP = "EOC-EXECUTABLE-ENTITY-REF-GROUP"
_ELEMENTS = (_ENTITY, _EVENT, _GROUP)
_SUCCESSORS = ("SUCCESSOR-REFS/SUCCESSOR-REF", "DIRECT-SUCCESSOR-REFS/DIRECT-SUCCESSOR-REF")
# What a group states beyond an order: logical execution times, and slots of a cycle.
_NOT_READ = ("LET-DATA-EXCHANGE-PARADIGM", "LET-INTERVAL-REFS", "MAX-CYCLES", "MAX-SLOTS", "MAX-SLOTS-PER-CYCLE")
GUARANTEES = "TIMING-GUARANTEES"
PROTOTYPE = "COMPONENT-IREF/TARGET-COMPONENT-REF"


def is_guarantee(node: Node) -> bool:
    """Whether a constraint states what is fulfilled already, rather than what is required."""
    holder = node.parts[0].element.getparent() if node.parts else None
    return holder is not None and local(holder) == GUARANTEES


def read_orders(tree: Tree) -> tuple[Order, ...]:
    """Read execution order and synchronisation point constraints as pairs of runnables or events."""
    found: list[Order] = []
    for node in tree.tagged(_EOC, _POINT):
        if not is_guarantee(node):
            found += _Constraint(tree, node).orders() if node.tag == _EOC else _point_orders(tree, node)
    return tuple(dict.fromkeys(found))


class _Constraint:
    """One execution order constraint: its elements, which groups hold which, and who comes before whom."""

    def __init__(self, tree: Tree, node: Node) -> None:
        self._tree = tree
        self._node = node
        self._what = f'{node.tag} "{node.path}"'
        self._elements = [child for child in node.inside() if child.tag in _ELEMENTS]
        self._after = {element: list(self._successors(element)) for element in self._elements}
        self._nested = {e: self._targets(e, "NESTED-ELEMENT-REFS/NESTED-ELEMENT-REF") for e in self._elements}

    def orders(self) -> Iterator[Order]:
        """Yield the order of every element and its successors; of groups, the last of one and the first of the next."""
        for element in self._elements:
            self._report_lost(element)
            for successor in self._after[element]:
                for first in self._edge_of(element, last=True):
                    for second in self._edge_of(successor, last=False):
                        yield Order(place_of(self._node), first, second)

    def _successors(self, element: Node) -> Iterator[Node]:
        for path in _SUCCESSORS:
            yield from self._targets(element, path)

    def _targets(self, element: Node, path: str) -> list[Node]:
        found = (self._tree.find(ref, self._what, _ELEMENTS) for ref in self._tree.refs(element, path))
        return [node for node in found if node is not None]

    def _edge_of(self, element: Node, *, last: bool) -> list[Ordered]:
        """Return what has no successor (`last`) or no predecessor among the leaves of an element."""
        leaves = self.leaves(element, [])
        if len(leaves) == 1 or element.tag != _GROUP:
            return list(ordered_by(self._tree, leaves))
        inner = [(a, b) for a in leaves for b in self._after.get(a, ()) if b in leaves]
        bound = {a for a, _ in inner} if last else {b for _, b in inner}
        return list(ordered_by(self._tree, [leaf for leaf in leaves if leaf not in bound]))

    def leaves(self, element: Node, way: list[Node]) -> list[Node]:
        """Return what a group holds, groups in it unfolded; a group inside itself is not entered again."""
        if element.tag != _GROUP:
            return [element]
        if element in way:
            return []
        nested = self._nested.get(element, [])
        return list(dict.fromkeys(leaf for inner in nested for leaf in self.leaves(inner, [*way, element])))

    def _report_lost(self, element: Node) -> None:
        for tag in _NOT_READ:
            for found, file in element.elements(tag):
                self._tree.findings.add(
                    codes.ORDER_LOST(
                        f"{tag} is not imported",
                        at=self._tree.at(found, file),
                        path=self._what,
                        help="state what it means for the tasks in the overlay (offset, precedence)",
                    )
                )


def ordered_by(tree: Tree, elements: Iterable[Node]) -> Iterator[Ordered]:
    """Yield the runnables or events that elements of an execution order name."""
    for element in elements:
        ref = tree.ref(element, "EXECUTABLE-REF") or tree.ref(element, "EVENT-REF")
        target = tree.find(ref, f'{element.tag} "{element.path}"') if ref else None
        prototype = tree.ref(element, PROTOTYPE)
        if target is not None:
            yield Ordered(target.path, prototype.path if prototype else None)


def _point_orders(tree: Tree, node: Node) -> Iterator[Order]:
    """Yield an order of everything before a synchronisation point and everything after it."""
    ends: list[list[Ordered]] = []
    for side in ("SOURCE", "TARGET"):
        what = f'{node.tag} "{node.path}"'
        elements = [tree.find(ref, what, _ELEMENTS) for ref in tree.refs(node, f"{side}-EEC-REFS/{side}-EEC-REF")]
        events = [tree.find(ref, what) for ref in tree.refs(node, f"{side}-EVENT-REFS/{side}-EVENT-REF")]
        leaves = [leaf for element in elements if element is not None for leaf in _unfolded(tree, element)]
        ends.append([*ordered_by(tree, leaves), *(Ordered(event.path) for event in events if event is not None)])
    for first in ends[0]:
        for second in ends[1]:
            yield Order(place_of(node), first, second)


def _unfolded(tree: Tree, element: Node) -> list[Node]:
    constraint = element.parent
    if element.tag != _GROUP or constraint is None:
        return [element]
    return _Constraint(tree, constraint).leaves(element, [])
