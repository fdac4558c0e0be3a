"""Units that may run a task (schedulers, affinities, target cores), and interrupt routines of units (MODEL 8.1)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.durations import Duration, seconds
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.graph import CALLS, Evaluator, everything, steps
from halpipe.importers.common.names import Names, legal
from halpipe.models import Interrupt

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from halpipe.importers.amalthea.hardware import Hardware, Pu
    from halpipe.importers.amalthea.modes import SystemMode
    from halpipe.importers.amalthea.xmi import Forest, Item
    from halpipe.importers.overlay import OverlayUse

_PROCESS = {"TaskAllocation": "task", "ProcessAllocation": "process", "ISRAllocation": "isr"}
_AFFINITIES = ("affinity", "coreAffinity")


class Allocations:
    """The mapping model, by task and by scheduler."""

    def __init__(self, forest: Forest) -> None:
        self._forest = forest
        self._cores: dict[Item, list[Item]] = {}
        self._allocations: dict[Item, list[Item]] = {}
        self._of_runnable: dict[Item, list[Item]] = {}
        for item in forest.kinds("SchedulerAllocation", "CoreAllocation"):
            self._add_scheduler(item)
        for kind, feature in _PROCESS.items():
            for item in forest.kinds(kind):
                if (task := forest.ref(item, feature)) is not None:
                    self._allocations.setdefault(task, []).append(item)
        for item in forest.kinds("RunnableAllocation"):
            if (runnable := forest.ref(item, "entity")) is not None:
                self._of_runnable.setdefault(runnable, []).append(item)
        self._targets = _targets(forest, self)

    def _add_scheduler(self, item: Item) -> None:
        scheduler = self._forest.ref(item, "scheduler")
        cores = [core for name in ("responsibility", "core") for core in self._forest.refs(item, name)]
        if not cores:
            cores = [core for name in ("executingPU", "executingCore") for core in self._forest.refs(item, name)]
        if scheduler is not None and cores:
            item.use()
            self._cores.setdefault(scheduler, []).extend(cores)

    def units(self, task: Item) -> list[Item] | None:
        """Return the units that a task is bound to, None if to none in particular."""
        bound = [self._allocated(item) for item in self._allocations.get(task, ())]
        if not any(bound):
            bound = [self._by_runnables(task)]
        units = [unit for found in bound for unit in found or ()]
        for targets, separates in self._targets.get(task, ()):
            all_units = units or self._forest.kinds("ProcessingUnit", "Core")
            kept = [unit for unit in all_units if (unit in targets) is not separates]
            if not kept:
                self._contradiction(task, "its pairing or separation leaves none of the units that it is allocated to")
            units = kept or units
        return list(dict.fromkeys(units)) or None

    def _allocated(self, item: Item) -> list[Item]:
        """Return the units of an allocation: those of the affinity, as far as the scheduler is responsible for them."""
        scheduler = self._forest.ref(item, "scheduler") or self._forest.ref(item, "controller")
        cores = [] if scheduler is None else self.responsible(scheduler)
        affinity = [unit for name in _AFFINITIES for unit in self._forest.refs(item, name)]
        if cores or affinity:
            item.use()
        if not affinity or not cores:
            return affinity or cores
        both = [unit for unit in affinity if unit in cores]
        if not both and scheduler is not None:
            names = ", ".join(unit.name for unit in affinity)
            message = f'the affinity to {names} is not among the units of scheduler "{scheduler.name}"'
            task = self._forest.ref(item, _PROCESS[item.kind])
            path = item.path if task is None else task.path
            help = "correct the affinity or the scheduler, or state units in an overlay"
            self._forest.findings.add(codes.AFFINITY(message, at=item.at, path=path, help=help))
        return both or cores

    def responsible(self, scheduler: Item) -> list[Item]:
        """Return the units of a scheduler; one without takes those of the scheduler above it."""
        current: Item | None = scheduler
        seen: set[Item] = set()
        while current is not None and current not in self._cores and current not in seen:
            seen.add(current)
            association = current.one("parentAssociation")
            current = None if association is None else self._forest.ref(association, "parent")
        if current is None or current not in self._cores:
            return []
        scheduler.use()
        current.use()
        return self._cores[current]

    def _by_runnables(self, task: Item) -> list[Item]:
        """Return the units that all allocated runnables of a task have in common."""
        if not self._of_runnable:
            return []
        common: list[Item] | None = None
        for step in everything(self._forest, steps(task)):
            runnable = self._forest.ref(step, CALLS[step.kind]) if step.kind in CALLS else None
            for item in self._of_runnable.get(runnable, ()) if runnable is not None else ():
                scheduler = self._forest.ref(item, "scheduler")
                cores = [] if scheduler is None else self.responsible(scheduler)
                if cores:
                    item.use()
                    common = cores if common is None else [core for core in common if core in cores]
        if common == []:
            self._contradiction(task, "its runnables are allocated to different units")
        return common or []

    def _contradiction(self, task: Item, message: str) -> None:
        help = "correct the mapping, or state units in an overlay"
        self._forest.report(codes.AFFINITY, message, task, help)


def _targets(forest: Forest, mapping: Allocations) -> dict[Item, list[tuple[list[Item], bool]]]:
    """Return for tasks the target units of pairing and separation constraints, and whether they are to be avoided."""
    found: dict[Item, list[tuple[list[Item], bool]]] = {}
    unmapped = []
    for item in forest.within("ConstraintsModel", "affinityConstraints"):
        units = _target_units(forest, item, mapping)
        processes = (task for group in item.all("group", "groups") for task in forest.refs(group, "processes"))
        tasks = [task for task in processes if task.kind in ("Task", "ISR")]
        if not units or not tasks:
            unmapped.append(item)
            continue
        item.use_all()
        for task in tasks:
            found.setdefault(task, []).append((units, "Separation" in item.kind))
    help = "state units in an overlay, if they matter"
    forest.report_each(codes.NOT_IMPORTED, "affinity constraints without processes or target units", unmapped, help)
    return found


def _target_units(forest: Forest, item: Item, mapping: Allocations) -> list[Item]:
    units = []
    for target in item.all("target"):
        units += forest.refs(target, "cores")
        units += [unit for s in forest.refs(target, "schedulers") for unit in mapping.responsible(s)]
    return units


_ACTIVATES = ("InterProcessTrigger", "InterProcessActivation", "CustomEventTrigger", "SetEvent")


def is_interrupt(forest: Forest, task: Item) -> bool:
    """Return whether a routine only takes time: one that activates tasks, or lets them go on, is a task itself."""
    return task.kind == "ISR" and not any(step.kind in _ACTIVATES for step in everything(forest, steps(task)))


def interrupts_of(
    forest: Forest,
    routines: Mapping[Item, Sequence[Duration]],
    hardware: Hardware,
    allocation: Allocations | None,
    evaluator: Evaluator,
    modes: Sequence[SystemMode],
    overlay: OverlayUse | None,
) -> dict[Item, tuple[Interrupt, ...]]:
    """Return the interrupts of every unit; report the routines whose time, distance or unit is not known.

    `routines` have the least distances of their arrivals: one interrupt for each, since activations of several
    stimuli may come at one time. A routine that may run on several units interrupts each of them.
    """
    names = Names(forest.findings, codes.RENAMED)
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
        for distance in distances:
            name = names.unique(routine.name, "interrupt", routine.at)
            for unit, time in times.items():
                if time is not None:
                    interrupt = Interrupt(name=name, distance=distance, wcet=time, origin=routine.origin)
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
