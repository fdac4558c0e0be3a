"""Parsed statements of overlay files, not yet matched with a model.

Elements that need nothing of the import (units, chains, constraints ...) are already elements of the model, with the
overlay as their origin.
"""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING, Any

from halpipe.core.records import record

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


@record(kw_only=True)
class VersionEntry:
    """What an overlay states of a version; what is not there is left to less specific entries, then to the source.

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
    """What an overlay states of the tasks that `pattern` matches; `common` holds for all their versions.

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
