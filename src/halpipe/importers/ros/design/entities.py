"""The entities of a set of design files, by name, with inheritance resolved: ``base``, ``override`` and ``remove``."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Location, named
from halpipe.core.files import YamlList, YamlMap
from halpipe.core.suggest import did_you_mean
from halpipe.importers.ros import codes
from halpipe.importers.ros.names import printable
from halpipe.importers.ros.sources.yaml_reader import Reader

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.core.diagnostics import Findings

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
        base_name = entity.body.get("base")
        if not isinstance(base_name, str):
            entity.resolved = entity.body
            return entity.resolved
        at = Location(self.file_of(entity.body), entity.body.line_of("base"))
        if base_name in (*below, entity.name):
            self.reader(entity.body).malformed("is its own base", at.line, f'entity "{entity.name}"')
            entity.resolved = entity.body
            return entity.resolved
        base = self.entities.get(base_name)
        if base is None:
            self.get(base_name, at, f'entity "{entity.name}"')
            entity.resolved = entity.body
            return entity.resolved
        inherited = self.resolve(base, (*below, entity.name))
        entity.resolved = self.changed(inherited, entity.body)
        return entity.resolved

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
