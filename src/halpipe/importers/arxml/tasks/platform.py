"""Execution units: the configured cores, or one assumed core per ECU or machine; and which of them a task may use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.importers.arxml.names import legal_name, unique_name
from halpipe.models import Unit

if TYPE_CHECKING:
    from halpipe.importers.arxml.system.values import Place, Process, System
    from halpipe.importers.arxml.tasks.grouping import Draft

DEFAULT_UNIT = "core0"


class Platform:
    """The execution units of a system; `assumed` are those that no file configures.

    `core_of` has the unit of every OsApplication (path) that is bound to a core.
    """

    def __init__(self, system: System) -> None:
        self._taken: set[str] = set()
        self._units: list[Unit] = []
        self._by_core: dict[str, str] = {}
        self._by_prototype: dict[str, str] = {}
        self._by_machine: dict[str, tuple[str, ...]] = {}
        self._by_place: dict[str, str] = {}
        self.hardware: dict[str, str] = {}
        self.assumed: list[str] = []
        self._add_classic(system)
        self.core_of = {
            application.place.path: self._by_core[application.core]
            for application in system.configuration.applications
            if application.core in self._by_core
        }
        self._classic = tuple(unit.name for unit in self._units)
        self._add_machines(system)
        self.units = tuple(self._units)

    def _add(self, name: str, place: Place | None) -> str:
        unit = Unit(name=unique_name(legal_name(name), self._taken), origin=place.origin if place else None)
        self._units.append(unit)
        return unit.name

    def _assume(self, name: str, place: Place | None) -> str:
        unit = self._add(name, place)
        self.assumed.append(unit)
        return unit

    # --------------------------------------------------------------------------------------------- classic

    def _add_classic(self, system: System) -> None:
        """Add the cores of the ECU configuration, else processing units of the hardware, else one core per ECU."""
        for core in system.configuration.cores:
            unit = self._by_core[core.name] = self._add(core.name, core.place)
            if core.hardware:
                self.hardware[unit] = core.hardware
        if self._units or (system.processes and not system.instances and not system.configuration.tasks):
            return
        by_hardware = {place.path: self._add(place.name, place) for place in system.hardware}
        if by_hardware:
            self.hardware = {unit: path for path, unit in by_hardware.items()}
            for ecu in system.ecus:
                self._by_prototype.update({p: by_hardware[h] for p, h in ecu.hardware if h in by_hardware})
            return
        ecus = [ecu for ecu in system.ecus if ecu.prototypes]
        if len(ecus) < 2:
            self._assume(DEFAULT_UNIT, None)
            return
        for ecu in ecus:
            self._by_prototype.update(
                dict.fromkeys(ecu.prototypes, self._assume(f"{ecu.place.name}/{DEFAULT_UNIT}", ecu.place))
            )

    # -------------------------------------------------------------------------------------------- adaptive

    def _add_machines(self, system: System) -> None:
        """Add the cores of every machine; one is assumed for a machine that states none."""
        for machine in system.machines:
            label = f"{machine.place.name}/" if len(system.machines) > 1 or self._classic else ""
            for core in machine.cores:
                self._by_place[core.path] = self._add(f"{label}{core.name}", core)
            found = tuple(self._by_place[core.path] for core in machine.cores)
            self._by_machine[machine.place.path] = found or (self._assume(f"{label}{DEFAULT_UNIT}", machine.place),)
        if system.processes and not self._by_machine:
            self._by_machine[""] = self._classic or (self._assume(DEFAULT_UNIT, None),)

    def _of_process(self, process: Process) -> tuple[str, ...]:
        cores = tuple(self._by_place[path] for path in process.cores if path in self._by_place)
        on_machine = self._by_machine.get(process.machine or "", ())
        return cores or on_machine or tuple(unit for units in self._by_machine.values() for unit in units)

    # ------------------------------------------------------------------------------------------------ units

    def unit_of_core(self, core: str | None) -> str | None:
        """Return the unit of a core by its name; the only unit, if there is but one."""
        alone = self.units[0].name if len(self.units) == 1 else None
        return self._by_core.get(core, alone) if core is not None else alone

    def bound_unit(self, draft: Draft) -> str | None:
        """Return the unit of the core that the task's OsApplication is bound to, or of the ECU it is mapped to."""
        if draft.os_task is not None and draft.os_task.core is not None:
            return self._by_core[draft.os_task.core]
        paths = (path for member in draft.members for path in member.context)
        return next((self._by_prototype[path] for path in paths if path in self._by_prototype), None)

    def is_mapped(self, draft: Draft) -> bool:
        """Whether an OsTask has a core, on which all its jobs run."""
        return draft.os_task is not None and draft.os_task.core is not None

    def is_bound(self, draft: Draft) -> bool:
        """Whether the files say where a task runs."""
        process = draft.members[0].process
        if process is not None:
            return process.machine is not None
        return self.bound_unit(draft) is not None

    def units_of(self, draft: Draft) -> tuple[str, ...]:
        """Return the units that a task may run on: the one it is bound to, those of its machine, or all."""
        process = draft.members[0].process
        if process is not None:
            return self._of_process(process)
        bound = self.bound_unit(draft)
        return (bound,) if bound is not None else self._classic
