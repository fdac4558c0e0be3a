"""Tasks bound in the whole system whose modes have unlike versions: one set of units that serves in every mode."""

from dataclasses import replace

import pytest

import halpipe
from halpipe.models import Interrupt, Mode, Run, Split, Task, TaskModel, Unit, Version


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
