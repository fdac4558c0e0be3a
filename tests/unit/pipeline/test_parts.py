"""Each part of the search can be switched off, and then it does nothing."""

import pytest

from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.integers import filled
from halpipe.pipeline.solve.kernel.kernel import (
    ALL_PARTS,
    COST,
    MOVES,
    Part,
    anneal,
    gumbel_table,
    new_state,
    total_cost,
)
from halpipe.pipeline.solve.problem import build_problem
from support import access, after, model, task, version

NOISE = gumbel_table()
ENOUGH = 60_000
"""Moves after which there have been restarts."""


def problem_of(system):
    return build_problem(
        expand(system, system.modes[0]), system.units, [resource.name for resource in system.resources], system.chains
    )


def searched(problem, enabled, moves=4000):
    state = new_state(problem.arrays, 3, problem.mean_wcet, enabled)
    state.hint[:] = filled(len(state.hint), 2)
    anneal(problem.arrays, state, NOISE, moves)
    return state


def mixed(*, is_linked):
    """Slack, choices, memory phases, maybe windows: every part has something to do, and there is no schedule.

    Where there are windows, nobody changes places.
    """
    units = "u1 u2"
    tasks = [task("t0", 40, version("v", 3, units))]
    for n in range(1, 12):
        rows = [after(f"t{n - 1}", 0, 3)] if is_linked and n % 3 == 0 else []
        made = [version("v", 9, units, access("r", 0, 2), *rows), version("w", 9, units, *rows)]
        tasks.append(task(f"t{n}", 20 if n == 7 else 40, *made, slack="0.1" if n % 2 else 0))
    return model(*tasks, units=units, resources="r")


@pytest.mark.parametrize("part", list(Part))
def test_every_part_changes_the_way_of_the_search_and_none_its_account(part):
    problem = problem_of(mixed(is_linked=part is not Part.MOVE_SWAP))
    whole, without = searched(problem, ALL_PARTS, ENOUGH), searched(problem, ALL_PARTS & ~part, ENOUGH)
    assert whole.register[MOVES] == without.register[MOVES] == ENOUGH
    assert without.register[COST] == total_cost(problem.arrays, without)
    assert whole.start.tolist() != without.start.tolist()
