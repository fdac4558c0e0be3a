"""Writer of the task model XML (schema task-model-1.xsd); what it writes reads back to an equal model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.exporters.native.document import add, add_element, attributes_of, document, serialise
from halpipe.models import Task
from halpipe.models.attributes import DURATIONS, attributes, texts
from halpipe.schemas import TASK_MODEL

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lxml import etree

    from halpipe.models import Mode, Origin, Split, TaskModel, Unit, Version


def format_model(model: TaskModel) -> bytes:
    """Return the canonical XML of a task model."""
    root = document(TASK_MODEL, attributes_of(model))
    platform = add(root, "platform")
    for unit in model.units:
        _write_unit(platform, unit)
    for resource in model.resources:
        _write_origin(add_element(platform, "resource", resource), resource.origin)
    common = _common(model.tasks)
    tasks = add(root, "tasks", common)
    for task in model.tasks:
        _write_task(tasks, task, common)
    if model.chains:
        chains = add(root, "chains")
        for chain in model.chains:
            _write_origin(add_element(chains, "chain", chain), chain.origin)
    modes = add(root, "modes")
    for mode in model.modes:
        _write_mode(modes, mode)
    if model.transitions:
        transitions = add(root, "transitions")
        for transition in model.transitions:
            _write_origin(add_element(transitions, "transition", transition), transition.origin)
    if model.health:
        health = add(root, "health")
        for rule in model.health:
            _write_origin(add_element(health, "rule", rule), rule.origin)
    _write_origin(root, model.origin)
    return serialise(root, TASK_MODEL)


def _write_origin(parent: etree._Element, origin: Origin | None) -> None:
    if origin is not None:
        add_element(parent, "origin", origin)


def _write_unit(parent: etree._Element, unit: Unit) -> None:
    element = add_element(parent, "unit", unit)
    for interrupt in unit.interrupts:
        _write_origin(add_element(element, "interrupt", interrupt), interrupt.origin)
    _write_origin(element, unit.origin)


def _common(tasks: tuple[Task, ...]) -> dict[str, str]:
    """Return the attributes that all tasks have in common and that are written once."""
    found: dict[str, str] = {}
    common = [stated for stated in attributes(Task) if stated.is_common]
    said_of = [texts(task) for task in tasks] if common else []
    for stated in common:
        said = {stating.get(stated.name) for stating in said_of}
        found.update((stated.name, text) for text in said if text is not None and len(said) == 1)
    return found


def _write_task(parent: etree._Element, task: Task, common: Mapping[str, str]) -> None:
    element = add(parent, "task", {name: text for name, text in attributes_of(task).items() if name not in common})
    for version in task.versions:
        _write_version(element, version)
    _write_origin(element, task.origin)


def _write_version(parent: etree._Element, version: Version) -> None:
    element = add(parent, "version", {**attributes_of(version), **_split(version.split)})
    units = attributes_of(version, "units")
    if units:
        add(element, "units", units)
    for access in version.accesses:
        inner = add_element(element, "access", access)
        for transfer in access.transfers:
            add_element(inner, "transfer", transfer)
    for precedence in version.precedences:
        _write_origin(add_element(element, "precedence", precedence), precedence.origin)
    if version.source is not None:
        add_element(element, "source", version.source)
    _write_origin(element, version.origin)


def _split(split: Split) -> dict[str, str]:
    where = "anywhere" if split.anywhere else DURATIONS.text(split.points)
    return {**({"split": where} if where else {}), **attributes_of(split)}


def _write_mode(parent: etree._Element, mode: Mode) -> None:
    element = add_element(parent, "mode", mode)
    for run in mode.runs:
        add_element(element, "run", run)
    _write_origin(element, mode.origin)
