"""Two entries change places: which may, that nothing else moves, and what it is worth where little is idle."""

from fractions import Fraction

import pytest

from halpipe.pipeline.generate import SetParameters, generate
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.kernel.kernel import (
    ALL_PARTS,
    BEST,
    COST,
    FROZEN_HINT,
    INSERTED,
    Part,
    anneal,
    gumbel_table,
    new_state,
    total_cost,
)
from halpipe.pipeline.solve.problem import build_problem
from kernel_moves import move_swap
from support import after, model, task, version

NOISE = gumbel_table()


def constructed(*tasks, seed=1):
    """Return the arrays of a model on two units and the state in which all its tasks are placed."""
    system = model(*tasks, units="u1 u2")
    problem = build_problem(expand(system, system.modes[0]), system.units, [], system.chains)
    state = new_state(problem.arrays, seed, problem.mean_wcet)
    anneal(problem.arrays, state, NOISE, len(problem.arrays.entry_offset))
    assert state.register[INSERTED] == len(problem.arrays.entry_offset)
    return problem.arrays, state


def finds_a_partner(arrays, state, entry):
    """Return whether an entry has somebody to change places with, in many moves."""
    return any(move_swap(arrays, state, NOISE, entry) for _ in range(100))


def plain(name, wcet=3, period=20, **options):
    return task(name, period, version("v", wcet, "u1 u2"), **options)


def test_entries_of_the_same_period_change_places_and_nothing_else_moves():
    arrays, state = constructed(plain("a"), plain("b", 4), plain("c", period=10))
    before = state.start.tolist()
    moved = set()
    for _ in range(200):
        move_swap(arrays, state, NOISE, 0)  # now and then, nobody of the same period is drawn
        assert state.register[COST] == total_cost(arrays, state)
        moved |= {job for job, (was, now) in enumerate(zip(before, state.start, strict=True)) if was != now}
    assert moved == {0, 1}, "the jobs of the task with another period stay"


@pytest.mark.parametrize(
    "other",
    [
        plain("b", period=10),
        plain("b", offset=3),
        task("b", 20, version("v", 3, "u1 u2", after("a", 0, 19))),
    ],
    ids=["period", "offset", "window"],
)
def test_what_is_of_another_kind_has_no_part_in_it(other):
    arrays, state = constructed(plain("a"), other)
    assert not finds_a_partner(arrays, state, 0)


def test_what_is_frozen_stays():
    arrays, state = constructed(plain("a"), plain("b"))
    state.hint[1] = FROZEN_HINT
    assert not finds_a_partner(arrays, state, 0)
    assert not finds_a_partner(arrays, state, 1)


DENSE = SetParameters(tasks=72, units=3, unit_types=1, utilisation=Fraction(94, 100), resource_fill=Fraction(3, 5))
FULL = SetParameters(tasks=72, units=3, unit_types=1, utilisation=Fraction(98, 100), resource_fill=Fraction(1, 5))


@pytest.mark.slow
def test_where_little_is_idle_changing_places_finds_more_schedules():
    """In 200 000 moves: two sets that fill units and resources, and one that fills the units alone."""
    solved = dict.fromkeys((ALL_PARTS, ALL_PARTS & ~Part.MOVE_SWAP), 0)
    for parameters, seed in ((DENSE, 1), (DENSE, 2), (FULL, 1)):
        system = generate(parameters, seed)
        resources = [resource.name for resource in system.resources]
        problem = build_problem(expand(system, system.modes[0]), system.units, resources)
        for parts in solved:
            state = new_state(problem.arrays, seed, problem.mean_wcet, parts)
            anneal(problem.arrays, state, NOISE, 200_000)
            solved[parts] += state.register[BEST] == 0
    with_swaps, without = solved.values()
    assert with_swaps >= without + 2, solved
