"""Rule health: the reactions that a schedule states are those that the model's health rules ask for (MODEL 9)."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import NOWHERE, about
from halpipe.core.records import record
from halpipe.models import HealthAction, Reaction, Status
from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.rules import Rule

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.core.durations import Duration
    from halpipe.models import HealthRule, ModeSchedule, Schedule, TaskModel


@record
class Health:
    """A model and its schedule, for the rules that are about both as a whole."""

    model: TaskModel
    schedule: Schedule


def check_health(health: Health) -> Iterator[Diagnostic]:
    """Check that every rule has its reaction in every mode where it holds, and that there are no others."""
    stated = Counter(replace(reaction, at=NOWHERE) for reaction in health.schedule.reactions)
    running = {mode.name: {run.task for run in mode.runs if run.versions} for mode in health.model.modes}
    for mode in {mode.name: mode for mode in reversed(health.schedule.modes)}.values():
        for rule in health.model.health:
            if rule.mode == mode.name or rule.task not in running.get(mode.name, ()):
                continue
            path = about(mode=mode.name, health_rule_of_task=rule.task)
            within = _time(health.schedule, mode, rule)
            if within is None and rule.action is not HealthAction.RESTART:
                text, help = f'there is no table to "{rule.mode}"', "schedule the transition, or change the rule"
                yield codes.REACTION_MISSING(text, at=mode.at, path=path, help=help)
                continue
            wanted = Reaction(
                mode=mode.name,
                task=rule.task,
                event=rule.event,
                count=rule.count,
                cycles=rule.cycles,
                action=rule.action,
                target=rule.mode,
                within=within,
            )
            if stated[wanted]:
                stated[wanted] -= 1
                continue
            took = "" if within is None else f" within {within}"
            text, help = f"its reaction, {rule.action}{took}, is not stated", "schedule the model again"
            yield codes.REACTION_MISSING(text, at=mode.at, path=path, help=help)
    places = {replace(reaction, at=NOWHERE): reaction.at for reaction in health.schedule.reactions}
    for reaction in stated.elements():
        path = about(mode=reaction.mode, reaction_to_task=reaction.task)
        after = f"{reaction.action} after {reaction.count} times {reaction.event} in {reaction.cycles} tables"
        to = f' to "{reaction.target}"' if reaction.target else ""
        took = "" if reaction.within is None else f" within {reaction.within}"
        text, help = f"{after}{to}{took} follows from no rule of the model", "schedule the model again"
        yield codes.WRONG_REACTION(text, at=places[reaction], path=path, help=help)


def _time(schedule: Schedule, mode: ModeSchedule, rule: HealthRule) -> Duration | None:
    """Return how long a rule takes at most: an event just after an end of the hyperperiod waits for the next one."""
    if rule.action is HealthAction.STOP:
        return mode.hyperperiod
    for table in schedule.transitions:
        if (table.source, table.target) == (mode.name, rule.mode) and table.status is Status.VALID:
            return mode.hyperperiod + table.length
    return None


HEALTH: Rule[Health] = Rule(
    "health",
    "In every mode where a health rule of the model holds, the schedule states its reaction and the longest time that "
    "it takes, and has the table that it needs; it states no other reactions.",
    check_health,
)
