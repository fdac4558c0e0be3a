"""Calls of the RTE: several events that lead to one call in an OsTask are one task, as the RTE generator has it.

An event of the RTE and one of the BSW scheduler at the same position of an OsTask, with the same period, whose
runnable and entity are the same C function, are one call. Several events of one runnable of one instance in an OsTask
are one call, too, which comes once where more than one of them is due (RTE specification, mapping of runnables).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about, named
from halpipe.core.durations import ZERO
from halpipe.importers.arxml import codes

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.core.diagnostics import Findings
    from halpipe.importers.arxml.tasks.activation import Activation

_RUNNABLE, _ENTITY = "RUNNABLE-ENTITY", "BSW-SCHEDULABLE-ENTITY"


def join_calls(activations: Sequence[Activation], findings: Findings) -> list[Activation]:
    """Return the activations, those of one call with one period, and twins of the BSW pointing to their runnables."""
    joined = _twins(activations, findings)
    by_call: dict[object, list[int]] = {}
    for index, activation in enumerate(joined):
        if activation.os_task is not None and activation.runnable is not None and activation.period is not None:
            by_call.setdefault((activation.work, activation.os_task.place.path), []).append(index)
    for indices in by_call.values():
        found = [joined[index] for index in indices]
        for index in indices:
            joined[index] = _within(joined[index], found)
        _report_rest([joined[index] for index in indices], findings)
    return joined


def _twins(activations: Sequence[Activation], findings: Findings) -> list[Activation]:
    """Point BSW entities to the runnables that are the same function at the same place."""
    runnables: dict[object, list[Activation]] = {}
    for activation in activations:
        if activation.place.kind == _RUNNABLE and (slot := _slot(activation)):
            runnables.setdefault(slot, []).append(activation)
    result = []
    for activation in activations:
        found = runnables.get(_slot(activation)) if activation.place.kind == _ENTITY else None
        if not found:
            result.append(activation)
            continue
        other = found.pop(0) if len(found) > 1 else found[0]
        result.append(replace(activation, twin=other.actor, joins=other.event))
        findings.add(
            codes.SAME_FUNCTION(
                f'is one call with "{other.name}": the same function, OsTask, position and period',
                at=activation.place.at,
                path=named("BSW entity", activation.name),
            )
        )
    return result


def _slot(activation: Activation) -> object:
    """Return what twins have in common, None for what no OsTask calls at a position with a period."""
    mapping, task = activation.mapping, activation.os_task
    if task is None or mapping is None or mapping.position is None or activation.runnable is None:
        return None
    if activation.period is None:
        return None
    return task.place.path, mapping.position, activation.period, activation.offset, activation.runnable.symbol


def _within(activation: Activation, others: Iterable[Activation]) -> Activation:
    """Give an activation that is due only when another of its call is due the period and offset of that one."""
    best = activation
    for other in others:
        if _is_due_with(best, other):
            best = other
    return replace(activation, period=best.period, offset=best.offset)


def _is_due_with(activation: Activation, other: Activation) -> bool:
    """Whether every release of an activation is one of the `other`, which has more of them."""
    assert activation.period is not None
    assert other.period is not None
    if other.period >= activation.period or activation.period % other.period:
        return False
    return (activation.offset or ZERO) % other.period == (other.offset or ZERO) % other.period


def _report_rest(call: Sequence[Activation], findings: Findings) -> None:
    rates = dict.fromkeys(f"{a.period}" + (f" from {a.offset} on" if a.offset else "") for a in call)
    if len(rates) > 1:
        first = call[0]
        findings.add(
            codes.SEVERAL_RATES(
                f"is one call of its OsTask for {', '.join(rates)}, but becomes a task for each",
                at=first.place.at,
                path=about(task=first.name),
                help="its load is overstated where they are due together; state one period in the overlay (sources)",
            )
        )
