"""Applies the entries for tasks and their versions, and the precedence constraints."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import chain
from typing import TYPE_CHECKING, Any, TypeVar

from halpipe.core.diagnostics import NOWHERE, Location, about
from halpipe.importers.overlay.changes import Changes, Ranks, show
from halpipe.importers.overlay.codes import DOES_NOT_FIT, MOVED_INSIDE
from halpipe.importers.overlay.entries import EVERYTHING, Overlay, TaskEntry, VersionEntry
from halpipe.models import WHOLE, Access, Origin, Precedence, Split, Task, Version
from halpipe.models.attributes import Attribute, attributes

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.core.settings import Stated

E = TypeVar("E")
Ranked = list[tuple[str, "TaskEntry"]]
IMPORTED_VERSION = "default"


@dataclass(slots=True)
class TaskMerger:
    """Merges entries into tasks, given the platform that the model ends up with.

    `units_at` is the place of the overlay's own list of units, None where the imported units stay. `stand_ins` are the
    units that the importer assumed because its source describes no computer: a list of units ends the assumption, also
    where it has one of the same name. `constraints` holds the overlay's precedence list by task and predecessor.
    """

    changes: Changes
    units: tuple[str, ...]
    resources: tuple[str, ...]
    units_at: Location | None
    stand_ins: frozenset[str]
    constraints: Mapping[str, Mapping[str, tuple[Precedence, ...]]]
    pointed: frozenset[str]
    """Tasks with points that windows of other tasks count from."""
    _unit_sets: dict[Stated[tuple[str, ...]], tuple[str, ...]] = field(default_factory=dict)

    def merge(self, task: Task, ranked: Ranked) -> Task:
        """Return `task` with what the entries that match it state, of which the first wins."""
        path = about(task=task.name)
        entries = _ranks([(pattern == EVERYTHING, entry) for pattern, entry in ranked])
        key = _key_of_versions(task, ranked)
        return replace(
            task,
            **{one.field: self._pick(path, one, task, entries) for one in attributes(Task) if one.field != "name"},
            versions=tuple(
                self._version(task, base, _statements(ranked, base.name, key))
                for base in _base_versions(task, ranked, key)
            ),
        )

    def _pick(self, path: str, one: Attribute, base: Any, entries: Ranks[Any]) -> Any:
        """Return the value of an attribute that holds."""
        shown = "WCET" if one.field == "wcet" else one.name
        old = getattr(base, one.field)
        return self.changes.pick(path, shown, old, one.default, entries, lambda entry: entry.stated.get(one.field))

    def _version(self, task: Task, base: Version, entries: Ranks[VersionEntry]) -> Version:
        path = about(task=task.name, version=base.name)
        pick = self.changes.pick
        stated: dict[str, Any] = {
            one.field: self._units(path, base, entries)
            if one.field == "units"
            else self._pick(path, one, base, entries)
            for one in (*attributes(Version), *attributes(Version, "units"))
            if one.field != "name"
        }
        version = replace(
            base,
            **stated,
            split=self._split(path, base.split, entries),
            accesses=pick(path, "access phases", base.accesses, (), entries, lambda v: v.accesses),
            precedences=self._precedences(path, task.name, base, entries),
            source=pick(path, "source", base.source, None, entries, lambda v: v.source),
        )
        self._check_fit(path, base, version, entries)
        self._check_inside(path, task, base, version, entries)
        return version

    def _split(self, path: str, base: Split, entries: Ranks[VersionEntry]) -> Split:
        where = Split(points=base.points, anywhere=base.anywhere)
        return replace(
            self.changes.pick(path, "split", where, WHOLE, entries, lambda v: v.split),
            **{one.field: self._pick(path, one, base, entries) for one in attributes(Split)},
        )

    # ---------------------------------------------------------------------------------------------- units

    def _units(self, path: str, base: Version, entries: Ranks[VersionEntry]) -> tuple[str, ...]:
        kept = self._kept(base.units) if self.units_at else base.units
        stated = entries.firm(lambda v: v.stated.get("units"))
        if stated is not None:
            units = self._expand(stated, path)
            if kept:
                self.changes.overridden(path, "units", kept, units, stated.at)
            return units
        if kept:
            if kept != base.units:
                gone = tuple(unit for unit in base.units if unit not in self.units)
                message = f"units {show(gone)} are not on the overlay's platform; {show(kept)} remain"
                self.changes.removed(message, base.at, path)
            return kept
        stated = entries.default(lambda v: v.stated.get("units"))
        units, at = (self._expand(stated, path), stated.at) if stated else (self.units, self.units_at)
        if at is None:
            return kept
        self.changes.coverage.defaulted(path, "units", show(units), at)
        return units

    def _kept(self, units: tuple[str, ...]) -> tuple[str, ...]:
        """Return those of the imported `units` that the overlay's platform has, and that the source stated itself."""
        return tuple(unit for unit in units if unit in self.units and unit not in self.stand_ins)

    def _expand(self, stated: Stated[tuple[str, ...]], path: str) -> tuple[str, ...]:
        """Return the platform's units that the names and globs mean; report, once, those that mean none."""
        if stated in self._unit_sets:
            return self._unit_sets[stated]
        matching = (self.changes.matching_units(pattern, self.units, stated.at, path) for pattern in stated.value)
        self._unit_sets[stated] = tuple(dict.fromkeys(chain.from_iterable(matching)))
        return self._unit_sets[stated]

    # ----------------------------------------------------------------------------------------- precedence

    def _precedences(self, path: str, task: str, base: Version, entries: Ranks[VersionEntry]) -> tuple[Precedence, ...]:
        """Return the version's constraints: exactly its own where it states some, else imported and listed ones."""
        stated = entries.firm(lambda v: v.precedences)
        if stated is not None:
            own = self._valid(stated, task, path)
            if base.precedences:
                self.changes.overridden(path, "precedence", base.precedences, own, stated.at)
            return own
        found = base.precedences
        for predecessor, listed in self.constraints.get(task, {}).items():
            old = tuple(p for p in found if p.task == predecessor)
            found = tuple(p for p in found if p.task != predecessor) + listed
            if old:
                self.changes.overridden(path, "precedence", old, listed, listed[0].at)
        stated = None if found else entries.default(lambda v: v.precedences)
        if stated is None:
            return found
        own = self._valid(stated, task, path)
        self.changes.coverage.defaulted(path, "precedence", show(own), stated.at)
        return own

    def _valid(self, stated: Stated[tuple[Precedence, ...]], task: str, path: str) -> tuple[Precedence, ...]:
        valid = []
        for p in stated.value:
            if p.task == task:
                self._refuse("the task cannot precede itself", p.at, path, "name another task")
            elif self.changes.knows_task(p.task, p.at, path):
                valid.append(p)
        return tuple(valid)

    # --------------------------------------------------------------------------------------------- checks

    def _refuse(self, message: str, at: Location, path: str, help: str) -> None:
        self.changes.findings.report(DOES_NOT_FIT, message, at, path, help)

    def _check_fit(self, path: str, base: Version, version: Version, entries: Ranks[VersionEntry]) -> None:
        stated = entries.firm(lambda v: v.stated.get("wcet")) or entries.default(lambda v: v.stated.get("wcet"))
        points = entries.firm(lambda v: v.split) or entries.default(lambda v: v.split)
        changed = (version.wcet, version.accesses) != (base.wcet, base.accesses)
        for access in version.accesses:
            self._check_resource(path, access)
            if changed and version.wcet is not None and access.end > version.wcet:
                message = f"an access phase ends at {access.end}, the WCET is {version.wcet}"
                at = access.at if access.at.file or stated is None else stated.at
                self._refuse(message, at, path, "end the phase earlier, or raise the WCET")
        beyond = [p for p in version.split.points if version.wcet is not None and p >= version.wcet]
        if beyond and (version.wcet, version.split.points) != (base.wcet, base.split.points):
            message = f"the split point {beyond[0]} is not below the WCET {version.wcet}"
            help = "state the split points of the new WCET, or split: none"
            at = next((found.at for found in (version, points, stated) if found is not None and found.at.file), NOWHERE)
            self._refuse(message, at, path, help)
        if version.gang > len(version.units) > 0 and (version.gang, version.units) != (base.gang, base.units):
            message = f"a gang of {version.gang} does not fit on {len(version.units)} units: {show(version.units)}"
            self._refuse(message, version.at, path, "name more units, or make the gang smaller")

    def _check_inside(
        self, path: str, task: Task, base: Version, version: Version, entries: Ranks[VersionEntry]
    ) -> None:
        """Warn where positions inside a job stay those of a WCET that the overlay replaces, or a version has none."""
        stated = entries.firm(lambda v: v.stated.get("wcet"))
        held = base.accesses and version.accesses == base.accesses
        cut = base.split.points and version.split.points == base.split.points
        kinds = (("access phases", held), ("preemption points", cut), ("triggers", task.name in self.pointed))
        inside = [what for what, stays in kinds if stays]
        if stated is not None and base.wcet is not None and version.wcet != base.wcet and inside:
            message = f"the WCET is {version.wcet}, not {base.wcet}, but {' and '.join(inside)} stay where they were"
            help = "state the accesses and the split of the new WCET, or the windows after the task"
            self.changes.findings.report(MOVED_INSIDE, message, stated.at, path, help)
        resources = sorted({access.resource for other in task.versions for access in other.accesses})
        states = entries.firm(lambda v: v.accesses) or entries.default(lambda v: v.accesses)
        if base not in task.versions and resources and states is None:
            message = f"has no access phases, but the source has some of the task, on {show(tuple(resources))}"
            self.changes.findings.report(MOVED_INSIDE, message, version.at, path, "state its access, [] if it has none")

    def _check_resource(self, path: str, access: Access) -> None:
        if access.resource not in self.resources:
            otherwise = "add it to the overlay's platform, under resources"
            self.changes.unknown("resource", access.resource, self.resources, access.at, path, otherwise)


def _key_of_versions(task: Task, ranked: Ranked) -> str | None:
    """Return the key whose entries state the versions: the most specific; ``*`` only where no WCET is known."""
    key = next((pattern for pattern, entry in ranked if entry.versions), None)
    return None if key == EVERYTHING and any(v.wcet is not None for v in task.versions) else key


def _base_versions(task: Task, ranked: Ranked, key: str | None) -> list[Version]:
    """Return the imported versions, and empty ones for those that only the overlay has.

    Stated versions replace the importer's version "default" if that has no WCET. A new version starts with the units
    and the constraints of the imported one: data flows to it all the same. Of its split only the points stay behind,
    which count its execution time.
    """
    stated: dict[str, Location] = {}
    for pattern, entry in reversed(ranked):
        if pattern == key:
            stated.update({name: version.at for name, version in entry.versions.items() if name not in stated})
    imported = {v.name: v for v in task.versions}
    placeholder = imported.get(IMPORTED_VERSION)
    template = placeholder or next(iter(task.versions), Version(name=""))
    kept = dict(imported)
    if stated and placeholder is not None and placeholder.wcet is None and IMPORTED_VERSION not in stated:
        del kept[IMPORTED_VERSION]
    for name, at in stated.items():
        if name not in kept:
            origin = Origin(at.file, at.line, f'task "{task.name}" version "{name}"')
            split = replace(template.split, points=())
            kept[name] = replace(
                template, name=name, wcet=None, accesses=(), source=None, split=split, origin=origin, at=at
            )
    return list(kept.values())


def _statements(ranked: Ranked, version: str, key: str | None) -> Ranks[VersionEntry]:
    """Return what the entries state of a version; in each, what it says of the version before what of the task."""
    found: list[tuple[bool, VersionEntry]] = []
    for pattern, entry in ranked:
        if pattern == key and version in entry.versions:
            found.append((pattern == EVERYTHING, entry.versions[version].value))
        found.append((pattern == EVERYTHING, entry.common))
    return _ranks(found)


def _ranks(entries: list[tuple[bool, E]]) -> Ranks[E]:
    """Split (is it of ``*``, entry) into what overrules the source and what only fills its gaps."""
    return Ranks(tuple(e for rest, e in entries if not rest), tuple(e for rest, e in entries if rest))


def constraints_by_task(overlay: Overlay, changes: Changes) -> dict[str, dict[str, tuple[Precedence, ...]]]:
    """Return the precedence list by task and predecessor, without those that name no task of the model."""
    found: dict[str, dict[str, tuple[Precedence, ...]]] = {}
    for (predecessor, task), listed in overlay.precedence.items():
        known = [changes.knows_task(name, listed[0].at, "precedence") for name in (predecessor, task)]
        if all(known):
            found.setdefault(task, {})[predecessor] = listed
    return found
