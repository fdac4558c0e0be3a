"""Packing: bins and boards are filled to the last tick, what is neither is left to others."""

from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from halpipe.bench.families import FINE, PerfectFit, Rectangles
from halpipe.models import ModeSchedule, Schedule, Status
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.draws import Draws
from halpipe.pipeline.solve.packing.bins import fill
from halpipe.pipeline.solve.packing.boards import MAX_RECTANGLES, fill_board
from halpipe.pipeline.solve.packing.modes import pack
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.solve.workers import Workers
from halpipe.pipeline.verify import verify
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
        task("b", 10, version("v", 4, "u1 u2"), offset=3),
        task("b", 10, version("v", 4, "u1")),
        task("b", 10, version("v", 4, "u1 u2"), version("w", 5, "u1 u2")),
    ],
    ids=["period", "window", "offset", "units", "versions"],
)
def test_what_minds_others_is_no_packing(other):
    system = model(task("a", 10, BESIDE), other, units="u1 u2", resources="mem")
    assert packed(system) is None


def test_what_two_things_are_contested_for_is_no_packing():
    both = [task(name, 10, version("v", 3, "u1 u2", access("mem", 0, 2, 1))) for name in "abc"]
    assert packed(model(*both, units="u1 u2", resources="mem")) is None
    assert packed(model(*both[:2], units="u1 u2", resources="mem")) is not None, "of units there are enough for two"


def test_chains_are_no_packing():
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


# ------------------------------------------------------------------------------------------------ boards


GANGS = Rectangles(tasks=24, height=8, is_gang=True)
SHARES = Rectangles(tasks=20, height=FINE, is_gang=False)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("family", [GANGS, SHARES], ids=["gangs", "shares"])
def test_boards_without_a_gap_are_filled(family, seed):
    """`schedule_model` holds every answer against verify."""
    found = schedule_model(family.draw(seed), SearchOptions(seed=seed), go_on)
    assert found.is_complete
    assert found.schedule.solver in ("packing", "anneal")


def test_a_board_that_the_annealer_does_not_find_has_the_same_bytes_for_any_number_of_workers():
    found = [schedule_model(GANGS.draw(203), SearchOptions(workers=Workers(workers)), go_on) for workers in (1, 2, 8)]
    assert found[0].schedule.solver == "packing"
    assert found[0].schedule == found[1].schedule == found[2].schedule


def test_phases_may_begin_after_their_jobs_and_jobs_pass_the_end():
    """Thirds of a resource, all of it taken for 10 ms, from 1 ms after the start of each job on."""
    sizes = [(4, "1/3"), (4, "1/3"), (2, "1/3"), (6, "2/3"), (4, "2/3")]
    tasks = [
        task(f"t{n}", 10, version("v", 1 + c, f"u{n}", access("mem", 1, 1 + c, bound)))
        for n, (c, bound) in enumerate(sizes)
    ]
    system = model(*tasks, units="u0 u1 u2 u3 u4", resources="mem")
    jobs = packed(system)
    assert jobs is not None
    assert any(job.end > tasks[0].period for job in jobs)
    table = ModeSchedule(name="all", hyperperiod=tasks[0].period, status=Status.VALID, jobs=jobs)
    assert verify(system, Schedule(model=system.name, model_sha256=system.digest, modes=(table,))) == ()


def fits(sizes, height, length):
    """Whether rectangles fit on a board, by trying every start of every one."""

    def place(rest, free):
        if not rest:
            return True
        (long, high), *others = rest
        for start in range(length - long + 1):
            if all(free[t] >= high for t in range(start, start + long)):
                taken = [f - high if start <= t < start + long else f for t, f in enumerate(free)]
                if place(others, taken):
                    return True
        return False

    return place(sizes, [height] * length)


@given(st.integers(1, 4), st.integers(2, 6), st.data())
def test_small_boards_are_filled_if_and_only_if_they_can_be(height, length, data):
    side = st.tuples(st.integers(1, length), st.integers(1, height))
    sizes = data.draw(st.lists(side, min_size=1, max_size=6))
    starts = fill_board(sizes, height, length, Draws(1), 3, go_on)
    assert (starts is not None) == fits(sizes, height, length)
    if starts is not None:
        for time in range(length):
            held = [high for (long, high), start in zip(sizes, starts, strict=True) if start <= time < start + long]
            assert sum(held) <= height
        assert all(0 <= start <= length - long for (long, _), start in zip(sizes, starts, strict=True))


def test_boards_have_no_more_rectangles_than_a_word_has_bits():
    assert fill_board([(1, 1)] * MAX_RECTANGLES, 2, 32, Draws(1), 1, go_on) is not None
    assert fill_board([(1, 1)] * (MAX_RECTANGLES + 1), 2, 40, Draws(1), 1, go_on) is None


def test_a_board_is_given_up_when_nobody_wants_more():
    asked = []
    assert fill_board([(6, 2), (5, 1)], 2, 10, Draws(1), 20, lambda: bool(asked.append(1))) is None
    assert len(asked) == 1
