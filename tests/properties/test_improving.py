"""Improving a valid schedule makes nothing worse that counts, and moves nothing that is frozen."""

import random
from dataclasses import replace
from unittest import mock

import pytest
import split_systems
import verify_systems as systems
from hypothesis import assume, given
from hypothesis import strategies as st

from halpipe.models import Chain, Status
from halpipe.pipeline.checked import validate_model, verify_schedule
from halpipe.pipeline.solve import goals
from halpipe.pipeline.solve import schedule as search
from halpipe.pipeline.solve.goals import Quality
from halpipe.pipeline.solve.schedule import SearchOptions
from profiles import examples

SEEDS = st.integers(0, 2**32)
FAST = examples(60)


def with_chains(system, rng):
    """Give a model two chains without limits, through tasks drawn."""
    names = [task.name for task in system.tasks]
    chains = [Chain(name=f"free{n}", tasks=tuple(rng.choices(names, k=rng.choice((1, 2, 3))))) for n in range(2)]
    return replace(system, chains=(*system.chains, *chains))


def drawn(seed, family):
    """Return a model that a schedule exists for by construction, with chains."""
    rng = random.Random(seed)
    system = with_chains(family.valid_system(rng)[0], rng)
    assume(not any(d.is_error for d in validate_model(system)))
    return system


def table(system, **options):
    """Return the schedule of the first mode; nothing where none is found."""
    with mock.patch.object(goals, "POLISH_BUDGET", 30), mock.patch.object(search, "POLISH_TABLES", 4):
        plan = search.schedule_model(system, SearchOptions(budget=300, **options), lambda *_: True).schedule
    assume(all(mode.status is Status.VALID for mode in plan.modes))
    assert [d.message for d in verify_schedule(system, plan) if d.is_error] == []
    return plan


def latencies(mode):
    """Return all latencies; where nothing gets through, more than any."""
    return [time.ns if time else 10**30 for chain in mode.chains for time in (chain.reaction, chain.age)]


def check_chains(system):
    first, better = (table(system, quality=quality).modes[0] for quality in (Quality.FIRST, Quality.COST))
    before, after = latencies(first), latencies(better)
    assert all(now <= then for then, now in zip(before, after, strict=True)), (before, after)
    assert better.cost.total <= first.cost.total


@FAST
@given(SEEDS)
def test_cost_makes_no_chain_longer_than_it_was_at_first(seed):
    check_chains(drawn(seed, systems))


@pytest.mark.slow
@examples(30)
@given(SEEDS)
def test_cost_makes_no_chain_of_split_jobs_longer_than_it_was_at_first(seed):
    check_chains(drawn(seed, split_systems))


@examples(20)
@given(SEEDS, st.sampled_from([Quality.COST, Quality.MARGIN]))
def test_improving_moves_nothing_that_is_frozen(seed, quality):
    system = drawn(seed, systems)
    shipped = table(system)
    name = random.Random(seed).choice([task.name for task in system.tasks])
    some = tuple(replace(m, jobs=tuple(j for j in m.jobs if j.task != name)) for m in shipped.modes)
    improved = table(system, quality=quality, shipped=replace(shipped, modes=some))
    now = {(mode.name, job.task, job.index): job for mode in improved.modes for job in mode.jobs}
    for mode in some:
        for job in mode.jobs:
            assert now[mode.name, job.task, job.index].start == job.start


def test_goals_name_what_they_weigh():
    """Every stage may look only at objectives that are judged."""
    for wanted in goals.QUALITIES.values():
        if wanted is not None:
            assert all(leading <= len(wanted.objectives) for _, leading in wanted.stages)
