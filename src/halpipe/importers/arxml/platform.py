"""Execution units: the configured cores, or one assumed core per ECU; and which of them a task may use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.importers.arxml.names import legal_name, unique_name
from halpipe.models import Unit

if TYPE_CHECKING:
    from halpipe.importers.arxml.grouping import Draft
    from halpipe.importers.arxml.system import System

DEFAULT_UNIT = "core0"


class Platform:
    """The execution units of a system; `is_assumed` when the input configures no core."""

    def __init__(self, system: System) -> None:
        taken: set[str] = set()
        cores = system.configuration.cores
        self.is_assumed = not cores
        self._by_core = {core.name: unique_name(legal_name(core.name), taken) for core in cores}
        self._by_prototype: dict[str, str] = {}
        if cores:
            self.units = tuple(
                Unit(name=self._by_core[core.name], origin=core.place.origin if core.place else None) for core in cores
            )
            return
        ecus = [ecu for ecu in system.ecus if ecu.prototypes]
        if len(ecus) < 2:
            self.units = (Unit(name=DEFAULT_UNIT),)
            return
        units = []
        for ecu in ecus:
            name = unique_name(legal_name(f"{ecu.place.name}/{DEFAULT_UNIT}"), taken)
            units.append(Unit(name=name, origin=ecu.place.origin))
            self._by_prototype.update(dict.fromkeys(ecu.prototypes, name))
        self.units = tuple(units)

    def bound_unit(self, draft: Draft) -> str | None:
        """Return the unit of the core that the task's OsApplication is bound to, or of the ECU it is mapped to."""
        if draft.os_task is not None and draft.os_task.core is not None:
            return self._by_core[draft.os_task.core]
        paths = (path for member in draft.members for path in member.context)
        return next((self._by_prototype[path] for path in paths if path in self._by_prototype), None)

    def units_of(self, draft: Draft) -> tuple[str, ...]:
        """Return the units that a task may run on: the one it is bound to, or all."""
        bound = self.bound_unit(draft)
        return (bound,) if bound is not None else tuple(unit.name for unit in self.units)
