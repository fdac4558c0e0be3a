"""The whole import: files to items to drafts to the task model, with findings and account."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.core.files import refuse_more_than
from halpipe.core.suggest import counted, few
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.account import account
from halpipe.importers.amalthea.documents import load, read_embedded
from halpipe.importers.amalthea.graph import Evaluator
from halpipe.importers.amalthea.hardware import Memories, read_hardware
from halpipe.importers.amalthea.mapping import Allocations, interrupts_of
from halpipe.importers.amalthea.modes import DEFAULT, read_modes
from halpipe.importers.amalthea.parts import make_drafts
from halpipe.importers.amalthea.tasks import TaskBuilder
from halpipe.importers.amalthea.timing import Reactions, reactions_of, read_timing
from halpipe.importers.amalthea.versions import UNIT, Locks, Splitter, VersionMaker
from halpipe.importers.amalthea.xmi import Forest, Names, legal
from halpipe.importers.common.base import Coverage, Imported, imported
from halpipe.models import Mode, Origin, Resource, ResourceKind, Run, TaskModel, Unit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.importers.amalthea import AmaltheaImportOptions
    from halpipe.importers.amalthea.hardware import Hardware
    from halpipe.importers.amalthea.modes import SystemMode
    from halpipe.importers.amalthea.parts import Drafts
    from halpipe.importers.amalthea.tasks import Built
    from halpipe.importers.amalthea.xmi import Item
    from halpipe.models import Chain, Interrupt

MOST_TASKS = 50_000
"""As many are imported within the cost law; vehicles have some thousands."""


def import_amalthea(paths: Sequence[str], options: AmaltheaImportOptions) -> Imported:
    """Read the files of one AMALTHEA model into one task model.

    Raise `HalpipeError` with every finding if any is an error: unusable files, values of a wrong form, no task with a
    period; under `options.strict` also every loss (warning), with the exit code for unsupported input.
    """
    return imported(lambda findings: _import(paths, options, findings), options)


def _import(paths: Sequence[str], options: AmaltheaImportOptions, findings: Findings) -> Imported:
    """Import one model; what its periods decide is added once an overlay is on it."""
    coverage = Coverage()
    model, reactions = _model(paths, options, findings, coverage)
    return Imported(model=model, diagnostics=(), coverage=coverage, completion=reactions.complete)


def _model(
    paths: Sequence[str], options: AmaltheaImportOptions, findings: Findings, coverage: Coverage
) -> tuple[TaskModel, Reactions]:
    """Read files into a model, and what is added once an overlay is on it; `coverage` accounts for every element."""
    documents = load(paths, findings)
    embedded = read_embedded(documents, options, findings, coverage)
    if embedded is not None:
        return embedded, Reactions(())
    forest = Forest(documents, findings)
    count = sum(1 for _ in forest.within("SWModel", "tasks", "isrs"))
    refuse_more_than(MOST_TASKS, count, "tasks and interrupt routines", forest.roots[0].at)
    hardware = read_hardware(forest)
    units = _unit_names(forest, hardware)
    modes = read_modes(forest)
    evaluator = Evaluator(forest)
    drafts = make_drafts(forest, modes, evaluator, options.overlay)
    _stop_without_tasks(forest, drafts, findings)
    memories = Memories(forest, hardware)
    splitter = Splitter(evaluator, options.pieces, added=options.memory == "added")
    locks = Locks(forest, evaluator, [memories.name(item) for item in hardware.memories])
    makers = VersionMaker(
        forest, evaluator, memories, units, modes=modes, memory=options.memory, splitter=splitter, locks=locks
    )
    mapping = Allocations(forest) if options.mapping == "stated" else None
    timing = read_timing(forest, drafts)
    builder = TaskBuilder(
        forest, hardware, units, mapping=mapping, versions=makers, memories=memories, coverage=coverage
    )
    built = builder.build(drafts, timing)
    interrupts = interrupts_of(forest, drafts.routines, hardware, mapping, evaluator, modes, options.overlay)
    runs = _modes(modes, built)
    model = TaskModel(
        name=legal(options.name or _name(paths)),
        units=_units(hardware, units, interrupts),
        resources=(*memories.resources(built.resources), *_locks(locks)),
        tasks=built.tasks,
        chains=_named(forest, built.chains),
        modes=runs,
        origin=Origin(forest.roots[0].file, 1),
    )
    makers.report()
    memories.report()
    _report(forest, model, evaluator, coverage)
    account(forest, drafts, memories, evaluator.accesses, coverage)
    return model, Reactions(reactions_of(timing))


def _stop_without_tasks(forest: Forest, drafts: Drafts, findings: Findings) -> None:
    if drafts.items:
        return
    count = len(drafts.without)
    held = f"{counted(count, 'task')}, none of them with a period" if count else "no task"
    help = "state periods under tasks: in an overlay" if count else "name the file with the software model, too"
    if not count and forest.kinds("SWModel"):
        help = (
            "its software model defines no tasks: let tasks call its runnables, or name the file that defines them, too"
        )
    findings.add(codes.NO_TASKS(f"the model has {held}", at=Location(forest.roots[0].file), help=help))
    raise HalpipeError(*findings.items)


def _name(paths: Sequence[str]) -> str:
    """Return the name of the first file or folder."""
    return os.path.basename(os.path.normpath(paths[0])).removesuffix(".amxmi") or "amalthea"


# --------------------------------------------------------------------------------------------- platform


def _locks(locks: Locks) -> tuple[Resource, ...]:
    kind = ResourceKind.LOCK
    return tuple(Resource(name=name, kind=kind, origin=item.origin) for item, name in locks.names.items())


def _unit_names(forest: Forest, hardware: Hardware) -> dict[Item, str]:
    names = Names(forest.findings)
    return {unit.item: names.unique(unit.item.name, "processing unit", unit.item.at) for unit in hardware.units}


def _units(
    hardware: Hardware, names: dict[Item, str], interrupts: dict[Item, tuple[Interrupt, ...]]
) -> tuple[Unit, ...]:
    found = []
    for unit in hardware.units:
        unit.item.use()
        kind = ""
        if unit.type is not None:
            unit.type.use()
            kind = legal(unit.type.name)
        served = interrupts.get(unit.item, ())
        found.append(Unit(name=names[unit.item], type=kind, interrupts=served, origin=unit.item.origin))
    return tuple(found) or (Unit(name=UNIT),)


def _named(forest: Forest, chains: Sequence[Chain]) -> tuple[Chain, ...]:
    names = Names(forest.findings)
    return tuple(
        replace(chain, name=names.unique(chain.name, "chain", chain.origin.location if chain.origin else Location()))
        for chain in chains
    )


def _modes(modes: Sequence[SystemMode], built: Built) -> tuple[Mode, ...]:
    """Return the modes, each with the tasks and versions that its stimuli and branches choose.

    Modes that make no difference to any task are one.
    """
    found = []
    for mode in modes:
        runs = [
            Run(task=name, versions=tuple(by[mode.name])) for name, by in built.by_mode.items() if by.get(mode.name)
        ]
        found.append(Mode(name=mode.name, runs=tuple(runs), origin=mode.origin.origin if mode.origin else None))
    if all(mode.runs == found[0].runs for mode in found):
        return (Mode(name=DEFAULT, runs=found[0].runs),)
    for mode in modes:
        for label in mode.literals:
            label.use()
        if mode.origin is not None:
            mode.origin.use()
    return tuple(found)


# ---------------------------------------------------------------------------------------------- reports


def _report(forest: Forest, model: TaskModel, evaluator: Evaluator, coverage: Coverage) -> None:
    help = "state the WCET in an overlay, if no job takes the longest branch of all"
    forest.report_each(codes.BRANCHES, "switches choose at run time", list(evaluator.branched), help)
    help = "state the WCET in an overlay"
    forest.report_each(codes.LOOP, "loops are counted once", list(evaluator.loops), help)
    file = Location(forest.roots[0].file)
    lacking = [task for task in model.tasks if any(version.wcet is None for version in task.versions)]
    if lacking:
        at = lacking[0].origin.location if lacking[0].origin else file
        names = few([task.name for task in lacking], "")
        message = f"{len(lacking)} of {len(model.tasks)} tasks have no execution time: {names}"
        forest.findings.add(codes.NO_WCET(message, at=at, help="give them in an overlay (tasks: wcet)"))
    if model.units == (Unit(name=UNIT),):
        coverage.defaulted("platform", "units", UNIT)
        cure = "add the file with the hardware model"
        if forest.kinds("HWModel"):
            cure = "let the hardware model define processing units"
        help = f"{cure}, or name units under platform: in an overlay"
        forest.findings.add(codes.DEFAULT_UNIT(f"no processing unit is defined; assumed {UNIT}", at=file, help=help))
