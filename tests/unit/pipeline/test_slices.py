"""Searches in slices: the outcome depends on the moves alone, not on threads, slices or a stop on the way."""

import re
from pathlib import Path
from types import SimpleNamespace

import pytest

from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.kernel import kernel, slices
from halpipe.pipeline.solve.kernel.kernel import BEST, MOVES, new_state
from halpipe.pipeline.solve.kernel.slices import run
from halpipe.pipeline.solve.problem import build_problem
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.solve.workers import Workers
from support import access, mode, model, task, version

UNITS = "u1 u2 u3"


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
def short_slices(monkeypatch):
    """Come back after a handful of moves."""
    monkeypatch.setattr(slices, "SLICE_WORK", 200)


def facts(state):
    return state.register[MOVES], state.register[BEST], state.start.tolist(), state.option.tolist()


@pytest.mark.parametrize("stop_at", [3, 40, 90, 150, 400])
@pytest.mark.parametrize("seed", [2, 5])
def test_stopped_anywhere_it_continues_to_the_same(problem, seed, stop_at):
    whole, parts = (new_state(problem.arrays, seed, problem.mean_wcet) for _ in range(2))
    assert not run(problem.arrays, whole, 40_000, lambda *_: True)
    assert whole.register[BEST] == 0
    calls = []

    def stop(moves, best):
        calls.append(moves)
        return len(calls) < stop_at

    is_stopped = run(problem.arrays, parts, 40_000, stop)
    assert is_stopped == (len(calls) == stop_at)
    run(problem.arrays, parts, 40_000, lambda *_: True)
    assert facts(parts) == facts(whole)


def test_a_search_ends_with_its_budget():
    hopeless = tight_model(idle=-2)
    full = build_problem(expand(hopeless, hopeless.modes[0]), hopeless.units, ["mem"], [])
    state = new_state(full.arrays, 1, full.mean_wcet)
    assert not run(full.arrays, state, 1000, lambda *_: True)
    assert state.register[BEST] > 0
    assert state.register[MOVES] == 1000


def test_a_search_is_kept_when_it_is_due_and_for_certain_at_its_end(problem):
    told = []
    kept = SimpleNamespace(keep=lambda state, *, now: told.append((now, state.register[MOVES])))
    state = new_state(problem.arrays, 2, problem.mean_wcet)
    run(problem.arrays, state, 40_000, lambda *_: len(told) < 3, kept)
    moves = [made for _, made in told]
    assert [now for now, _ in told] == [False] * 4 + [True]
    assert moves == sorted(moves)
    assert moves[-1] == state.register[MOVES] > moves[0]


@pytest.mark.slow
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
    modes = _Modes(system, expansions, SearchOptions(), lambda *_: True, common={})
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


def test_the_library_knows_the_parts_of_the_search_by_the_same_bits():
    header = Path(kernel.__file__).with_name("native") / "arrays.h"
    bits = {name: 1 << int(bit) for name, bit in re.findall(r"([A-Z_]+) = 1 << ([0-9]+)", header.read_text())}
    assert {part.name: part.value for part in kernel.Part} == bits


def test_a_state_is_kept_after_each_slice_where_it_is_due_and_at_the_end_at_once(problem):
    state, moments, made = new_state(problem.arrays, 2, problem.mean_wcet), [], []
    keeper = SimpleNamespace(keep=lambda kept, now: moments.append((kept is state, now)))
    assert run(problem.arrays, state, 40_000, lambda *done: made.append(done) or len(made) < 3, keeper)
    assert moments == [(True, False)] * 3 + [(True, True)]
