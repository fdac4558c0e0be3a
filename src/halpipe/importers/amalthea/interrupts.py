"""Interrupt service routines: what interrupts the jobs of a unit, at most so often and for so long (MODEL 8.1)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.durations import seconds
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.graph import everything, steps
from halpipe.importers.amalthea.names import Names, legal
from halpipe.models import Interrupt, Origin

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from halpipe.core.durations import Duration
    from halpipe.importers.amalthea.graph import Evaluator
    from halpipe.importers.amalthea.hardware import Hardware, Pu
    from halpipe.importers.amalthea.mapping import Mapping as Allocation
    from halpipe.importers.amalthea.modes import SystemMode
    from halpipe.importers.amalthea.xmi import Forest, Item
    from halpipe.importers.common.base import Supplement

_ACTIVATES = ("InterProcessTrigger", "InterProcessActivation", "CustomEventTrigger", "SetEvent")


def is_interrupt(forest: Forest, task: Item) -> bool:
    """Return whether a routine only takes time: one that activates tasks, or lets them go on, is a task itself."""
    return task.kind == "ISR" and not any(step.kind in _ACTIVATES for step in everything(forest, steps(task)))


def interrupts_of(
    forest: Forest,
    routines: Mapping[Item, Sequence[Duration]],
    hardware: Hardware,
    allocation: Allocation | None,
    evaluator: Evaluator,
    modes: Sequence[SystemMode],
    overlay: Supplement | None,
) -> dict[Item, tuple[Interrupt, ...]]:
    """Return the interrupts of every unit; report the routines whose time, distance or unit is not known.

    `routines` have the least distances of their arrivals: one interrupt for each, since activations of several
    stimuli may come at one time. A routine that may run on several units interrupts each of them.
    """
    names = Names(forest.findings)
    found: dict[Item, tuple[Interrupt, ...]] = {}
    lacking: list[Item] = []
    accessing: list[Item] = []
    for routine, distances in routines.items():
        if overlay is not None and overlay.states_interrupt(legal(routine.name)):
            routine.use()
            continue
        bound = None if allocation is None else allocation.units(routine)
        units = [unit for unit in hardware.units if bound is None or unit.item in bound]
        times = {unit.item: _time(routine, unit, evaluator, modes) for unit in units}
        if any(step.kind == "LabelAccess" for step in everything(forest, steps(routine))):
            accessing.append(routine)
        if not distances or not times or not all(times.values()):
            lacking.append(routine)
            continue
        routine.use()
        origin = Origin(routine.at.file, routine.at.line, routine.name)
        for distance in distances:
            name = names.unique(routine.name, "interrupt", routine.at)
            for unit, time in times.items():
                if time is not None:
                    interrupt = Interrupt(name=name, distance=distance, wcet=time, origin=origin)
                    found[unit] = (*found.get(unit, ()), interrupt)
    if lacking:
        listed = ", ".join(routine.name for routine in lacking)
        message = f"{len(lacking)} interrupt routines have no time, distance or unit: {listed}"
        help = "state them as interrupts of their unit under platform: in an overlay"
        forest.findings.add(codes.UNKNOWN_INTERRUPT(message, at=lacking[0].at, help=help))
    help = "let the ticks of the routine contain them, and state shares of the memory in an overlay"
    forest.report_each(codes.NOT_READ, "interrupt routines access labels, which takes no share", accessing, help)
    return found


def _time(routine: Item, unit: Pu, evaluator: Evaluator, modes: Sequence[SystemMode]) -> Duration | None:
    """Return the longest time of a routine on a unit in any mode; None if some of it is not known."""
    amounts = [evaluator.amount(steps(routine), mode, unit) for mode in modes]
    if not unit.frequency or not all(amount.is_known and amount.is_timed for amount in amounts):
        return None
    return seconds(max(amount.cycles for amount in amounts) / unit.frequency)
