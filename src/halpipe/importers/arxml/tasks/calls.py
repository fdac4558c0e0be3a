"""Calls of the RTE: several events that lead to one call, or to one activation of a basic OsTask, are one.

An event of the RTE and one of the BSW scheduler at the same position of an OsTask, with the same period, whose
runnable and entity are the same C function, are one call. Several events of one runnable of one instance in an OsTask
are one call, too, which comes once where more than one of them is due (RTE specification, mapping of runnables). A
basic OsTask is activated as often as the greatest common divisor of the periods and offsets of its calls says; its jobs
are as long as all their calls together."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, about, named
from halpipe.core.durations import ZERO, Duration, greatest_common_divisor
from halpipe.core.grouping import grouped
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.words import listed

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.importers.arxml.system.values import Trigger
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
    runnables = grouped((slot, each) for each in activations if each.place.kind == _RUNNABLE and (slot := _slot(each)))
    result = []
    for activation in activations:
        found = runnables.get(_slot(activation)) if activation.place.kind == _ENTITY else None
        if not found:
            result.append(activation)
            continue
        other = found.pop(0) if len(found) > 1 else found[0]
        result.append(replace(activation, twin=other.actor, joins=other.event))
        message = f'is one call with "{other.name}": the same function, OsTask, position and period'
        findings.report(codes.SAME_FUNCTION, message, at=activation.place.at, path=named("BSW entity", activation.name))
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
    rates = _rates(call)
    if len(rates) > 1:
        first = call[0]
        message = f"is one call of its OsTask for {', '.join(rates)}, but becomes a task for each"
        help = "its load is overstated where they are due together; state one period in the overlay (sources)"
        findings.report(codes.SEVERAL_RATES, message, at=first.place.at, path=about(task=first.name), help=help)


def with_one_rate(activations: Sequence[Activation], findings: Findings) -> list[Activation]:
    """Return the activations, those that a basic OsTask calls with its own period and offset."""
    result = list(activations)
    for indices in _hosted(result).values():
        calls = [result[index] for index in indices]
        period, offset = _rate(calls)
        if len({(call.period, call.offset or ZERO) for call in calls}) < 2:
            continue
        for index in indices:
            call = result[index]
            slower = call.period if call.period != period else None
            result[index] = replace(call, period=period, offset=offset or None, called_every=slower)
        _report(calls, period, findings)
    return result


def _hosted(activations: Sequence[Activation]) -> dict[str, list[int]]:
    """Return which activations are calls of each basic OsTask (path)."""
    hosted: dict[str, list[int]] = {}
    for index, activation in enumerate(activations):
        task = activation.os_task
        if task is not None and task.is_basic and activation.period is not None and activation.event is not None:
            hosted.setdefault(task.place.path, []).append(index)
    return hosted


def report_other_rates(activations: Sequence[Activation], triggers: Iterable[Trigger], findings: Findings) -> None:
    """Report alarms and tables that activate an OsTask at another rate than that at which its calls are due."""
    hosted = _hosted(activations)
    comes = grouped(((path, t.table or t.place.path), t) for t in triggers for path in t.tasks)
    for (path, starter), found in comes.items():
        calls = [a for a in (activations[i] for i in hosted.get(path, ())) if a.event and a.event.is_timing]
        named_by = {name for call in calls if call.mapping for name in call.mapping.triggers}
        is_compared = starter in named_by or any(trigger.place.path in named_by for trigger in found)
        if not calls or is_compared or any(call.distance for call in calls):
            continue
        rate, due = found[0].period / len(found), _rate(calls)[0]
        if due % rate:  # generated code may count the activations of one that comes more often
            message = f"activates {path} every {rate}, whose calls are due every {due}"
            help = "make them agree; the period of the calls counts"
            found[0].place.report(findings, codes.TRIGGERING_DIFFERS, message, help=help)


def _rate(calls: Iterable[Activation]) -> tuple[Duration, Duration]:
    """Return the longest period, with its offset, at which every call is due at an activation."""
    periods = [call.period for call in calls if call.period is not None]
    offsets = [call.offset or ZERO for call in calls]
    first = min(offsets)
    apart = [offset - first for offset in offsets if offset != first]
    period = greatest_common_divisor([*periods, *apart])
    assert period is not None
    return period, first % period


def _rates(calls: Sequence[Activation]) -> list[str]:
    return list(dict.fromkeys(f"{c.period}" + (f" from {c.offset} on" if c.offset else "") for c in calls))


def _report(calls: Sequence[Activation], period: Duration, findings: Findings) -> None:
    task = calls[0].os_task
    assert task is not None
    message = (
        f"waits for no OsEvent and calls runnables every {listed(_rates(calls))}: it is activated every {period}, "
        "and each of its jobs is taken to be as long as all of them"
    )
    help = "give each period an OsTask, or an OsEvent, of its own"
    findings.report(codes.SEVERAL_RATES_OF_TASK, message, at=task.place.at, path=about(task=task.place.name), help=help)
