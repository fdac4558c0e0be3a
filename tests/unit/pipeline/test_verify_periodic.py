"""Rules periodic and deadline: one phase for all jobs, every job in time after its release."""

from dataclasses import replace
from fractions import Fraction

import pytest
from verify_helpers import codes_found, errors, messages, only

from halpipe.core.durations import Duration
from halpipe.pipeline.verify import codes, verify
from support import after, job, model, schedule, task, version


def system(slack=0, offset=None, deadline=None, wcet=1, count=3):
    return model(
        task("a", 10, version("v", wcet), slack=slack, offset=offset, deadline=deadline),
        task("slow", 10 * count, version("v", 1, "u2")),
        units="u1 u2",
    )


def at(found, *starts):
    jobs = [job(found, "a", k, start, "u1") for k, start in enumerate(starts)]
    return schedule(found, 10 * len(starts), *jobs, job(found, "slow", 0, 0, "u2"))


def test_without_slack_jobs_are_exactly_a_period_apart():
    strict = system()
    assert not errors(strict, at(strict, 3, 13, 23))
    text = only(strict, at(strict, 3, 13, "23000001ns"), codes.NOT_PERIODIC)
    assert text.startswith('mode "all" task "a" job 2: starts at 23.000001ms, 1ns after its release')
    assert "its slack allows 0ms: 1ns too late" in text
    assert "1ns before its release" in only(strict, at(strict, 3, 13, "22999999ns"), codes.NOT_PERIODIC)


def test_the_phase_may_turn_the_indices_round():
    strict = system()
    assert not errors(strict, at(strict, 23, 3, 13))
    assert not errors(strict, at(strict, 13, 23, 3))
    assert codes.NOT_PERIODIC.id in codes_found(strict, at(strict, 13, 3, 23))


def test_the_minority_is_blamed():
    strict = system()
    found = messages(strict, at(strict, 3, 14, 24), codes.NOT_PERIODIC)
    assert [line.split(":")[0] for line in found] == ['mode "all" task "a" job 0']


def test_drift_up_to_the_slack_and_not_a_tick_more():
    loose = system(slack=Fraction(3, 10))
    assert not errors(loose, at(loose, 3, 16, 23))
    assert not errors(loose, at(loose, 6, 13, 23))
    assert not errors(loose, at(loose, 29, 12, 22))  # round the end: s = 29, 9, 19
    assert codes.NOT_PERIODIC.id in codes_found(loose, at(loose, 3, "16000001ns", 23))
    assert codes.NOT_PERIODIC.id in codes_found(loose, at(loose, "6000001ns", 13, 23))
    # each pair is within the slack of each other, but not all three with one phase
    assert codes.NOT_PERIODIC.id in codes_found(loose, at(loose, 3, 15, 27))


def test_an_exact_third_of_slack():
    third = system(slack=Fraction(1, 3))
    assert not errors(third, at(third, 0, Duration(Fraction(40_000_000, 3)), 20))
    beyond = Duration(Fraction(40_000_000, 3) + Fraction(1, 10**6))
    assert codes.NOT_PERIODIC.id in codes_found(third, at(third, 0, beyond, 20))


def test_full_slack_of_a_single_job_admits_every_start():
    alone = model(task("a", 10, version("v", 1), slack=1))
    assert all(not errors(alone, schedule(alone, 10, job(alone, "a", 0, start, "u1"))) for start in range(10))


def test_an_offset_fixes_the_phase():
    fixed = system(offset=3)
    assert not errors(fixed, at(fixed, 3, 13, 23))
    assert len(messages(fixed, at(fixed, 4, 14, 24), codes.NOT_PERIODIC)) == 3
    assert codes.NOT_PERIODIC.id in codes_found(fixed, at(fixed, 13, 23, 3))
    beyond = system(offset=13)  # an offset counts modulo the period
    assert not errors(beyond, at(beyond, 3, 13, 23))
    loose = system(offset=3, slack=Fraction(1, 2))
    assert not errors(loose, at(loose, 8, 13, 23))
    assert "1ms before its release" in only(loose, at(loose, 2, 13, 23), codes.NOT_PERIODIC)


def test_deadline_counts_from_the_release():
    loose = system(slack=Fraction(1, 2), deadline=4, wcet=2, count=2)
    assert not errors(loose, at(loose, 5, 13))  # release 3: delays 2 and 0
    text = only(loose, at(loose, 6, 13), codes.LATE)
    assert text.startswith('mode "all" task "a" job 0: ends 5ms after its release, its deadline is 4ms: 1ms late')


def test_slack_and_deadline_hold_for_one_phase():
    """The phase that suits the slack alone (6) would let job 1 miss its deadline; 5 suits both."""
    both = system(slack=Fraction(1, 2), deadline=6, wcet=3, count=2)
    assert not errors(both, at(both, 5, 18))
    only(both, at(both, 5, 19), codes.LATE)


def test_deadline_is_the_period_where_none_is_given():
    full = system(wcet=8, slack=1, count=2)
    assert not errors(full, at(full, 0, 12))
    assert "1ns late, at 20.000001ms" in messages(full, at(full, 0, "12000001ns"), codes.LATE)[0]


def test_a_wcet_beyond_the_deadline_is_late_wherever_it_starts():
    long = system(wcet=5, deadline=4)
    assert len(messages(long, at(long, 0, 10, 20), codes.LATE)) == 3
    outside = at(long, 0, 10, 25)
    assert len(messages(long, outside, codes.LATE)) == 3
    assert len(messages(long, outside, codes.NOT_PERIODIC)) == 1


def test_a_job_outside_its_slack_is_not_late_as_well():
    tight = system(wcet=4, deadline=4)
    only(tight, at(tight, 0, 10, 21), codes.NOT_PERIODIC)


def test_a_deadline_beyond_the_period_lets_jobs_lie_side_by_side():
    wide = model(
        task("a", 10, version("v", 15, "u1 u2"), deadline=15), task("b", 20, version("v", 1, "u3")), units="u1 u2 u3"
    )
    jobs = [job(wide, "a", 0, 0, "u1"), job(wide, "a", 1, 10, "u2"), job(wide, "b", 0, 0, "u3")]
    assert not errors(wide, schedule(wide, 20, *jobs))


def test_the_deadline_of_a_task_on_demand_has_no_release_to_count_from():
    own = task("a", 10, version("v", 1, "u1", after("help", 0, 10)))
    found = model(own, task("help", None, version("v", 5, "u2"), deadline=1), units="u1 u2")
    assert not errors(found, schedule(found, 10, job(found, "a", 0, 5, "u1"), job(found, "help", 0, 1, "u2")))


def test_a_job_half_way_between_two_releases_is_late():
    strict = system()
    text = only(strict, at(strict, 3, 13, 8), codes.NOT_PERIODIC)
    assert "starts at 8ms, 15ms after its release; its slack allows 0ms: 15ms too late" in text
    assert "14.999999ms before its release" in only(strict, at(strict, 3, 13, "8000001ns"), codes.NOT_PERIODIC)


@pytest.mark.parametrize(
    ("offset", "told"),
    [(3, "its offset puts the first release at 3ms"), (None, "most jobs fit a first release at 3ms")],
)
def test_help_says_where_releases_are_counted_from(offset, told):
    for found, starts in (
        (system(offset=offset), (3, 13, 24)),
        (system(offset=offset, wcet=4, deadline=3), (3, 13, 23)),
    ):
        for finding in verify(found, at(found, *starts)):
            assert finding.help.endswith(f"({told})")


def test_a_job_delayed_by_all_of_its_slack_has_a_deadline():
    full = system(offset=3, slack=Fraction(1, 2), deadline=6, wcet=2)
    assert "ends 7ms after its release, its deadline is 6ms: 1ms late" in only(full, at(full, 8, 13, 23), codes.LATE)


def test_of_phases_that_suit_the_slack_one_that_suits_the_deadline_too_is_taken():
    """Both 5 and 15 suit the slack of 10 ms. At 5 the long job would end 15 ms after its release, 4 too late."""
    own = task("a", 10, version("short", 1, "u1"), version("long", 5, "u2"), slack=1, deadline=11)
    found = model(own, task("slow", 20, version("v", 1, "u3")), units="u1 u2 u3")
    jobs = [job(found, "a", 0, 5, "u1", "short"), job(found, "a", 1, 5, "u2", "long"), job(found, "slow", 0, 0, "u3")]
    assert not errors(found, schedule(found, 20, *jobs))


def test_a_window_as_long_as_the_hyperperiod_suits_every_phase():
    """Three jobs where one belongs: the long ones are late anyway, so the phase is that of the short one."""
    own = task("a", 10, version("short", 1, "u1"), version("long", 6, "u2 u3"), slack=1, deadline=4)
    found = model(own, units="u1 u2 u3")
    jobs = [job(found, "a", 0, 7, unit, "long") for unit in ("u2", "u3")]
    told = [
        d
        for d in verify(found, schedule(found, 10, job(found, "a", 0, 3, "u1", "short"), *jobs))
        if d.code == codes.LATE.id
    ]
    assert [d.help.endswith("(most jobs fit a first release at 3ms)") for d in told] == [True] * len(told)
    assert told


def test_a_job_nearer_to_the_release_before_is_too_late():
    """17 ms after its release and 13 before the next; 12 ms beyond its slack."""
    loose = system(offset=3, slack=Fraction(1, 2))
    text = only(loose, at(loose, 20, 13, 23), codes.NOT_PERIODIC)
    assert "starts at 20ms, 17ms after its release; its slack allows 5ms: 12ms too late" in text


def test_a_job_behind_the_last_has_no_release():
    strict = system()
    plan = at(strict, 3, 13, 23)
    more = replace(plan.modes[0], jobs=(*plan.modes[0].jobs, job(strict, "a", 3, 7, "u1")))
    only(strict, replace(plan, modes=(more,)), codes.SURPLUS_JOB)


def test_the_phase_of_most_jobs_is_taken_where_others_are_later():
    strict = system(count=4)
    found = messages(strict, at(strict, 3, 13, 24, 35), codes.NOT_PERIODIC)
    assert [line.split(":")[0] for line in found] == [f'mode "all" task "a" job {k}' for k in (2, 3)]
