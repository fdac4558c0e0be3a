"""Component instances that the root compositions unfold into and the Rte names, and those of one chosen ECU."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from itertools import islice
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, Location, named
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.codes import ABSENT_MODULE
from halpipe.importers.arxml.files.words import listed, steps_of
from halpipe.importers.arxml.system.components import COMPOSITION, SERVICES
from halpipe.importers.arxml.system.containers import standard_modules
from halpipe.importers.arxml.system.values import Component, Composition, Ecu, Instance, RteInstance, System

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.importers.arxml.files.tree import Node, Ref, Tree

_MAX_DEPTH = 32
MAX_INSTANCES = 20_000
_PROTOTYPE = "SW-COMPONENT-PROTOTYPE"
Context = tuple[str, ...]
"""A root composition and the prototypes down to a component (paths)."""


def find_instances(
    tree: Tree,
    components: Sequence[Component],
    compositions: Sequence[Composition],
    mapped: Sequence[RteInstance],
    *,
    is_one: bool,
) -> tuple[tuple[Instance, ...], tuple[str, ...], dict[str, Context]]:
    """Unfold the root compositions into component instances; report several that are to be one system.

    Return them, the compositions (paths) taken for copies of others, and the context of the instance that each
    prototype (path) of the Rte configuration stands for.

    Roots are the compositions that a SYSTEM names, or else those that no other composition uses, and those of services
    or whose prototypes the Rte configuration names. Roots of which it names no instance are copies. Component types
    that no composition uses stand for themselves, as BSW modules do, or for the instances that only the Rte names.
    """
    by_path = {composition.place.path: composition for composition in compositions}
    types = {component.place.path: component for component in components}
    findings, of_systems = tree.findings, _of_systems(tree)
    roots = _roots(of_systems, compositions, mapped)
    unfolded = {root: _bounded(_unfold(by_path[root], (root,), by_path, types), by_path[root]) for root in roots}
    everything = [instance for root in roots for instance in unfolded[root]]
    configured, alone = _Configured(tree, everything, components).resolve(mapped)
    whole = {root: found for root, found in unfolded.items() if by_path[root].place.kind == COMPOSITION}
    copies = _copies(whole, {*configured.values(), *(item.prototype for item in mapped)})
    for root in copies:
        message = "none of its component prototypes is in the Rte configuration"
        help = "nothing to do if it is the system that the ECU extract was made of"
        by_path[root].place.report(findings, codes.COPY, message, help=help)
    kept = [instance for root in roots if root not in copies for instance in unfolded[root]]
    left = [root for root in of_systems if root not in copies]
    if not _report_shared_types(kept, by_path, findings) and is_one and len(left) > 1:
        message = f"is the root of a system, but so is {listed(left[1:])}: they are imported as one"
        help = "import the files of one system only"
        by_path[left[0]].place.report(findings, codes.SEVERAL_ROOTS, message, help=help)
    used = {instance.component.place.path for instance in (*kept, *alone)}
    rest = [component for component in components if component.place.path not in used]
    if kept:
        for component in rest:
            if not component.is_module and any(event.is_timing for event in component.events):
                message = "is used in no composition of the system, so that its runnables are no tasks"
                help = "add it to the composition, or import its file on its own"
                component.place.report(findings, codes.NOT_INSTANTIATED, message, help=help)
        rest = [component for component in rest if component.is_module]
    single = [Instance(_label(component), (component.place.path,), component) for component in rest]
    return (*kept, *alone, *single), copies, configured


class _Configured:
    """Finds the instances that the Rte configuration names, which is mostly made for the flattened ECU extract.

    A prototype that no file defines is looked up in the flat maps; else it is the only instance of its name, or the
    only one left, that has its events; else, where no composition has its type, it is an instance of its own.
    """

    def __init__(self, tree: Tree, instances: Sequence[Instance], components: Sequence[Component]) -> None:
        self._tree = tree
        self._instances = instances
        self._by_prototype: dict[str, list[Instance]] = {}
        for instance in instances:
            self._by_prototype.setdefault(instance.prototype, []).append(instance)
        self._owner = {event.place.path: component for component in components for event in component.events}
        self._upstream = dict(upstream(tree))

    def resolve(self, mapped: Sequence[RteInstance]) -> tuple[dict[str, Context], list[Instance]]:
        """Return the context that each named prototype stands for, and the instances that only the Rte knows."""
        found: dict[str, Context] = {}
        open_: list[RteInstance] = []
        for item in mapped:
            defined = self._by_prototype.get(item.prototype)
            context = defined[0].context if defined else self._by_flat_map(item)
            if context:
                found[item.prototype] = context
            elif not self._tree.has(item.prototype, _PROTOTYPE) and not self._tree.is_absent(item.prototype):
                open_.append(item)
        for is_named in (True, False):
            for item in [item for item in open_ if item.prototype not in found]:
                context = self._only(item, set(found.values()), is_named=is_named)
                if context:
                    found[item.prototype] = context
        used = {instance.component.place.path for instance in self._instances}
        alone: dict[str, Instance] = {}
        for item in [item for item in open_ if item.prototype not in found]:
            types = self._types(item)
            if len(types) == 1 and types[0].place.path not in used:
                context = (item.prototype.rpartition("/")[0], item.prototype)
                found[item.prototype] = context
                alone[item.prototype] = Instance(item.prototype.rpartition("/")[2], context, types[0])
            elif types or not item.events:
                self._report(item, types)
        return found, list(alone.values())

    def _by_flat_map(self, item: RteInstance) -> Context | None:
        steps = self._upstream.get(item.prototype)
        if steps is None:
            return None
        candidates = [i.context for i in self._by_prototype.get(steps[-1], ())]
        exact = [context for context in candidates if context[1:] == steps]
        return next(iter(exact or (candidates if len(candidates) == 1 else [])), None)

    def _only(self, item: RteInstance, taken: set[Context], *, is_named: bool) -> Context | None:
        """Return the only instance of the type that events tell; if `is_named`, of the name, and of such a type."""
        types = {component.place.path for component in self._types(item)}
        found = [
            i for i in self._instances if i.context not in taken and (i.component.place.path in types or not types)
        ]
        if is_named:
            found = [i for i in found if i.prototype.rpartition("/")[2] == item.prototype.rpartition("/")[2]]
        return found[0].context if len(found) == 1 and (types or is_named) else None

    def _types(self, item: RteInstance) -> list[Component]:
        """Return the component types that own the mapped events: one, unless the configuration is wrong."""
        found = {self._owner[path].place.path: self._owner[path] for path in item.events if path in self._owner}
        return list(found.values())

    def _report(self, item: RteInstance, types: Sequence[Component]) -> None:
        count = Counter(i.component.place.path for i in self._instances)
        several = sum(count[component.place.path] for component in types)
        why = f"; {several} instances could be meant" if several > 1 else ""
        self._tree.findings.report(
            codes.DANGLING,
            f"RteSoftwareComponentInstanceRef refers to {item.prototype}, which no file defines{why}, so that its "
            f"{len(item.events)} event mappings are lost",
            at=item.at,
            path=named(item.place.kind, item.place.path),
            help="add the ECU extract with the flat composition, or its FLAT-MAP, to the import",
        )


def upstream(tree: Tree) -> Iterator[tuple[str, Context]]:
    """Yield every prototype of a flat ECU extract, and the prototypes down to the one that it was made of."""
    for node in tree.tagged("FLAT-INSTANCE-DESCRIPTOR"):
        flat = tree.ref(node, "ECU-EXTRACT-REFERENCE-IREF/TARGET-REF")
        origin = tree.ref(node, "UPSTREAM-REFERENCE-IREF/TARGET-REF")
        if flat is not None and origin is not None and origin.dest in ("", _PROTOTYPE):
            refs = tree.refs(node, "UPSTREAM-REFERENCE-IREF/CONTEXT-ELEMENT-REF")
            inner = [ref.path for ref in refs if ref.dest == _PROTOTYPE and ref.path != origin.path]
            yield flat.path, (*inner, origin.path)


def _label(component: Component) -> str:
    """Name a module apart from the service component of the same name, which most modules have."""
    return f"BSW/{component.place.name}" if component.is_module else component.place.name


def _of_systems(tree: Tree) -> list[str]:
    """Return the root compositions (paths) that SYSTEMs name."""
    nodes = tree.tagged("ROOT-SW-COMPOSITION-PROTOTYPE")
    found = (tree.path_at(node, "SOFTWARE-COMPOSITION-TREF", (COMPOSITION,), "root composition") for node in nodes)
    return list(dict.fromkeys(path for path in found if path is not None))


def _roots(chosen: Sequence[str], compositions: Sequence[Composition], named: Sequence[RteInstance]) -> list[str]:
    used = {prototype.type for composition in compositions for prototype in composition.prototypes}
    unused = [c.place.path for c in compositions if c.place.path not in used and c.place.kind == COMPOSITION]
    holders = {item.prototype.rpartition("/")[0] for item in named}
    services = {composition.place.path for composition in compositions if composition.place.kind == SERVICES}
    more = [c.place.path for c in compositions if c.place.path in services | holders and c.prototypes]
    return list(dict.fromkeys((*(chosen or unused), *(path for path in more if path not in used))))


def _unfold(
    composition: Composition,
    context: tuple[str, ...],
    compositions: dict[str, Composition],
    types: dict[str, Component],
) -> Iterator[Instance]:
    """Yield the instances inside one use of a composition; refuse one that is inside itself, or too deep."""
    if len(context) > _MAX_DEPTH:
        raise _too_many(f"is nested in more than {_MAX_DEPTH - 1} compositions", composition)
    for prototype in composition.prototypes:
        inner = (*context, prototype.place.path)
        if prototype.place.path in context:
            raise _too_many("is a part of itself", composition)
        if prototype.type in compositions:
            yield from _unfold(compositions[prototype.type], inner, compositions, types)
        elif prototype.type in types:
            label = "/".join(path.rpartition("/")[2] for path in inner[1:])
            yield Instance(label, inner, types[prototype.type])


def _bounded(instances: Iterator[Instance], root: Composition) -> list[Instance]:
    """Collect instances; compositions that multiply beyond all reason are refused."""
    found = list(islice(instances, MAX_INSTANCES + 1))
    if len(found) > MAX_INSTANCES:
        raise _too_many(f"makes more than {MAX_INSTANCES} component instances", root)
    return found


def _too_many(message: str, composition: Composition) -> HalpipeError:
    at, path = composition.place.at, named("composition", composition.place.path)
    return HalpipeError(codes.TOO_MANY(message, at=at, path=path, help="import one part of the system at a time"))


def _copies(unfolded: dict[str, list[Instance]], configured: set[Context | str]) -> tuple[str, ...]:
    """Return the roots without any of the contexts and prototypes of the Rte configuration, if others have some."""

    def is_configured(root: str) -> bool:
        return any(not configured.isdisjoint((i.context, *i.context)) for i in unfolded[root])

    if not any(is_configured(root) for root in unfolded):
        return ()
    return tuple(root for root in unfolded if not is_configured(root))


def _report_shared_types(instances: Sequence[Instance], by_path: dict[str, Composition], findings: Findings) -> bool:
    """Report root compositions that use the same component types; return whether there are any."""
    roots: dict[str, list[str]] = {}
    for instance in instances:
        known = roots.setdefault(instance.component.place.path, [])
        if instance.context[0] not in known:
            known.append(instance.context[0])
    pairs = dict.fromkeys(tuple(found) for found in roots.values() if len(found) > 1)
    for pair in pairs:
        shared = next(path for path, found in roots.items() if tuple(found) == pair)
        message = f"{shared} and others are used in each of {', '.join(pair)}"
        help = "import the files of one system only, or add the ECU configuration of the Rte"
        by_path[pair[0]].place.report(findings, codes.SEVERAL_ROOTS, message, help=help)
    return bool(pairs)


_MODULE, _CONTAINER = "ECUC-MODULE-CONFIGURATION-VALUES", "ECUC-CONTAINER-VALUE"
_STANDARD = re.compile(r"(?<![a-z])(?:[a-z]|[A-Z0-9_]+)?(?:Os|Rte|EcuC)$")  # by name: Os, iRte, VTTOs, MyEcu_Rte


@record
class Selection:
    """The ECU that is imported (None: there are not several), and its module configurations (paths; None: all).

    `is_whole` tells that everything is of one ECU, though the system describes more.
    """

    ecu: Ecu | None = None
    modules: frozenset[str] | None = None
    is_whole: bool = False


def select_ecu(tree: Tree, ecus: Sequence[Ecu], name: str) -> Selection:
    """Choose the ECU called `name`; raise `HalpipeError` if there are several and none, or an unknown one, is named."""
    used = [ecu for ecu in ecus if any(tree.has(path, "SW-COMPONENT-PROTOTYPE") for path in ecu.prototypes)]
    groups, systems = _groups(tree), _operating_systems(tree)
    configured = {name: os for name, paths in groups.items() if (os := [p for p in paths if p in systems])}
    several = len({*map(tuple, configured.values())}) > 1
    if name in groups:
        return Selection(modules=frozenset(groups[name]))
    if name:
        chosen = [ecu for ecu in used or ecus if name in (ecu.place.name, ecu.place.path)]
        if len(chosen) != 1:
            known = [ecu.place.name for ecu in used or ecus]
            tree.findings.report(
                codes.UNKNOWN_ECU,
                f'there are several ECUs "{name}"' if chosen else f'there is no ECU "{name}"',
                at=chosen[0].place.at if chosen else used[0].place.at if used else Location(),
                help="name it by its path"
                if chosen
                else did_you_mean(name, known, f"the ECUs are {', '.join(known) or 'none'}"),
            )
    elif several or (len(used) > 1 and not _is_of_tresos(tree)):
        chosen = []
        places = [(ecu.place.name, ecu.place.at) for ecu in used]
        what = "have components"
        if several and len(used) < 2:
            places, what = [(group, systems[paths[0]].at) for group, paths in configured.items()], "have an Os"
        message = f"{len(places)} ECUs {what}: {', '.join(f'{label} ({at})' for label, at in places)}"
        help = f"choose one: --ecu {used[0].place.name if used else places[0][0]}"
        tree.findings.report(codes.SEVERAL_ECUS, message, at=places[0][1], help=help)
    else:
        return Selection(is_whole=len(used) > 1)
    tree.findings.stop_on_errors()
    return Selection(chosen[0], _modules(tree, ecus, groups, chosen[0]) if several or len(used) > 1 else None)


def _operating_systems(tree: Tree) -> dict[str, Node]:
    """Return the configurations of an Os (by path) that have OsTasks, which what a vendor proposes has not."""
    modules = (tree.nodes_at(path)[0] for path, module in standard_modules(tree).items() if module == "Os")
    return {node.path: node for node in modules if any(map(_is_os_task, node.inside(_CONTAINER)))}


def _is_os_task(container: Node) -> bool:
    return any((e.text or "").strip().endswith("/OsTask") for e, _ in container.elements("DEFINITION-REF"))


def _is_of_tresos(tree: Tree) -> bool:
    """Whether a project of EB tresos configures the Rte: it has one ECU, whatever else its system describes."""
    standard = standard_modules(tree)
    return any(standard.get(node.path) == "Rte" and node.at.file.endswith(".xdm") for node in tree.tagged(_MODULE))


# ------------------------------------------------------------------------------------------- ECU configurations


def _modules(tree: Tree, ecus: Sequence[Ecu], groups: dict[str, list[str]], chosen: Ecu) -> frozenset[str]:
    """Return the module configurations of the chosen ECU, by the groups in which they are configured together."""
    owners = {name: _owner(tree, name, modules, ecus) for name, modules in groups.items()}
    found = frozenset(path for name, modules in groups.items() if owners[name] == chosen for path in modules)
    unlinked = [name for name, owner in owners.items() if owner is None and groups[name]]
    if unlinked and not found and len(unlinked) == 1 and len(groups) == 1:
        found = frozenset(groups[unlinked[0]])
    for name in unlinked:
        first = tree.nodes_at(next(iter(groups[name])))[0]
        taken = "taken for that of the chosen one" if found and found == frozenset(groups[name]) else "left out"
        message = f"its {len(groups[name])} modules are of no ECU that is known, and {taken}"
        help = "add the ECUC-VALUE-COLLECTION and the SYSTEM of its ECU extract"
        tree.findings.report(codes.UNLINKED, message, at=first.at, path=named("ECU configuration", name), help=help)
    return found


def _collected(tree: Tree, collection: Node) -> list[Ref]:
    """Return the references to module configurations, which releases before 4 do not wrap."""
    plain = f"ECUC-VALUES/{_MODULE}-REF"
    return [*tree.refs(collection, f"{plain}-CONDITIONAL/{_MODULE}-REF"), *tree.refs(collection, plain)]


def report_absent(tree: Tree) -> None:
    """Report the configurations of Os, Rte and EcuC that a collection names, and no file has."""
    for node in tree.tagged("ECUC-VALUE-COLLECTION"):
        absent = [r for r in _collected(tree, node) if _STANDARD.search(r.path) and not tree.has(r.path, _MODULE)]
        if absent:
            message = f"names {listed([ref.path for ref in absent])}, which no file defines"
            help = "add the files of the ECU configuration that hold them"
            at, path = absent[0].at, named("ECUC-VALUE-COLLECTION", node.path)
            tree.findings.report(ABSENT_MODULE, message, at=at, path=path, help=help)


def _groups(tree: Tree) -> dict[str, list[str]]:
    """Return the module configurations (paths) of every collection, and of every package for those in none."""
    groups: dict[str, list[str]] = {}
    collected = set()
    for node in tree.tagged("ECUC-VALUE-COLLECTION"):
        found = [ref.path for ref in _collected(tree, node) if tree.has(ref.path, _MODULE)]
        if found:
            groups[node.path] = found
            collected.update(found)
    for node in tree.tagged(_MODULE):
        if node.path not in collected:
            groups.setdefault(node.path.rpartition("/")[0], []).append(node.path)
    return groups


def _owner(tree: Tree, name: str, modules: Sequence[str], ecus: Sequence[Ecu]) -> Ecu | None:
    """Return the ECU of a group: by the system that it names, by the instances of its Rte, or by its name."""
    for node in tree.nodes_at(name):
        extract = tree.ref(node, "ECU-EXTRACT-REF") if node.tag == "ECUC-VALUE-COLLECTION" else None
        if extract is not None:
            mapped = [e for e in ecus if any(m.path.startswith(extract.path + "/") for m in e.mappings)]
            if len(mapped) == 1:
                return mapped[0]
    chains = dict(upstream(tree))
    named: set[str] = set()
    for node in tree.tagged(_CONTAINER):
        if any(node.path.startswith(module + "/") for module in modules):
            for ref in tree.refs(node, "REFERENCE-VALUES/ECUC-REFERENCE-VALUE/VALUE-REF"):
                named |= {ref.path, *chains.get(ref.path, ())} if ref.dest in (_PROTOTYPE, "") else set()
    by_instances = [ecu for ecu in ecus if not named.isdisjoint(ecu.prototypes)]
    if len(by_instances) == 1:
        return by_instances[0]
    steps = [step for path in (name, *modules) for step in path.split("/")]
    by_name = [e for e in ecus if any(s == e.place.name or s.endswith(f"_{e.place.name}") for s in steps)]
    return by_name[0] if len(by_name) == 1 else None


# ------------------------------------------------------------------------------------------------------ instances


def keep_own(tree: Tree, system: System, ecu: Ecu) -> System:
    """Return the system with what is on one ECU; report what is on none."""
    chains = dict(upstream(tree))
    configured = set(system.configured.values())
    own: list[Instance] = []
    lost: list[Instance] = []
    for instance in system.instances:
        if instance.component.is_module:
            if _is_used(tree, instance, system):
                own.append(instance)
            continue
        found = ecu_of(instance, system.ecus, chains)
        if found == ecu or (found is None and instance.context in configured):
            own.append(instance)
        elif found is None and instance.component.events:
            lost.append(instance)
    if lost:
        message = f"{len(lost)} component instances are mapped to no ECU: {listed([i.label for i in lost])}"
        help = "add an SWC-TO-ECU-MAPPING for each, or for a composition that holds them"
        tree.findings.report(codes.UNMAPPED_COMPONENT, message, at=lost[0].component.place.at, help=help)
    return replace(system, instances=tuple(own), ecus=(ecu,), place=ecu.place)


def ecu_of(instance: Instance, ecus: Sequence[Ecu], chains: dict[str, tuple[str, ...]]) -> Ecu | None:
    """Return the ECU that an instance, or the innermost composition round it that is mapped, is mapped to."""
    contexts = [instance.context[1:], chains.get(instance.prototype, ())]
    for context in contexts:
        for depth in range(len(context), 0, -1):
            for ecu in ecus:
                if any(context[:depth][-len(chain) :] == chain for chain in ecu.chains):
                    return ecu
    return None


def _is_used(tree: Tree, instance: Instance, system: System) -> bool:
    """Whether the ECU configuration has the module of an instance, or maps an event of it; all if it has none."""
    configuration = system.configuration
    if not configuration.modules:
        return True
    events = {event.place.path for event in instance.component.events}
    if any(mapping.event in events for mapping in configuration.mappings):
        return True
    texts = (tree.text(node, "DEFINITION-REF") for path in configuration.modules for node in tree.nodes_at(path))
    return instance.component.place.name in {steps_of(text.text)[-1] for text in texts if text}
