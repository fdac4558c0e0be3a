"""The whole document: the model as one mode or all modes of it, with the schedule that was chosen."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, about, error
from halpipe.core.embedding import pieces, properties_hash
from halpipe.core.suggest import did_you_mean
from halpipe.exporters.amalthea.document import (
    Written,
    add,
    add_property,
    definitions_of,
    document,
    write_hardware,
    write_mapping,
    write_system,
)
from halpipe.exporters.amalthea.software import Software
from halpipe.exporters.amalthea.stimuli import Events, stimuli_of, write_constraints, write_stimuli
from halpipe.exporters.common.frozen import serialise
from halpipe.exporters.common.selection import select
from halpipe.exporters.native import format_model
from halpipe.models.modes import require_mode

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator

    from lxml import etree

    from halpipe.exporters.amalthea import AmaltheaOptions
    from halpipe.models import Schedule, TaskModel

DANGLING_NAME = error(
    "HAL0891",
    "AMALTHEA export lacks a definition of a name",
    "AMALTHEA refers from element to element, so a task, unit, resource, version or mode that the model names, but "
    "does not define, cannot be written. `halpipe validate` lists them, too.",
)


def format_amalthea(model: TaskModel, schedule: Schedule | None, options: AmaltheaOptions) -> bytes:
    """Return the document; raise `HalpipeError` for an unknown mode, or names of what is not there."""
    if options.mode:
        require_mode(options.mode, model.modes)
        model = model.alone(options.mode)
    _refuse_dangling(model)
    chosen = None if schedule is None else select(model, schedule, options.mode, "amalthea")
    written = Written()
    root = _document(model, chosen, options.release, written)
    return serialise(root, written.texts)


def _document(model: TaskModel, schedule: Schedule | None, release: str, written: Written) -> etree._Element:
    root = document(release)
    definitions = definitions_of(model)
    stimuli = stimuli_of(model, schedule)
    software = Software(model, release, {unit.name: definitions[unit.type] for unit in model.units}, written)
    software.write(add(root, "swModel"), stimuli)
    write_hardware(add(root, "hwModel"), model, definitions)
    write_system(add(root, "osModel"), model, release)
    write_stimuli(add(root, "stimuliModel"), model, stimuli, written)
    events = Events(add(root, "eventModel"), written)
    write_constraints(add(root, "constraintsModel"), model, events, software.runnables, written)
    write_mapping(add(root, "mappingModel"), model, stimuli, written)
    _embed(root, model)
    return root


def _embed(root: etree._Element, model: TaskModel) -> None:
    """Put the native model before the standard elements, with their hash."""
    last = len(root)
    add_property(root, "hash", properties_hash(root))
    for number, text in enumerate(pieces(format_model(model))):
        add_property(root, f"model.{number}", text)
    for place, element in enumerate(root[last:]):
        root.insert(place, element)


def _refuse_dangling(model: TaskModel) -> None:
    """Raise with every name that refers to nothing."""
    findings = Findings()
    known = {
        "task": {task.name for task in model.tasks},
        "unit": {unit.name for unit in model.units},
        "resource": {resource.name for resource in model.resources},
        "mode": {mode.name for mode in model.modes},
    }
    for path, kind, name in _references(model):
        _check(name, kind, known[kind], path, findings)
    versions = {task.name: {version.name for version in task.versions} for task in model.tasks}
    for mode in model.modes:
        for run in mode.runs:
            for version in run.versions:
                path = f'mode "{mode.name}", task "{run.task}"'
                _check(version, "version", versions.get(run.task, ()), path, findings)
    findings.stop_on_errors()


def _check(name: str, kind: str, known: Collection[str], path: str, findings: Findings) -> None:
    if name not in known:
        help = did_you_mean(name, sorted(known), "define it, or correct the name")
        findings.add(DANGLING_NAME(f'names the {kind} "{name}", which is not there', path=path, help=help))


def _references(model: TaskModel) -> Iterator[tuple[str, str, str]]:
    """Yield (path, kind, name) of every reference to an element by its name alone."""
    for task in model.tasks:
        path = about(task=task.name)
        for version in task.versions:
            yield from _each(path, "unit", version.units)
            yield from _each(path, "resource", (access.resource for access in version.accesses))
            yield from _each(path, "task", (precedence.task for precedence in version.precedences))
    for chain in model.chains:
        yield from _each(about(chain=chain.name), "task", chain.tasks)
    for mode in model.modes:
        yield from _each(about(mode=mode.name), "task", (run.task for run in mode.runs))
    for transition in model.transitions:
        yield from _each("transition", "mode", (transition.source, transition.target))
    for rule in model.health:
        yield from _each("health rule", "task", (rule.task,))
        yield from _each("health rule", "mode", (rule.mode,) if rule.mode else ())


def _each(path: str, kind: str, names: Iterable[str]) -> Iterator[tuple[str, str, str]]:
    return ((path, kind, name) for name in names)
