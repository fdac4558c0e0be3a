"""Sums of intervals on the circle, and recurring instants, against counting tick by tick."""

import random
from fractions import Fraction

import pytest

from halpipe.pipeline.measure.placement import Instants, Interval, sweep


def levels(intervals, period):
    """Add up the heights on every tick of the circle."""
    found = [Fraction(0)] * period
    for start, length, height in intervals:
        for time in range(start, start + length):
            found[time % period] += height
    return found


@pytest.mark.parametrize("seed", range(60))
def test_sweep_agrees_with_counting(seed):
    rng = random.Random(seed)
    period = rng.randint(1, 12)
    intervals = [
        Interval(rng.randrange(3 * period), rng.randrange(3 * period), rng.choice((1, 2, Fraction(1, 3))))
        for _ in range(rng.randrange(8))
    ]
    steps = sweep(intervals, period)
    assert [step.begin for step in steps] == [0, *(step.end for step in steps[:-1])]
    assert steps[-1].end == period
    assert [step.level for step in steps for _ in range(step.begin, step.end)] == levels(intervals, period)


def test_sweep_of_nothing_is_one_step_of_zero():
    assert sweep([], 7) == [(0, 7, 0)]


def test_an_interval_ends_where_the_next_begins():
    assert sweep([Interval(0, 3, 1), Interval(3, 2, 1)], 5) == [(0, 3, 1), (3, 5, 1)]


@pytest.mark.parametrize("seed", range(40))
def test_instants_agree_with_a_list_unrolled_far(seed):
    rng = random.Random(seed)
    period = rng.randint(1, 9)
    given = [(rng.randrange(-5, 3 * period), label) for label in range(rng.randint(1, 4))]
    instants = Instants.of(given, period)
    line = sorted((time % period + turn * period, label) for time, label in given for turn in range(-9, 10))
    for time in range(-4 * period, 4 * period):
        assert instants.at_or_after(time) == next(found for found in line if found[0] >= time)
        assert instants.at_or_before(time) == [found for found in line if found[0] <= time][-1]


def test_instants_list_their_times_in_order():
    assert list(Instants.of([(7, 0), (2, 1), (9, 2)], 5)) == [(2, 0), (2, 1), (4, 2)]
