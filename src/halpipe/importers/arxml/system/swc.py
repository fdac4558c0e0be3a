"""Software component types and BSW modules: behaviours, runnables, events, and the data that runnables access."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.importers.arxml.files.tree import local, qualified
from halpipe.importers.arxml.system.values import Component, DataItem, Event, Place, Runnable, Stated, Twin

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.importers.arxml.files.tree import Node, Text, Tree

_BEHAVIORS = ("SWC-INTERNAL-BEHAVIOR", "BSW-INTERNAL-BEHAVIOR")
RUNNABLES = ("RUNNABLE-ENTITY", "BSW-SCHEDULABLE-ENTITY", "BSW-CALLED-ENTITY", "BSW-INTERRUPT-ENTITY")
_WRITES = ("DATA-WRITE-ACCESSS", "DATA-SEND-POINTS", "WRITTEN-LOCAL-VARIABLES")
_READS = (
    "DATA-READ-ACCESSS",
    "DATA-RECEIVE-POINT-BY-ARGUMENTS",
    "DATA-RECEIVE-POINT-BY-VALUES",
    "READ-LOCAL-VARIABLES",
)
_AREA_REFS = (
    "RUNS-INSIDE-EXCLUSIVE-AREA-REFS/RUNS-INSIDE-EXCLUSIVE-AREA-REF",
    "CAN-ENTER-EXCLUSIVE-AREA-REFS/CAN-ENTER-EXCLUSIVE-AREA-REF",
    "RUNS-INSIDES/EXCLUSIVE-AREA-REF-CONDITIONAL/EXCLUSIVE-AREA-REF",
    "CAN-ENTERS/EXCLUSIVE-AREA-REF-CONDITIONAL/EXCLUSIVE-AREA-REF",
)
# How releases before 4 name the variables between runnables, by the list that they stand in since.
_VARIABLE_REFS = {
    "WRITTEN-LOCAL-VARIABLES": "WRITTEN-VARIABLE-REFS/WRITTEN-VARIABLE-REF",
    "READ-LOCAL-VARIABLES": "READ-VARIABLE-REFS/READ-VARIABLE-REF",
}


def read_components(tree: Tree) -> tuple[Component, ...]:
    """Read every atomic component type and BSW module description that has an internal behaviour."""
    detached = _detached_behaviors(tree)
    components = (
        _component(tree, node, detached.get(node.path, ())) for node in tree.nodes() if is_component_type(node.tag)
    )
    return tuple(component for component in components if component.behaviors)


def _detached_behaviors(tree: Tree) -> dict[str, list[Node]]:
    """Return the behaviours that refer to their component type instead of being inside it, as before release 4."""
    found: dict[str, list[Node]] = {}
    for node in tree.tagged(*_BEHAVIORS):
        ref = tree.ref(node, "COMPONENT-REF")
        target = tree.find(ref, f'{node.tag} "{node.path}"') if ref else None
        if target is not None:
            found.setdefault(target.path, []).append(node)
    return found


def is_component_type(tag: str) -> bool:
    """Whether elements of `tag` hold runnables: component types other than compositions, and BSW modules."""
    if tag == "BSW-MODULE-DESCRIPTION":
        return True
    return tag.endswith("-SW-COMPONENT-TYPE") and tag != "COMPOSITION-SW-COMPONENT-TYPE"


def place_of(node: Node) -> Place:
    """Return where a node is, with its tag as its kind."""
    return Place(node.path, node.tag, node.at)


def stated(text: Text | None) -> Stated | None:
    """Return a text as a stated value; None if it is absent or empty."""
    return Stated(text.value, text.at) if text is not None and text.value else None


def read_twins(tree: Tree) -> tuple[Twin, ...]:
    """Read which runnables and BSW entities are the same function."""
    return tuple(twin for node in tree.tagged("SWC-BSW-MAPPING") for twin in _twins(tree, node))


def _twins(tree: Tree, node: Node) -> Iterator[Twin]:
    what = f'SWC-BSW-MAPPING "{node.path}"'
    for element, file in node.elements("RUNNABLE-MAPPINGS/SWC-BSW-RUNNABLE-MAPPING"):
        ends = []
        for path in ("SWC-RUNNABLE-REF", "BSW-ENTITY-REF"):
            child = element.find(qualified(path))
            ref = tree.reference(node, child, file) if child is not None else None
            ends.append(tree.find(ref, what, RUNNABLES) if ref else None)
        if ends[0] is not None and ends[1] is not None:
            yield Twin(place_of(node), ends[0].path, ends[1].path)


def _component(tree: Tree, node: Node, detached: Iterable[Node]) -> Component:
    behaviors = [*node.inside(*_BEHAVIORS), *detached]
    inner = [child for behavior in behaviors for child in behavior.inside()]
    return Component(
        place=place_of(node),
        behaviors=tuple(place_of(behavior) for behavior in behaviors),
        runnables=tuple(_runnable(tree, child) for child in inner if child.tag in RUNNABLES),
        events=tuple(_event(tree, child) for child in inner if child.tag.endswith("-EVENT")),
    )


def _event(tree: Tree, node: Node) -> Event:
    path = "STARTS-ON-EVENT-REF" if node.tag.startswith("BSW-") else "START-ON-EVENT-REF"
    start = tree.ref(node, path)
    runnable = tree.find(start, f'{node.tag} "{node.path}"', RUNNABLES) if start else None
    is_timing = node.tag.endswith("TIMING-EVENT")
    return Event(
        place=place_of(node),
        runnable=runnable.path if runnable else None,
        period=stated(tree.text(node, "PERIOD")) if is_timing else None,
        offset=stated(tree.text(node, "OFFSET")) if is_timing else None,
        data=_received_data(tree, node),
        disabled_in=tuple(_disabled_in(tree, node)),
    )


def _received_data(tree: Tree, node: Node) -> DataItem | None:
    if node.tag != "DATA-RECEIVED-EVENT":
        return None
    port = tree.ref(node, "DATA-IREF/CONTEXT-R-PORT-REF")
    element = tree.ref(node, "DATA-IREF/TARGET-DATA-ELEMENT-REF")
    return DataItem(port.path, element.path) if port and element else None


def _disabled_in(tree: Tree, node: Node) -> Iterator[str]:
    """Yield the paths of the mode declarations in which the event does not occur (SWC, BSW, release 3)."""
    what = f'{node.tag} "{node.path}"'
    for path in (
        "DISABLED-MODE-IREFS/DISABLED-MODE-IREF/TARGET-MODE-DECLARATION-REF",
        "DISABLED-IN-MODE-IREFS/DISABLED-IN-MODE-IREF/TARGET-MODE-REF",
        "MODE-DEPENDENCY/DEPENDENT-ON-MODE-IREFS/DEPENDENT-ON-MODE-IREF/MODE-DECLARATION-REF",
    ):
        for ref in tree.refs(node, path):
            mode = tree.find(ref, what, ("MODE-DECLARATION",))
            if mode is not None:
                yield mode.path


def _runnable(tree: Tree, node: Node) -> Runnable:
    accesses = [(role, item) for access in node.inside("VARIABLE-ACCESS") for role, item in _access(tree, access)]
    for role, path in _VARIABLE_REFS.items():
        accesses += [(role, DataItem("", ref.path)) for ref in tree.refs(node, path)]
    return Runnable(
        place=place_of(node),
        symbol=_symbol(tree, node),
        writes=tuple(item for role, item in accesses if role in _WRITES),
        reads=tuple(item for role, item in accesses if role in _READS),
        interval=stated(tree.text(node, "MINIMUM-START-INTERVAL")),
        areas=tuple(_areas(tree, node)),
    )


def _areas(tree: Tree, node: Node) -> Iterator[Place]:
    """Yield the exclusive areas that a runnable may enter, or runs inside of; releases spell that in several ways."""
    what = f'{node.tag} "{node.path}"'
    found = {ref.path: ref for path in _AREA_REFS for ref in tree.refs(node, path)}
    for ref in found.values():
        area = tree.find(ref, what, ("EXCLUSIVE-AREA",))
        if area is not None:
            yield place_of(area)


def _symbol(tree: Tree, node: Node) -> str:
    """Return the C function: the SYMBOL of a runnable, the entry that a BSW entity implements, or else its name."""
    symbol = tree.text(node, "SYMBOL")
    entry = tree.ref(node, "IMPLEMENTED-ENTRY-REF")
    return (symbol.value if symbol else "") or (entry.name if entry else "") or node.name


def _access(tree: Tree, access: Node) -> Iterator[tuple[str, DataItem]]:
    """Yield the role (the list that the access stands in) and what is accessed."""
    holder = access.parts[0].element.getparent()
    role = local(holder) if holder is not None else ""
    variable = tree.ref(access, "ACCESSED-VARIABLE/LOCAL-VARIABLE-REF")
    if variable is not None:
        yield role, DataItem("", variable.path)
    port = tree.ref(access, "ACCESSED-VARIABLE/AUTOSAR-VARIABLE-IREF/PORT-PROTOTYPE-REF")
    element = tree.ref(access, "ACCESSED-VARIABLE/AUTOSAR-VARIABLE-IREF/TARGET-DATA-PROTOTYPE-REF")
    if port is not None and element is not None:
        yield role, DataItem(port.path, element.path)
