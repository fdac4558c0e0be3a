"""Cost, loads and latencies of split jobs against verify and the oracle, as `test_cost_verify` does for whole jobs."""

import random

import pytest
import split_mutants
import split_systems as systems
import verify_mutants
import verify_oracle as oracle
from hypothesis import given
from hypothesis import strategies as st
from test_cost_verify import OPERATORS as OF_WHOLE_JOBS
from test_cost_verify import reported

from halpipe.core.diagnostics import render_text
from halpipe.pipeline.verify import codes, verify
from halpipe.pipeline.whatif.sensitivity import common_tick, grown, sensitivities
from profiles import examples

OPERATORS = {name: verify_mutants.OPERATORS[name] for name in OF_WHOLE_JOBS}
OPERATORS |= {name: function for name, function in split_mutants.OPERATORS.items() if "switch" not in name}

HELD_BY_CONSTRUCTION = {"periodic", "deadline"}
MALFORMED = {"parts", "file"}
"""What leaves open where a job executes what, so that its figures have no meaning."""


def check(system, plan):
    """Compare cost and figures; return whether the cost says that something is broken, None where it need not."""
    broken = {rule for rule, _ in oracle.broken(system, plan)}
    if broken & MALFORMED:
        return None
    plan = reported(system, plan)
    found = [d for d in verify(system, plan) if d.code == codes.WRONG_FIGURE.id]
    assert not [d for d in found if "load" in d.path or "chain" in d.path], told(found)
    if broken & HELD_BY_CONSTRUCTION:
        return None
    assert not found, told(found)
    assert (plan.modes[0].cost.total > 0) == bool(broken), broken
    return bool(broken)


def told(findings):
    return "\n".join(render_text(d) for d in findings)


def test_schedules_valid_by_construction_cost_nothing():
    assert not any(check(*systems.valid_system(random.Random(seed))) for seed in range(60))


@pytest.mark.parametrize("seeds", [3, pytest.param(25, marks=pytest.mark.slow)])
def test_mutants_cost_where_they_are_broken(seeds):
    costly = set()
    for name in OPERATORS:
        for seed in range(seeds):
            rng = random.Random(f"{seed} {name}")
            mutant = OPERATORS[name](rng, *systems.valid_system(rng))
            if mutant is not None and check(*mutant):
                costly.add(name)
    assert len(costly) > 12


@pytest.mark.parametrize("make", [systems.valid_system, systems.switching_system])
def test_sensitivity_names_a_growth_that_verifies_and_a_tick_more_does_not(make):
    @examples(12)
    @given(st.randoms(use_true_random=False))
    def compare(rng):
        system, plan = make(rng)
        if any(d.is_error for d in verify(system, plan)):
            return
        tick = common_tick(system, plan)
        for row in sensitivities(system, plan, frozenset()):
            if row.growth is not None:
                longer = grown(system, plan, row.task, row.version, row.growth)
                assert not any(d.is_error for d in verify(*longer)), row
                longer = grown(system, plan, row.task, row.version, row.growth + tick)
                assert any(d.is_error for d in verify(*longer)), row

    compare()
