"""The simulation of earliest deadline first in C gives the tables of the one that is written plainly in Python."""

import random
from dataclasses import replace
from unittest import mock

import pytest
from split_systems import crowded_system, valid_system

from edf_reference import Compared
from halpipe.models import Chain
from halpipe.pipeline.jobs import expand, natural_tick
from halpipe.pipeline.measure.latency import chain_latencies
from halpipe.pipeline.measure.placement import Placement
from halpipe.pipeline.solve.edf import native
from halpipe.pipeline.solve.edf.fixed import fix
from halpipe.pipeline.solve.edf.plans import Plan, allowed_ways, first_plan
from halpipe.pipeline.solve.edf.trials import ChainTimes, named
from halpipe.pipeline.solve.edf.works import works_of
from profiles import volume


def drawn_mode(rng):
    """A mode of a random system, on a grid that may be finer than its own; of some, jobs stay as a witness has them."""
    owner, witness = rng.choice((crowded_system, valid_system))(rng)
    expansion = expand(owner, owner.modes[0])
    mode = works_of(owner, expansion, natural_tick(expansion) / rng.choice((1, 1, 3)))
    if rng.random() < 0.3:
        stay = {task.name for task in owner.tasks if rng.random() < 0.4}
        fixed, _ = fix(mode, {(j.task, j.index): j for j in witness.modes[0].jobs if j.task in stay})
        mode = replace(mode, fixed=fixed)
    return owner, mode


def drawn_plan(rng, mode):
    """The first plan, or one that has little to do with it."""
    allowed = allowed_ways(mode, {})
    plan = first_plan(mode, allowed)
    if rng.random() < 0.2:
        return plan
    cycle = mode.hyperperiod
    return Plan(
        ways=tuple(map(rng.choice, allowed)),
        phases=tuple(rng.choice((phase, rng.randrange(cycle))) for phase in plan.phases),
        urgency=tuple(rng.choice((urgency, rng.randint(1, 2 * cycle))) for urgency in plan.urgency),
        holds=tuple(rng.choice((0, 0, rng.randrange(cycle // 2))) for _ in plan.holds),
        fresh=rng.random() < 0.7,
    )


def compared(seed, plans=4):
    """Compare the tables of random plans of a random mode; where one is closed, its latencies are those of its jobs."""
    rng = random.Random(seed)
    owner, mode = drawn_mode(rng)
    names = [work.name for work in mode.works]
    chains = [Chain(name=f"c{n}", tasks=tuple(rng.sample(names, min(len(names), 1 + n)))) for n in range(3)]
    times, simulator, closed = ChainTimes(mode, chains), Compared(mode), 0
    for _ in range(plans):
        plan = drawn_plan(rng, mode)
        table = simulator.table(plan)
        if table.closed:
            closed += 1
            placement = Placement.of(mode.expansion, named(mode, plan, table), owner.units)
            found = [(c.reaction, c.age) for c in chain_latencies(placement, chains)]
            assert found == [(mode.tick * reaction, mode.tick * age) for reaction, age in times.of(plan, table)]
    return closed


@pytest.mark.parametrize("seed", range(60))
def test_tables_and_latencies_are_those_of_the_reference(seed):
    compared(seed)


def test_many_of_them_repeat():
    assert sum(map(compared, range(20))) > 20


def test_too_little_room_changes_nothing():
    """The library says that it lacks room, and begins again with more, until there is enough."""
    with mock.patch.dict(native.FIRST_ROOM, dict.fromkeys(native.FIRST_ROOM, 1)):
        assert sum(map(compared, range(100, 120))) > 20


@pytest.mark.slow  # the same with other seeds
def test_tables_of_many_systems_are_those_of_the_reference():
    count = volume(400)
    assert sum(map(compared, range(1000, 1000 + count))) > count * 3 // 5
