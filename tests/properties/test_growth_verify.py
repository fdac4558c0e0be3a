"""At the growth that sensitivity gives the schedule verifies; with anything more it does not."""

from fractions import Fraction

import pytest
import verify_systems as systems
from hypothesis import assume, given
from hypothesis import strategies as st

import every_verb
import halpipe
from halpipe.core.diagnostics import HalpipeError, render_text
from halpipe.pipeline.verify import verify
from halpipe.pipeline.whatif.sensitivity import common_tick, grown, sensitivities
from profiles import examples

MANY = examples(60)
MOST_HALVES = 200


def faults(system, plan):
    return [render_text(d) for d in verify(system, plan) if d.is_error]


def check(system, plan, rng):
    """Half a tick is less than any two times of the system differ, so nothing can heal within it.

    What is lost may be found again by more growth: any amount below has to be valid as well.
    """
    half = common_tick(system, plan) / 2
    seen = 0
    for row in sensitivities(system, plan, frozenset()):
        jobs = [job for table in (*plan.modes, *plan.transitions) for job in table.jobs]
        used = any((job.task, job.version) == (row.task, row.version) for job in jobs)
        assert (row.growth is not None) == used
        if row.growth is None:
            continue
        seen += 1
        less = row.growth * Fraction(rng.randrange(8), 8)
        for amount in (row.growth, less):
            assert faults(*grown(system, plan, row.task, row.version, amount)) == [], row
        assert faults(*grown(system, plan, row.task, row.version, row.growth + half)), row
        assert row.reason
    return seen


@MANY
@given(st.randoms(use_true_random=False))
def test_growth_in_one_mode_is_exact(rng):
    system, plan = systems.valid_system(rng)
    assert faults(system, plan) == []
    assert check(system, plan, rng) > 0


@examples(25)
@given(st.randoms(use_true_random=False))
def test_growth_across_switches_is_exact(rng):
    system, plan = systems.switching_system(rng)
    assume(not faults(system, plan))
    assert check(system, plan, rng) > 0


@pytest.mark.parametrize("first", range(9_100_760, 9_100_840, 10))
def test_growth_of_any_system_ends_before_the_first_fault(first):
    """All halves of a tick are tried, of systems with any features and their switches; 9100770 loses a window."""
    seen = 0
    for seed in range(first, first + 10):
        system, _ = every_verb.system(seed)
        try:
            plan = halpipe.schedule(system, budget=300, workers=1)
        except HalpipeError:
            continue
        half = common_tick(system, plan) / 2
        for row in sensitivities(system, plan, frozenset()):
            halves = 0 if row.growth is None else row.growth // half
            if 0 < halves < MOST_HALVES:
                seen += 1
                assert not any(faults(*grown(system, plan, row.task, row.version, half * n)) for n in range(1, halves))
    assert seen > 5
