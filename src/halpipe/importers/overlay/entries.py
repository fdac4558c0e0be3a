"""Parsed statements of overlay files, and the names and globs that key them; not yet matched with a model.

Elements that need nothing of the import (units, chains, constraints ...) are already elements of the model, with the
overlay as their origin. The order of entries for a name is fixed: the exact name before a glob, a later entry before an
earlier one, and ``*`` last.
"""

from __future__ import annotations

import re
from dataclasses import field
from fnmatch import translate
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from halpipe.core.records import record
from halpipe.importers.common.stated import is_glob

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from halpipe.core.diagnostics import Location
    from halpipe.core.durations import Duration
    from halpipe.core.settings import Stated
    from halpipe.models import (
        Access,
        Chain,
        HealthRule,
        Interrupt,
        Precedence,
        Resource,
        Source,
        Split,
        Transition,
        Unit,
    )

T = TypeVar("T")

EVERYTHING = "*"
MAX_GLOBS = 1000
"""Globs of one overlay: each is tried on every name."""


class Patterns(Generic[T]):
    """Entries keyed by names and globs; finding those of a name costs one look-up and one match per glob."""

    def __init__(self, entries: Iterable[tuple[str, T]]) -> None:
        self._exact: dict[str, list[tuple[str, T]]] = {}
        self._globs: list[tuple[re.Pattern[str], str, T]] = []
        self._everything: list[tuple[str, T]] = []
        for pattern, entry in reversed(list(entries)):
            if pattern == EVERYTHING:
                self._everything.append((pattern, entry))
            elif is_glob(pattern):
                self._globs.append((re.compile(translate(pattern)), pattern, entry))
            else:
                self._exact.setdefault(pattern, []).append((pattern, entry))

    def of(self, name: str) -> list[tuple[str, T]]:
        """Return (pattern, entry) of everything that matches `name`, the one that wins first."""
        globs = [(pattern, entry) for regex, pattern, entry in self._globs if regex.match(name)]
        return [*self._exact.get(name, ()), *globs, *self._everything]


def expand(pattern: str, names: Iterable[str]) -> list[str]:
    """Return those of `names` that `pattern` matches, in their order."""
    matches = re.compile(translate(pattern)).match
    return [name for name in names if matches(name)]


@record(kw_only=True)
class VersionEntry:
    """Statements of an overlay on a version; absent ones are left to less specific entries, then to the source.

    `stated` has attributes of the version and of its split, by field; of `units`, patterns. Of `split` only the
    points, or that it is anywhere, are meant.
    """

    stated: Mapping[str, Stated[Any]] = field(default_factory=dict)
    split: Stated[Split] | None = None
    accesses: Stated[tuple[Access, ...]] | None = None
    precedences: Stated[tuple[Precedence, ...]] | None = None
    source: Stated[Source] | None = None


@record(kw_only=True)
class TaskEntry:
    """Statements of an overlay on the tasks that `pattern` matches; `common` holds for all their versions.

    `stated` has attributes of the tasks by field.
    """

    pattern: str
    at: Location
    stated: Mapping[str, Stated[Any]] = field(default_factory=dict)
    drop: Stated[bool] | None = None
    common: VersionEntry = field(default_factory=VersionEntry)
    versions: Mapping[str, Stated[VersionEntry]] = field(default_factory=dict)


@record(kw_only=True)
class InterruptEntry:
    """An interrupt that joins the units that patterns name, or replaces theirs of the same name."""

    units: Stated[tuple[str, ...]]
    interrupt: Interrupt


@record(kw_only=True)
class ModeEntry:
    """A mode: patterns of its tasks, for some of them the versions (default: all), and its attributes by field."""

    name: str
    at: Location
    tasks: tuple[Stated[str], ...]
    versions: tuple[tuple[Stated[str], tuple[str, ...]], ...] = ()
    stated: Mapping[str, Any] = field(default_factory=dict)


@record(kw_only=True)
class Overlay:
    """Everything that one or several overlay files state.

    `sources` maps patterns of data sources to periods. `precedence` gives constraints by (predecessor, task).
    """

    units: Stated[tuple[Unit, ...]] | None = None
    resources: Stated[tuple[Resource, ...]] | None = None
    interrupts: tuple[InterruptEntry, ...] = ()
    sources: tuple[tuple[Stated[str], Duration], ...] = ()
    tasks: tuple[TaskEntry, ...] = ()
    precedence: Mapping[tuple[str, str], tuple[Precedence, ...]] = field(default_factory=dict)
    modes: Mapping[str, ModeEntry] = field(default_factory=dict)
    transitions: Mapping[tuple[str, str], Transition] = field(default_factory=dict)
    chains: Mapping[str, Chain] = field(default_factory=dict)
    health: tuple[HealthRule, ...] = ()
    drops: tuple[Stated[str], ...] = ()


def merge(overlays: Iterable[Overlay]) -> Overlay:
    """Join overlays, later before earlier.

    Entries for tasks, interrupts, sources and drops are all kept, since their order decides between them. A mode,
    transition or chain, and the constraints between a pair of tasks, replace the earlier ones of the same name; a list
    of units, of resources or of health rules replaces the earlier list as a whole, so that one overlay can hold the
    tasks and another the board.
    """
    merged = Overlay()
    for later in overlays:
        merged = Overlay(
            units=later.units or merged.units,
            resources=later.resources or merged.resources,
            interrupts=merged.interrupts + later.interrupts,
            sources=merged.sources + later.sources,
            tasks=merged.tasks + later.tasks,
            precedence={**merged.precedence, **later.precedence},
            modes={**merged.modes, **later.modes},
            transitions={**merged.transitions, **later.transitions},
            chains={**merged.chains, **later.chains},
            health=later.health or merged.health,
            drops=merged.drops + later.drops,
        )
    return merged
