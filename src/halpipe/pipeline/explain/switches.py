"""Switches between modes that have schedules: those without a table, and the least length that would do."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.pipeline.explain import codes
from halpipe.pipeline.transitions.tables import NO_IMPLIED_TABLE, NO_TABLE

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import TaskModel, Transition
    from halpipe.pipeline.solve.schedule import Scheduled, SearchOptions

Pair = tuple[str, str]


def failed_switches(
    model: TaskModel, options: SearchOptions, go_on: Callable[[], bool], *, remedies: bool
) -> tuple[tuple[Pair, ...], list[Diagnostic]]:
    """Schedule all modes and switches as `schedule` does; return the listed pairs without a table, and findings."""
    scheduled = _scheduled(model, options, go_on)
    found = {(table.source, table.target) for table in scheduled.schedule.transitions}
    missing = [each for each in model.transitions if (each.source, each.target) not in found]
    findings = [each for each in scheduled.diagnostics if each.code in (NO_TABLE.id, NO_IMPLIED_TABLE.id)]
    if scheduled.stopped or not findings:
        return (), []
    for transition in missing if remedies else ():
        if transition.max_length is not None:
            findings.append(_remedy(model, transition, options, go_on))
    return tuple((each.source, each.target) for each in missing), findings


def _scheduled(model: TaskModel, options: SearchOptions, go_on: Callable[[], bool]) -> Scheduled:
    from halpipe.pipeline.checked import schedule_model

    return schedule_model(model, options, lambda *_: go_on())


def _remedy(model: TaskModel, transition: Transition, options: SearchOptions, go_on: Callable[[], bool]) -> Diagnostic:
    """Look for the shortest table of any length."""
    free = replace(transition, max_length=None)
    others = tuple(free if each is transition else each for each in model.transitions)
    path = about(transition=(transition.source, transition.target))
    tables = _scheduled(replace(model, transitions=others), options, go_on).schedule.transitions
    for table in tables:
        if (table.source, table.target) == (transition.source, transition.target):
            text = f"max-length {table.length} instead of {transition.max_length}"
            text += " (found sufficient: the shortest table that was found)"
            return codes.REMEDY(text, at=transition.at, path=path, help="change the model so, if you can")
    text, help = "no table of any length was found", "allow more slack or wider windows"
    return codes.NO_REMEDY(text, at=transition.at, path=path, help=help)
