"""Improving a valid schedule: each wish is granted where it can be, and the result still verifies."""

from fractions import Fraction

import pytest

from halpipe.pipeline.checked import schedule_model, verify_schedule
from halpipe.pipeline.solve.goals import Quality
from halpipe.pipeline.solve.schedule import SearchOptions
from support import access, after, chain, model, task, version

UNITS = "u1 u2 u3"


def system(**extra):
    """Three short tasks on three units: one unit would do; a chain and slack leave room to improve."""
    sense = task("sense", 40, version("v", 4, UNITS, access("mem", 0, 2)), slack=Fraction(1, 4))
    plan = task("plan", 40, version("v", 6, UNITS, after("sense", 0, 30, "end")), slack=Fraction(1, 4))
    act = task("act", 20, version("v", 2, UNITS, access("mem", 0, 1)), slack=Fraction(1, 2))
    chains = [chain("c", "sense plan act")]
    return model(sense, plan, act, units=UNITS, resources="mem", chains=chains, **extra)


def best(quality, seed=1, target=None):
    options = SearchOptions(seed=seed, quality=quality, target=target)
    scheduled = schedule_model(system(), options, lambda *progress: True)
    assert scheduled.is_complete
    assert [d.message for d in verify_schedule(system(), scheduled.schedule) if d.is_error] == []
    return scheduled


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
    first, polished = (best(quality, seed).schedule.modes[0] for quality in (Quality.FIRST, Quality.COST))
    assert polished.cost.total <= first.cost.total
    assert polished.cost.occupancy == Fraction(2, 3)  # 14 ms of work in 40 ms fit on one unit
    assert polished.cost.timeliness == 1
    assert polished.chains[0].age <= first.chains[0].age


@pytest.mark.parametrize("seed", range(1, 4))
def test_margin_spreads_the_jobs(seed):
    first, polished = (best(quality, seed).schedule.modes[0] for quality in (Quality.FIRST, Quality.MARGIN))
    assert least_gap(polished) >= least_gap(first)
    assert least_gap(polished) >= 3


def test_a_target_that_is_met_at_once_stops_the_improvement():
    assert best(Quality.COST, target=Fraction(1)).moves == best(Quality.FIRST).moves
    assert best(Quality.COST).moves > best(Quality.FIRST).moves


def test_improving_is_deterministic():
    assert best(Quality.COST).schedule == best(Quality.COST).schedule
