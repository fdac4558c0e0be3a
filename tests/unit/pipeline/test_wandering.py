"""Placements that cost nothing but cannot be dealt out to units: others nearby that can."""

from array import array
from itertools import pairwise

import pytest

from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.kernel import search as driver
from halpipe.pipeline.solve.kernel.kernel import anneal, gumbel_table, total_cost, wander
from halpipe.pipeline.solve.kernel.state import BEST, MOVES, new_state
from halpipe.pipeline.solve.problem import build_problem
from support import model, task, version

UNITS = "u1 u2 u3"
NOISE = gumbel_table()


def full_problem(idle):
    """Twelve tasks of two periods on three units, of which so many ticks of 36 are idle."""
    wcets = [9, 9, 9, 8, 5, 6, 7, 4, 8, 9, 10, 11]
    wcets[0] -= idle
    tasks = [task(f"t{n}", 36, version("v", wcet, UNITS)) for n, wcet in enumerate(wcets)]
    tasks.append(task("short", 12, version("v", 4, UNITS)))
    system = model(*tasks, units=UNITS)
    return build_problem(expand(system, system.modes[0]), system.units, [], [])


@pytest.fixture(scope="module")
def problem():
    return full_problem(idle=3)


def solved(problem, seed):
    state = new_state(problem.arrays, seed, problem.mean_wcet)
    assert anneal(problem.arrays, state, NOISE, 10**6) == 0
    return state


@pytest.mark.parametrize("seed", range(1, 6))
def test_every_placement_on_the_way_is_another_one_that_costs_nothing(problem, seed):
    state = solved(problem, seed)
    found = {tuple(state.best_start)}
    for _ in range(20):
        before = tuple(state.best_start), tuple(state.best_option), state.register[MOVES]
        assert wander(problem.arrays, state, NOISE, 100_000)
        assert state.register[BEST] == total_cost(problem.arrays, state) == 0
        assert (tuple(state.best_start), tuple(state.best_option)) == (tuple(state.start), tuple(state.option))
        assert (tuple(state.best_start), tuple(state.best_option)) != before[:2]
        assert before[2] < state.register[MOVES] <= before[2] + 100_000
        found.add(tuple(state.best_start))
    assert len(found) > 5


def test_it_makes_no_more_moves_than_it_may(problem):
    state = solved(problem, 1)
    before = state.register[MOVES], tuple(state.best_start)
    found = wander(problem.arrays, state, NOISE, 1)
    assert state.register[MOVES] == before[0] + 1
    assert found == (tuple(state.best_start) != before[1])


def dealt(monkeypatch, problem, state, refused, limit=10**6, go_on=lambda made: True):
    """Look nearby while the first so many placements are refused; return the outcome and all that were asked about."""
    asked = []

    def refusing(_, start, option):
        asked.append((tuple(start), tuple(option)))
        return None if len(asked) <= refused else [()]

    monkeypatch.setattr(driver, "deal", refusing)
    return driver._dealt_nearby(problem, state, limit, go_on), asked


@pytest.mark.parametrize("refused", [0, 1, 7])
def test_others_are_tried_until_one_can_be_dealt_out(monkeypatch, problem, refused):
    state = solved(problem, 2)
    before = state.register[MOVES]
    (units, made, stopped), asked = dealt(monkeypatch, problem, state, refused)
    assert (units, stopped) == ([()], False)
    assert made == state.register[MOVES] - before > 0
    assert len(asked) == refused + 1
    assert all(one != other for one, other in pairwise(asked))


def test_where_none_can_be_the_placement_still_costs_nothing(monkeypatch, problem):
    state = solved(problem, 3)
    (units, made, stopped), asked = dealt(monkeypatch, problem, state, 10**9, limit=500)
    assert (units, made, stopped) == (None, 500, False)
    assert asked, "some were found"
    assert (tuple(state.start), tuple(state.option)) == asked[-1]
    assert state.register[BEST] == 0


def test_it_can_be_stopped(monkeypatch, problem):
    state = solved(problem, 3)
    (units, made, stopped), _ = dealt(monkeypatch, problem, state, 10**9, go_on=lambda made: False)
    assert (units, stopped) == (None, True)
    assert 0 < made < 10**6


def test_of_placements_that_are_frozen_none_is_looked_for(problem):
    from halpipe.pipeline.solve.kernel.state import FROZEN

    state = solved(problem, 4)
    state.register[FROZEN] = len(problem.arrays.entry_offset)
    before = array("q", state.start)
    assert driver._dealt_nearby(problem, state, 1000, lambda made: True) == (None, 0, False)
    assert state.start == before
