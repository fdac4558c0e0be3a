"""Searches that take turns: who wins depends on the moves alone, not on threads, slices or a stop on the way."""

import operator

import pytest

from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.kernel import portfolio
from halpipe.pipeline.solve.kernel.kernel import BEST, MOVES, new_state
from halpipe.pipeline.solve.kernel.portfolio import Kept, race
from halpipe.pipeline.solve.problem import build_problem
from halpipe.pipeline.solve.relay import Memory
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.solve.workers import Workers
from support import access, mode, model, task, version

UNITS = "u1 u2 u3"


TASKS = 21


def tight_model(idle=0):
    """Three units without a gap, filled by tasks of six lengths: takes a search some hundred moves."""
    wcets = [3, 4, 5, 6, 7, 7, 8] * 3
    wcets[0] -= idle
    tasks = [
        task(f"t{n}", 40, version("v", wcet, UNITS, *([access("mem", 0, 1)] if n % 2 == 0 else [])))
        for n, wcet in enumerate(wcets)
    ]
    return model(*tasks, units=UNITS, resources="mem")


@pytest.fixture
def problem():
    system = tight_model()
    return build_problem(expand(system, system.modes[0]), system.units, ["mem"], [])


@pytest.fixture(autouse=True)
def short_turns(monkeypatch):
    """Let the others begin after a handful of moves, and every turn be short."""
    monkeypatch.setattr(portfolio, "LEAD", 2)
    monkeypatch.setattr(portfolio, "TURN", 1)
    monkeypatch.setattr(portfolio, "SLICE_WORK", 200)


def run(problem, members=3, workers=1, seed=1, budget=40_000, on_slice=lambda *_: True, kept=None):
    def begin(member):
        return new_state(problem.arrays, 1000 * seed + member, problem.mean_wcet)

    return race(problem, begin, budget, members, Workers(workers), on_slice, kept)


@pytest.mark.parametrize("seed", range(1, 9))
def test_any_number_of_threads_comes_to_the_same(problem, seed):
    first, second, third = (run(problem, workers=count, seed=seed) for count in (1, 2, 3))
    assert first.state.register[BEST] == 0
    for other in (second, third):
        assert other.moves == first.moves
        assert other.state.start.tolist() == first.state.start.tolist()


@pytest.mark.parametrize("seed", range(1, 9))
def test_the_winner_is_the_first_by_turn_and_then_by_number(problem, seed):
    """Recomputed from what each search needs when it is alone."""
    needed = [run_alone(problem, 1000 * seed + member) for member in range(3)]
    bounds = [(2 * TASKS, 0, 0)]
    while not any(map(operator.ge, bounds[-1], needed)):
        bounds.append(tuple(bound + share * TASKS for bound, share in zip(bounds[-1], (2, 1, 1), strict=True)))
    winner = next(member for member in range(3) if bounds[-1][member] >= needed[member])
    expected = [bounds[-1 if member < winner else -2][member] for member in range(3)] if len(bounds) > 1 else [0, 0, 0]
    expected[winner] = needed[winner]
    result = run(problem, seed=seed)
    assert int(result.state.register[MOVES]) == needed[winner]
    assert result.moves == sum(expected)
    assert len(bounds) > 1, "a seed that decides something"


def run_alone(problem, seed):
    state = new_state(problem.arrays, seed, problem.mean_wcet)
    portfolio.run(problem, state, 10**6, lambda *_: True)
    return int(state.register[MOVES])


def test_the_budget_is_that_of_all_searches_together(problem):
    hopeless = tight_model(idle=-2)
    full = build_problem(expand(hopeless, hopeless.modes[0]), hopeless.units, ["mem"], [])
    result = run(full, budget=1000)
    assert result.state.register[BEST] > 0
    assert not result.stopped
    assert 1000 - 3 < result.moves <= 1000


def test_a_stop_ends_all_searches_and_returns_the_best(problem):
    told = []

    def stop(moves, best):
        told.append(moves)
        return len(told) < 4

    result = run(problem, budget=10**6, on_slice=stop, workers=2, seed=3)
    assert result.stopped
    assert result.state.register[BEST] > 0


def facts(found):
    return found.moves, found.stopped, found.state.start.tolist(), found.state.option.tolist()


class Snapshots(Memory):
    """A keeper that saves every time it may, as one on disk does when it is time."""

    def keep(self, key, state, *, now):
        super().keep(key, state, now=True)


@pytest.mark.parametrize("stop_at", [3, 40, 90, 150, 400])
@pytest.mark.parametrize("seed", [2, 5])
def test_stopped_anywhere_it_continues_to_the_same(problem, seed, stop_at):
    whole = run(problem, seed=seed)
    keeper, calls = Snapshots(), []

    def stop(moves, best):
        calls.append(moves)
        return len(calls) < stop_at

    run(problem, seed=seed, on_slice=stop, kept=Kept(keeper, "mode"))
    assert facts(run(problem, seed=seed, kept=Kept(keeper, "mode"))) == facts(whole)


@pytest.mark.parametrize("workers", [2, 4])
def test_modes_are_searched_at_the_same_time_with_the_same_result(workers):
    """Modes start from the placements of modes before, which some of them have to wait for."""
    tasks = list(tight_model(idle=2).tasks)
    modes = [mode("all", tasks), mode("few", tasks[:9]), mode("rest", tasks[9:]), mode("some", tasks[4:14])]
    extra = task("x", 20, version("v", 3, UNITS))
    modes += [mode("apart", [extra]), mode("both", [extra, *tasks[:5]])]
    system = model(*tasks, extra, units=UNITS, resources="mem", modes=modes)
    one = schedule_model(system, SearchOptions(seed=5, budget=4000), lambda *_: True)
    assert one.is_complete
    several = schedule_model(system, SearchOptions(seed=5, budget=4000, workers=Workers(workers)), lambda *_: True)
    assert several == one


def test_a_mode_starts_as_if_all_before_it_had_been_searched_in_order():
    """The order in which modes may be searched leaves nothing out that a mode would start from."""
    from halpipe.pipeline.solve.kernel.warmstart import Earlier
    from halpipe.pipeline.solve.schedule import _Modes

    short, long = task("a", 10, version("v", 2, "u1 u2")), task("b", 20, version("v", 3, "u1 u2"))
    other = task("c", 40, version("v", 4, "u1 u2"))
    names = {"m0": [short], "m1": [short, long], "m2": [other], "m3": [short, other], "m4": [short, long, other]}
    system = model(short, long, other, units="u1 u2", modes=[mode(name, tasks) for name, tasks in names.items()])
    expansions = [expand(system, each) for each in system.modes]
    modes = _Modes(system, expansions, SearchOptions(), lambda *_: True)
    found = modes.search()
    earlier = Earlier()
    for number, expansion in enumerate(expansions):
        tasks = {active.name: active.jobs for active in expansion.tasks}
        start = modes._start(number, found)
        assert start is not None
        assert {t: p for t, p in start.phases.items() if t in tasks} == {
            t: p for t, p in earlier.phases.items() if t in tasks
        }
        assert {(t, j): u for (t, j), u in start.units.items() if j < tasks.get(t, 0)} == {
            (t, j): u for (t, j), u in earlier.units.items() if j < tasks.get(t, 0)
        }
        earlier = earlier.and_then(expansion, found[number].table.jobs)
    assert modes._start(1, {}) is None, "waits for the first mode"
    assert modes._start(2, {}) is not None, "shares no task with the modes before"
    assert modes._start(3, {2: found[2]}) is None
