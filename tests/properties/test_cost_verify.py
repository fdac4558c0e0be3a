"""The cost and the figures of a report against verify: F <= 0 exactly where no rule that the cost covers is broken."""

import random
from dataclasses import replace

import pytest
import verify_mutants as mutants
import verify_oracle as oracle
import verify_systems as systems

from halpipe.core.diagnostics import render_text
from halpipe.models import Status
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.cost import mode_report
from halpipe.pipeline.verify import codes, verify

NOT_COVERED = {"periodic", "deadline"}
"""What holds by construction in every placement of the search, so that the cost has no term for it."""

OPERATORS = [
    "start_one_tick_later",
    "start_one_tick_earlier",
    "start_anywhere",
    "one_tick_of_overlap",
    "swap_units",
    "wrong_unit",
    "drop_gang_member",
    "add_gang_member",
    "bound_too_large_by_a_thousandth",
    "phase_one_tick_longer",
    "window_closes_one_tick_earlier",
    "window_opens_one_tick_later",
    "window_from_the_other_end",
    "one_more_demand",
    "tighter_chain",
]


def reported(system, plan):
    """Return the plan with all figures that a report states, made from its jobs alone."""
    table = plan.modes[0]
    made = mode_report(system, expand(system, system.mode(table.name)), table.jobs, Status.VALID)
    if oracle.broken(system, plan):  # the bound is one of valid schedules
        made = replace(made, margin_bound=None)
    return replace(plan, modes=(made,))


def check(system, plan):
    """Compare cost and figures with the oracle and with verify; return whether a covered rule is broken."""
    plan = reported(system, plan)
    broken = {rule for rule, _ in oracle.broken(system, plan)} - NOT_COVERED
    assert (plan.modes[0].cost.total > 0) == bool(broken), broken
    found = [d for d in verify(system, plan) if d.code == codes.WRONG_FIGURE.id]
    if not any(rule in NOT_COVERED for rule, _ in oracle.broken(system, plan)):
        assert not found, "\n".join(render_text(d) for d in found)
    assert not [d for d in found if "load" in d.path or "chain" in d.path]
    return bool(broken)


@pytest.mark.parametrize("block", range(4))
def test_wild_schedules(block):
    """Jobs lie anywhere; latencies and loads that are stated must be those that verify finds."""
    results = [check(*systems.wild_system(random.Random(seed))) for seed in range(block * 100, block * 100 + 100)]
    assert any(results)


@pytest.mark.slow
def test_schedules_valid_by_construction_cost_nothing():
    assert not any(check(*systems.valid_system(random.Random(seed))) for seed in range(150))


@pytest.mark.parametrize("name", OPERATORS)
def test_mutants_cost_where_they_are_broken(name):
    results = []
    for seed in range(40):
        rng = random.Random(f"{seed} {name}")
        mutant = mutants.OPERATORS[name](rng, *systems.valid_system(rng))
        if mutant is not None:
            results.append(check(*mutant))
    assert any(results)
