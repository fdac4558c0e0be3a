"""Writer of the task model XML (schema task-model-1.xsd); what it writes reads back to an equal model."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from halpipe.exporters.native.document import add, document, listed, serialise
from halpipe.models import Binding, HealthEvent
from halpipe.quantities import format_bandwidth, format_rational, format_size
from halpipe.schemas import TASK_MODEL

if TYPE_CHECKING:
    from lxml import etree

    from halpipe.models import (
        Access,
        Chain,
        HealthRule,
        Mode,
        Origin,
        Precedence,
        Resource,
        Source,
        Task,
        TaskModel,
        Transition,
        Unit,
        Version,
    )

T = TypeVar("T")


def format_model(model: TaskModel) -> bytes:
    """Return the canonical XML of a task model."""
    root = document(TASK_MODEL, name=model.name)
    platform = add(root, "platform")
    for unit in model.units:
        _write_unit(platform, unit)
    for resource in model.resources:
        _write_resource(platform, resource)
    default = _common_binding(model.tasks)
    tasks = add(root, "tasks", binding=_other(default, Binding.JOB))
    for task in model.tasks:
        _write_task(tasks, task, default)
    if model.chains:
        chains = add(root, "chains")
        for chain in model.chains:
            _write_chain(chains, chain)
    modes = add(root, "modes")
    for mode in model.modes:
        _write_mode(modes, mode)
    if model.transitions:
        transitions = add(root, "transitions")
        for transition in model.transitions:
            _write_transition(transitions, transition)
    if model.health:
        health = add(root, "health")
        for rule in model.health:
            _write_rule(health, rule)
    _write_origin(root, model.origin)
    return serialise(root, TASK_MODEL)


def _write_origin(parent: etree._Element, origin: Origin | None) -> None:
    if origin is not None:
        add(parent, "origin", file=origin.file, line=origin.line or None, path=origin.path or None)


def _write_unit(parent: etree._Element, unit: Unit) -> None:
    element = add(parent, "unit", name=unit.name, type=unit.type or None)
    for interrupt in unit.interrupts:
        served = add(element, "interrupt", name=interrupt.name, distance=interrupt.distance, wcet=interrupt.wcet)
        _write_origin(served, interrupt.origin)
    _write_origin(element, unit.origin)


def _write_resource(parent: etree._Element, resource: Resource) -> None:
    bandwidth = None if resource.bandwidth is None else format_bandwidth(resource.bandwidth)
    _write_origin(add(parent, "resource", name=resource.name, bandwidth=bandwidth), resource.origin)


def _common_binding(tasks: tuple[Task, ...]) -> Binding:
    """Return what all tasks say alike, so that it need not be said of each; else the default."""
    said = {task.binding for task in tasks}
    return said.pop() if len(said) == 1 else Binding.JOB


def _other(value: T, default: T) -> T | None:
    """Return a value, or None where it need not be written."""
    return None if value == default else value


def _write_task(parent: etree._Element, task: Task, binding: Binding) -> None:
    element = add(
        parent,
        "task",
        name=task.name,
        period=task.period,
        slack=format_rational(task.slack) if task.slack else None,
        offset=task.offset,
        deadline=task.deadline,
        distance=task.distance,
        binding=_other(task.binding, binding),
    )
    for version in task.versions:
        _write_version(element, version)
    _write_origin(element, task.origin)


def _write_version(parent: etree._Element, version: Version) -> None:
    split = version.split
    element = add(
        parent,
        "version",
        name=version.name,
        wcet=version.wcet,
        split="anywhere" if split.anywhere else " ".join(map(str, split.points)) or None,
        resume=split.resume or None,
        max_gaps=split.max_gaps,
        min_part=split.min_part,
    )
    if version.units or version.gang != 1:
        gang = None if version.gang == 1 else version.gang
        add(element, "units", names=listed(version.units) if version.units else None, gang=gang)
    for access in version.accesses:
        _write_access(element, access)
    for precedence in version.precedences:
        _write_precedence(element, precedence)
    if version.source is not None:
        _write_source(element, version.source)
    _write_origin(element, version.origin)


def _write_access(parent: etree._Element, access: Access) -> None:
    element = add(
        parent,
        "access",
        resource=access.resource,
        start=access.start,
        end=access.end,
        bound=format_rational(access.bound),
        kind=access.kind,
    )
    for transfer in access.transfers:
        size = format_size(transfer.size)
        add(element, "transfer", buffer=transfer.buffer, symbol=transfer.symbol, size=size)


def _write_precedence(parent: etree._Element, precedence: Precedence) -> None:
    element = add(
        parent,
        "precedence",
        task=precedence.task,
        from_=precedence.anchor,
        min=precedence.min,
        max=precedence.max,
    )
    _write_origin(element, precedence.origin)


def _write_source(parent: etree._Element, source: Source) -> None:
    add(
        parent,
        "source",
        files=listed(source.files),
        entry=source.entry,
        defines=listed(source.defines) if source.defines else None,
    )


def _write_chain(parent: etree._Element, chain: Chain) -> None:
    element = add(
        parent,
        "chain",
        name=chain.name,
        tasks=listed(chain.tasks),
        max_reaction=chain.max_reaction,
        max_age=chain.max_age,
    )
    _write_origin(element, chain.origin)


def _write_mode(parent: etree._Element, mode: Mode) -> None:
    element = add(parent, "mode", name=mode.name)
    for run in mode.runs:
        add(element, "run", task=run.task, versions=listed(run.versions))
    _write_origin(element, mode.origin)


def _write_transition(parent: etree._Element, transition: Transition) -> None:
    element = add(parent, "transition", from_=transition.source, to=transition.target, max_length=transition.max_length)
    _write_origin(element, transition.origin)


def _write_rule(parent: etree._Element, rule: HealthRule) -> None:
    element = add(
        parent,
        "rule",
        task=rule.task,
        on=_other(rule.event, HealthEvent.ANY),
        count=_other(rule.count, 1),
        cycles=_other(rule.cycles, 1),
        action=rule.action,
        mode=rule.mode or None,
    )
    _write_origin(element, rule.origin)
