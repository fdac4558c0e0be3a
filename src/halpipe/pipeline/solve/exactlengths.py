"""Interrupt-inflated lengths for the exact engine: versions whose times hold on all their units (MODEL 8.2).

A version on units with different interrupts becomes one for each kind of unit. Instants of its execution move to where
interrupts put them at worst-case pace.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.models import Anchor
from halpipe.pipeline.parts import reserved_length, service_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from halpipe.core.durations import Duration
    from halpipe.models import Precedence, TaskModel, Unit, Version
    from halpipe.pipeline.jobs import ActiveTask, Expansion
    from halpipe.pipeline.parts import Service


def kinds_of(version: Version, units: Mapping[str, Unit]) -> dict[Service[Duration], tuple[str, ...]]:
    """Return the units of a version by the interrupts that a job there suffers."""
    found: dict[Service[Duration], tuple[str, ...]] = {}
    for name in dict.fromkeys(version.units):
        service = tuple(sorted(service_of(units, [name]), key=lambda row: (row[0].ns, row[1].ns)))
        found[service] = (*found.get(service, ()), name)
    return {service * version.gang: names for service, names in found.items()}


def inflated(model: TaskModel, expansion: Expansion) -> Expansion:
    """Return a mode whose WCETs, phases and points contain the interrupts of the units."""
    units = {unit.name: unit for unit in model.units}
    if not any(unit.interrupts for unit in model.units):
        return expansion
    tasks = (
        replace(active, versions=tuple(v for version in active.versions for v in _variants(version, units)))
        for active in expansion.tasks
    )
    moved = (_with_points(active, expansion, units) for active in tasks)
    return replace(expansion, tasks=tuple(moved))


def _variants(version: Version, units: Mapping[str, Unit]) -> Iterator[Version]:
    """Yield a version for each kind of unit on which interrupts leave time for it."""
    for service, names in kinds_of(version, units).items():
        try:
            wcet = reserved_length(version.wcet or ZERO, service)
            accesses = tuple(replace(a, end=reserved_length(a.end, service)) for a in version.accesses)
        except ValueError:
            continue
        yield replace(version, wcet=wcet, units=names, accesses=accesses)


def _with_points(active: ActiveTask, expansion: Expansion, units: Mapping[str, Unit]) -> ActiveTask:
    def moved(row: Precedence) -> Precedence:
        if row.anchor is not Anchor.POINT or row.point is None:
            return row
        [service] = services_of(expansion.by_name[row.task], units)
        return replace(row, point=reserved_length(row.point, service))

    versions = tuple(replace(v, precedences=tuple(map(moved, v.precedences))) for v in active.versions)
    return replace(active, versions=versions)


def services_of(active: ActiveTask, units: Mapping[str, Unit]) -> set[Service[Duration]]:
    """Return the sets of interrupts that jobs of a task may suffer."""
    return {service for version in active.versions for service in kinds_of(version, units)}
