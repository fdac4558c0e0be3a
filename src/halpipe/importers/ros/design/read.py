"""From design files to one graph for each mode of the system."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, Location, named, sort_diagnostics
from halpipe.core.files import YamlMap
from halpipe.core.records import record
from halpipe.importers.ros import codes
from halpipe.importers.ros.design.entities import Catalogue
from halpipe.importers.ros.design.processes import NodeProcesses
from halpipe.importers.ros.design.structure import Structure
from halpipe.importers.ros.names import printable
from halpipe.importers.ros.sources.graph import Callback, Group, Node, Publication, RosGraph, Subscription

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from halpipe.core.diagnostics import Findings
    from halpipe.importers.common.base import Coverage
    from halpipe.importers.ros.design.entities import Entity

ONLY_MODE = "default"


@record
class ModeGraph:
    """The graph of one mode, and the compute unit of each node that has one."""

    mode: str
    graph: RosGraph
    units: Mapping[str, str]
    at: Location


@record
class Design:
    """A system: its name, and its modes, of which the default one comes first."""

    name: str
    modes: tuple[ModeGraph, ...]


def read_design(files: Sequence[tuple[str, YamlMap]], findings: Findings, coverage: Coverage) -> Design:
    """Read design files by name; raise `HalpipeError` if several systems are among them that no other builds on."""
    catalogue = Catalogue(findings)
    for file, body in files:
        catalogue.add(body, file)
    root = _root(catalogue)
    if root is None:
        structure = Structure(catalogue)
        alone = _unused(catalogue)
        for entity in alone:
            structure.expand_alone(entity)
        mode = _mode(ONLY_MODE, structure, None, Location(files[0][0]), coverage)
        _account_files(catalogue, coverage)
        return Design(alone[0].name.rpartition(".")[0] if len(alone) == 1 else "", (mode,))
    body = catalogue.resolve(root, ())
    reader = catalogue.reader(body)
    label = f'entity "{root.name}"'
    stated = []
    for entry in reader.entries(body, "modes", label):
        coverage.mapped("mode")
        stated.append((reader.text(entry, "name", label), entry.get("default") is not True, catalogue.at(entry)))
    modes = []
    for name, _, at in sorted(stated, key=lambda mode: mode[1]) or [(ONLY_MODE, False, root.at)]:
        change = body.get(name)
        changed = catalogue.changed(body, change) if isinstance(change, YamlMap) else body
        structure = Structure(catalogue)
        structure.expand(changed, label, _components(catalogue, body) - _components(catalogue, changed))
        modes.append(_mode(printable(name), structure, changed, at, coverage))
    _account_files(catalogue, coverage)
    return Design(root.name.rpartition(".")[0], tuple(modes))


def _account_files(catalogue: Catalogue, coverage: Coverage) -> None:
    """Account for the file of every entity: those that nothing resolved are no part of the system."""
    for entity in catalogue.entities.values():
        if entity.resolved is not None:
            coverage.mapped(f"{entity.kind}_file")
        else:
            coverage.ignored(f"{entity.kind}_file", entity.name, "no part of the system uses it", entity.at)


def _components(catalogue: Catalogue, system: YamlMap) -> set[str]:
    return {str(entry.get("name")) for entry in catalogue.reader(system).entries(system, "components", "system")}


def _root(catalogue: Catalogue) -> Entity | None:
    systems = list(catalogue.of_kind("system"))
    bases = {system.body.get("base") for system in systems}
    roots = [system for system in systems if system.name not in bases] or systems[:1]
    if len(roots) > 1:
        names = ", ".join(f'"{system.name}"' for system in roots)
        raise HalpipeError(
            *sort_diagnostics(catalogue.findings.items),
            *(
                codes.TWO_GRAPHS(f"is one of {len(roots)} systems: {names}", at=system.at, help="name one")
                for system in roots
            ),
        )
    return roots[0] if roots else None


def _unused(catalogue: Catalogue) -> list[Entity]:
    """Return the modules and nodes that no other module instantiates."""
    used = {
        instance.get("entity")
        for module in catalogue.of_kind("module")
        for instance in catalogue.reader(module.body).entries(catalogue.resolve(module, ()), "instances", "")
    }
    return [entity for entity in catalogue.of_kind("module", "node") if entity.name not in used]


def _mode(name: str, structure: Structure, system: YamlMap | None, at: Location, coverage: Coverage) -> ModeGraph:
    catalogue = structure.catalogue
    parameters = _parameters(catalogue, system)
    variables = _values(catalogue, system, "variables") if system is not None else {}
    nodes: list[Node] = []
    callbacks: list[Callback] = []
    publications: list[Publication] = []
    subscriptions: list[Subscription] = []
    taken: dict[str, Location] = {}
    for instance in structure.instances:
        if instance.path in taken:
            text, help = f"is there twice, first from {taken[instance.path]}", "give one of the two another path"
            path = named("node", instance.path)
            catalogue.findings.add(codes.DUPLICATE(text, at=instance.at, path=path, help=help))
            continue
        taken[instance.path] = instance.at
        own = _values(catalogue, instance.body, "param_values")
        values = {**variables, **own, **parameters.get(instance.path, {})}
        reader = NodeProcesses(instance, structure, catalogue, values)
        reader.read(coverage)
        nodes.append(Node(name=instance.path, at=instance.at))
        callbacks += reader.callbacks
        publications += reader.publications
        subscriptions += reader.subscriptions
    graph = RosGraph(
        file=at.file,
        nodes=tuple(nodes),
        callbacks=tuple(callbacks),
        publications=tuple(publications),
        subscriptions=tuple(dict.fromkeys(subscriptions)),
        groups=() if system is None else tuple(_containers(catalogue, system, callbacks)),
    )
    for number in range(structure.services):
        coverage.ignored("service_connection", f"{name} {number}", "a service is called on demand", at)
    units = {instance.path: instance.unit for instance in structure.instances if instance.unit}
    return ModeGraph(name, graph, units, at)


def _values(catalogue: Catalogue, body: YamlMap, key: str) -> dict[str, str]:
    """Return the values of parameters or variables: their ``value``, else their ``default``."""
    found = {}
    for entry in catalogue.reader(body).entries(body, key, key):
        value = entry.get("value", entry.get("default"))
        if isinstance(value, str):
            found[str(entry.get("name"))] = value
    return found


def _parameters(catalogue: Catalogue, system: YamlMap | None) -> dict[str, dict[str, str]]:
    """Return the values that parameter sets give, by the node's path; sets without a file are left out."""
    found: dict[str, dict[str, str]] = {}
    if system is None:
        return found
    reader = catalogue.reader(system)
    names = [name for name, _ in reader.names(system, "parameter_sets", "parameter_sets")]
    for component in reader.entries(system, "components", "components"):
        names += [name for name, _ in catalogue.reader(component).names(component, "parameter_set", "component")]
    for name in dict.fromkeys(names):
        entity = catalogue.entities.get(name)
        body = catalogue.resolve(entity, ()) if entity is not None else YamlMap(0)
        for entry in catalogue.reader(body).entries(body, "parameters", name):
            found.setdefault(str(entry.get("node")), {}).update(_values(catalogue, entry, "param_values"))
    return found


def _containers(catalogue: Catalogue, system: YamlMap, callbacks: Iterable[Callback]) -> Iterable[Group]:
    """Yield the node groups: containers of one thread run their callbacks one after the other."""
    reader = catalogue.reader(system)
    for entry in reader.entries(system, "node_groups", "system"):
        name = reader.text(entry, "name", "system")
        kind = reader.optional(entry, "type", f'node group "{name}"') or ""
        patterns = [_glob(text) for text, _ in reader.names(entry, "nodes", f'node group "{name}"')]
        members = tuple(c.name for c in callbacks if any(pattern.fullmatch(c.node) for pattern in patterns))
        single = re.search(r"_mt(_|$)", kind) is None
        yield Group(kind="executor", name=name, exclusive=single, callbacks=members, at=catalogue.at(entry))


def _glob(text: str) -> re.Pattern[str]:
    return re.compile(".*".join(re.escape(part) for part in text.split("*")))
