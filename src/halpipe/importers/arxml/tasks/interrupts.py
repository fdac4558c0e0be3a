"""Interrupt routines of the Os: what interrupts the jobs of a core, at most so often and for so long (MODEL 8.1)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.importers.arxml import codes
from halpipe.importers.arxml.names import legal_name
from halpipe.models import Interrupt

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.diagnostics import Findings
    from halpipe.importers.arxml.coverage import Ledger
    from halpipe.importers.arxml.system.values import OsIsr, System
    from halpipe.importers.arxml.tasks.platform import Platform
    from halpipe.importers.common.base import Supplement
    from halpipe.models import Unit


def with_interrupts(
    platform: Platform, system: System, overlay: Supplement | None, ledger: Ledger, findings: Findings
) -> tuple[Unit, ...]:
    """Return the units with the interrupts that they serve; report routines that are not described enough."""
    served: dict[str, list[Interrupt]] = {unit.name: [] for unit in platform.units}
    lacking: list[OsIsr] = []
    for routine in system.configuration.routines:
        name = legal_name(routine.place.name)
        unit = platform.unit_of_core(routine.core)
        if overlay is not None and overlay.states_interrupt(name):
            ledger.mapped(routine.place)
        elif unit is None or not routine.budget or not routine.distance:
            lacking.append(routine)
            ledger.ignored(routine.place, "its execution time, its distance or its core is not stated")
        else:
            origin = routine.place.origin
            served[unit].append(Interrupt(name=name, distance=routine.distance, wcet=routine.budget, origin=origin))
            ledger.mapped(routine.place)
    _report(lacking, findings)
    return tuple(replace(unit, interrupts=tuple(served[unit.name])) for unit in platform.units)


def _report(lacking: Sequence[OsIsr], findings: Findings) -> None:
    if lacking:
        names = ", ".join(legal_name(routine.place.name) for routine in lacking)
        message = f"{len(lacking)} interrupt routines have no time, distance or core: {names}"
        help = "state them as interrupts under platform: in the overlay"
        findings.add(codes.UNKNOWN_INTERRUPT(message, at=lacking[0].place.at, help=help))
