"""Compositions with their prototypes and connectors, and what is put onto which ECU and hardware."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.importers.arxml.files.tree import Text, local, place
from halpipe.importers.arxml.system.swc import place_of, stated
from halpipe.importers.arxml.system.values import (
    Composition,
    Connector,
    Ecu,
    End,
    PeriodOverride,
    Place,
    Prototype,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.importers.arxml.files.tree import Node, Part, Tree

COMPOSITION = "COMPOSITION-SW-COMPONENT-TYPE"
_PORTS = ("P-PORT-PROTOTYPE", "R-PORT-PROTOTYPE", "PR-PORT-PROTOTYPE")


# ------------------------------------------------------------------------------------------------ reading


def read_compositions(tree: Tree) -> tuple[Composition, ...]:
    """Read every composition type with its prototypes and connectors."""
    return tuple(_composition(tree, node) for node in tree.tagged(COMPOSITION))


def _composition(tree: Tree, node: Node) -> Composition:
    connectors = [
        connector
        for child in node.inside("ASSEMBLY-SW-CONNECTOR", "DELEGATION-SW-CONNECTOR")
        for connector in dict.fromkeys(_connector(tree, child, part) for part in child.parts)
    ]
    return Composition(
        place=place_of(node),
        prototypes=tuple(_prototype(tree, child) for child in node.inside("SW-COMPONENT-PROTOTYPE")),
        connectors=tuple(connectors),
        overrides=tuple(_overrides(tree, node)),
    )


def _prototype(tree: Tree, node: Node) -> Prototype:
    ref = tree.ref(node, "TYPE-TREF")
    target = tree.find(ref, f'component prototype "{node.path}"') if ref else None
    return Prototype(place_of(node), target.path if target else None)


def _connector(tree: Tree, node: Node, part: Part) -> Connector:
    """Read one part of a connector; parts that differ are connectors of the same name, as some tools write them."""
    at = Place(node.path, node.tag, place(part.element, part.file))
    if node.tag == "ASSEMBLY-SW-CONNECTOR":
        source = _end(tree, node, part, "PROVIDER-IREF", "P")
        return Connector(place=at, source=source, target=_end(tree, node, part, "REQUESTER-IREF", "R"))
    outer = _target(tree, node, part, "OUTER-PORT-REF")
    outside = End("", outer) if outer else None
    for kind in ("P", "R"):
        inner = f"INNER-PORT-IREF/{kind}-PORT-IN-COMPOSITION-INSTANCE-REF"
        if part.find(inner) is not None:
            inside = _end(tree, node, part, inner, kind)
            ends = (inside, outside) if kind == "P" else (outside, inside)
            return Connector(place=at, source=ends[0], target=ends[1])
    return Connector(place=at, source=None, target=None)


def _end(tree: Tree, node: Node, part: Part, path: str, kind: str) -> End | None:
    prototype = _target(tree, node, part, f"{path}/CONTEXT-COMPONENT-REF")
    port = _target(tree, node, part, f"{path}/TARGET-{kind}-PORT-REF")
    return End(prototype, port) if prototype and port else None


def _target(tree: Tree, node: Node, part: Part, path: str) -> str | None:
    kinds = ("SW-COMPONENT-PROTOTYPE",) if path.endswith("COMPONENT-REF") else _PORTS
    element = part.find(path)
    ref = tree.reference(node, element, part.file) if element is not None else None
    target = tree.find(ref, f'connector "{node.path}"', kinds) if ref else None
    return target.path if target else None


def _overrides(tree: Tree, node: Node) -> Iterator[PeriodOverride]:
    for element, file in node.elements("INSTANTIATION-RTE-EVENT-PROPSS/INSTANTIATION-TIMING-EVENT-PROPS"):
        refs = {local(child): child for child in element.iterfind("{*}REFINED-EVENT-IREF/{*}*")}
        context = [child for tag, child in refs.items() if tag.startswith("CONTEXT-")]
        target = [child for tag, child in refs.items() if tag.startswith("TARGET-")]
        period = next((child for child in element if local(child) == "PERIOD"), None)
        prototype = tree.reference(node, context[-1], file) if context else None
        event = tree.reference(node, target[0], file) if target else None
        value = stated(Text((period.text or "").strip(), place(period, file))) if period is not None else None
        if prototype and event and value:
            yield PeriodOverride(prototype=prototype.path, event=event.path, period=value)


def read_ecus(tree: Tree) -> tuple[Ecu, ...]:
    """Read every ECU instance with the component prototypes mapped to it."""
    ecus = tree.tagged("ECU-INSTANCE")
    mapped: dict[str, list[str]] = {node.path: [] for node in ecus}
    mappings: dict[str, list[Place]] = {node.path: [] for node in ecus}
    hardware: dict[str, list[tuple[str, str]]] = {node.path: [] for node in ecus}
    chains: dict[str, list[tuple[str, ...]]] = {node.path: [] for node in ecus}
    for node in tree.tagged("SWC-TO-ECU-MAPPING"):
        ref = tree.ref(node, "ECU-INSTANCE-REF")
        ecu = tree.find(ref, f'mapping "{node.path}"', ("ECU-INSTANCE",)) if ref else None
        if ecu is not None:
            refs = tree.refs(node, "COMPONENT-IREFS/COMPONENT-IREF/TARGET-COMPONENT-REF")
            mapped[ecu.path] += [ref.path for ref in refs]
            chains[ecu.path] += _chains(tree, node)
            mappings[ecu.path].append(place_of(node))
            unit = tree.ref(node, "PROCESSING-UNIT-REF")
            found = tree.find(unit, f'mapping "{node.path}"', ("HW-ELEMENT",)) if unit else None
            if found is not None:
                hardware[ecu.path] += [(ref.path, found.path) for ref in refs]
    return tuple(
        Ecu(
            place_of(ecu),
            tuple(mapped[ecu.path]),
            tuple(mappings[ecu.path]),
            tuple(hardware[ecu.path]),
            tuple(chains[ecu.path]),
        )
        for ecu in ecus
    )


def _chains(tree: Tree, mapping: Node) -> Iterator[tuple[str, ...]]:
    """Yield each mapped prototype after those that hold it; some tools name it among these, too."""
    for element, file in tree.elements(mapping, "COMPONENT-IREFS/COMPONENT-IREF"):
        refs = [tree.reference(mapping, child, file) for child in element]
        target = next((ref.path for ref in refs if ref and local(ref.element) == "TARGET-COMPONENT-REF"), None)
        if target is not None:
            outer = [ref.path for ref in refs if ref and local(ref.element) == "CONTEXT-COMPONENT-REF"]
            yield (*(path for path in outer if path != target), target)


def read_hardware(tree: Tree) -> tuple[Place, ...]:
    """Read the HW-ELEMENTs of the standard category ProcessingUnit."""
    return tuple(
        place_of(node)
        for node in tree.tagged("HW-ELEMENT")
        if any(ref.name == "ProcessingUnit" for ref in tree.refs(node, "HW-CATEGORY-REFS/HW-CATEGORY-REF"))
    )
