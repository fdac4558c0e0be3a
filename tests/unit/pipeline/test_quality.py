"""Improving a valid schedule: each wish is granted where it can be, and the result still verifies."""

from fractions import Fraction

import pytest

from halpipe.pipeline.checked import schedule_model, verify_schedule
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.solve.schedule import SearchOptions
from support import access, after, chain, model, task, version

UNITS = "u1 u2 u3"
COST, CHAINS = Objective.COST, Objective.CHAINS


def system(**extra):
    """Three short tasks on three units: one unit would do; a chain and slack leave room to improve."""
    sense = task("sense", 40, version("v", 4, UNITS, access("mem", 0, 2)), slack=Fraction(1, 4))
    plan = task("plan", 40, version("v", 6, UNITS, after("sense", 0, 30, "end")), slack=Fraction(1, 4))
    act = task("act", 20, version("v", 2, UNITS, access("mem", 0, 1)), slack=Fraction(1, 2))
    chains = [chain("c", "sense plan act")]
    return model(sense, plan, act, units=UNITS, resources="mem", chains=chains, **extra)


def best(*objectives, seed=1, target=None):
    options = SearchOptions(seed=seed, optimise=objectives, target=target)
    scheduled = schedule_model(system(), options, lambda *progress: True)
    assert scheduled.is_complete
    assert [d.message for d in verify_schedule(system(), scheduled.schedule) if d.is_error] == []
    return scheduled


def sum_of(mode):
    return mode.chains[0].reaction + mode.chains[0].age


def least_gap(mode):
    """The least time from a job's start to the next on its unit, beyond its WCET and as a share of it."""
    cycle = mode.hyperperiod
    gaps = []
    for job in mode.jobs:
        for unit in job.units:
            starts = [other.start for other in mode.jobs if unit in other.units]
            following = min((start - job.start) % cycle or cycle for start in starts)
            gaps.append(following / (job.end - job.start) - 1)
    return min(gaps)


@pytest.mark.parametrize("seed", range(1, 4))
def test_cost_empties_units_uses_no_slack_and_shortens_chains(seed):
    first, polished = (best(*aims, seed=seed).schedule.modes[0] for aims in ((), (COST, CHAINS)))
    assert polished.cost.total <= first.cost.total
    assert polished.cost.occupancy == Fraction(2, 3)  # 14 ms of work in 40 ms fit on one unit
    assert polished.cost.timeliness == 1
    assert sum_of(polished) <= sum_of(first)


@pytest.mark.parametrize("seed", range(1, 4))
def test_margin_spreads_the_jobs(seed):
    first, polished = (best(*aims, seed=seed).schedule.modes[0] for aims in ((), (Objective.MARGIN,)))
    assert least_gap(polished) >= least_gap(first)
    assert least_gap(polished) >= 3


def test_a_target_that_is_met_at_once_stops_the_improvement():
    assert best(COST, target=Fraction(1)).moves == best().moves
    assert best(COST).moves > best().moves


def test_the_target_itself_is_good_enough():
    """F of a valid schedule is at most 0; the improvement ends with the first F that is no more than the target."""
    reached = best(COST).schedule.modes[0].cost.total
    first = best().schedule.modes[0].cost.total
    assert reached < first <= 0
    assert best(COST, target=reached).schedule.modes[0].cost.total == reached
    assert best(COST, target=first).moves == best().moves
    assert best(COST, target=first - Fraction(1, 10**9)).moves > best().moves


def test_improving_is_deterministic():
    assert best(COST).schedule == best(COST).schedule
