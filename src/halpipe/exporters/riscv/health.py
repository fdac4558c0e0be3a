"""Health rules as the runtime has them: those of a task side by side, each with its place in the history of events."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.models import HealthAction, HealthEvent

if TYPE_CHECKING:
    from halpipe.models import Schedule, TaskModel

_OVERRUN, _FAULT = ("FLAG_LATE", "FLAG_OVERRUN"), ("FLAG_FAULT", "FLAG_STUCK", "FLAG_ERROR")
_FLAGS = {HealthEvent.OVERRUN: _OVERRUN, HealthEvent.FAULT: _FAULT, HealthEvent.ANY: (*_OVERRUN, *_FAULT)}


@record
class Rule:
    """One rule, in the words of C; what its fields mean is in runtime/halpipe.h."""

    task: str
    first: int
    mode: str
    priority: int
    flags: str
    count: int
    cycles: int
    action: str


@record
class Health:
    """The rules of a model, and how many events they count together."""

    rules: tuple[Rule, ...] = ()
    events: int = 0

    def of(self, task: str) -> tuple[str, str]:
        """Return the index of the first rule of a task and their number, as in C."""
        own = [i for i, rule in enumerate(self.rules) if rule.task == task]
        return f"{own[0] if own else 0}U", f"{len(own)}U"


def health_of(model: TaskModel, schedule: Schedule) -> Health:
    """Return the rules in the order of their tasks; the one that stands first in the model goes before the others."""
    modes = {mode.name: i for i, mode in enumerate(schedule.modes)}
    found: list[Rule] = []
    events = 0
    for priority, rule in sorted(enumerate(model.health), key=lambda entry: entry[1].task):
        found.append(
            Rule(
                task=rule.task,
                first=events,
                mode=f"{modes[rule.mode]}U" if rule.action is HealthAction.SWITCH else "HP_NO_TABLE",
                priority=priority,
                flags=" | ".join(_FLAGS[rule.event]),
                count=rule.count,
                cycles=rule.cycles,
                action=f"HEALTH_{rule.action.name}",
            )
        )
        events += rule.count
    return Health(tuple(found), events)
