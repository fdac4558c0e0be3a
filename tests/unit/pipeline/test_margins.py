"""Margins of WCETs between the ticks of the search, and bounds that no schedule passes."""

from __future__ import annotations

from fractions import Fraction

import pytest

from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.margins import LARGEST_MARGIN, least_margin
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.measure.placement import Placement
from halpipe.pipeline.solve.optimise import lower_bound, stretched
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.verify import verify
from support import after, job, model, schedule, task, version


def margin(system, jobs):
    return least_margin(Placement.of(expand(system, system.modes[0]), jobs))


def stretch(system, *starts, most=10):
    jobs = tuple(job(system, name, index, start, units) for name, index, start, units in starts)
    wider = stretched(system, expand(system, system.modes[0]), jobs, Fraction(most))
    assert [d for d in verify(system, schedule(system, "20ms", *wider)) if d.is_error] == []
    return margin(system, jobs), margin(system, wider)


def test_starts_between_the_ticks_give_the_largest_margin_of_an_order():
    """Between two jobs of a, 10 ms apart, are one of b: 3 ms + 3 ms times 5/3 each, of which 3 ms lie off the grid."""
    system = model(task("a", 10, version("v", 3)), task("b", 20, version("v", 3)))
    assert stretch(system, ("a", 0, 0, "u1"), ("a", 1, 10, "u1"), ("b", 0, 4, "u1")) == (Fraction(1, 3), Fraction(2, 3))


def test_tasks_on_several_units_move_together():
    system = model(
        task("g", 20, version("v", 2, "u1 u2", gang=2)),
        task("a", 20, version("v", 4, "u1")),
        task("b", 20, version("v", 6, "u2")),
        units="u1 u2",
    )
    before, wider = stretch(system, ("g", 0, 0, "u1 u2"), ("a", 0, 2, "u1"), ("b", 0, 2, "u2"))
    assert before == 0
    assert wider == Fraction(3, 2)


def test_what_must_not_move_stays():
    windowed = version("v", 2, "u1", after("a", 0, 5))
    system = model(task("a", 20, version("v", 2), offset=0), task("b", 20, windowed))
    assert stretch(system, ("a", 0, 0, "u1"), ("b", 0, 2, "u1")) == (0, 0)


def test_no_more_than_asked_for():
    system = model(task("a", 20, version("v", 4)), task("b", 20, version("v", 4)))
    _, wider = stretch(system, ("a", 0, 0, "u1"), ("b", 0, 4, "u1"), most=Fraction(1, 2))
    assert wider >= Fraction(1, 2)


def test_the_bound_knows_that_jobs_meet():
    """a and b meet beyond gcd(10, 15) = 5 ms in sum, long before the unit is full."""
    system = model(task("a", 10, version("v", 2)), task("b", 15, version("v", 1)), units="u1 u2")
    assert lower_bound(Objective.MARGIN, system, expand(system, system.modes[0])) == -Fraction(2, 3)


def test_the_bound_knows_the_unit_that_is_full():
    slack = task("a", 10, version("v", 8), slack=1)
    system = model(slack, task("b", 10, version("v", 1, "u2")), units="u1 u2")
    assert lower_bound(Objective.MARGIN, system, expand(system, system.modes[0])) == -Fraction(1, 4)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_optimise_margin_reaches_what_is_proven(seed):
    tasks = (("t0", 5, "1ms"), ("t1", 10, "1.5ms"), ("t2", 20, "1.5ms"), ("t3", 20, "2ms"))
    system = model(*(task(name, period, version("v", wcet)) for name, period, wcet in tasks))
    result = schedule_model(system, SearchOptions(optimise=(Objective.MARGIN,), seed=seed), lambda *_: True)
    [reached] = result.reached
    assert (reached.value, reached.bound) == (-Fraction(2, 3), -Fraction(2, 3))
    assert [d for d in verify(system, result.schedule) if d.is_error] == []


def test_the_least_margin_of_a_schedule_is_that_of_the_tightest_stay():
    """On u1 2 ms are followed by 3 free ones, round the edge 4 ms by 1; on u2 one job of 2 ms has 8 to grow by."""
    system = model(
        *(task(n, 10, version("v", c, u)) for n, c, u in (("a", 2, "u1"), ("b", 4, "u1"), ("c", 2, "u2"))),
        units="u1 u2",
    )
    jobs = [job(system, "a", 0, 0, "u1"), job(system, "b", 0, 5, "u1"), job(system, "c", 0, 9, "u2")]
    assert margin(system, jobs) == Fraction(1, 4)
    assert margin(system, jobs[::2]) == 4
    assert margin(system, []) == LARGEST_MARGIN
