"""First-fit construction along chains: valid tables at once, and nothing left behind by tables without success."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from halpipe.models import Match, Status
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.integers import ints
from halpipe.pipeline.solve.kernel import search as driver
from halpipe.pipeline.solve.kernel.first_fit import _levels, _Orders, _Refused, _Table, construct
from halpipe.pipeline.solve.kernel.kernel import (
    BEST,
    FROZEN,
    INSERTED,
    MOVES,
    NEVER,
    bound,
    new_state,
    total_cost,
)
from halpipe.pipeline.solve.problem import build_problem
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.verify import verify
from support import access, after, chain, model, task, version

PERIODS, SHARES = (1, 2, 5, 10, 20, 50, 100), (3, 2, 2, 25, 25, 3, 20)


def chained_system(tasks, seed, load=0.8, length=8):
    """Tasks of the usual periods on three cores, with chains of one period each whose data may be one period old."""
    draw = random.Random(seed)
    periods = draw.choices(PERIODS, SHARES, k=tasks)
    works = [draw.uniform(0.5, 1.5) for _ in range(tasks)]
    loads = [sum(works[n] / periods[n] for n in range(core, tasks, 3)) for core in range(3)]
    made = [
        task(f"t{n}", period, version("v", f"{max(1, int(works[n] * load / loads[n % 3] * 1000))}us", f"u{n % 3}"))
        for n, period in enumerate(periods)
    ]
    alike = {p: [n for n in range(tasks) if periods[n] == p] for p in PERIODS}
    chains = []
    for number in range(tasks // 25):
        period = draw.choice([p for p in PERIODS if len(alike[p]) >= length])
        steps = sorted(draw.sample(alike[period], length))
        chains.append(chain(f"c{number}", " ".join(f"t{n}" for n in steps), age=period))
    return model(*made, units="u0 u1 u2", chains=chains)


@pytest.mark.parametrize("seed", range(5))
def test_chains_within_their_period_need_a_few_tables(seed):
    """The annealer alone finds one such system of eight in 40 seconds."""
    system = chained_system(150, 903 + seed)
    result = schedule_model(system, SearchOptions(), lambda *_: True)
    assert result.schedule.modes[0].status is Status.VALID
    assert [found.message for found in verify(system, result.schedule) if found.is_error] == []
    assert result.moves <= 64 * len(system.tasks)


def state_of(system, seed=1):
    problem = build_problem(
        expand(system, system.modes[0]), system.units, [resource.name for resource in system.resources], system.chains
    )
    return problem, new_state(problem.arrays, seed, problem.mean_wcet)


def constructed(system, budget=10**6):
    problem, state = state_of(system)
    return construct(problem, state, budget, lambda made: True), problem, state


def starts(problem, state):
    return {active.name: state.start[problem.arrays.task_job[n]] for n, active in enumerate(problem.expansion.tasks)}


def test_messages_with_jitter_follow_their_senders_job_by_job():
    """Its second job has to wait for another message; what follows the message waits for the latest of them."""
    system = model(
        task("send", 10, version("v", 2, "u1")),
        task("other", 20, version("v", 3, "u2"), offset=12),
        task("message", 10, version("v", 1, "u2"), slack=1),
        task("receive", 10, version("v", 2, "u3")),
        units="u1 u2 u3",
        chains=[chain("c", "send message receive", age=10)],
    )
    is_valid, problem, state = constructed(system)
    assert is_valid
    assert state.register[BEST] == 0 == total_cost(problem.arrays, state)
    assert state.register[MOVES] == len(problem.arrays.entry_offset)


def test_slower_tasks_of_a_chain_come_where_faster_ones_wait_for_them():
    system = model(
        task("fast", 5, version("v", 1, "u1")),
        task("slow", 20, version("v", 4, "u2")),
        task("last", 10, version("v", 2, "u1")),
        units="u1 u2",
        chains=[chain("c", "fast slow last", age=18)],
    )
    is_valid, problem, state = constructed(system)
    assert is_valid
    assert (starts(problem, state)["slow"] - starts(problem, state)["fast"]) % 5 == 1


@pytest.mark.slow
def test_many_windows_of_one_cycle_are_placed_in_a_row_within_a_move_for_each_task():
    rows = [replace(after(f"t{n - 1}", 0, 100, "end"), match=Match.CYCLE) for n in range(1, 300)]
    system = model(
        task("t0", 100, version("v", "100us", "u0")),
        *(task(f"t{n}", 100, version("v", "100us", f"u{n % 4}", row)) for n, row in enumerate(rows, 1)),
        units="u0 u1 u2 u3",
    )
    found = schedule_model(system, SearchOptions(budget=1), lambda *_: True)
    assert found.is_complete
    assert not [finding for finding in verify(system, found.schedule) if finding.is_error]


def test_windows_gangs_and_resources_are_kept():
    system = model(
        task("a", 10, version("v", 3, "u1 u2", access("mem", 0, 2, "3/4"))),
        task("b", 10, version("v", 3, "u1 u2", access("mem", 1, 3, "1/2"), after("a", 1, 4, "end"))),
        task("g", 20, version("v", 2, "u1 u2", gang=2)),
        task("helper", None, version("v", 1, "u1 u2")),
        task("user", 20, version("v", 1, "u1 u2", after("helper", 1, 3))),
        units="u1 u2",
        resources="mem",
        chains=[chain("c", "a b", age=8)],
    )
    is_valid, problem, state = constructed(system)
    assert is_valid
    assert total_cost(problem.arrays, state) == 0


def test_a_table_without_success_leaves_the_state_empty_but_for_hints():
    system = model(
        task("a", 10, version("v", 4)),
        task("b", 10, version("v", 4)),
        task("c", 10, version("v", 4)),
        chains=[chain("c", "a b c", age=30)],
    )
    is_valid, _, state = constructed(system)
    assert not is_valid
    assert set(state.start) == {-1}
    assert list(state.edges) == [1] * len(state.edges)
    assert state.register[INSERTED] == state.register[FROZEN] == 0
    assert sorted(state.hint) == [-1, 0, 2]  # ticks of 2 ms


def test_no_more_tables_than_the_budget_allows():
    system = chained_system(60, 5, load=1.2, length=4)
    _, _, state = constructed(system, 150)
    assert state.register[MOVES] == 120


def test_what_asks_to_stop_is_obeyed():
    problem, state = state_of(chained_system(60, 5, load=1.2, length=4))
    assert not construct(problem, state, 10**6, lambda made: False)
    assert state.register[MOVES] == 60


@pytest.mark.parametrize(
    ("match", "chains", "most", "is_constructed"),
    [
        (Match.CYCLE, [], 1, True),
        (Match.CYCLE, [], 2, False),  # few tasks
        (Match.WINDOW, [], 1, False),
        (Match.WINDOW, [chain("c", "a", 30)], 2, True),
        (Match.WINDOW, [chain("c", "a")], 2, False),  # without a limit
    ],
)
def test_tables_are_built_for_limited_chains_and_for_many_windows_of_one_cycle(
    monkeypatch, match, chains, most, is_constructed
):
    monkeypatch.setattr(driver, "MANY_TASKS", most)
    row = replace(after("a", 0, 9), match=match)
    system = model(task("a", 10, version()), task("b", 10, version("v", 1, "u1", row)), chains=chains)
    assert driver._is_constructed(state_of(system)[0]) is is_constructed


def test_what_a_construction_has_left_starts_at_its_offset():
    """Of a task with some jobs placed, the others, too; those on demand start at once."""
    asks = task("asks", 20, version("v", 1, "u1", after("h", 0, 9)))
    system = model(
        task("a", 10, version(), offset=3), task("b", 5, version()), asks, task("h", None, version("v", 2)),
        task("c", 20, version("w", 3), version("x", 4)),
    )  # fmt: skip
    problem, state = state_of(system)
    state.start[:2], state.phase[:2] = ints([4, 14]), ints([4, 4])
    found = driver._completed(problem, state, 1)
    assert found.start.tolist() == [4, 14, 0, 5, 10, 15, 0, 0, 0]
    assert found.phase.tolist() == [4, 4, 0, 0, 0, 0, 0, 0, 0]
    assert found.option.tolist() == [*[0] * 2, *[1] * 4, *problem.arrays.task_option[2:5]]
    assert found.register[BEST] == total_cost(problem.arrays, found) > 0
    state.start[:2] = ints([-1, -1])
    assert driver._completed(problem, state, 1).start.tolist()[:2] == [3, 13]


def test_tables_are_built_once_however_often_a_search_goes_on(monkeypatch):
    built = []
    monkeypatch.setattr(driver, "construct", lambda *given: built.append(given[2]))
    problem, _ = state_of(
        model(task("a", 10, version("v", 6)), task("b", 10, version("v", 6)), chains=[chain("c", "a", 9)])
    )
    search = driver.Search(problem, lambda: problem, 1)
    assert [search.run(budget, lambda *_: True).moves for budget in (5, 9)] == [5, 9]
    assert built == [5]


def test_an_entry_fits_between_what_is_placed_and_comes_out_again():
    problem, state = state_of(model(task("a", 10, version("v", 5)), task("b", 20, version("v", 3))))
    place, remove = bound("fit", problem.arrays, state), bound("remove", problem.arrays, state)
    assert place(0, 3, 9) == 3
    assert place(1, 4, 19) == 8
    remove(1)
    assert place(1, 11, 17) == NEVER
    assert place(1, 11, 39) == 18
    assert state.start[-1] == 18


def test_what_finds_no_room_where_it_was_before_is_placed_elsewhere():
    problem, state = state_of(model(task("a", 10, version("v", 4)), task("b", 10, version("v", 6))))
    state.hint[:] = state.hint.__class__("q", [1, 1])
    assert construct(problem, state, 10**6, lambda made: True)
    assert state.register[MOVES] == 2
    assert 1 in starts(problem, state).values()


def test_jobs_on_demand_are_followed_where_they_end():
    """`ask` starts at 9 ms of 10 at the earliest, so that `h`, which has to come after it, lies in the next 10 ms."""
    system = model(
        task("first", 10, version("v", 9, "u1"), offset=0),
        task("ask", 10, version("v", 1, "u1", after("h", 0, 8))),
        task("h", None, version("v", 2, "u2")),
        units="u1 u2",
        chains=[chain("c", "first h ask", reaction=30)],
    )
    is_valid, problem, state = constructed(system)
    assert is_valid
    assert (starts(problem, state)["ask"], starts(problem, state)["h"] in (1, 2, 3, 4, 5, 6, 7, 8, 9)) == (9, True)


# ------------------------------------------------------------------------------------------------ orders


def orders_of(system):
    problem, _ = state_of(system)
    return _Orders.of(problem.arrays), [active.name for active in problem.expansion.tasks]


def in_order(orders, names):
    return " ".join(names[number] for number in orders.tasks())


def test_tasks_come_by_offsets_then_by_the_periods_that_divide_theirs_then_by_what_is_beside_them():
    system = model(
        task("slow", 24, version("v", 1)),
        task("odd", 6, version("v", 1)),
        task("four", 4, version("v", 1)),
        task("short", 8, version("v", 1)),
        task("long", 8, version("v", 2)),
        task("beside", 8, version("v", 1)),
        task("fixed", 24, version("v", 1), offset=3),
        task("first", 24, version("v", 2), offset=0),
        task("last", 24, version("v", 1)),
        chains=[chain("c", "beside last", 99)],
    )
    assert in_order(*orders_of(system)) == "first fixed odd four beside long short last slow"


def test_a_task_comes_after_what_is_before_it_which_has_its_rank():
    """`fast` waits for `mid` and that for `slow`, which come early for its sake; `alone` has a longer period."""
    system = model(
        task("alone", 10, version("v", 1)),
        task("slow", 40, version("v", 1)),
        task("mid", 20, version("v", 1, "u1", after("slow", 0, 39))),
        task("fast", 5, version("v", 1, "u1", after("mid", 0, 19))),
    )
    assert in_order(*orders_of(system)) == "slow mid fast alone"


def test_a_task_comes_before_those_on_demand_that_it_asks_for():
    asks = task("asks", 10, version("v", 1, "u1", after("h", 0, 9)))
    assert in_order(*orders_of(model(task("h", None, version()), asks))) == "asks h"


def test_chains_that_meet_themselves_begin_with_the_best_rank():
    system = model(
        task("a", 20, version("v", 1)),
        task("b", 10, version("v", 1)),
        chains=[chain("c", "a b", 99), chain("d", "b a", 99)],
    )
    assert sorted(in_order(*orders_of(system)).split()) == ["a", "b"]


def test_a_task_that_a_chain_passes_twice_in_a_row_does_not_come_after_itself():
    system = model(task("b", 20, version("v", 1)), task("a", 20, version("v", 2)), chains=[chain("c", "a a b", 99)])
    orders, names = orders_of(system)
    assert orders.before == [{1: None}, {}]
    assert in_order(orders, names) == "a b"


def test_a_task_without_room_comes_halfway_to_the_front_with_all_that_is_before_it():
    orders, names = orders_of(model(*(task(f"t{n}", 10, version("v", 1)) for n in range(8))))
    orders.learn([_Refused(6, {})])
    assert in_order(orders, names) == "t0 t1 t2 t6 t3 t4 t5 t7"
    orders.learn([_Refused(7, {}), _Refused(6, {})])
    assert in_order(orders, names) == "t0 t6 t1 t2 t7 t3 t4 t5"
    rows = [task(f"t{n}", 10, version("v", 1, "u1", *([after("t6", 0, 9)] if n == 7 else []))) for n in range(8)]
    orders, names = orders_of(model(*rows))
    before = in_order(orders, names).split()
    orders.learn([_Refused(5, {})])
    orders.learn([_Refused(7, {})])
    assert before.index("t6") < before.index("t7")
    assert in_order(orders, names).split().index("t6") < in_order(orders, names).split().index("t7")


def test_chains_that_took_too_long_begin_later_within_their_period():
    orders, _ = orders_of(model(task("a", 10, version("v", 1)), task("b", 20, version("v", 1))))
    orders.learn([_Refused(1, {0: 4})])
    orders.learn([_Refused(1, {0: 3, 1: 25})])
    assert orders.delay == {0: 7, 1: 5}
    orders.learn([_Refused(1, {0: 4})])
    assert orders.delay == {0: 1, 1: 5}


@pytest.mark.parametrize(
    ("begins", "limits", "late"),
    [
        ({0: 3}, (9, 15), {0: 20 + 4 - 3 - 15}),  # the larger limit; it has to begin so much later
        ({0: 3}, (19, None), {0: 4}),  # at least by what the task takes
        ({}, (9, None), {}),
    ],
)
def test_a_chain_that_takes_too_long_begins_later_by_the_excess_or_the_length_of_the_task(begins, limits, late):
    names = [task(name, 40, version("v", wcet)) for name, wcet in (("a", 1), ("b", 2), ("c", 4))]
    fixed = task("fixed", 40, version("v", 1), offset=0)
    reaction, age = limits
    system = model(
        *names, fixed, chains=[chain("c", "a b c", reaction, age), chain("d", "c b", 5), chain("e", "fixed c", 5)]
    )
    problem, state = state_of(system)
    table = _Table(problem.arrays, state, _Orders.of(problem.arrays), None)
    table.begins.update(begins | {3: 0})
    assert table._lateness(2, 20) == late


def test_levels_count_the_periods_that_divide_each_other():
    assert _levels([2, 3, 4, 6, 12, 25]) == {2: 1, 3: 1, 4: 2, 6: 2, 12: 3, 25: 1}
