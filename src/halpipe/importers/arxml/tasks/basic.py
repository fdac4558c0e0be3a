"""Basic OsTasks that host calls of several periods: one activation runs what is due, as the generated RTE counts.

The RTE has its OsTask activated as often as the greatest common divisor of the periods and offsets says (RTE
specification, mapping of runnables); its jobs are as long as all their calls together.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.core.durations import ZERO, greatest_common_divisor
from halpipe.importers.arxml.meaning_codes import SEVERAL_RATES_OF_TASK
from halpipe.importers.arxml.names import listed

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.core.diagnostics import Findings
    from halpipe.core.durations import Duration
    from halpipe.importers.arxml.tasks.activation import Activation


def with_one_rate(activations: Sequence[Activation], findings: Findings) -> list[Activation]:
    """Return the activations, those that a basic OsTask calls with its own period and offset."""
    result = list(activations)
    hosted: dict[str, list[int]] = {}
    for index, activation in enumerate(result):
        task = activation.os_task
        if task is not None and task.is_basic and activation.period is not None and activation.event is not None:
            hosted.setdefault(task.place.path, []).append(index)
    for indices in hosted.values():
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


def _rate(calls: Iterable[Activation]) -> tuple[Duration, Duration]:
    """Return the longest period, with its offset, at which every call is due at an activation."""
    periods = [call.period for call in calls if call.period is not None]
    offsets = [call.offset or ZERO for call in calls]
    first = min(offsets)
    apart = [offset - first for offset in offsets if offset != first]
    period = greatest_common_divisor([*periods, *apart])
    assert period is not None
    return period, first % period


def _report(calls: Sequence[Activation], period: Duration, findings: Findings) -> None:
    task = calls[0].os_task
    assert task is not None
    rates = dict.fromkeys(f"{call.period}" + (f" from {call.offset} on" if call.offset else "") for call in calls)
    findings.add(
        SEVERAL_RATES_OF_TASK(
            f"waits for no OsEvent and calls runnables every {listed(list(rates))}: it is activated every {period}, "
            "and each of its jobs is taken to be as long as all of them",
            at=task.place.at,
            path=about(task=task.place.name),
            help="give each period an OsTask, or an OsEvent, of its own",
        )
    )
