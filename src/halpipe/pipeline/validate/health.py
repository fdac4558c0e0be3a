"""Checks of health rules: what the target does after overruns or faults (MODEL 9)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.models import HealthAction
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import Check, place

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import HealthRule
    from halpipe.pipeline.validate.context import Context

MOST = 255
"""Events, and tables, that a rule may count: targets keep the events of each rule."""


def _path(rule: HealthRule) -> str:
    return about(health_rule_of_task=rule.task)


def check_form(context: Context) -> Iterator[Diagnostic]:
    """A rule counts at least one event in at least one table; a switch has a mode, other actions have none."""
    for rule in context.model.health:
        at, path = place(rule), _path(rule)
        if not (1 <= rule.count <= MOST and 1 <= rule.cycles <= MOST):
            text = f"counts {rule.count} events in {rule.cycles} tables"
            yield codes.BAD_RULE(text, at=at, path=path, help=f"write numbers from 1 to {MOST}")
        if (rule.action is HealthAction.SWITCH) != bool(rule.mode):
            text = f'names mode "{rule.mode}", but its action is {rule.action}' if rule.mode else "switches to no mode"
            yield codes.BAD_RULE(text, at=at, path=path, help='write action="switch" with a mode, or another without')


def check_switches(context: Context) -> Iterator[Diagnostic]:
    """The switch of a rule is allowed from every mode in which its task runs, and there is such a mode."""
    if not context.model.health:
        return
    allowed = {(t.source, t.target) for t in context.model.allowed_transitions()}
    running: dict[str, list[str]] = {}
    for mode in context.model.modes:
        for run in mode.runs:
            running.setdefault(run.task, []).append(mode.name)
    for rule in context.model.health:
        if rule.task not in context.tasks or (rule.mode and rule.mode not in context.modes):
            continue
        target = rule.mode if rule.action is HealthAction.SWITCH else ""
        holds = [name for name in dict.fromkeys(running.get(rule.task, ())) if name != target]
        if not holds:
            help = "remove the rule, or let its task run in other modes"
            yield codes.RULE_NEVER_HOLDS("never holds", at=place(rule), path=_path(rule), help=help)
        for source in holds if target else ():
            if (source, target) not in allowed:
                text = f'in mode "{source}" it leads to "{target}", but that switch is not allowed'
                help = f'list the transition from "{source}" to "{target}"'
                yield codes.RULE_WITHOUT_SWITCH(text, at=place(rule), path=_path(rule), help=help)


CHECKS = (
    Check(
        "health",
        "Every health rule counts 1 to 255 events in 1 to 255 tables, and names a mode if and only if it switches.",
        (codes.BAD_RULE,),
        check_form,
    ),
    Check(
        "health-switches",
        "Every health rule holds in some mode, and its switch is allowed from every mode in which its task runs.",
        (codes.RULE_WITHOUT_SWITCH, codes.RULE_NEVER_HOLDS),
        check_switches,
    ),
)
