"""Every term of the cost function by hand (paper, section III; MODEL 4)."""

from dataclasses import replace
from fractions import Fraction

import pytest
from placed_cases import place, roborace, roborace_jobs
from split_helpers import interrupts, parted, points, split

from halpipe.models import Anchor, Match
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.cost import WEIGHT_OCCUPANCY, WEIGHT_TIMELINESS, cost_terms
from halpipe.pipeline.measure.placement import Placement
from support import access, after, chain, job, model, ms, task, version


def terms(system, *jobs):
    return cost_terms(system, place(system, *jobs))


def penalties(found):
    return (found.overlap, found.access, found.precedence, found.unit)


def test_a_valid_schedule_has_only_bonuses():
    system = roborace(88, 63)
    found = terms(system, *roborace_jobs(system))
    assert penalties(found) == (0, 0, 0, 0)
    assert (found.occupancy, found.timeliness) == (0, 1)
    assert found.total == -Fraction(1, 2)


def test_the_bonuses_stay_below_the_smallest_penalty():
    assert WEIGHT_OCCUPANCY + WEIGHT_TIMELINESS < 1


def test_overlap_counts_time_for_every_job_too_many_on_every_unit():
    tasks = [task(name, 10, version("v", 4, "u1 u2", gang=gang)) for name, gang in (("a", 2), ("b", 1), ("c", 1))]
    system = model(*tasks, units="u1 u2")
    found = terms(system, job(system, "a", 0, 8, "u1 u2"), job(system, "b", 0, 1, "u1"), job(system, "c", 0, 9, "u2"))
    assert found.overlap == 1 + 3  # a and b share u1 on [11, 12), a and c u2 on [9, 12)
    tight = terms(
        system, *(job(system, name, 0, 1, units) for name, units in (("a", "u1 u2"), ("b", "u1"), ("c", "u1")))
    )
    assert tight.overlap == 8


def test_access_is_the_integral_of_what_exceeds_a_resource():
    system = model(
        task("a", 10, version("v", 4, "u1", access("r", 0, 4, "2/3"))),
        task("b", 10, version("v", 4, "u2", access("r", 1, 4, "1/2"))),
        units="u1 u2",
        resources="r",
    )
    found = terms(system, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 0, "u2"))
    assert found.access == Fraction(3, 6)
    bonus = Fraction(2, 5) * 0 + Fraction(1, 2) * 1
    assert found.total == Fraction(1, 2) * 6 - bonus  # weighted by the common denominator of all bounds
    assert terms(system, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 3, "u2")).access == 0


@pytest.mark.parametrize(
    ("start", "anchor", "distance"),
    [
        (3, "start", 0),  # the window is [2, 5] after 1
        (6, "start", 0),
        (7, "start", 1),
        (9, "start", 3),
        (1, "start", 2),  # two too early, and five too late
        (2, "start", 1),
        (3, "end", 3),  # the predecessor ends at 4: three too early, and 4 too late after its last end
        (6, "end", 0),
        (9, "end", 0),
        (0, "end", 1),
    ],
)
def test_precedence_is_the_distance_from_the_window(start, anchor, distance):
    system = model(
        task("a", 10, version("v", 3)), task("b", 10, version("v", 1, "u2", after("a", 2, 5, anchor))), units="u1 u2"
    )
    assert terms(system, job(system, "a", 0, 1, "u1"), job(system, "b", 0, start, "u2")).precedence == distance


def test_a_window_may_reach_over_many_hyperperiods():
    system = model(task("a", 10, version()), task("b", 10, version("v", 1, "u1", after("a", 32, 34))))
    for start, distance in ((4, 0), (6, 0), (7, 1), (3, 1), (9, 3)):
        assert terms(system, job(system, "a", 0, 2, "u1"), job(system, "b", 0, start, "u1")).precedence == distance


def test_chains_count_what_exceeds_their_limits():
    system = roborace(80, 60)
    assert terms(system, *roborace_jobs(system)).precedence == (88 - 80) + (63 - 60)
    assert terms(system, *roborace_jobs(system)).total == 11 - Fraction(1, 2)


def test_demands_without_jobs_and_jobs_without_demands_count_a_mean_wcet():
    system = model(
        task("a", 10, version("v", 4, "u1", after("h", 0, 9)), version("w", 4)), task("h", None, version("v", 2))
    )
    served = [job(system, "a", 0, 0, "u1", "v"), job(system, "h", 0, 5, "u1")]
    assert terms(system, *served).precedence == 0
    assert terms(system, served[0]).precedence == 3  # one mean WCET of a and h
    assert terms(system, job(system, "a", 0, 0, "u1", "w"), served[1]).precedence == 3
    assert terms(system, job(system, "a", 0, 0, "u1", "w")).precedence == 0


def test_a_chain_that_never_gets_through_counts_a_mean_wcet():
    system = model(task("a", 10, version("v", 4)), task("h", None, version()), chains=[chain("c", "a h", 50)])
    assert terms(system, job(system, "a", 0, 0, "u1")).precedence == 4


@pytest.mark.parametrize(("units", "wrong"), [("u1 u2", 0), ("u1", 1), ("u1 u1", 1), ("u1 u3", 1), ("u1 u2 u3", 1)])
def test_unit_counts_jobs_on_sets_their_versions_do_not_allow(units, wrong):
    system = model(task("a", 10, version("v", 1, "u1 u2", gang=2)), units="u1 u2 u3")
    assert terms(system, job(system, "a", 0, 0, units)).unit == wrong


def test_occupancy_is_the_share_of_empty_units():
    system = model(task("a", 10, version()), units="u1 u2 u3 u4")
    assert terms(system, job(system, "a", 0, 0, "u1")).occupancy == Fraction(3, 4)


@pytest.mark.parametrize(
    ("starts", "slack", "offset", "expected"),
    [
        ((3, 13), "1/2", None, 1),
        ((3, 15), "1/2", None, Fraction(4, 5)),  # 2 of 5 ms late, the other at its phase
        ((3, 18), "1/2", None, Fraction(1, 2)),
        ((3, 13), "1/2", 2, Fraction(4, 5)),  # both 1 of 5 ms late
        ((18, 8), "1/2", None, 1),  # job 1 lies before job 0 on the circle
        ((3, 13), 0, None, 1),
        ((3, 14), "1/4", None, Fraction(4, 5)),  # 1 of 2.5 ms late, the other at its phase
        ((3, 19), "1/4", None, Fraction(1, 2)),  # later than the slack counts no less than nothing
    ],
)
def test_timeliness_falls_with_the_delay(starts, slack, offset, expected):
    system = model(task("a", 10, version(), slack=slack, offset=offset), task("b", 20, version()))
    jobs = [job(system, "a", index, start, "u1") for index, start in enumerate(starts)]
    assert terms(system, *jobs).timeliness == expected


def test_timeliness_is_cut_to_six_digits():
    system = model(task("a", 6, version(), slack="1/2"), task("b", 12, version()), task("c", 12, version(), slack=1))
    jobs = [job(system, "a", 0, 0, "u1"), job(system, "a", 1, 7, "u1"), job(system, "b", 0, 3, "u1")]
    assert terms(system, *jobs).timeliness == Fraction(888888, 10**6)  # 8/9


def test_without_jobs_nothing_is_late_and_all_units_are_empty():
    found = terms(model(task("a", 10, version()), units="u1 u2"))
    assert (found.timeliness, found.occupancy, found.precedence) == (1, 1, 0)
    assert terms(model(replace(task("a", 10, version()), let=ms(10)))).precedence == 0


@pytest.mark.parametrize(
    ("slack", "deadline", "beyond"),
    [(1, None, 0), ("3/10", None, 1), ("1/5", None, 2), (1, 5, 0), (1, 4, 1), (1, 3, 2), ("3/10", 3, 2), ("1/5", 4, 2)],
)
def test_the_phase_of_a_task_of_a_cycle_lies_in_its_first_period(slack, deadline, beyond):
    """Jobs of a start 12 and 13 ms after the cycles' starts: with 4 ms of slack their releases may be at 9 ms.

    Of a deadline, the millisecond that a job takes is no room for its start.
    """
    row = replace(after("a", 0, 19), match=Match.CYCLE)
    tasks = (
        task("a", 10, version("v", 1), slack=slack, deadline=deadline),
        task("b", 20, version("v", 1, "u2", row), slack=1),
    )
    system = model(*tasks, units="u1 u2")
    jobs = [job(system, "a", 0, 12, "u1"), job(system, "a", 1, 3, "u1"), job(system, "b", 0, 15, "u2")]
    assert terms(system, *jobs).precedence == beyond


@pytest.mark.parametrize(
    ("offset", "index", "start", "is_before"),
    [
        (None, 0, 0, False),
        (None, 1, 9, True),
        (None, 1, 10, False),
        (3, 0, 2, True),
        (3, 1, 13, False),
        (13, 1, 12, True),
    ],
)
def test_a_job_before_its_release_belongs_to_the_cycle_before(offset, index, start, is_before):
    system = model(
        task("a", 10, version("v", 1), slack=1, offset=offset), task("b", 20, version("v", 1, "u2")), units="u1 u2"
    )
    placed = place(system, job(system, "a", index, start, "u1"))
    assert placed.tick * placed.lap(placed.jobs[0]) == (ms(20) if is_before else ms(0))


def test_points_of_execution_are_reached_at_worst_pace():
    cut = split(version("v", 6), points(2, 4, resume=ms(1)))
    system = interrupts(model(task("a", 40, cut, version("w", 6))), "u1", (5, 1))
    whole = replace(job(system, "a", 0, 10, "u1", "w"), end=ms(18))
    parts = parted("a", 0, "u1", (10, 13, 0, 2), (20, 27, 2, 6))
    for placed, instants in ((whole, (10, 12, 13, 14, 17, 18)), (parts, (10, 12, 13, 23, 25, 27))):
        found = Placement.of(expand(system, system.modes[0]), [placed], system.units)
        reached = [found.tick * found.instant(found.jobs[0], Anchor.POINT, ms(point)) for point in (0, 1, 2, 3, 5, 6)]
        assert reached == [ms(instant) for instant in instants]
        own = found.jobs[0]
        assert found.tick * found.instant(own, Anchor.END) == ms(instants[-1])
        assert found.tick * found.instant(own, Anchor.START) == ms(10)
