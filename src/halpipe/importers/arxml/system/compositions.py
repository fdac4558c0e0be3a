"""Compositions, their connectors, and the component instances that they make when nested into each other."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING

from halpipe.diagnostics import HalpipeError
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.tree import Text, local, place
from halpipe.importers.arxml.system.swc import place_of, stated
from halpipe.importers.arxml.system.values import (
    Component,
    Composition,
    Connector,
    Ecu,
    End,
    Instance,
    PeriodOverride,
    Place,
    Prototype,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.diagnostics import Findings
    from halpipe.importers.arxml.files.tree import Node, Part, Tree

COMPOSITION = "COMPOSITION-SW-COMPONENT-TYPE"
_PORTS = ("P-PORT-PROTOTYPE", "R-PORT-PROTOTYPE", "PR-PORT-PROTOTYPE")
_MAX_DEPTH = 32
MAX_INSTANCES = 20_000


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
    for node in tree.tagged("SWC-TO-ECU-MAPPING"):
        ref = tree.ref(node, "ECU-INSTANCE-REF")
        ecu = tree.find(ref, f'mapping "{node.path}"', ("ECU-INSTANCE",)) if ref else None
        if ecu is not None:
            refs = tree.refs(node, "COMPONENT-IREFS/COMPONENT-IREF/TARGET-COMPONENT-REF")
            mapped[ecu.path] += [ref.path for ref in refs]
            mappings[ecu.path].append(place_of(node))
            unit = tree.ref(node, "PROCESSING-UNIT-REF")
            found = tree.find(unit, f'mapping "{node.path}"', ("HW-ELEMENT",)) if unit else None
            if found is not None:
                hardware[ecu.path] += [(ref.path, found.path) for ref in refs]
    return tuple(
        Ecu(place_of(ecu), tuple(mapped[ecu.path]), tuple(mappings[ecu.path]), tuple(hardware[ecu.path]))
        for ecu in ecus
    )


def read_hardware(tree: Tree) -> tuple[Place, ...]:
    """Read the HW-ELEMENTs of the standard category ProcessingUnit."""
    return tuple(
        place_of(node)
        for node in tree.tagged("HW-ELEMENT")
        if any(ref.name == "ProcessingUnit" for ref in tree.refs(node, "HW-CATEGORY-REFS/HW-CATEGORY-REF"))
    )


# ----------------------------------------------------------------------------------------------- instances


@dataclass(frozen=True, slots=True)
class Instances:
    """The component instances, and the compositions (paths) taken for copies of others."""

    items: tuple[Instance, ...]
    copies: tuple[str, ...]


def find_instances(
    tree: Tree,
    components: Sequence[Component],
    compositions: Sequence[Composition],
    configured: Sequence[str],
    findings: Findings,
) -> Instances:
    """Unfold the root compositions into component instances.

    Roots are the compositions that a SYSTEM names, or else those that no other composition uses. `configured` are
    the component prototypes (paths) of the Rte configuration: roots without any of them are copies. Without any
    instance component types stand for themselves, as BSW modules always do.
    """
    by_path = {composition.place.path: composition for composition in compositions}
    types = {component.place.path: component for component in components}
    roots = _roots(tree, compositions)
    unfolded = {root: _bounded(_unfold(by_path[root], (root,), by_path, types), by_path[root]) for root in roots}
    copies = _copies(unfolded, frozenset(configured))
    for root in copies:
        findings.add(
            codes.COPY(
                "none of its component prototypes is in the Rte configuration",
                at=by_path[root].place.at,
                path=f'composition "{root}"',
                help="nothing to do if it is the system that the ECU extract was made of",
            )
        )
    kept = [instance for root in roots if root not in copies for instance in unfolded[root]]
    _report_shared_types(kept, by_path, findings)
    used = {instance.component.place.path for instance in kept}
    rest = [component for component in components if component.place.path not in used]
    if kept:
        _report_unused([component for component in rest if not component.is_module], findings)
        rest = [component for component in rest if component.is_module]
    alone = [Instance(_label(component), (component.place.path,), component) for component in rest]
    return Instances((*kept, *alone), copies)


def _label(component: Component) -> str:
    """Name a module apart from the service component of the same name, which most modules have."""
    return f"BSW/{component.place.name}" if component.is_module else component.place.name


def _report_unused(components: Sequence[Component], findings: Findings) -> None:
    for component in components:
        if any(event.is_timing for event in component.events):
            findings.add(
                codes.NOT_INSTANTIATED(
                    "is used in no composition of the system, so that its runnables are no tasks",
                    at=component.place.at,
                    path=f'{component.place.kind} "{component.place.path}"',
                    help="add it to the composition, or import its file on its own",
                )
            )


def _roots(tree: Tree, compositions: Sequence[Composition]) -> list[str]:
    named = []
    for node in tree.tagged("ROOT-SW-COMPOSITION-PROTOTYPE"):
        ref = tree.ref(node, "SOFTWARE-COMPOSITION-TREF")
        target = tree.find(ref, f'root composition "{node.path}"', (COMPOSITION,)) if ref else None
        if target is not None:
            named.append(target.path)
    used = {prototype.type for composition in compositions for prototype in composition.prototypes}
    unused = [composition.place.path for composition in compositions if composition.place.path not in used]
    return list(dict.fromkeys(named or unused))


def _unfold(
    composition: Composition,
    context: tuple[str, ...],
    compositions: dict[str, Composition],
    types: dict[str, Component],
) -> Iterator[Instance]:
    """Yield the instances inside one use of a composition; a composition inside itself is not entered again."""
    if len(context) > _MAX_DEPTH:
        return
    for prototype in composition.prototypes:
        inner = (*context, prototype.place.path)
        if prototype.type in compositions and prototype.place.path not in context:
            yield from _unfold(compositions[prototype.type], inner, compositions, types)
        elif prototype.type in types:
            label = "/".join(path.rpartition("/")[2] for path in inner[1:])
            yield Instance(label, inner, types[prototype.type])


def _bounded(instances: Iterator[Instance], root: Composition) -> list[Instance]:
    """Collect instances; compositions that multiply beyond all reason are refused."""
    found = list(islice(instances, MAX_INSTANCES + 1))
    if len(found) > MAX_INSTANCES:
        raise HalpipeError(
            codes.TOO_MANY(
                f"makes more than {MAX_INSTANCES} component instances",
                at=root.place.at,
                path=f'composition "{root.place.path}"',
                help="import one part of the system at a time",
            )
        )
    return found


def _copies(unfolded: dict[str, list[Instance]], configured: frozenset[str]) -> tuple[str, ...]:
    def is_configured(root: str) -> bool:
        return any(path in configured for instance in unfolded[root] for path in instance.context)

    if not any(is_configured(root) for root in unfolded):
        return ()
    return tuple(root for root in unfolded if not is_configured(root))


def _report_shared_types(instances: Sequence[Instance], by_path: dict[str, Composition], findings: Findings) -> None:
    roots: dict[str, list[str]] = {}
    for instance in instances:
        known = roots.setdefault(instance.component.place.path, [])
        if instance.context[0] not in known:
            known.append(instance.context[0])
    for pair in dict.fromkeys(tuple(found) for found in roots.values() if len(found) > 1):
        shared = next(path for path, found in roots.items() if tuple(found) == pair)
        findings.add(
            codes.SEVERAL_ROOTS(
                f"{shared} and others are used in each of {', '.join(pair)}",
                at=by_path[pair[0]].place.at,
                path=f'composition "{pair[0]}"',
                help="import the files of one system only, or add the ECU configuration of the Rte",
            )
        )
