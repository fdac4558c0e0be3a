"""Component types, BSW modules, compositions, modes, and what is put onto which ECU and hardware."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.tree import Node, Part, Stated, Tree, local, place, qualified
from halpipe.importers.arxml.files.words import listed
from halpipe.importers.arxml.system.values import (
    Component,
    Composition,
    Connector,
    DataItem,
    Ecu,
    End,
    Event,
    ModeGroup,
    Place,
    Prototype,
    Runnable,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


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
_DISABLED = "DISABLED-MODE-IREFS/DISABLED-MODE-IREF"
# How releases before 4 name the variables between runnables, by the list that they stand in since.
_VARIABLE_REFS = {
    "WRITTEN-LOCAL-VARIABLES": "WRITTEN-VARIABLE-REFS/WRITTEN-VARIABLE-REF",
    "READ-LOCAL-VARIABLES": "READ-VARIABLE-REFS/READ-VARIABLE-REF",
}


def read_components(tree: Tree) -> tuple[Component, ...]:
    """Read every atomic component type and BSW module description that has an internal behaviour."""
    detached = _detached_behaviors(tree)
    nodes = [node for node in tree.nodes() if is_component_type(node.tag)]
    patterns = [node for node in nodes if _is_blueprint(node)]
    if patterns:
        message = f"{len(patterns)} component types and modules are left out: {listed([n.path for n in patterns])}"
        help = "move them out of the package of the category BLUEPRINT, if they are to run"
        tree.findings.report(codes.BLUEPRINT, message, at=patterns[0].at, help=help)
    components = [_component(tree, node, detached.get(node.path, ())) for node in nodes if node not in patterns]
    for component in components:
        if not component.is_module and len(component.behaviors) > 1 and any(e.is_timing for e in component.events):
            message = f"has several internal behaviours: {listed([b.path for b in component.behaviors])}"
            component.place.report(tree.findings, codes.SEVERAL_BEHAVIORS, message, help="import the one that runs")
    return tuple(component for component in components if component.behaviors)


def _is_blueprint(node: Node) -> bool:
    """Whether an element is in a package of patterns, from which a tool derives elements."""
    holder = node.parent
    while holder is not None:
        if any((element.text or "").strip() == "BLUEPRINT" for element, _ in holder.elements("CATEGORY")):
            return True
        holder = holder.parent
    return False


def _detached_behaviors(tree: Tree) -> dict[str, list[Node]]:
    """Return the behaviours that refer to their component type instead of being inside it, as before release 4."""
    found: dict[str, list[Node]] = {}
    for node in tree.tagged(*_BEHAVIORS):
        target = tree.target(node, "COMPONENT-REF")
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


def read_twins(tree: Tree) -> dict[str, str]:
    """Read which runnable is the same function as a BSW entity: from SWC-BSW-RUNNABLE-MAPPINGs."""
    return dict(twin for node in tree.tagged("SWC-BSW-MAPPING") for twin in _twins(tree, node))


def _twins(tree: Tree, node: Node) -> Iterator[tuple[str, str]]:
    what = f'SWC-BSW-MAPPING "{node.path}"'
    for element, file in node.elements("RUNNABLE-MAPPINGS/SWC-BSW-RUNNABLE-MAPPING"):
        ends = []
        for path in ("BSW-ENTITY-REF", "SWC-RUNNABLE-REF"):
            child = element.find(qualified(path))
            ref = tree.reference(node, child, file) if child is not None else None
            ends.append(tree.find(ref, what, RUNNABLES) if ref else None)
        if ends[0] is not None and ends[1] is not None:
            yield ends[0].path, ends[1].path


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
    is_timing = node.tag.endswith("TIMING-EVENT")
    return Event(
        place=place_of(node),
        runnable=tree.path_at(node, path, RUNNABLES),
        period=tree.text(node, "PERIOD") if is_timing else None,
        offset=tree.text(node, "OFFSET") if is_timing else None,
        data=_received_data(tree, node),
        disabled_in=tuple(_disabled_in(tree, node)),
        mode_ports=tuple(
            ref.path for ref in tree.refs(node, "DISABLED-MODE-IREFS/DISABLED-MODE-IREF/CONTEXT-PORT-REF")
        ),
    )


def _received_data(tree: Tree, node: Node) -> DataItem | None:
    if node.tag != "DATA-RECEIVED-EVENT":
        return None
    port = tree.ref(node, "DATA-IREF/CONTEXT-R-PORT-REF")
    element = tree.ref(node, "DATA-IREF/TARGET-DATA-ELEMENT-REF")
    return DataItem(port.path, element.path) if port and element else None


def _disabled_in(tree: Tree, node: Node) -> Iterator[str]:
    """Yield the paths of the mode declarations in which the event does not occur (SWC, BSW, release 3)."""
    for path in (
        f"{_DISABLED}/TARGET-MODE-DECLARATION-REF",
        "DISABLED-IN-MODE-IREFS/DISABLED-IN-MODE-IREF/TARGET-MODE-REF",
        "MODE-DEPENDENCY/DEPENDENT-ON-MODE-IREFS/DEPENDENT-ON-MODE-IREF/MODE-DECLARATION-REF",
    ):
        yield from (mode.path for mode in tree.targets(node, path, ("MODE-DECLARATION",)))


def _runnable(tree: Tree, node: Node) -> Runnable:
    accesses = [(role, item) for access in node.inside("VARIABLE-ACCESS") for role, item in _access(tree, access)]
    for role, path in _VARIABLE_REFS.items():
        accesses += [(role, DataItem("", ref.path)) for ref in tree.refs(node, path)]
    return Runnable(
        place=place_of(node),
        symbol=_symbol(tree, node),
        writes=tuple(item for role, item in accesses if role in _WRITES),
        reads=tuple(item for role, item in accesses if role in _READS),
        interval=tree.text(node, "MINIMUM-START-INTERVAL"),
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
    return (symbol.text if symbol else "") or (entry.name if entry else "") or node.name


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


def read_mode_groups(tree: Tree) -> tuple[ModeGroup, ...]:
    """Read every MODE-DECLARATION-GROUP."""
    return tuple(_group(tree, node) for node in tree.tagged("MODE-DECLARATION-GROUP"))


def _group(tree: Tree, node: Node) -> ModeGroup:
    modes = [place_of(child) for child in node.inside("MODE-DECLARATION")]
    initial = tree.ref(node, "INITIAL-MODE-REF")
    modes.sort(key=lambda mode: initial is None or mode.path != initial.path)
    return ModeGroup(place=place_of(node), modes=tuple(modes), transitions=tuple(_transitions(tree, node)))


def _transitions(tree: Tree, group: Node) -> Iterator[tuple[Place, str, str]]:
    for node in group.inside("MODE-TRANSITION"):
        exited, entered = (tree.target(node, f"{end}-MODE-REF", ("MODE-DECLARATION",)) for end in ("EXITED", "ENTERED"))
        if exited is not None and entered is not None:
            yield place_of(node), exited.path, entered.path


COMPOSITION = "COMPOSITION-SW-COMPONENT-TYPE"
SERVICES = "ECU-SW-COMPOSITION"  # holds the service components of an ECU before release 4
_PORTS = ("P-PORT-PROTOTYPE", "R-PORT-PROTOTYPE", "PR-PORT-PROTOTYPE")


# ------------------------------------------------------------------------------------------------ reading


def read_compositions(tree: Tree) -> tuple[Composition, ...]:
    """Read every composition type with its prototypes and connectors."""
    return tuple(_composition(tree, node) for node in tree.tagged(COMPOSITION, SERVICES))


def _composition(tree: Tree, node: Node) -> Composition:
    connectors = [
        connector
        for child in node.inside("ASSEMBLY-SW-CONNECTOR", "DELEGATION-SW-CONNECTOR")
        for connector in dict.fromkeys(_connector(tree, child, part) for part in child.parts)
    ]
    return Composition(
        place=place_of(node),
        prototypes=tuple(
            Prototype(place_of(child), tree.path_at(child, "TYPE-TREF", kind="component prototype"))
            for child in node.inside("SW-COMPONENT-PROTOTYPE")
        ),
        connectors=tuple(connectors),
        periods=dict(_periods(tree, node)),
    )


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


def _periods(tree: Tree, node: Node) -> Iterator[tuple[tuple[str, str], Stated]]:
    for element, file in node.elements("INSTANTIATION-RTE-EVENT-PROPSS/INSTANTIATION-TIMING-EVENT-PROPS"):
        iref, period = (element.find(qualified(tag)) for tag in ("REFINED-EVENT-IREF", "PERIOD"))
        contexts, event = tree.instance(node, iref, file) if iref is not None else ([], None)
        text = "" if period is None else (period.text or "").strip()
        if contexts and event and period is not None and text:
            yield (event.path, contexts[-1].path), Stated(text, place(period, file))


def read_ecus(tree: Tree) -> tuple[Ecu, ...]:
    """Read every ECU instance with the component prototypes mapped to it; report one that is mapped to two."""
    ecus = tree.tagged("ECU-INSTANCE")
    mapped: dict[str, list[tuple[Node, list[tuple[str, ...]]]]] = {node.path: [] for node in ecus}
    owners: dict[tuple[str, ...], Stated] = {}
    for node in tree.tagged("SWC-TO-ECU-MAPPING"):
        ecu = tree.target(node, "ECU-INSTANCE-REF", ("ECU-INSTANCE",), "mapping")
        if ecu is not None:
            chains = list(_chains(tree, node))
            mapped[ecu.path].append((node, chains))
            for chain in chains:
                here = replace(node.stated, text=ecu.path)
                tree.agreed(node, f"the ECU of {chain[-1]}", (owners.setdefault(chain, here), here))
    return tuple(_ecu(tree, ecu, mapped[ecu.path]) for ecu in ecus)


def _ecu(tree: Tree, ecu: Node, mapped: Iterable[tuple[Node, list[tuple[str, ...]]]]) -> Ecu:
    units = [(tree.target(node, "PROCESSING-UNIT-REF", ("HW-ELEMENT",), "mapping"), found) for node, found in mapped]
    return Ecu(
        place_of(ecu),
        tuple(place_of(node) for node, _ in mapped),
        tuple((chain[-1], unit.path) for unit, found in units if unit is not None for chain in found),
        tuple(chain for _, found in mapped for chain in found),
    )


def _chains(tree: Tree, mapping: Node) -> Iterator[tuple[str, ...]]:
    """Yield each mapped prototype after those that hold it; some tools name it among these, too."""
    for element, file in tree.elements(mapping, "COMPONENT-IREFS/COMPONENT-IREF"):
        contexts, target = tree.instance(mapping, element, file)
        if target is not None:
            outer = (ref.path for ref in contexts if local(ref.element) == "CONTEXT-COMPONENT-REF")
            yield (*(path for path in outer if path != target.path), target.path)


def read_holders(tree: Tree) -> dict[str, tuple[str, ...]]:
    """Read which HW-ELEMENTs (paths) each HW-ELEMENT is nested in."""
    holders: dict[str, tuple[str, ...]] = {}
    for node in tree.tagged("HW-ELEMENT"):
        for ref in tree.refs(node, "NESTED-ELEMENTS/HW-ELEMENT-REF-CONDITIONAL/HW-ELEMENT-REF"):
            if tree.find(ref, f'{node.tag} "{node.path}"', ("HW-ELEMENT",)):
                holders[ref.path] = (*holders.get(ref.path, ()), node.path)
    return holders


def read_hardware(tree: Tree) -> tuple[Place, ...]:
    """Read the HW-ELEMENTs of the standard category ProcessingUnit."""
    return tuple(
        place_of(node)
        for node in tree.tagged("HW-ELEMENT")
        if any(ref.name == "ProcessingUnit" for ref in tree.refs(node, "HW-CATEGORY-REFS/HW-CATEGORY-REF"))
    )
