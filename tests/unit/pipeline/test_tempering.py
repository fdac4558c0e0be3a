"""Replicas: temperatures change hands as a heat bath says, and a search of them can stop and go on anywhere."""

import math
import random
from array import array
from itertools import islice

import pytest

from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.kernel import portfolio, tempering
from halpipe.pipeline.solve.kernel import run_in_slices as kernel_slices
from halpipe.pipeline.solve.kernel.portfolio import race
from halpipe.pipeline.solve.kernel.run_in_slices import Kept
from halpipe.pipeline.solve.kernel.state import BEST, COST, HEAT, MOVES, new_state
from halpipe.pipeline.solve.kernel.tempering import LADDER, Replicas, _changes
from halpipe.pipeline.solve.problem import build_problem
from halpipe.pipeline.solve.relay import Memory, turns
from halpipe.pipeline.solve.workers import Workers
from support import access, model, task, version

UNITS = "u1 u2 u3"
TASKS = 36


@pytest.fixture(scope="module")
def problem():
    """Three units of 76 with 36 tasks: full, and a resource on which half of them take turns."""
    wcets = [3, 4, 5, 6, 7, 7, 8, 9, 6, 7, 8, 6] * 3
    tasks = [
        task(f"t{n}", 76, version("v", wcet, UNITS, *([access("mem", 0, 2)] if n % 2 == 0 else [])))
        for n, wcet in enumerate(wcets)
    ]
    system = model(*tasks, units=UNITS, resources="mem")
    return build_problem(expand(system, system.modes[0]), system.units, ["mem"], [])


@pytest.fixture(autouse=True)
def short_turns(monkeypatch):
    """Let replicas begin after some moves, and their turns be short."""
    monkeypatch.setattr(portfolio, "LEAD", 2)
    monkeypatch.setattr(portfolio, "TURN", 1)
    monkeypatch.setattr(portfolio, "LONG", 4)
    monkeypatch.setattr(tempering, "TURN", 2)
    monkeypatch.setattr(kernel_slices, "SLICE_WORK", 200)


def run(problem, seed, workers=1, budget=400_000, on_slice=lambda *_: True, kept=None, members=4):
    def begin(member):
        return new_state(problem.arrays, 1000 * seed + member, problem.mean_wcet)

    return race(problem, begin, budget, members, Workers(workers), on_slice, kept)


def facts(found):
    return found.moves, found.stopped, found.state.start.tolist(), found.state.option.tolist()


BEFORE = (2 + 2 + 4) * TASKS
"""Moves that the searches make before they are replicas."""


@pytest.mark.parametrize("seed", range(1, 7))
def test_any_number_of_threads_comes_to_the_same(problem, seed):
    first, second, many = (run(problem, seed, workers) for workers in (1, 2, 6))
    assert first.state.register[BEST] == 0
    assert facts(first) == facts(second) == facts(many)


def test_some_of_these_seeds_are_found_by_replicas(problem):
    assert sum(run(problem, seed).moves > 2 * BEFORE for seed in range(1, 7)) >= 3


@pytest.mark.parametrize("members", [2, 4, 8, 10])
def test_there_are_as_many_as_temperatures(problem, members):
    seen = []

    class Spy(Replicas):
        def __init__(self, states, kept):
            super().__init__(states, kept)
            seen.append([state.register[HEAT] for state in states])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tempering, "Replicas", Spy)
        run(problem, 3, budget=BEFORE * 8, members=members)
    assert [len(set(heats)) for heats in seen] == [len(LADDER)]


class Snapshots(Memory):
    """A keeper that saves every time it may, as one on disk does when it is time."""

    def keep(self, key, state, *, now):
        super().keep(key, state, now=True)


@pytest.mark.parametrize("stop_at", [3, 40, 90, 150, 400])
@pytest.mark.parametrize("seed", [2, 5])
def test_stopped_anywhere_it_goes_on_to_the_same(problem, seed, stop_at):
    whole = run(problem, seed)
    keeper, calls = Snapshots(), []

    def stop(moves, best):
        calls.append(moves)
        return len(calls) < stop_at

    run(problem, seed, on_slice=stop, kept=Kept(keeper, "mode"))
    assert facts(run(problem, seed, kept=Kept(keeper, "mode"))) == facts(whole)


def test_in_rounds_of_more_and_more_moves_it_comes_to_the_same(problem):
    for seed in range(1, 7):
        whole = run(problem, seed)
        keeper = Memory()
        for budget in (500, 2000, 3001, 9000, 400_000):
            found = run(problem, seed, budget=budget, kept=Kept(keeper, "mode"))
            assert found.moves <= budget
            if found.state.register[BEST] == 0:
                break
        assert facts(found) == facts(whole)


def test_temperatures_change_hands_and_none_is_lost(problem):
    states = [new_state(problem.arrays, seed, problem.mean_wcet) for seed in range(len(LADDER))]
    replicas = Replicas(states, None)
    before = [state.register[HEAT] for state in states]
    rng = random.Random(1)
    orders = set()
    for _ in range(200):
        for state in states:
            state.register[COST] = rng.randrange(4 * before[0] >> 10, 8 * before[-1] >> 10)
            state.random[0] = rng.getrandbits(64)
        replicas.change_places()
        now = tuple(state.register[HEAT] for state in states)
        assert sorted(now) == sorted(before)
        orders.add(now)
    assert len(orders) > 50


@pytest.mark.parametrize("gain", [-3.0, -1.0, 0.0, 0.5, 2.0])
def test_two_change_places_as_often_as_a_heat_bath_says(gain):
    cold, hot = 4000, 6000
    costs = round(gain / (1024 / cold - 1024 / hot)), 0
    one, other = array("q", [0] * 16), array("q", [0] * 16)
    one[HEAT], other[HEAT], one[COST], other[COST] = cold, hot, *costs
    exact = (costs[0] - costs[1]) * (1024 / cold - 1024 / hot)
    rng = random.Random(5)
    changed = sum(_changes(one, other, rng.getrandbits(64)) for _ in range(20_000)) / 20_000
    assert abs(changed - 1 / (1 + math.exp(-exact))) < 0.015


def test_moves_are_those_of_all(problem):
    states = [new_state(problem.arrays, seed, problem.mean_wcet) for seed in range(len(LADDER))]
    for number, state in enumerate(states):
        state.register[MOVES] = number
    assert Replicas(states, None).moves == list(range(len(LADDER)))


def test_the_exact_engine_gets_less_of_many_jobs():
    """A deterministic second takes longer there: of 160 jobs, twenty times as long as the annealer's turn."""
    few, many = (list(islice(turns(1_600_000, 10**12, jobs), 4)) for jobs in (50, 160))
    assert [turn.work for turn in few] == [0, 1, 4, 16]
    assert [turn.moves for turn in few] == [turn.moves for turn in many] == [25_000, 100_000, 400_000, 1_600_000]
    assert [turn.work for turn in many] == [work * (50 / 160) ** 2 for work in (0, 1, 4, 16)]
