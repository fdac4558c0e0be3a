"""Reader of Autoware System Design files: a graph for each mode of a system, and one model of the models of the modes.

A process that another one triggers reads an inner topic, called ``<node>~<process>``, which the other publishes. Of
several triggers, whichever comes counts: like the format's own tool, the importer takes the highest rate of all.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Findings, HalpipeError, Location, about, named, sort_diagnostics
from halpipe.core.durations import Duration, seconds
from halpipe.core.files import YamlList, YamlMap
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.importers.ros import codes
from halpipe.importers.ros.graph import Callback, Group, Kind, Node, Publication, RosGraph, Subscription, printable
from halpipe.importers.ros.structure import PUBLISHER, SUBSCRIBER, Catalogue, Entity, Instance, Port, Structure, list_of
from halpipe.models import Mode, Run, Task, TaskModel, Unit, Version

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from halpipe.importers.common.base import Coverage


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
    readers: list[NodeProcesses] = []
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
        readers.append(reader)
    callbacks = [callback for reader in readers for callback in reader.callbacks]
    graph = RosGraph(
        file=at.file,
        nodes=tuple(Node(name=reader.instance.path, at=reader.instance.at) for reader in readers),
        callbacks=tuple(callbacks),
        publications=tuple(publication for reader in readers for publication in reader.publications),
        subscriptions=tuple(dict.fromkeys(each for reader in readers for each in reader.subscriptions)),
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


_RATE = re.compile(r"[0-9]{1,9}(?:\.[0-9]{1,9})?")
_VARIABLE = re.compile(r"\$\((?:var|param|parameter) ([\w./-]+)\)|\$\{(?:parameter |var )?([\w./-]+)\}")
_OUTPUTS = ("to_output", "to_output_topic")
_CONDITIONS = ("periodic", "on_input", "on_trigger", "once", "and", "or", "warn_rate", "error_rate", "timeout", "name")


@dataclass(slots=True)
class _Triggers:
    """Triggers of a process: rates, ports and other processes; `once` are ports that it only waits for at first."""

    period: Duration | None = None
    ports: dict[str, None] = field(default_factory=dict)
    processes: dict[str, None] = field(default_factory=dict)
    once: dict[str, None] = field(default_factory=dict)


@dataclass(slots=True)
class NodeProcesses:
    """Reads the processes of one node instance; the lists hold what was found."""

    instance: Instance
    structure: Structure
    catalogue: Catalogue
    values: Mapping[str, str]
    callbacks: list[Callback] = field(default_factory=list)
    publications: list[Publication] = field(default_factory=list)
    subscriptions: list[Subscription] = field(default_factory=list)

    def read(self, coverage: Coverage) -> None:
        """Read all processes, then the ports that they use and those that none uses."""
        body, path = self.instance.body, self.instance.path
        reader = self.catalogue.reader(body)
        where = f'node "{path}"'
        ports = {side: self._ports(side) for side in (PUBLISHER, SUBSCRIBER)}
        entries = {}
        for entry in reader.entries(body, "processes", where):
            name = reader.text(entry, "name", where)
            if name in entries:
                help = "rename one of the two"
                at = self.catalogue.at(entry)
                self.catalogue.findings.add(
                    codes.DUPLICATE("is declared again", at=at, path=f'{where} process "{name}"', help=help)
                )
            elif name:
                entries[name] = entry
        triggers = {name: self._triggers(entry, f'{where} process "{name}"') for name, entry in entries.items()}
        published = self._outcomes(entries, triggers, ports[PUBLISHER])
        asked = dict.fromkeys(name for found in triggers.values() for name in found.processes if name in entries)
        self.publications += [
            Publication(
                node=path, topic=f"{path}~{name}", callbacks=(f"{path}/{name}",), at=self.catalogue.at(entries[name])
            )
            for name in asked
        ]
        read: set[str] = set()
        for name, entry in entries.items():
            read |= self._callback(name, entry, triggers, ports[SUBSCRIBER])
        self._unused(ports, published, read, coverage)

    def _ports(self, side: str) -> dict[str, YamlMap]:
        reader = self.catalogue.reader(self.instance.body)
        key = list_of(self.instance.body, side)
        return {str(e.get("name")): e for e in reader.entries(self.instance.body, key, "ports")}

    # -------------------------------------------------------------------------------------------- triggers

    def _triggers(self, entry: YamlMap, where: str) -> _Triggers:
        found = _Triggers()
        self._gather(entry.get("trigger_conditions"), entry, where, found)
        return found

    def _gather(self, value: Any, entry: YamlMap, where: str, into: _Triggers) -> None:
        """Read conditions, however ``and`` and ``or`` nest them."""
        reader = self.catalogue.reader(entry)
        if value is None:
            return
        if isinstance(value, YamlList):
            for item in value:
                self._gather(item, entry, where, into)
            return
        if not isinstance(value, YamlMap):
            reader.malformed("trigger_conditions lists something that is no condition", entry.line, where)
            return
        reader.check_keys(value, where, _CONDITIONS)
        for key, inner in value.items():
            text = printable(inner) if isinstance(inner, str) else ""
            if key in ("and", "or"):
                self._gather(inner, entry, where, into)
            elif key == "periodic":
                period = self._period(text, value, where)
                into.period = min((p for p in (into.period, period) if p is not None), default=None)
            elif key == "on_input" and text:
                into.ports[text] = None
            elif key == "on_trigger" and text:
                into.processes[text] = None
            elif key == "once" and text:
                into.once[text] = None

    def _period(self, text: str, condition: YamlMap, where: str) -> Duration | None:
        """Return the period of a rate in Hz, exactly; variables have the value that the instance or its node gives."""
        match = _VARIABLE.fullmatch(text)
        shown, name = text, ""
        if match is not None:
            name = match[1] or match[2]
            text = self.values.get(name, "")
        at = self.catalogue.at(condition)
        if _RATE.fullmatch(text) and Fraction(text):
            return seconds(1 / Fraction(text))
        what = f'"{shown}" has the value "{text}"' if name and text else f'"{shown}" has no value' if name else shown
        problem = f"periodic: {what or 'nothing'}; it must be a rate in Hz above 0"
        help = "state the rate as a number, or give the parameter a default in param_values"
        self.catalogue.findings.add(codes.NO_RATE(problem, at=at, path=where, help=help))
        return None

    # -------------------------------------------------------------------------------------------- data flow

    def _outcomes(
        self, entries: Mapping[str, YamlMap], triggers: Mapping[str, _Triggers], ports: Mapping[str, YamlMap]
    ) -> set[str]:
        """Add what every process publishes; let those it triggers know of it; return the ports that are used."""
        path, used = self.instance.path, set()
        for name, entry in entries.items():
            reader = self.catalogue.reader(entry)
            where = f'node "{path}" process "{name}"'
            at = self.catalogue.at(entry)
            me = (f"{path}/{name}",)
            for outcome in reader.entries(entry, "outcomes", where):
                reader.check_keys(outcome, where, (*_OUTPUTS, "to_trigger", "terminal"))
                for key, value in outcome.items():
                    target = printable(value) if isinstance(value, str) else ""
                    if key in _OUTPUTS:
                        topic = self.structure.topic(Port(path, PUBLISHER, target))
                        self.publications.append(Publication(node=path, topic=topic, callbacks=me, at=at))
                        used.add(target)
                        self._known("publisher", target, ports, where, outcome)
                    elif (
                        key == "to_trigger"
                        and self._known("process", target, triggers, where, outcome)
                        and not triggers[target].period
                    ):
                        triggers[target].processes[name] = None
        return used

    def _callback(
        self, name: str, entry: YamlMap, processes: Mapping[str, _Triggers], ports: Mapping[str, YamlMap]
    ) -> set[str]:
        """Add the callback of a process; return the ports that it reads."""
        triggers = processes[name]
        path, at = self.instance.path, self.catalogue.at(entry)
        where = f'node "{path}" process "{name}"'
        inputs: dict[str, None] = {}
        for port in triggers.ports:
            self._known("subscriber", port, ports, where, entry)
            for topic in self.structure.topics(Port(path, SUBSCRIBER, port)):
                inputs[topic] = None
                self.subscriptions.append(Subscription(node=path, topic=topic, callback=f"{path}/{name}", at=at))
        for process in triggers.processes:
            if self._known("process", process, processes, where, entry):
                inputs[f"{path}~{process}"] = None
        stated = Callback(name=f"{path}/{name}", node=path, kind=Kind.PROCESS, inputs=tuple(inputs), at=at)
        self.callbacks.append(replace(stated, period=triggers.period))
        return set(triggers.ports) | set(triggers.once)

    def _unused(
        self, ports: Mapping[str, Mapping[str, YamlMap]], published: set[str], read: set[str], coverage: Coverage
    ) -> None:
        path, at = self.instance.path, self.catalogue.at
        for name, entry in ports[PUBLISHER].items():
            if name not in published:
                coverage.ignored("publisher", f"{path} {name}", "no process states it as its output", at(entry))
        for name, entry in ports[SUBSCRIBER].items():
            if name not in read:
                coverage.ignored("subscription", f"{path} {name}", "it triggers no process", at(entry))

    def _known(self, kind: str, name: str, known: Mapping[str, Any], where: str, element: YamlMap) -> bool:
        if name in known:
            return True
        help = did_you_mean(name, known, f"declare the {kind}, or remove its name here")
        at = self.catalogue.at(element)
        self.catalogue.findings.add(codes.LOOSE_CONNECTION(f'no {kind} "{name}"', at=at, path=where, help=help))
        return False


@record
class ModeModel:
    """The model of one mode alone, where each task has one version, and the place that declares the mode."""

    mode: str
    model: TaskModel
    at: Location


@dataclass(slots=True)
class _Merger:
    findings: Findings
    tasks: dict[str, Task] = field(default_factory=dict)
    units: dict[str, Unit] = field(default_factory=dict)

    def add(self, part: ModeModel) -> Mode:
        """Take the tasks of one mode; return the mode with the versions that run in it."""
        names = {task.name: self._name(task, part) for task in part.model.tasks}
        self.units.update({unit.name: unit for unit in part.model.units if unit.name not in self.units})
        runs = []
        for task in part.model.tasks:
            name = names[task.name]
            (only,) = task.versions
            renamed = tuple(replace(p, task=names[p.task]) for p in only.precedences)
            runs.append(Run(task=name, versions=(self._version(name, task, replace(only, precedences=renamed), part),)))
        return Mode(name=part.mode, runs=tuple(runs), at=part.at)

    def _name(self, task: Task, part: ModeModel) -> str:
        """Return the name of a task in the whole model: another one where its period is another one than before."""
        first = self.tasks.get(task.name)
        if first is None or first.period == task.period:
            return task.name
        name = f"{task.name}@{part.mode}"
        text = f'has period {task.period} in mode "{part.mode}", {first.period} before; there it is the task "{name}"'
        at = task.origin.location if task.origin else part.at
        self.findings.add(
            codes.MODE_PERIOD(text, at=at, path=about(task=task.name), help="use the new name in the overlay, too")
        )
        return name

    def _version(self, name: str, task: Task, version: Version, part: ModeModel) -> str:
        """Add the version to the task unless one that is equal is there; return the name of it."""
        known = self.tasks.get(name)
        if known is None:
            self.tasks[name] = replace(task, name=name, versions=(version,))
            return version.name
        for other in known.versions:
            if replace(version, name=other.name) == other:
                return other.name
        self.tasks[name] = replace(known, versions=(*known.versions, replace(version, name=part.mode)))
        return part.mode


def merge_modes(parts: Sequence[ModeModel], findings: Findings) -> TaskModel:
    """Return the model of all modes, the first of which keeps its names; `parts` has at least one."""
    merger = _Merger(findings)
    modes = tuple(merger.add(part) for part in parts)
    first = parts[0].model
    return replace(first, units=tuple(merger.units.values()), tasks=tuple(merger.tasks.values()), modes=modes)
