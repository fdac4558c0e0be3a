"""Structure of an Autoware System Design: entities with inheritance resolved, node instances, and connected ports.

A connection joins two ports, in either order: ``instance.publisher.port`` or, at the edge of a module,
``publisher.port`` and ``subscriber.port``. ``*``, ``^`` and ``+`` stand for any text, in names of instances, too, and
each for the same on both sides. Ports of modules hand on what they get. Connections of services are no flow of data and
are left out.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

from halpipe.core.diagnostics import Findings, Location, named
from halpipe.core.files import YamlList, YamlMap
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.importers.ros import codes
from halpipe.importers.ros.graph import printable
from halpipe.importers.ros.yaml_reader import Reader

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator


FORMAT_KEY = "autoware_system_design_format"
KINDS = ("system", "module", "node", "parameter_set")
NEWEST = (0, 4)
_FORMAT = re.compile(r"v?([0-9]{1,4})\.([0-9]{1,4})(\.[0-9]{1,4})?")
_HELP = "repair the file; see the documentation of the Autoware System Design format"


@dataclass(slots=True)
class Entity:
    """One file: `name` is with its kind, as in ``Planning.module``; `body` is as written, `resolved` with its base."""

    name: str
    kind: str
    body: YamlMap
    at: Location
    resolved: YamlMap | None = None


@dataclass(slots=True)
class Catalogue:
    """All entities, and the file that every mapping came from, since inheritance puts several files into one."""

    findings: Findings
    entities: dict[str, Entity] = field(default_factory=dict)
    missing: dict[str, None] = field(default_factory=dict)
    _files: dict[int, str] = field(default_factory=dict)
    _kept: list[YamlMap] = field(default_factory=list)
    """Merged mappings, held so that their identity stays theirs."""

    def add(self, body: YamlMap, file: str) -> None:
        """Take the entity of one file; report one without a usable name, and one that is there already."""
        self._remember(body, file)
        reader = Reader(file, self.findings, _HELP)
        name = reader.text(body, "name", "file")
        kind = name.rpartition(".")[2]
        at = Location(file, body.line_of("name"))
        if name and kind not in KINDS:
            reader.malformed(f'name "{name}" does not end in .{", .".join(KINDS)}', at.line, "file")
        elif name in self.entities:
            text = f"is declared again, first in {self.entities[name].at}"
            self.findings.add(codes.DUPLICATE(text, at=at, path=named("entity", name), help="remove one of the two"))
        elif name:
            self._check_format(body, file)
            self.entities[name] = Entity(name, kind, body, at)

    def _remember(self, value: Any, file: str) -> None:
        if isinstance(value, YamlMap):
            self._files[id(value)] = file
        for inner in value.values() if isinstance(value, YamlMap) else value if isinstance(value, YamlList) else ():
            self._remember(inner, file)

    def _check_format(self, body: YamlMap, file: str) -> None:
        stated = str(body.get(FORMAT_KEY))
        match = _FORMAT.fullmatch(stated)
        if match is None or (int(match[1]), int(match[2])) > NEWEST:
            text = f'format version "{printable(stated)}" is not known; it is read as {NEWEST[0]}.{NEWEST[1]}'
            at = Location(file, body.line_of(FORMAT_KEY))
            self.findings.add(codes.DESIGN_VERSION(text, at=at, help="check what was imported"))

    def of_kind(self, *kinds: str) -> Iterator[Entity]:
        """Yield the entities of some kinds, in the order of the files."""
        yield from (entity for entity in self.entities.values() if entity.kind in kinds)

    def file_of(self, element: YamlMap) -> str:
        """Return the file that a mapping was read from."""
        return self._files.get(id(element), "")

    def at(self, element: YamlMap) -> Location:
        """Return the place of a mapping."""
        return Location(self.file_of(element), element.line)

    def reader(self, element: YamlMap) -> Reader:
        """Return a reader for a mapping."""
        return Reader(self.file_of(element), self.findings, _HELP)

    def get(self, name: str, at: Location, path: str) -> Entity | None:
        """Return an entity with its base resolved; report, once, one that is not among the files."""
        entity = self.entities.get(name)
        if entity is None:
            if name not in self.missing:
                self.missing[name] = None
                help = did_you_mean(name, self.entities, "name the file or the folder that has it, too")
                text = f'"{name}" is not among the files; what is made of it is left out'
                self.findings.add(codes.MISSING_ENTITY(text, at=at, path=path, help=help))
            return None
        self.resolve(entity, ())
        return entity

    def resolve(self, entity: Entity, below: tuple[str, ...]) -> YamlMap:
        """Return the body of an entity put onto that of its base."""
        if entity.resolved is not None:
            return entity.resolved
        resolved, base_name = entity.body, entity.body.get("base")
        if isinstance(base_name, str):
            at, path = Location(self.file_of(resolved), resolved.line_of("base")), f'entity "{entity.name}"'
            if base_name in (*below, entity.name):
                self.reader(resolved).malformed("is its own base", at.line, path)
            elif base_name in self.entities:
                inherited = self.resolve(self.entities[base_name], (*below, entity.name))
                resolved = self.changed(inherited, resolved)
            else:
                self.get(base_name, at, path)
        entity.resolved = resolved
        return resolved

    def changed(self, body: YamlMap, change: YamlMap) -> YamlMap:
        """Return `body` without what `change` removes and with what it overrides, in this order."""
        removal, override = change.get("remove"), change.get("override")
        if isinstance(removal, YamlMap):
            body = self._without(body, removal)
        if isinstance(override, YamlMap):
            body = self._with(body, override)
        return body

    def _without(self, body: YamlMap, removal: YamlMap) -> YamlMap:
        result = self._copy(body)
        for key, unwanted in removal.items():
            kept = result.get(key)
            if not isinstance(kept, YamlList) or not isinstance(unwanted, YamlList):
                result.pop(key, None)
                continue
            gone = [_identity(item) for item in unwanted]
            result[key] = _listed(kept, (i for i, item in enumerate(kept) if _identity(item) not in gone))
        return result

    def _with(self, body: YamlMap, override: YamlMap) -> YamlMap:
        result = self._copy(body)
        for key, value in override.items():
            old = result.get(key)
            if isinstance(old, YamlList) and isinstance(value, YamlList):
                names = {_identity(item) for item in value if isinstance(item, YamlMap)}
                merged = _listed(old, (i for i, item in enumerate(old) if _identity(item) not in names))
                merged.extend(value)
                merged.lines.extend(value.lines)
                value = merged
            elif isinstance(old, YamlMap) and isinstance(value, YamlMap):
                value = self._with(old, value)
            result[key] = value
            result.lines[key] = override.line_of(key)
        return result

    def _copy(self, body: YamlMap) -> YamlMap:
        copy = YamlMap(body.line)
        copy.update(body)
        copy.lines.update(body.lines)
        self._files[id(copy)] = self.file_of(body)
        self._kept.append(copy)
        return copy


def _identity(item: Any) -> Any:
    """Return the identity of list items: the name of a mapping, otherwise the item itself."""
    if isinstance(item, YamlMap):
        return ("name", item["name"]) if isinstance(item.get("name"), str) else ("item", str(dict(item)))
    return ("item", str(item))


def _listed(items: YamlList, positions: Iterable[int]) -> YamlList:
    result = YamlList(items.line)
    for position in positions:
        result.append(items[position])
        result.lines.append(items.lines[position])
    return result


PUBLISHER, SUBSCRIBER = "publisher", "subscriber"
MOST_INSTANCES = 20_000
_LISTS = {PUBLISHER: ("publishers", "outputs"), SUBSCRIBER: ("subscribers", "inputs")}
_SIDES = {"publisher": PUBLISHER, "output": PUBLISHER, "subscriber": SUBSCRIBER, "input": SUBSCRIBER}
_WILD = re.compile(r"[*^+]")


class Port(NamedTuple):
    """A port of the instance at `path`: `side` is publisher or subscriber, as seen from the instance."""

    path: str
    side: str
    name: str


@record
class Instance:
    """A node of the running system: its `path` in ROS, the compute unit (or none) and values of its parameters."""

    path: str
    body: YamlMap
    unit: str
    at: Location


@dataclass(slots=True)
class _Scope:
    """A system or module while its connections are read: ports of its own and of its instances, by instance name."""

    path: str
    label: str
    own: dict[str, dict[str, None]]
    inner: dict[str, tuple[str, dict[str, dict[str, None]]]] = field(default_factory=dict)
    absent: dict[str, None] = field(default_factory=dict)


@dataclass(slots=True)
class Structure:
    """Structure of one mode of a system."""

    catalogue: Catalogue
    instances: list[Instance] = field(default_factory=list)
    sources: dict[Port, dict[Port, None]] = field(default_factory=dict)
    globals: dict[Port, str] = field(default_factory=dict)
    services: int = 0

    def expand(self, body: YamlMap, label: str, removed: Iterable[str] = ()) -> None:
        """Add all that the components of a system make; connections may name the ones that a mode `removed`."""
        scope = _Scope("", label, {PUBLISHER: {}, SUBSCRIBER: {}}, absent=dict.fromkeys(removed))
        reader = self.catalogue.reader(body)
        for component in reader.entries(body, "components", label):
            name = reader.text(component, "name", label)
            unit = reader.optional(component, "compute_unit", label) or ""
            self._instantiate(component, name, _path_of(component, name), unit, scope, ())
        self._connect(body, scope)

    def expand_alone(self, entity: Entity) -> None:
        """Add an entity that no system uses, under its own name."""
        path = "/" + entity.name.rpartition(".")[0]
        self._enter(entity, path, "", ())

    # ------------------------------------------------------------------------------------------- instances

    def _instantiate(
        self, element: YamlMap, name: str, path: str, unit: str, scope: _Scope, above: tuple[str, ...]
    ) -> None:
        reader = self.catalogue.reader(element)
        where = f'{scope.label} instance "{name}"'
        wanted = reader.text(element, "entity", where)
        if not name or not wanted:
            return
        if name in scope.inner:
            text, help = "is declared again", "rename one of the two"
            self.catalogue.findings.add(codes.DUPLICATE(text, at=self.catalogue.at(element), path=where, help=help))
            return
        if wanted in above:
            reader.malformed(f'"{wanted}" contains itself', element.line_of("entity"), where)
            return
        entity = self.catalogue.get(wanted, Location(reader.file, element.line_of("entity")), where)
        if entity is None:
            scope.absent[name] = None
            return
        scope.inner[name] = (path, self._enter(entity, path, unit, above))

    def _enter(self, entity: Entity, path: str, unit: str, above: tuple[str, ...]) -> dict[str, dict[str, None]]:
        """Add an instance of `entity` at `path`; return the names of its ports by side."""
        body = self.catalogue.resolve(entity, ())
        reader = self.catalogue.reader(body)
        label = f'entity "{entity.name}"'
        ports: dict[str, dict[str, None]] = {}
        for side in _LISTS:
            ports[side] = {}
            for port in reader.entries(body, list_of(body, side), label):
                name = reader.text(port, "name", label)
                ports[side][name] = None
                if (everywhere := reader.optional(port, "global", label)) is not None:
                    self.globals[Port(path, side, name)] = everywhere
        if entity.kind == "node":
            if len(self.instances) == MOST_INSTANCES:
                reader.malformed(f"the system has more than {MOST_INSTANCES} nodes", body.line, label)
            if len(self.instances) <= MOST_INSTANCES:
                self.instances.append(Instance(path, body, unit, self.catalogue.at(body)))
        elif entity.kind == "module" and len(self.instances) <= MOST_INSTANCES:
            scope = _Scope(path, label, ports)
            for element in reader.entries(body, "instances", label):
                name = reader.text(element, "name", label)
                self._instantiate(element, name, f"{path}/{name}", unit, scope, (*above, entity.name))
            self._connect(body, scope)
        return ports

    # ----------------------------------------------------------------------------------------- connections

    def _connect(self, body: YamlMap, scope: _Scope) -> None:
        pairs = body.get("connections")
        if pairs is None:
            return
        reader = self.catalogue.reader(body)
        if not isinstance(pairs, YamlList):
            reader.malformed("connections is not a list", body.line_of("connections"), scope.label)
            return
        for pair, line in zip(pairs, pairs.lines, strict=True):
            ends = list(pair.values()) if isinstance(pair, YamlMap) else pair
            if not isinstance(ends, list) or len(ends) != 2 or not all(isinstance(end, str) for end in ends):
                reader.malformed("a connection is no pair of ports", line, scope.label)
                continue
            if all(_is_service(end) for end in ends):
                self.services += 1
            else:
                self._join([printable(end) for end in ends], scope, Location(reader.file, line))

    def _join(self, ends: list[str], scope: _Scope, at: Location) -> None:
        found = [self._ports(end, scope, at) for end in ends]
        if None in found:
            return
        joined = False
        for (first, wild), (second, other) in product(found[0] or (), found[1] or ()):
            if not _is_same(wild, other):
                continue
            giver, taker = (first, second) if self._gives(first, scope) else (second, first)
            if self._gives(giver, scope) and not self._gives(taker, scope):
                self.sources.setdefault(taker, {})[giver] = None
                joined = True
        if not joined:
            text = f'"{ends[0]}" and "{ends[1]}" have no ports that fit each other'
            help = "join a publisher with a subscriber, and write wildcards that match the same on both sides"
            self.catalogue.findings.add(codes.LOOSE_CONNECTION(text, at=at, path=scope.label, help=help))

    def _gives(self, port: Port, scope: _Scope) -> bool:
        """Return whether data comes from a port, seen from inside of `scope`."""
        return (port.side == SUBSCRIBER) == (port.path == scope.path)

    def _ports(self, end: str, scope: _Scope, at: Location) -> list[tuple[Port, _Wild]] | None:
        """Return the ports that one end means, with what its wildcards stand for; None where a file is missing."""
        owner, side, name = _split(end)
        if side and not owner:
            return [(Port(scope.path, side, port), wild) for port, wild in _matching(name, scope.own[side])]
        instances = [(*scope.inner[key], wild) for key, wild in _matching(owner, scope.inner)]
        if side and instances:
            return [
                (Port(path, side, port), wild + more)
                for path, ports, wild in instances
                for port, more in _matching(name, ports[side])
            ]
        if not (side and any(_matching(owner, scope.absent))):
            help = did_you_mean(owner, scope.inner, "write instance.publisher.port or instance.subscriber.port")
            text = f'"{end}" is no port of an instance'
            self.catalogue.findings.add(codes.LOOSE_CONNECTION(text, at=at, path=scope.label, help=help))
        return None

    # ---------------------------------------------------------------------------------------------- topics

    def topics(self, port: Port) -> list[str]:
        """Return the topics that reach a subscriber's port of a node: named after the publishing ports.

        A port that nothing is connected to reads a topic named after where the connections begin.
        """
        if port in self.globals:
            return [self.globals[port]]
        found: dict[str, None] = {}
        seen, waiting = {port}, [port]
        while waiting:
            here = waiting.pop(0)
            given = self.sources.get(here, {})
            if not given:
                found[self.topic(here)] = None
            for giver in given:
                if giver not in seen:
                    seen.add(giver)
                    waiting.append(giver)
        return list(found)

    def topic(self, port: Port) -> str:
        """Return the name of the topic that begins at a port; what comes from outside is called an input."""
        inner = f"{port.path}/{port.name}" if port.side == PUBLISHER else f"{port.path}/input/{port.name}"
        return self.globals.get(port, inner)


def list_of(body: YamlMap, side: str) -> str:
    """Return the key under which a node or module lists its ports of one side."""
    return next((key for key in _LISTS[side] if key in body), _LISTS[side][0])


def _path_of(component: YamlMap, name: str) -> str:
    """Return the ROS name of a component: its ``path``; the ``namespace`` of older files lacks the name of a node."""
    for key in ("path", "namespace"):
        stated = component.get(key)
        if isinstance(stated, str) and stated.strip("/"):
            is_node = str(component.get("entity")).endswith(".node")
            return "/" + printable(stated.strip("/")) + (f"/{name}" if key == "namespace" and is_node else "")
    return f"/{name}"


def _split(end: str) -> tuple[str, str, str]:
    """Return instance, side and port of ``instance.side.port``; the side is empty if it is none."""
    head, _, rest = end.partition(".")
    if head in _SIDES:
        return "", _SIDES[head], rest
    side, _, name = rest.partition(".")
    return head, _SIDES.get(side, ""), name


def _is_service(end: str) -> bool:
    """Return whether one end of a connection is a server or a client of a service."""
    return any(part in ("server", "client") for part in end.split(".")[:2])


_Wild = tuple[tuple[str, str], ...]
"""Wildcards of one end with what they stand for, in their order."""


def _matching(pattern: str, names: Collection[str]) -> Iterator[tuple[str, _Wild]]:
    wild = _WILD.findall(pattern)
    if not wild:
        names = (pattern,) if pattern in names else ()
    first, *rest = map(re.escape, _WILD.split(pattern))
    inner = "".join(f"(?>(.*?){part})" for part in rest[:-1])  # atomic: many wildcards are tried in one way only
    expression = re.compile(first + inner + "".join(f"(.*){part}" for part in rest[-1:]))
    for name in names:
        if found := expression.fullmatch(name):
            yield name, tuple(zip(wild, found.groups(), strict=True))


def _is_same(first: _Wild, second: _Wild) -> bool:
    """Return whether wildcards of two ends stand for the same: those of one kind, or all where no kind is on both."""
    common = {mark for mark, _ in first} & {mark for mark, _ in second}
    texts = [[text for mark, text in each if not common or mark in common] for each in (first, second)]
    return not all(texts) or texts[0] == texts[1]
