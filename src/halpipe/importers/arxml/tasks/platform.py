"""Execution units with their interrupts, and execution modes.

AUTOSAR states in which modes an event does *not* occur. With one group of which modes disable events, every mode of
it becomes an execution mode without the tasks disabled there. Modes of several groups may be active in any mix: then
there is a mode ``default`` with all tasks, and one mode ``group.mode`` for every mode of every such group, in which
only that group switches tasks off. Function groups of the Adaptive Platform state in which of their modes a process
does run; they are mode groups like the others. A mode in which nothing runs needs no schedule and is left out."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, named
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.words import listed
from halpipe.importers.arxml.tasks.dataflow import find_providers
from halpipe.importers.common.names import legal, unique_name
from halpipe.models import Interrupt, Mode, Run, Transition, Unit

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from halpipe.importers.arxml.coverage import Ledger
    from halpipe.importers.arxml.system.values import ModeGroup, OsIsr, Place, Process, System
    from halpipe.importers.arxml.tasks.activation import Draft
    from halpipe.importers.overlay import OverlayUse

DEFAULT_UNIT = "core0"


class Platform:
    """The execution units of a system; `assumed` are those that no file configures.

    `core_of` has the unit of every OsApplication (path) that is bound to a core, and `hardware` the HW-ELEMENTs of a
    unit (paths): its own, then those that it is nested in, the nearest first.
    """

    def __init__(self, system: System) -> None:
        self._taken: dict[str, int] = {}
        self._units: list[Unit] = []
        self._by_core: dict[str, str] = {}
        self._by_prototype: dict[str, str] = {}
        self._by_machine: dict[str, tuple[str, ...]] = {}
        self._by_place: dict[str, str] = {}
        self.hardware: dict[str, tuple[tuple[str, ...], ...]] = {}
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
        unit = Unit(name=unique_name(legal(name), self._taken), origin=place.origin if place else None)
        self._units.append(unit)
        return unit.name

    def _assume(self, name: str, place: Place | None) -> str:
        unit = self._add(name, place)
        self.assumed.append(unit)
        return unit

    # --------------------------------------------------------------------------------------------- classic

    def _add_classic(self, system: System) -> None:
        """Add the cores of the ECU configuration, else processing units of the hardware, else one core."""
        for core in system.configuration.cores:
            unit = self._by_core[core.name] = self._add(core.name, core.place)
            if core.hardware:
                self.hardware[unit] = _levels(core.hardware, system.holders)
        if self._units or (system.processes and not system.instances and not system.configuration.tasks):
            return
        by_hardware = {place.path: self._add(place.name, place) for place in system.hardware}
        if by_hardware:
            self.hardware = {unit: _levels(path, system.holders) for path, unit in by_hardware.items()}
            for ecu in system.ecus:
                self._by_prototype.update({p: by_hardware[h] for p, h in ecu.hardware if h in by_hardware})
        else:
            self._assume(DEFAULT_UNIT, None)

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


def with_interrupts(
    platform: Platform, system: System, overlay: OverlayUse | None, ledger: Ledger, findings: Findings
) -> tuple[Unit, ...]:
    """Return the units with the interrupts that they serve; report routines that are not described enough."""
    served: dict[str, list[Interrupt]] = {unit.name: [] for unit in platform.units}
    lacking: list[OsIsr] = []
    for routine in system.configuration.routines:
        name = legal(routine.place.name)
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
    if lacking:
        names = ", ".join(legal(routine.place.name) for routine in lacking)
        message = f"{len(lacking)} interrupt routines have no time, distance or core: {names}"
        help = "state them as interrupts under platform: in the overlay"
        findings.report(codes.UNKNOWN_INTERRUPT, message, at=lacking[0].place.at, help=help)
    return tuple(replace(unit, interrupts=tuple(served[unit.name])) for unit in platform.units)


DEFAULT_MODE = "default"


def make_modes(
    system: System,
    drafts: Sequence[Draft],
    versions: Mapping[str, tuple[str, ...]],
    ledger: Ledger,
    findings: Findings,
) -> tuple[tuple[Mode, ...], tuple[Transition, ...]]:
    """Return the modes and the transitions between them; no transition means that every pair may be switched.

    `versions` are the names of the versions of every task.
    """
    disabled = frozenset(path for draft in drafts for path in draft.disabled_in)
    groups = [group for group in system.mode_groups if any(mode.path in disabled for mode in group.modes)]
    names = _mode_names(groups)
    modes = [] if len(groups) == 1 else [Mode(name=DEFAULT_MODE, runs=_runs(drafts, "", versions))]
    for group in groups:
        _report_machines(system, group, drafts, findings)
        ledger.mapped(group.place, *group.modes, *group.parts)
        for mode in group.modes:
            runs = _runs(drafts, mode.path, versions)
            if runs:
                modes.append(Mode(name=names[mode.path], runs=runs, origin=mode.origin))
            else:
                del names[mode.path]
                path = named(group.place.kind, group.place.path)
                findings.report(codes.EMPTY_MODE, f'no task runs in mode "{mode.name}"', at=mode.at, path=path)
    if len(groups) > 1:
        message = f"{len(groups)} mode groups switch tasks off: {', '.join(g.place.path for g in groups)}"
        help = "name the modes that occur together in the overlay (modes)"
        findings.report(codes.SEVERAL_GROUPS, message, at=groups[0].place.at, help=help)
    if not any(group.transitions for group in groups):
        return tuple(modes), ()
    transitions = [t for group in groups for t in _transitions(group, names, ledger)]
    if len(groups) > 1:
        ways = [way for name in names.values() for way in ((DEFAULT_MODE, name), (name, DEFAULT_MODE))]
        transitions += [Transition(source=source, target=target) for source, target in ways]
    return tuple(modes), tuple(transitions)


def _mode_names(groups: Sequence[ModeGroup]) -> dict[str, str]:
    taken = {DEFAULT_MODE: 1} if len(groups) > 1 else {}
    return {
        mode.path: unique_name(legal(f"{group.place.name}.{mode.name}" if len(groups) > 1 else mode.name), taken)
        for group in groups
        for mode in group.modes
    }


def _runs(drafts: Sequence[Draft], mode: str, versions: Mapping[str, tuple[str, ...]]) -> tuple[Run, ...]:
    return tuple(
        Run(task=draft.name, versions=versions[draft.name]) for draft in drafts if mode not in draft.disabled_in
    )


def _report_machines(system: System, group: ModeGroup, drafts: Sequence[Draft], findings: Findings) -> None:
    """Report a group whose modes are switched at several places: each combination of them is a state of its own."""
    modes = {mode.path for mode in group.modes}
    events = [(m.context, m.event) for draft in drafts for m in draft.members if m.event]
    ports = {(c, port): None for c, e in events for port in e.mode_ports if not modes.isdisjoint(e.disabled_in)}
    providers = find_providers(system) if len(ports) > 1 else {}
    machines = dict.fromkeys(providers[port] for port in ports if port in providers)
    if len(machines) > 1:
        group.place.report(
            findings,
            codes.SEVERAL_MACHINES,
            f"is switched by {len(machines)} providers, but imported as one: {listed([port for _, port in machines])}",
            help="state the modes that occur together in the overlay (modes)",
        )


def _transitions(group: ModeGroup, names: dict[str, str], ledger: Ledger) -> Iterator[Transition]:
    """Yield the transitions that a group states, or every pair of its modes if it states none."""
    for place, exited, entered in group.transitions:
        if exited in names and entered in names and exited != entered:
            ledger.mapped(place)
            yield Transition(source=names[exited], target=names[entered], origin=place.origin)
    if not group.transitions:
        for source in group.modes:
            for target in group.modes:
                if source != target and source.path in names and target.path in names:
                    yield Transition(source=names[source.path], target=names[target.path], origin=group.place.origin)


def _levels(path: str, holders: Mapping[str, Sequence[str]]) -> tuple[tuple[str, ...], ...]:
    """Return an element, the elements that it is nested in, those that these are nested in, and so on."""
    levels: list[tuple[str, ...]] = [(path,)]
    known = {path}
    while level := tuple(dict.fromkeys(h for inner in levels[-1] for h in holders.get(inner, ()) if h not in known)):
        levels.append(level)
        known.update(level)
    return tuple(levels)
