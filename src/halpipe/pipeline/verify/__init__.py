"""The independent check: decides from model and schedule alone whether the schedule is valid (MODEL 3, 5, 7).

It shares no code with the solver or the exporters, computes with exact numbers only, trusts nothing in the schedule,
and reports every violation with job, rule, amount and instant.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Findings, sort_diagnostics
from halpipe.pipeline.verify import codes, reading
from halpipe.pipeline.verify.assignment import UNIT, VERSION
from halpipe.pipeline.verify.binding import BINDING, SYSTEM_BINDING, Tables
from halpipe.pipeline.verify.chains import CHAIN
from halpipe.pipeline.verify.complete import COMPLETE
from halpipe.pipeline.verify.edge import EDGE
from halpipe.pipeline.verify.health import HEALTH, Health
from halpipe.pipeline.verify.metrics import FIGURES
from halpipe.pipeline.verify.nesting import NESTED
from halpipe.pipeline.verify.parts import PARTS
from halpipe.pipeline.verify.periodic import DEADLINE, PERIODIC
from halpipe.pipeline.verify.precedence import PRECEDENCE
from halpipe.pipeline.verify.rules import Rule
from halpipe.pipeline.verify.runtime import PRIORITY_RULE
from halpipe.pipeline.verify.sharing import ACCESS, EXCLUSIVE
from halpipe.pipeline.verify.tables import MAX_BITS, ModeTable
from halpipe.pipeline.verify.transitions import SWITCH_RULES

if TYPE_CHECKING:
    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Schedule, TaskModel

__all__ = ["RULES", "Rule", "verify", "verify_switches"]

MODE_RULES: tuple[Rule[ModeTable], ...] = (
    COMPLETE,
    VERSION,
    UNIT,
    PERIODIC,
    DEADLINE,
    PARTS,
    EXCLUSIVE,
    NESTED,
    ACCESS,
    PRECEDENCE,
    CHAIN,
    EDGE,
    BINDING,
)

RULES: tuple[Rule[Any], ...] = (*MODE_RULES, FIGURES, *SWITCH_RULES, SYSTEM_BINDING, PRIORITY_RULE, HEALTH)
"""Every rule with its sentence, in the order of checking; the manual's list is made from it."""


def verify(model: TaskModel, schedule: Schedule) -> tuple[Diagnostic, ...]:
    """Return every finding about `schedule`; it is valid for `model` if and only if none of them is an error.

    Never raises on any model or schedule: a model that gives "valid" no meaning is itself reported.
    """
    return _verify(model, schedule, switches_only=False)


def verify_switches(model: TaskModel, schedule: Schedule) -> tuple[Diagnostic, ...]:
    """Return the findings about the tables between modes alone, given that `verify` found no fault with the modes."""
    return _verify(model, schedule, switches_only=True)


def _verify(model: TaskModel, schedule: Schedule, *, switches_only: bool) -> tuple[Diagnostic, ...]:
    found = Findings()
    found.extend(reading.header(model, schedule))
    clock = reading.make_clock(model, schedule)
    if clock is None:
        text = f"the common denominator of all durations has more than {MAX_BITS} bits"
        found.add(codes.TOO_FINE(text, at=schedule.at, path="schedule", help="use coarser times"))
        return tuple(sort_diagnostics(found.items))
    modes = reading.active_modes(model, clock, found)
    tables = reading.mode_tables(model, schedule, modes, clock, found)
    sound = not any(d.code == codes.MODEL_FAULT.id for d in found.items)
    for table in tables.values():
        table.sound = sound
        for rule in () if switches_only else MODE_RULES:
            violations = tuple(rule.check(table))
            found.extend(violations)
            table.broken.update([rule.name] if violations else [])
        found.extend(() if switches_only else FIGURES.check(table))
    switches = []
    for switch in reading.switches(model, schedule, tables, clock, found):
        switches.append(switch)
        for switch_rule in SWITCH_RULES:
            found.extend(switch_rule.check(switch))
    everything = Tables(model, tuple(tables.values()), tuple(switches))
    found.extend(SYSTEM_BINDING.check(everything))
    found.extend(() if switches_only else PRIORITY_RULE.check(everything))
    found.extend(() if switches_only else HEALTH.check(Health(model, schedule)))
    return tuple(sort_diagnostics(found.items))
