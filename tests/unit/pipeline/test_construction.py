"""The order in which a schedule is built up: nobody left out, linked tasks one after the other, heavy ones first."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.construction import construction_order
from halpipe.pipeline.solve.problem import build_problem
from support import access, after, model, task, version


def order(loads, *windows):
    """Return the order of tasks with these loads and windows (one task, another, width)."""
    links = [{} for _ in loads]
    for one, other, width in windows:
        links[one][other] = links[other][one] = width
    return list(construction_order(loads, links))


def test_tasks_without_windows_come_heaviest_first_and_equal_ones_in_the_order_of_the_model():
    assert order([3, 7, 3, 9]) == [3, 1, 0, 2]


def test_a_component_counts_as_a_whole_and_begins_with_its_heaviest_task():
    assert order([5, 4, 3, 6], (1, 2, 10)) == [1, 2, 3, 0]


def test_within_a_component_the_shortest_window_to_what_is_placed_comes_next():
    assert order([9, 1, 1, 1], (0, 1, 30), (0, 2, 20), (2, 3, 10)) == [0, 2, 3, 1]


def test_of_equal_windows_the_heavier_task_comes_first():
    assert order([9, 1, 2], (0, 1, 5), (0, 2, 5)) == [0, 2, 1]


@st.composite
def linked(draw):
    count = draw(st.integers(1, 12))
    numbers = st.integers(0, count - 1)
    windows = draw(st.lists(st.tuples(numbers, numbers, st.integers(0, 9)), max_size=20))
    return draw(st.lists(st.integers(0, 9), min_size=count, max_size=count)), [w for w in windows if w[0] != w[1]]


@given(linked())
def test_every_task_comes_once_and_each_component_in_one_piece(case):
    loads, windows = case
    found = order(loads, *windows)
    assert sorted(found) == list(range(len(loads)))
    component = list(range(len(loads)))
    for one, other, _ in windows * len(loads):
        component[one] = component[other] = min(component[one], component[other])
    pieces = [component[task] for task in found]
    changes = sum(before != after for before, after in pairwise(pieces))
    assert changes == len(set(component)) - 1


def test_the_entries_of_a_mode_are_ordered_so_with_all_jobs_on_demand_of_a_task_together():
    def short(name, period, *after):
        return task(name, period, version("v", "1ms", "u1 u2", access("r", 0, "1ms"), *after))

    def constructed(*tasks):
        system = model(*tasks, units="u1 u2", resources="r")
        problem = build_problem(expand(system, system.modes[0]), system.units, ["r"])
        arrays, names = problem.arrays, [active.name for active in problem.expansion.tasks]
        return [names[arrays.job_task[arrays.entry_job[entry]]] for entry in arrays.construction.tolist()]

    often, seldom = short("often", "10ms"), short("seldom", "40ms")
    assert constructed(seldom, often) == ["often", "seldom"]
    follower = short("follower", "40ms", after("seldom", 0, "3ms"))
    assert constructed(seldom, often, follower) == ["often", "seldom", "follower"]
    asked = short("asked", None)
    asking = short("asking", "20ms", after("asked", 0, "3ms"))
    assert constructed(seldom, often, asking, asked) == ["often", "asking", "asked", "asked", "seldom"]
