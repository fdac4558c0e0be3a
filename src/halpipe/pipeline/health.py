"""Reactions of a schedule that follow from the health rules of its model (MODEL 9)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.models import HealthAction, HealthRule, ModeSchedule, Reaction, Schedule, Status, TaskModel

if TYPE_CHECKING:
    from collections.abc import Iterator


def with_reactions(model: TaskModel, schedule: Schedule) -> Schedule:
    """Return the schedule with a reaction for every rule in every mode where it holds and can be performed."""
    return replace(schedule, reactions=tuple(_reactions(model, schedule)))


def _reactions(model: TaskModel, schedule: Schedule) -> Iterator[Reaction]:
    for table in schedule.modes:
        tasks = {run.task for run in model.mode(table.name).runs}
        for rule in model.health:
            if rule.task in tasks and rule.mode != table.name:
                yield from _reaction(rule, table, schedule)


def _reaction(rule: HealthRule, table: ModeSchedule, schedule: Schedule) -> Iterator[Reaction]:
    """Yield what follows from a rule in a mode; nothing where the switch that it needs was not found."""
    found = Reaction(
        mode=table.name, task=rule.task, event=rule.event, count=rule.count, cycles=rule.cycles, action=rule.action
    )
    if rule.action is HealthAction.RESTART:
        yield found
    elif rule.action is HealthAction.STOP:
        yield replace(found, within=table.hyperperiod)
    for switch in schedule.transitions if rule.action is HealthAction.SWITCH else ():
        if (switch.source, switch.target) == (table.name, rule.mode) and switch.status is Status.VALID:
            yield replace(found, target=rule.mode, within=switch.worst_latency)
