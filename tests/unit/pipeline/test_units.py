"""Dealing units out to jobs: never a wrong answer, and rarely none where there is one."""

import itertools
import random

import pytest

from halpipe.pipeline.solve.kernel.assign_units import Arc, assign_units


def cells(arc, hyperperiod):
    return {time % hyperperiod for time in range(arc.start, arc.start + arc.length)}


def check(arcs, units, hyperperiod, dealt):
    """Every job has its number of different units of the group, and no unit two jobs at a time."""
    assert set(dealt) == {arc.job for arc in arcs}
    for arc in arcs:
        assert len(set(dealt[arc.job])) == len(dealt[arc.job]) == arc.width
        assert set(dealt[arc.job]) <= set(range(units))
    for one, other in itertools.combinations(arcs, 2):
        if cells(one, hyperperiod) & cells(other, hyperperiod):
            assert not set(dealt[one.job]) & set(dealt[other.job])


def fitting_arcs(rng, units, hyperperiod, most):
    """Draw arcs whose load stays within `units` at every instant; dense, up to the last tick."""
    load = [0] * hyperperiod
    arcs = []
    for _ in range(12 * most):
        width = rng.choice((1, 1, 1, 2)) if units > 1 else 1
        arc = Arc(len(arcs), rng.randrange(hyperperiod), rng.randint(1, max(1, hyperperiod * 2 // 3)), width)
        if len(arcs) < most and all(load[time] + width <= units for time in cells(arc, hyperperiod)):
            arcs.append(arc)
            for time in cells(arc, hyperperiod):
                load[time] += width
    return arcs


def exists(arcs, units, hyperperiod):
    """Try everything."""

    def extend(number, chosen):
        if number == len(arcs):
            return True
        for pick in itertools.combinations(range(units), arcs[number].width):
            clash = any(
                set(pick) & set(taken) and cells(arcs[number], hyperperiod) & cells(other, hyperperiod)
                for other, taken in zip(arcs, chosen, strict=False)
            )
            if not clash and extend(number + 1, [*chosen, pick]):
                return True
        return False

    return extend(0, [])


@pytest.mark.parametrize("block", range(4))
def test_dense_circles_are_dealt_out_rightly(block):
    dealt_out = 0
    for seed in range(block * 150, block * 150 + 150):
        rng = random.Random(seed)
        units, hyperperiod = rng.randint(1, 6), rng.choice((5, 12, 30))
        arcs = fitting_arcs(rng, units, hyperperiod, rng.randint(1, 30))
        rng.shuffle(arcs)
        dealt = assign_units(arcs, units, hyperperiod)
        if dealt is not None:
            check(arcs, units, hyperperiod, dealt)
            dealt_out += 1
    assert dealt_out > 110


def test_it_gives_up_only_rarely_where_there_is_a_way():
    missed = possible = 0
    for seed in range(400):
        rng = random.Random(seed)
        units, hyperperiod = rng.randint(2, 3), rng.choice((5, 8))
        arcs = fitting_arcs(rng, units, hyperperiod, 7)
        if exists(arcs, units, hyperperiod):
            possible += 1
            missed += assign_units(arcs, units, hyperperiod) is None
        else:
            assert assign_units(arcs, units, hyperperiod) is None
    assert possible > 300
    assert missed <= possible // 20


def test_a_circle_may_need_more_units_than_its_load():
    """Three arcs of two thirds each overlap in pairs everywhere, yet two units cannot serve them."""
    arcs = [Arc(n, 2 * n, 4, 1) for n in range(3)]
    assert assign_units(arcs, 2, 6) is None
    check(arcs, 3, 6, assign_units(arcs, 3, 6))


def test_jobs_may_take_the_whole_circle():
    arcs = [Arc(0, 3, 6, 1), Arc(1, 5, 6, 2), Arc(2, 1, 2, 1), Arc(3, 3, 4, 1)]
    check(arcs, 4, 6, assign_units(arcs, 4, 6))


@pytest.mark.parametrize("seed", range(100))
def test_overloaded_circles_are_refused(seed):
    """The best placement of a search that failed may be anything."""
    rng = random.Random(seed)
    units, hyperperiod = rng.randint(1, 4), 8
    arcs = [
        Arc(job, rng.randrange(hyperperiod), rng.randint(1, hyperperiod), rng.randint(1, units))
        for job in range(rng.randint(1, 9))
    ]
    dealt = assign_units(arcs, units, hyperperiod)
    overloaded = any(
        sum(arc.width for arc in arcs if time in cells(arc, hyperperiod)) > units for time in range(hyperperiod)
    )
    if overloaded:
        assert dealt is None
    elif dealt is not None:
        check(arcs, units, hyperperiod, dealt)


def test_too_much_load_is_refused():
    assert assign_units([Arc(0, 0, 3, 1), Arc(1, 2, 3, 1)], 1, 6) is None
    assert assign_units([Arc(0, 0, 3, 2)], 1, 6) is None


def test_no_arcs_need_no_units():
    assert assign_units([], 3, 6) == {}
