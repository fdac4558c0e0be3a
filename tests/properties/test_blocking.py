"""That a unit is held for too long is never said of what has a schedule, and the exact engine agrees."""

import random
from dataclasses import replace
from fractions import Fraction

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from halpipe.models import Status
from halpipe.pipeline.explain import codes
from halpipe.pipeline.explain.witnesses import find_witnesses
from halpipe.pipeline.solve.exact import Answer, Effort, solve_exact
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.validate import validate
from profiles import examples
from support import chain, model, task, version

SEEDS = st.integers(0, 2**32)


def drawn(seed, **limits):
    """Make a chain over a GPU and cores, beside a task that holds the GPU."""
    rng = random.Random(seed)
    slack = Fraction(rng.choice((0, 0, 1, 2, 4)), 4)
    period = rng.choice((8, 10, 12))
    work = [version("gpu", rng.randint(1, 3), "gpu")]
    if rng.random() < 0.7:
        work.append(version("core", rng.randint(2, 8), "c2"))
    first = task("first", period, version("v", rng.randint(1, 2), "c1"), slack=slack)
    middle = task("middle", rng.choice((period, 2 * period)), *work, slack=rng.choice((0, 1)))
    last = task("last", rng.choice((period, 2 * period)), version("v", rng.randint(1, 2), "c1"), slack=slack)
    holder = task("holder", rng.choice((4, 6)) * period, version("v", rng.randint(period // 2, 4 * period - 1), "gpu"))
    chains = [chain("c", "first middle last", **limits)]
    return model(first, middle, last, holder, units="gpu c1 c2", chains=chains)


def is_held(system):
    found = [d.code for hopeless in find_witnesses(system) for d in hopeless.diagnostics]
    return codes.UNIT_HELD.id in found


@examples(150)
@given(SEEDS)
def test_it_is_never_said_of_what_has_a_schedule(seed):
    """The limits are the latencies of a schedule that was found, to the tick."""
    free = drawn(seed)
    assume(not any(d.is_error for d in validate(free)) and not find_witnesses(free))
    (table,) = schedule_model(free, SearchOptions(budget=200), lambda *_: True).schedule.modes
    assume(table.status is Status.VALID)
    (found,) = table.chains
    limited = (replace(free.chains[0], max_reaction=found.reaction, max_age=found.age),)
    assert find_witnesses(replace(free, chains=limited)) == ()


@pytest.mark.parametrize("kind", ["age", "reaction"])
def test_the_exact_engine_agrees(kind):
    pytest.importorskip("ortools")
    limited = (drawn(seed, **{kind: limit}) for seed in range(20) for limit in (12, 16))
    held = [s for s in limited if not any(d.is_error for d in validate(s)) and is_held(s)]
    assert held
    for system in held:
        assert solve_exact(system, system.modes[0], Effort(work=5)).status is not Answer.FEASIBLE


@pytest.mark.parametrize("kind", ["age", "reaction"])
def test_both_limits_are_looked_at(kind):
    assert any(is_held(drawn(seed, **{kind: limit})) for seed in range(60) for limit in (12, 16))
