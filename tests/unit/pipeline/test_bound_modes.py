"""Tasks bound in the whole system whose modes have unlike versions: one set of units that serves in every mode."""

from dataclasses import replace

import pytest

import halpipe
from halpipe.models import Interrupt, Mode, Run, Split, Task, TaskModel, Unit, Version
from halpipe.pipeline.solve.schedule import SearchOptions, _fitting, schedule_model


def model(first, second, *versions, split=False):
    cut = Split(anywhere=True, max_gaps=1) if split else Split()
    task = Task(
        name="b", period="6ms", slack=1, versions=tuple(replace(v, split=cut) for v in versions), binding="system"
    )
    runs = (("A", first), ("B", second))
    modes = tuple(Mode(name=name, runs=(Run(task="b", versions=tuple(words.split())),)) for name, words in runs)
    return TaskModel(name="m", units=tuple(Unit(name=f"u{n}") for n in range(3)), tasks=(task,), modes=modes)


def version(name, units, gang=1):
    return Version(name=name, wcet="1ms", units=tuple(units.split()), gang=gang)


ANY, PAIR = version("v", "u0 u1 u2"), version("v", "u0 u1 u2", 2)


@pytest.mark.parametrize("split", [False, True])
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("first", "second", "versions"),
    [
        ("v", "w", (ANY, version("w", "u1"))),
        ("v w", "w", (ANY, version("w", "u1"))),
        ("w", "v", (ANY, version("w", "u1"))),
        ("v w", "v w", (ANY, version("w", "u1"))),
        ("v", "w", (PAIR, version("w", "u1 u2", 2))),
        ("v", "v w", (PAIR, version("w", "u1 u2"))),
        ("v w", "w", (PAIR, version("w", "u1 u2"))),
        ("v", "w x", (PAIR, version("w", "u0 u1", 2), version("x", "u1 u2", 2))),
    ],
)
def test_a_set_of_units_serves_in_both_modes(first, second, versions, seed, split):
    found = halpipe.schedule(model(first, second, *versions, split=split), seed=seed, budget=300)
    assert len({frozenset(job.units) for mode in found.modes for job in mode.jobs}) == 1


def test_one_mode_may_use_any_version():
    wide = model("v w", "v w", version("v", "u0 u1", 2), version("w", "u1 u2", 2))
    alone = replace(wide, modes=wide.modes[:1])
    assert {
        frozenset(job.units)
        for seed in range(8)
        for mode in halpipe.schedule(alone, seed=seed, budget=300).modes
        for job in mode.jobs
    } == {frozenset(("u0", "u1")), frozenset(("u1", "u2"))}


@pytest.mark.parametrize("seed", range(4))
def test_jobs_that_have_shipped_in_a_later_mode_decide(seed):
    both = model("v", "v", ANY)
    shipped = halpipe.schedule(both, modes=["B"], seed=seed)
    found = halpipe.schedule(both, freeze=shipped, seed=seed + 1, budget=300)
    assert {job.units for mode in found.modes for job in mode.jobs} == {shipped.modes[0].jobs[0].units}


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("length", ["3ms", "5ms"])  # with the interrupts of u0, 4 and 7 ms
def test_the_units_serve_in_time_in_every_mode(seed, length):
    long = replace(version("w", "u0 u1"), wcet=length)
    two = model("v", "w", version("v", "u0 u1"), long)
    busy = Unit(name="u0", interrupts=(Interrupt(name="i", distance="4ms", wcet="1ms"),))
    found = halpipe.schedule(replace(two, units=(busy, *two.units[1:])), seed=seed, budget=300)
    assert len({job.units for mode in found.modes for job in mode.jobs}) == 1


@pytest.mark.parametrize(
    ("changes", "units"),
    [
        ({"deadline": "8ms"}, "u1 u2"),
        ({"deadline": "7999us"}, "u1"),
        ({"period": "8ms"}, "u1 u2"),
        ({"period": "7ms"}, "u1"),
        ({"distance": "28ms"}, "u1 u2"),  # 8 ms from one start to the end of the next, after 20 ms
        ({"distance": "30ms", "deadline": "27ms"}, "u1"),
        ({"distance": "26ms", "deadline": "28ms"}, "u1 u2"),
        ({"let": "8ms"}, "u1 u2"),
        ({"let": "7ms"}, "u1"),
        ({"let": "9ms", "deadline": "7ms"}, "u1"),
        ({"let": "7ms", "deadline": "9ms"}, "u1"),
        ({"deadline": "4ms"}, "u1 u2"),  # where none serves in time, another finding says so
        ({"period": None}, "u1 u2"),
    ],
)
def test_a_unit_serves_where_a_job_ends_in_time_with_its_interrupts(changes, units):
    """Of 5 ms: with 3 ms of interrupts in each 10 ms, on u2 it takes 8 ms."""
    stated = replace(version("v", "u1 u2"), wcet="5ms")
    task = Task(**{"name": "b", "period": "20ms", "versions": (stated,), "slack": 1} | changes)
    busy = Unit(name="u2", interrupts=(Interrupt(name="i", distance="10ms", wcet="3ms"),))
    found = _fitting(task, task.versions[0], {"u1": Unit(name="u1"), "u2": busy})
    assert found == replace(task.versions[0], units=tuple(units.split()))


def test_attempts_take_the_sets_of_a_gang_in_turn():
    """Three pairs serve in both modes; the second search from seed 1 takes the third of them."""
    pairs = [version(name, units, 2) for name, units in (("w", "u0 u1"), ("x", "u1 u2"), ("y", "u0 u2"))]
    both = model("v", "w x y", PAIR, *pairs)
    found = {
        (seed, attempt): {frozenset(job.units) for table in tables for job in table.jobs}
        for seed, attempt in ((0, 0), (1, 0), (1, 1), (0, 2), (3, 0))
        for tables in [schedule_model(both, SearchOptions(seed=seed, attempt=attempt, budget=50), lambda *_: True)
                       .schedule.modes]
    }  # fmt: skip
    sets = [{frozenset(pair)} for pair in (("u0", "u1"), ("u0", "u2"), ("u1", "u2"))]
    assert found == {(0, 0): sets[0], (1, 0): sets[1], (1, 1): sets[2], (0, 2): sets[2], (3, 0): sets[0]}
