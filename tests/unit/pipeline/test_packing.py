"""Packing: what is bin packing is filled to the last tick, what is not is left to others."""

from dataclasses import replace
from itertools import pairwise

import pytest

from halpipe.bench.families import PerfectFit
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.draws import Draws
from halpipe.pipeline.solve.packing import fill, pack
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.solve.workers import Workers
from support import access, after, chain, model, task, version


def go_on(*progress):
    return True


def packed(system):
    return pack(system, expand(system, system.modes[0]), 1, 50, go_on)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("units", "tasks"), [(3, 6), (8, 4), (12, 4), (12, 5)])
def test_perfect_fits_are_filled_to_the_last_tick(units, tasks, seed):
    system = PerfectFit(units=units, tasks=tasks).draw(seed)
    jobs = packed(system)
    assert jobs is not None
    for unit in system.units:
        own = sorted((job.start, job.end) for job in jobs if job.units == (unit.name,))
        assert own[0][0].ns == 0
        assert own[-1][1] == system.tasks[0].period
        assert all(end == start for (_, end), (start, _) in pairwise(own))


def test_the_command_says_that_packing_answered():
    system = PerfectFit(units=12, tasks=4).draw(7)
    found = [schedule_model(system, SearchOptions(workers=Workers(workers)), go_on) for workers in (1, 2, 8)]
    assert found[0].is_complete
    assert found[0].schedule == found[1].schedule == found[2].schedule
    assert found[0].schedule.solver == "packing"


def test_units_of_two_kinds_are_packed_apart():
    first = [task(f"a{n}", 10, version("v", c, "u1 u2")) for n, c in enumerate((6, 4, 7, 3))]
    second = [task(f"b{n}", 10, version("v", c, "v1")) for n, c in enumerate((9, 1))]
    jobs = packed(model(*first, *second, units="u1 u2 v1"))
    assert jobs is not None
    assert {job.task[0] for job in jobs if job.units == ("v1",)} == {"b"}


BESIDE = version("v", 4, "u1 u2")


@pytest.mark.parametrize(
    "other",
    [
        task("b", 5, version("v", 1, "u1 u2")),
        task("b", 10, version("v", 4, "u1 u2", after("a", 0, 5))),
        task("b", 10, version("v", 4, "u1 u2", access("mem", 0, 4, 1))),
        task("b", 10, version("v", 4, "u1 u2", gang=2)),
        task("b", 10, version("v", 4, "u1 u2"), offset=3),
        task("b", 10, version("v", 4, "u1")),
        task("b", 10, version("v", 4, "u1 u2"), version("w", 5, "u1 u2")),
    ],
    ids=["period", "window", "access", "gang", "offset", "units", "versions"],
)
def test_what_minds_others_is_no_bin_packing(other):
    system = model(task("a", 10, BESIDE), other, units="u1 u2", resources="mem")
    assert packed(system) is None


def test_chains_are_no_bin_packing():
    system = model(task("a", 10, BESIDE), task("b", 10, BESIDE), units="u1 u2")
    assert packed(system) is not None
    assert packed(replace(system, chains=(chain("c", "a b", age=20),))) is None


@pytest.mark.parametrize(("lengths", "fits"), [((6, 4, 7, 3), True), ((7, 7, 6), False), ((6, 6, 4, 3), True)])
def test_bins_hold_no_more_than_they_can(lengths, fits):
    bins = fill(lengths, 2, 10, Draws(1), 20, go_on)
    assert (bins is not None) == fits
    if bins is not None:
        assert sorted(item for held in bins for item in held) == list(range(len(lengths)))
        assert all(sum(lengths[item] for item in held) <= 10 for held in bins)


def test_it_stops_when_nobody_wants_more():
    asked = []
    assert fill((7, 7, 5), 2, 10, Draws(1), 20, lambda: bool(asked.append(1))) is None
    assert len(asked) == 1
