"""Tightly linked tasks move together: who belongs to a cluster, and that a move keeps the windows inside it."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.kernel.kernel import (
    ALL_PARTS,
    BEST,
    CLUSTER,
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
from kernel_moves import gather_cluster, move_cluster
from profiles import examples
from support import access, after, chain, model, task, version

NOISE = gumbel_table()
PHASES = access("r", 0, "1ms")


def follows(name, first, high, period="40ms", **options):
    return task(name, period, version("v", "2ms", "u1 u2", PHASES, after(first, 0, high)), **options)


def first(name, **options):
    return task(name, "40ms", version("v", "2ms", "u1 u2", PHASES), **options)


def constructed(*tasks, seed=1, **options):
    """Return the arrays of a model and the state in which all its tasks are placed, and the numbers of tasks."""
    system = model(*tasks, units="u1 u2", resources="r", **options)
    problem = build_problem(expand(system, system.modes[0]), system.units, ["r"], system.chains)
    state = new_state(problem.arrays, seed, problem.mean_wcet)
    anneal(problem.arrays, state, NOISE, len(problem.arrays.entry_offset))
    assert state.register[INSERTED] == len(problem.arrays.entry_offset)
    return problem.arrays, state, {active.name: number for number, active in enumerate(problem.expansion.tasks)}


def cluster(arrays, state, numbers, name):
    size = gather_cluster(arrays, state, numbers[name])
    names = {number: name for name, number in numbers.items()}
    return {names[number] for number in state.cluster[:size].tolist()}


def test_windows_up_to_an_eighth_of_the_period_link_tightly_in_both_directions_and_over_several_tasks():
    made = constructed(first("a"), follows("b", "a", "5ms"), follows("c", "b", "4ms"), follows("d", "a", "6ms"))
    for name in "abc":
        assert cluster(*made, name) == {"a", "b", "c"}
    assert cluster(*made, "d") == {"d"}


@pytest.mark.parametrize(
    "bound", [{"offset": "0ms"}, {"period": "20ms", "offset": "3ms"}], ids=["an offset", "an offset and two jobs"]
)
def test_what_is_bound_to_its_offset_is_not_moved_with_others(bound):
    made = constructed(first("a"), follows("b", "a", "1ms", **{"period": "40ms", **bound}))
    assert cluster(*made, "a") == set()


def test_what_is_in_a_chain_with_a_limit_is_not_moved_with_others():
    made = constructed(first("a"), follows("b", "a", "1ms"), chains=(chain("c", "a b", "20ms"),))
    assert cluster(*made, "a") == set()


def test_what_is_frozen_is_not_moved_with_others():
    arrays, state, numbers = constructed(first("a"), follows("b", "a", "1ms"))
    state.hint[arrays.job_entry[arrays.task_job[numbers["b"]]]] = FROZEN_HINT
    assert cluster(arrays, state, numbers, "a") == set()


def test_of_more_tasks_than_fit_into_a_move_the_nearest_move_together():
    tasks = [first("t0"), *(follows(f"t{n}", f"t{n - 1}", "2ms") for n in range(1, CLUSTER + 1))]
    assert cluster(*constructed(*tasks[:CLUSTER]), "t0") == {f"t{n}" for n in range(CLUSTER)}
    made = constructed(*tasks)
    assert cluster(*made, "t0") == {f"t{n}" for n in range(CLUSTER)}
    assert cluster(*made, f"t{CLUSTER}") == {f"t{n}" for n in range(1, CLUSTER + 1)}


RIGID = "0.3125ms"
"""The widest window that makes one body of two tasks with a period of 40 ms: a 128th of it."""


def test_a_body_moves_as_a_whole_however_many_tasks_it_has():
    tasks = [first("t0"), *(follows(f"t{n}", f"t{n - 1}", RIGID) for n in range(1, 2 * CLUSTER))]
    made = constructed(*tasks)
    for name in ("t0", f"t{CLUSTER}", f"t{2 * CLUSTER - 1}"):
        assert cluster(*made, name) == {f"t{n}" for n in range(2 * CLUSTER)}


def test_what_is_tightly_linked_joins_only_with_its_whole_body():
    """Of two bodies of five tasks with a short window between them, one moves: both are more than a move may take."""
    left = [first("a0"), *(follows(f"a{n}", f"a{n - 1}", RIGID) for n in range(1, 5))]
    right = [follows("b0", "a4", "2ms"), *(follows(f"b{n}", f"b{n - 1}", RIGID) for n in range(1, 5))]
    made = constructed(*left, *right, follows("c", "a0", "2ms"))
    assert cluster(*made, "a2") == {*(f"a{n}" for n in range(5)), "c"}
    assert cluster(*made, "b0") == {f"b{n}" for n in range(5)}


def test_a_wider_window_makes_no_body():
    tasks = [first("t0"), *(follows(f"t{n}", f"t{n - 1}", "0.32ms") for n in range(1, 2 * CLUSTER))]
    assert len(cluster(*constructed(*tasks), "t0")) == CLUSTER


def rigid_chains(seed, width):
    """Three chains of nine tasks, laid out one after the other with gaps; each window is as wide as `width` ticks."""
    rng = random.Random(seed)
    order = [number for number in range(3) for _ in range(9)]
    rng.shuffle(order)
    tasks, starts, time = [], {}, 0
    for which in order:
        before, wcet = starts.setdefault(which, []), rng.randint(8, 20)
        time += rng.randint(5, 18)
        rows = [after(f"c{which}_{len(before) - 1}", time - last, time - last + width) for last in before[-1:]]
        tasks.append(task(f"c{which}_{len(before)}", 1000, version("v", wcet, "u1", *rows)))
        before.append(time)
        time += wcet
    return model(*sorted(tasks, key=lambda made: made.name), units="u1")


@pytest.mark.parametrize("width", [0, 3])
@pytest.mark.parametrize("seed", range(6))
def test_rigid_chains_find_their_places_between_each_other(seed, width):
    system = rigid_chains(seed, width)
    problem = build_problem(expand(system, system.modes[0]), system.units, [])
    for parts, is_solved in ((ALL_PARTS, True), (ALL_PARTS & ~Part.MOVE_CLUSTER, False)):
        state = new_state(problem.arrays, 1, problem.mean_wcet, parts)
        anneal(problem.arrays, state, NOISE, 5000)
        assert (state.register[BEST] == 0) is is_solved


def at(values, places):
    return [values[place] for place in places]


def differences(now, before, circle):
    return {(a - b) % circle for a, b in zip(now, before, strict=True)}


@examples(60)
@given(st.integers(0, 2**32), st.booleans())
def test_a_move_keeps_distances_inside_the_cluster_and_accounts_for_its_cost(seed, flexible):
    slack = "0.1" if flexible else 0
    tasks = [
        first("a", slack=slack),
        follows("b", "a", "5ms", slack=slack),
        follows("c", "b", "2ms", period="80ms", slack=slack),
        *(first(f"x{n}") for n in range(8)),
    ]
    arrays, state, numbers = constructed(*tasks, seed=seed)
    jobs = [job for name in "abc" for job in range(arrays.task_job[numbers[name]], arrays.task_job[numbers[name] + 1])]
    rest = [job for job in range(len(arrays.job_task)) if job not in jobs]
    moved = False
    for _ in range(10):
        before, phases, others = at(state.start, jobs), at(state.phase, jobs), at(state.start, rest)
        size = gather_cluster(arrays, state, numbers["b"])
        assert size == 3
        move_cluster(arrays, state, NOISE, size)
        shifts = differences(at(state.start, jobs), before, arrays.hyperperiod)
        assert len(shifts) == 1
        assert differences(at(state.phase, jobs), phases, arrays.hyperperiod) == shifts
        assert all(0 <= state.phase[arrays.task_job[numbers[name]]] < arrays.hyperperiod for name in "abc")
        assert at(state.start, rest) == others
        assert state.register[COST] == total_cost(arrays, state)
        moved |= shifts != {0}
    assert moved
