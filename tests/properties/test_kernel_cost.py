"""The kernel's running cost is the cost of what it holds, and the cost that the reference finds in it."""

from bisect import bisect_right
from collections import Counter, defaultdict
from fractions import Fraction
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scheduler_systems import random_problem

from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.cost import cost_terms
from halpipe.pipeline.measure.placement import Placement
from halpipe.pipeline.solve.integers import Table, filled, ints
from halpipe.pipeline.solve.kernel.assign_units import deal_anyhow
from halpipe.pipeline.solve.kernel.kernel import (
    BEST,
    COST,
    CYCLE_LEFT,
    INSERTED,
    anneal,
    gumbel_table,
    load,
    new_state,
    total_cost,
)
from halpipe.pipeline.solve.kernel.warmstart import named_jobs
from halpipe.pipeline.solve.problem import build_problem
from kernel_moves import luby, move, move_swap, next_temperature, restart
from profiles import examples, volume
from support import after, chain, model, task, version

SEEDS = st.integers(0, 2**32)
FAST = examples(120)
NOISE = gumbel_table()


def walk(problem, seed, moves):
    """Yield the state after each of `moves` moves; unlike the search, go on where the cost is zero."""
    state = new_state(problem.arrays, seed, problem.mean_wcet)
    for _ in range(moves if len(problem.arrays.entry_offset) else 0):
        next_temperature(problem.arrays, state)
        move(problem.arrays, state, NOISE)
        yield state


def is_complete(problem, state):
    return state.register[INSERTED] == len(problem.arrays.entry_offset)


def rectangles(problem, state):
    """Yield lane, begin, length and height of everything placed, with job and number of the rectangle."""
    arrays = problem.arrays
    for job in (job for job, start in enumerate(state.start) if start >= 0):
        first, last = arrays.rect_first[state.option[job] : state.option[job] + 2]
        for number, (lane, offset, length, height) in enumerate(arrays.rect.rows(first, last)):
            yield lane, state.start[job] + offset, length, height, job, number


def check_profiles(problem, state):
    """Every lane's profile is the sum of what lies on it, tick by tick, and its owners are those who lie on it."""
    arrays = problem.arrays
    load_of, owners = Counter(), defaultdict(set)
    for lane, begin, length, height, job, number in rectangles(problem, state):
        owners[lane].add((begin % arrays.hyperperiod, length, job, number))
        for time in range(begin, begin + length):
            load_of[lane, time % arrays.hyperperiod] += height
    for lane in range(len(arrays.lane_capacity)):
        base, count = arrays.lane_first[lane], state.edges[lane]
        edges, levels = zip(*Table(state.step, 2).rows(base, base + count + 1), strict=True)  # and the sentinel
        assert edges[0] == 0
        assert edges[-1] == arrays.hyperperiod
        spans = [end - begin for begin, end in pairwise(edges)]
        assert all(span > 0 for span in spans)
        profile = [level for level, span in zip(levels[:-1], spans, strict=True) for _ in range(span)]
        assert profile == [load_of[lane, time] for time in range(arrays.hyperperiod)]
        assert base + count < arrays.lane_first[lane + 1]
        guide = state.guide[arrays.guide_first[lane] : arrays.guide_first[lane + 1]]
        begins = [stretch << arrays.guide_shift[lane] for stretch in range(len(guide))]
        assert begins[-1] < arrays.hyperperiod <= begins[-1] + (1 << arrays.guide_shift[lane])
        assert guide.tolist() == [bisect_right(edges, begin) - 1 for begin in begins]
        place = arrays.owner_first[lane]
        held = list(Table(state.owner, 3).rows(place, place + state.owners[lane]))
        assert len(held) == len(owners[lane])
        assert {(begin, length, *divmod(mark, state.max_rects)) for begin, length, mark in held} == owners[lane]


def check_phases(problem, state):
    """Starts follow from phases, and the jobs of a task have a common phase within slack, deadline and offset."""
    arrays = problem.arrays
    for owner in range(len(arrays.task_period)):
        jobs = [j for j in range(arrays.task_job[owner], arrays.task_job[owner + 1]) if state.start[j] >= 0]
        for number, job in enumerate(jobs):
            assert arrays.task_option[owner] <= state.option[job] < arrays.task_option[owner + 1]
            shift = number * arrays.task_period[owner] if arrays.task_cyclic[owner] else 0
            assert state.start[job] == (state.phase[job] + shift) % arrays.hyperperiod
        if not arrays.task_cyclic[owner] or not jobs:
            continue
        earliest = max(state.phase[job] - arrays.option_late[state.option[job]] for job in jobs)
        latest = min(state.phase[job] for job in jobs)
        offset = arrays.entry_offset[arrays.job_entry[jobs[0]]]
        assert earliest <= latest
        assert offset < 0 or earliest <= offset <= latest


def dealt_jobs(problem, start, option):
    return list(named_jobs(problem, start, option, deal_anyhow(problem, start, option)))


def access_cost(problem, placement):
    """Return the cost of overloads, weighted as the kernel weighs them, and their integral; tick by tick."""
    arrays = problem.arrays
    names = dict.fromkeys(
        a.resource for active in problem.expansion.tasks for version in active.task.versions for a in version.accesses
    )
    order = {"r": len(problem.groups), "s": len(problem.groups) + 1}
    cost, integral = Fraction(0), Fraction(0)
    for name in names:
        claims = [Fraction(0)] * placement.hyperperiod
        for job in placement.jobs:
            for a in (a for a in job.version.accesses if a.resource == name):
                for time in range(a.start // placement.tick, a.end // placement.tick):
                    claims[(job.start + time) % placement.hyperperiod] += a.bound
        excess = sum((max(Fraction(0), claim - 1) for claim in claims), Fraction(0))
        lane = order[name]
        integral += excess
        cost += excess * int(arrays.lane_capacity[lane]) * int(arrays.lane_weight[lane])
    return cost, integral


def reference_cost(system, problem, start, option):
    """Return the reference cost in the kernel's weights; lanes are single units."""
    placement = Placement.of(problem.expansion, dealt_jobs(problem, start, option))
    terms = cost_terms(system, placement)
    assert placement.tick == problem.tick or problem.tick // placement.tick >= 1
    assert terms.unit == 0
    access, integral = access_cost(problem, placement)
    assert terms.access == integral
    scale = problem.tick // placement.tick
    arrays = problem.arrays
    weighted = int(arrays.lane_weight[0]) * terms.overlap + int(arrays.unit_weight) * terms.precedence
    return (access + weighted) / scale, terms


@FAST
@given(SEEDS, st.booleans())
def test_the_running_cost_is_the_cost_of_the_placement_after_every_move(seed, grouped):
    _, problem = random_problem(seed, grouped=grouped)
    for state in walk(problem, seed, 80):
        assert state.register[COST] == total_cost(problem.arrays, state)
        check_phases(problem, state)


@FAST
@given(SEEDS, st.booleans())
def test_the_running_cost_is_that_of_the_placement_after_entries_have_changed_places(seed, grouped):
    _, problem = random_problem(seed, grouped=grouped)
    entries = len(problem.arrays.entry_offset)
    for number, state in enumerate(walk(problem, seed, entries + 40)):
        if is_complete(problem, state):
            move_swap(problem.arrays, state, NOISE, number % entries)
            assert state.register[COST] == total_cost(problem.arrays, state)
            check_phases(problem, state)
            check_profiles(problem, state)


@FAST
@given(SEEDS, st.booleans())
def test_profiles_hold_what_is_placed(seed, grouped):
    _, problem = random_problem(seed, grouped=grouped)
    for number, state in enumerate(walk(problem, seed, 60)):
        if number % 6 == 5:
            check_profiles(problem, state)


@FAST
@given(SEEDS)
def test_the_kernel_and_the_reference_agree_on_the_cost(seed):
    system, problem = random_problem(seed, grouped=False)
    for number, state in enumerate(walk(problem, seed, 60)):
        if is_complete(problem, state) and number % 8 == 0:
            expected, terms = reference_cost(system, problem, state.start, state.option)
            assert state.register[COST] == expected
            assert (state.register[COST] == 0) == (terms.total <= 0)


@examples(60)
@given(SEEDS)
def test_the_best_placement_has_the_best_cost(seed):
    system, problem = random_problem(seed, grouped=False)
    costs = [int(state.register[COST]) for state in walk(problem, seed, 70) if is_complete(problem, state)]
    for state in list(walk(problem, seed, 70))[-1:]:
        if is_complete(problem, state):
            assert state.register[BEST] == min(costs)
            assert reference_cost(system, problem, state.best_start, state.best_option)[0] == min(costs)


@examples(40)
@given(SEEDS)
def test_a_placement_that_is_loaded_costs_what_it_cost(seed):
    _, problem = random_problem(seed, grouped=True)
    for state in list(walk(problem, seed, 40))[-1:]:
        if is_complete(problem, state):
            fresh = new_state(problem.arrays, seed + 1, problem.mean_wcet)
            for name in ("start", "option", "phase"):
                getattr(fresh, name)[:] = getattr(state, name)
            assert load(problem.arrays, fresh) == state.register[COST] == fresh.register[BEST]
            check_profiles(problem, fresh)
            assert fresh.best_start.tolist() == state.start.tolist()


@examples(40)
@given(SEEDS)
def test_a_restart_leaves_nothing_and_goes_on_with_the_right_cost(seed):
    _, problem = random_problem(seed, grouped=True)
    for state in list(walk(problem, seed, 40))[-1:]:
        restart(problem.arrays, state)
        assert state.register[COST] == total_cost(problem.arrays, state)
        assert (state.register[INSERTED], max(state.start)) == (0, -1)
        check_profiles(problem, state)
        for _ in range(40):
            next_temperature(problem.arrays, state)
            move(problem.arrays, state, NOISE)
            assert state.register[COST] == total_cost(problem.arrays, state)
        check_profiles(problem, state)
        check_phases(problem, state)


def test_costs_hold_through_cycles_and_their_restarts():
    """What has no schedule is searched for long enough for restarts to happen by themselves."""
    system = model(*(task(f"t{n}", 10, version("v", 1)) for n in range(11)))
    problem = build_problem(expand(system, system.modes[0]), system.units, [])
    state = new_state(problem.arrays, 1, problem.mean_wcet)
    restarts = 0
    for _ in range(20):
        anneal(problem.arrays, state, NOISE, max(1, int(state.register[CYCLE_LEFT])))
        assert state.register[COST] == total_cost(problem.arrays, state)
        anneal(problem.arrays, state, NOISE, 1)
        restarts += state.register[INSERTED] == 1
        assert state.register[COST] == total_cost(problem.arrays, state)
    assert 0 < restarts < 20
    check_profiles(problem, state)


@pytest.mark.slow
def test_many_linked_tasks_are_built_up_anew_in_each_cycle_and_cycles_get_longer():
    """Where tasks were before is tried first in a few cycles, and then no more."""
    tasks = [task("t0", 40, version("v", 1))]
    tasks += [task(f"t{n}", 40, version("v", 2, "u1", after(f"t{n - 1}", 0, 4))) for n in range(1, 40)]
    system = model(*tasks)
    problem = build_problem(expand(system, system.modes[0]), system.units, [])
    state = new_state(problem.arrays, 1, problem.mean_wcet)
    state.hint[:] = filled(len(state.hint), 7)
    lengths, hinted = [], []
    for _ in range(20):
        anneal(problem.arrays, state, NOISE, 1)
        assert state.register[INSERTED] == 1
        left = int(state.register[CYCLE_LEFT])
        anneal(problem.arrays, state, NOISE, left)
        lengths.append(1 + left)
        assert state.register[COST] == total_cost(problem.arrays, state)
        hinted.append(set(state.hint) == {7})
        assert hinted[-1] or max(state.hint) == -1
    assert [length // 40 for length in lengths] == [20, 40, 80, 160] + [300] * 11 + [600] * 5
    assert hinted == [True] * 4 + [False] * 16
    check_profiles(problem, state)


def test_cycles_follow_lubys_sequence():
    """The n-th term is 2^(k-1) for n = 2^k - 1, else the term at n - 2^(k-1) + 1 (Luby, Sinclair, Zuckerman 1993)."""
    assert [luby(n) for n in range(1, 16)] == [1, 1, 2, 1, 1, 2, 4, 1, 1, 2, 1, 1, 2, 4, 8]


def test_of_jobs_that_end_together_the_one_started_later_is_newer():
    """The long job of a starts at 2 and the short one at 5; both end at 6, and b reads at 6 what is 1 ms old."""
    system = model(
        task("a", 6, version("long", 4, "u1"), version("short", 1, "u2"), slack=1, deadline=12),
        task("b", 12, version("v", 1, "u3")),
        units="u1 u2 u3",
        chains=[chain("c", "a b", age=2)],
    )
    problem = build_problem(expand(system, system.modes[0]), system.units, [], system.chains)
    state = new_state(problem.arrays, 1, problem.mean_wcet)
    state.start[:] = ints([2, 5, 6])
    state.option[:] = ints([0, 1, 2])
    state.phase[:] = ints([2, -1, 6])
    assert load(problem.arrays, state) == 0


@pytest.mark.slow
@pytest.mark.parametrize("grouped", [True, False])
def test_costs_at_length(grouped):
    @examples(volume(120))
    @given(SEEDS)
    def check(seed):
        system, problem = random_problem(seed, grouped=grouped)
        for number, state in enumerate(walk(problem, seed, 200)):
            assert state.register[COST] == total_cost(problem.arrays, state)
            if number % 10 == 0:
                check_phases(problem, state)
                check_profiles(problem, state)
                if not grouped and is_complete(problem, state):
                    assert state.register[COST] == reference_cost(system, problem, state.start, state.option)[0]

    check()
