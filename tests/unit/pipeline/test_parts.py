"""Each part of the search can be switched off, and then it does nothing."""

from dataclasses import replace

import pytest

from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.integers import filled
from halpipe.pipeline.solve.kernel.kernel import (
    ALL_PARTS,
    BEST,
    COST,
    MOVES,
    Part,
    anneal,
    gumbel_table,
    new_state,
    total_cost,
)
from halpipe.pipeline.solve.problem import build_problem
from support import access, after, chain, model, task, version

NOISE = gumbel_table()
ENOUGH = 60_000
"""Moves after which there have been restarts."""

RULES = Part.LANES | Part.WINDOWS | Part.DEMANDS | Part.CHAINS


def problem_of(system):
    return build_problem(
        expand(system, system.modes[0]), system.units, [resource.name for resource in system.resources], system.chains
    )


def searched(problem, enabled, moves=4000):
    state = new_state(problem.arrays, 3, problem.mean_wcet, enabled)
    state.hint[:] = filled(len(state.hint), 2)
    anneal(problem.arrays, state, NOISE, moves)
    return state


# Each breaks one rule, whatever is tried, and no other.
BROKEN = {
    Part.LANES: model(*(task(f"t{n}", 10, version("v", 6)) for n in range(2))),
    Part.WINDOWS: model(
        task("a", 10, version("v", 3), offset=0),
        task("b", 10, version("v", 3, "u1", after("a", 0, 4)), offset=5),
    ),
    Part.CHAINS: model(task("a", 10, version("v", 4)), task("b", 10, version("v", 4)), chains=[chain("c", "a b", 9)]),
}


@pytest.mark.parametrize("rule", [Part.LANES, Part.WINDOWS, Part.CHAINS])
def test_a_rule_that_is_off_costs_nothing(rule):
    problem = problem_of(BROKEN[rule])
    assert searched(problem, ALL_PARTS).register[BEST] > 0
    assert searched(problem, ALL_PARTS & ~rule).register[BEST] == 0
    for other in RULES & ~rule:
        assert searched(problem, ALL_PARTS & ~other).register[BEST] > 0


def test_a_demand_that_is_not_looked_at_is_not_missed():
    """Only the version "v" of the second task asks for the first one."""
    system = model(
        task("need", None, version("v", 1, "u2")),
        task("a", 10, version("v", 1, "u1", after("need", 0, 20)), version("w", 1, "u1")),
        units="u1 u2",
    )
    problem = problem_of(system)
    state = searched(problem, ALL_PARTS)
    assert state.register[BEST] == 0
    runs = [problem.options[option].version is not None for option in state.option.tolist()]
    asks = problem.options[state.option[1]].version.name == "v"
    assert runs == [asks, True]
    (state.option[0],) = [n for n in (0, 1) if n != state.option[0]]  # to run, and not to
    missed = problem.arrays.missing_cost
    off = replace(state, enabled=int(ALL_PARTS & ~(Part.DEMANDS | Part.WINDOWS)))
    assert total_cost(problem.arrays, replace(off, enabled=int(off.enabled | Part.DEMANDS))) == missed
    assert total_cost(problem.arrays, off) == 0


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


@pytest.mark.parametrize("part", [part for part in Part if part not in RULES])
def test_every_part_changes_the_way_of_the_search_and_none_its_account(part):
    problem = problem_of(mixed(is_linked=part is not Part.MOVE_SWAP))
    whole, without = searched(problem, ALL_PARTS, ENOUGH), searched(problem, ALL_PARTS & ~part, ENOUGH)
    assert whole.register[MOVES] == without.register[MOVES] == ENOUGH
    assert without.register[COST] == total_cost(problem.arrays, without)
    assert whole.start.tolist() != without.start.tolist()
