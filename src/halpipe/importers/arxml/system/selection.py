"""One ECU of a vehicle: which component instances, modules and ECU configurations are its own, and what it shares."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Location, named
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.importers.arxml import selection_codes as codes
from halpipe.importers.arxml.meaning_codes import ABSENT_MODULE
from halpipe.importers.arxml.names import listed
from halpipe.importers.arxml.system.containers import standard_modules
from halpipe.importers.arxml.system.instances import upstream

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.importers.arxml.files.tree import Node, Tree
    from halpipe.importers.arxml.system.values import Ecu, Instance, System

_MODULE, _CONTAINER = "ECUC-MODULE-CONFIGURATION-VALUES", "ECUC-CONTAINER-VALUE"
_COLLECTED = "ECUC-VALUES/ECUC-MODULE-CONFIGURATION-VALUES-REF-CONDITIONAL/ECUC-MODULE-CONFIGURATION-VALUES-REF"
_OLD_COLLECTED = "ECUC-VALUES/ECUC-MODULE-CONFIGURATION-VALUES-REF"
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
    if name:
        chosen = [ecu for ecu in used or ecus if name in (ecu.place.name, ecu.place.path)]
        if len(chosen) != 1:
            known = [ecu.place.name for ecu in used or ecus]
            tree.findings.add(
                codes.UNKNOWN_ECU(
                    f'there are several ECUs "{name}"' if chosen else f'there is no ECU "{name}"',
                    at=chosen[0].place.at if chosen else used[0].place.at if used else Location(),
                    help="name it by its path"
                    if chosen
                    else did_you_mean(name, known, f"the ECUs are {', '.join(known) or 'none'}"),
                )
            )
    elif len(used) > 1 and not _is_of_tresos(tree):
        chosen = []
        tree.findings.add(
            codes.SEVERAL_ECUS(
                f"{len(used)} ECUs have components: " + ", ".join(f"{ecu.place.name} ({ecu.place.at})" for ecu in used),
                at=used[0].place.at,
                help=f"choose one: --ecu {used[0].place.name}",
            )
        )
    else:
        return Selection(is_whole=len(used) > 1)
    tree.findings.stop_on_errors()
    return Selection(chosen[0], _modules(tree, used, chosen[0]) if len(used) > 1 else None)


def _is_of_tresos(tree: Tree) -> bool:
    """Whether a project of EB tresos configures the Rte: it has one ECU, whatever else its system describes."""
    standard = standard_modules(tree)
    return any(standard.get(node.path) == "Rte" and node.at.file.endswith(".xdm") for node in tree.tagged(_MODULE))


# ------------------------------------------------------------------------------------------- ECU configurations


def _modules(tree: Tree, ecus: Sequence[Ecu], chosen: Ecu) -> frozenset[str]:
    """Return the module configurations of the chosen ECU, by the groups in which they are configured together."""
    groups = _groups(tree)
    owners = {name: _owner(tree, name, modules, ecus) for name, modules in groups.items()}
    found = frozenset(path for name, modules in groups.items() if owners[name] == chosen for path in modules)
    unlinked = [name for name, owner in owners.items() if owner is None and groups[name]]
    if unlinked and not found and len(unlinked) == 1 and len(groups) == 1:
        found = frozenset(groups[unlinked[0]])
    for name in unlinked:
        first = tree.nodes_at(next(iter(groups[name])))[0]
        taken = "taken for that of the chosen one" if found and found == frozenset(groups[name]) else "left out"
        tree.findings.add(
            codes.UNLINKED(
                f"its {len(groups[name])} modules are of no ECU that is known, and {taken}",
                at=first.at,
                path=named("ECU configuration", name),
                help="add the ECUC-VALUE-COLLECTION and the SYSTEM of its ECU extract",
            )
        )
    return found


def report_absent(tree: Tree) -> None:
    """Report the configurations of Os, Rte and EcuC that a collection names, and no file has."""
    for node in tree.tagged("ECUC-VALUE-COLLECTION"):
        absent = [
            ref
            for path in (_COLLECTED, _OLD_COLLECTED)
            for ref in tree.refs(node, path)
            if _STANDARD.search(ref.path) and not tree.has(ref.path, _MODULE)
        ]
        if absent:
            tree.findings.add(
                ABSENT_MODULE(
                    f"names {listed([ref.path for ref in absent])}, which no file defines",
                    at=absent[0].at,
                    path=named("ECUC-VALUE-COLLECTION", node.path),
                    help="add the files of the ECU configuration that hold them",
                )
            )


def _groups(tree: Tree) -> dict[str, list[str]]:
    """Return the module configurations (paths) of every collection, and of every package for those in none."""
    groups: dict[str, list[str]] = {}
    collected = set()
    for node in tree.tagged("ECUC-VALUE-COLLECTION"):
        refs = (*tree.refs(node, _COLLECTED), *tree.refs(node, _OLD_COLLECTED))
        found = [ref.path for ref in refs if tree.has(ref.path, _MODULE)]
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
            for path in _instance_refs(tree, node):
                named.update((path, *chains.get(path, ())))
    by_instances = [ecu for ecu in ecus if not named.isdisjoint(ecu.prototypes)]
    if len(by_instances) == 1:
        return by_instances[0]
    steps = [step for path in (name, *modules) for step in path.split("/")]
    by_name = [e for e in ecus if any(s == e.place.name or s.endswith(f"_{e.place.name}") for s in steps)]
    return by_name[0] if len(by_name) == 1 else None


def _instance_refs(tree: Tree, node: Node) -> Iterator[str]:
    for element, file in tree.elements(node, "REFERENCE-VALUES/ECUC-REFERENCE-VALUE/VALUE-REF"):
        ref = tree.reference(node, element, file)
        if ref is not None and ref.dest in ("SW-COMPONENT-PROTOTYPE", ""):
            yield ref.path


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
        tree.findings.add(
            codes.UNMAPPED_COMPONENT(
                f"{len(lost)} component instances are mapped to no ECU: {listed([i.label for i in lost])}",
                at=lost[0].component.place.at,
                help="add an SWC-TO-ECU-MAPPING for each, or for a composition that holds them",
            )
        )
    others = tuple(instance for instance in system.instances if instance not in own and instance not in lost)
    return replace(system, instances=tuple(own), others=others, ecus=(ecu,), place=ecu.place)


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
    names = {tree.last_of_definition(path) for path in configuration.modules}
    return instance.component.place.name in names
