"""The independent check: decides from model and schedule alone whether the schedule is valid (MODEL 3, 5, 7).

It shares no code with the solver or the exporters, computes with exact numbers only, trusts nothing in the schedule,
and reports every violation with job, rule, amount and instant.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, Findings, sort_diagnostics
from halpipe.pipeline.verify import codes, reading
from halpipe.pipeline.verify.chains import CHAIN
from halpipe.pipeline.verify.figures import FIGURES, HEALTH, Health
from halpipe.pipeline.verify.jobs import BINDING, COMPLETE, SYSTEM_BINDING, UNIT, VERSION, Tables
from halpipe.pipeline.verify.precedence import PRECEDENCE
from halpipe.pipeline.verify.preemption import NESTED, PARTS, PRIORITY_RULE
from halpipe.pipeline.verify.sharing import ACCESS, EXCLUSIVE
from halpipe.pipeline.verify.tables import MAX_BITS, ModeTable, Rule
from halpipe.pipeline.verify.timing import DEADLINE, EDGE, PERIODIC
from halpipe.pipeline.verify.transitions import SWITCH_RULES

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.models import Schedule, TaskModel

__all__ = ["RULES", "Rule", "broken_rules", "verify", "verify_switches"]

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

_RANKS = {codes.WRONG_MODEL.id: 0, codes.MODEL_CHANGED.id: 0, codes.MODEL_FAULT.id: 0, codes.WRONG_FIGURE.id: 2}


def verify(model: TaskModel, schedule: Schedule) -> tuple[Diagnostic, ...]:
    """Return every finding about `schedule`; it is valid for `model` if and only if none of them is an error.

    Causes come before effects: model, jobs, then the figures that follow from jobs. Never raises on any model or
    schedule: a model that gives "valid" no meaning is itself reported.
    """
    ranks: tuple[list[Diagnostic], ...] = ([], [], [])
    for _, found in _findings(model, schedule, switches_only=False):
        ranks[_RANKS.get(found.code, 1)].append(found)
    return tuple(found for rank in ranks for found in sort_diagnostics(rank))


def verify_switches(model: TaskModel, schedule: Schedule) -> tuple[Diagnostic, ...]:
    """Return the findings about the tables between modes alone, given that `verify` found no fault with the modes."""
    return tuple(sort_diagnostics(found for _, found in _findings(model, schedule, switches_only=True)))


def broken_rules(model: TaskModel, schedule: Schedule) -> frozenset[str]:
    """Return the names of the rules that a schedule breaks; what cannot be read counts as ``reading``."""
    return frozenset(name for name, found in _findings(model, schedule, switches_only=False) if found.is_error)


def _findings(model: TaskModel, schedule: Schedule, *, switches_only: bool) -> Iterator[tuple[str, Diagnostic]]:
    """Yield every finding with the name of its rule, in the order of checking."""
    read = Findings()
    read.extend(reading.header(model, schedule))
    clock = reading.make_clock(model, schedule)
    if clock is None:
        text = f"the common denominator of all durations has more than {MAX_BITS} bits"
        read.add(codes.TOO_FINE(text, at=schedule.at, path="schedule", help="use coarser times"))
        yield from (("reading", found) for found in read.items)
        return
    modes = reading.active_modes(model, clock, read)
    tables = reading.mode_tables(model, schedule, modes, clock, read)
    sound = not any(d.code == codes.MODEL_FAULT.id for d in read.items)
    for table in tables.values():
        table.sound = sound
        for rule in () if switches_only else MODE_RULES:
            for violation in rule.check(table):
                table.broken.add(rule.name)
                yield rule.name, violation
        if not switches_only:
            yield from ((FIGURES.name, found) for found in FIGURES.check(table))
    switches = []
    for switch in reading.switches(model, schedule, tables, clock, read):
        switches.append(switch)
        for switch_rule in SWITCH_RULES:
            yield from ((switch_rule.name, found) for found in switch_rule.check(switch))
    yield from (("reading", found) for found in read.items)
    everything = Tables(model, tuple(tables.values()), tuple(switches))
    yield from ((SYSTEM_BINDING.name, found) for found in SYSTEM_BINDING.check(everything))
    if not switches_only:
        yield from ((PRIORITY_RULE.name, found) for found in PRIORITY_RULE.check(everything))
        yield from ((HEALTH.name, found) for found in HEALTH.check(Health(model, schedule)))
