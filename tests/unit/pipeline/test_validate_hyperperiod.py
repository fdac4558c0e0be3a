"""Hyperperiods that explode: who is guilty, and what would do."""

import re
from dataclasses import replace
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st
from validate_cases import found, the

from halpipe.core.durations import Duration, least_common_multiple, milliseconds, seconds
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.validate import codes, validate
from halpipe.pipeline.validate.hyperperiod import (
    MAX_JOBS,
    MAX_TICKS,
    _by_fit,
    _digits,
    _round_periods,
    nearest_harmonic,
    periods_instead,
)
from support import access, after, model, ms, task, version


def periodic(*periods, **more):
    """One short task for each period, named t0, t1, ..."""
    return model(*(task(f"t{i}", period, version("v", "1ns")) for i, period in enumerate(periods)), **more)


def test_harmonic_periods_are_fine():
    assert validate(periodic("5ms", "10ms", "20ms", "1/30s", "100ms", "1s")) == ()


def test_limit_on_jobs_is_exact():
    at_limit = periodic("1us", f"{MAX_JOBS - 1}us")
    assert expand(at_limit, at_limit.modes[0]).job_count == MAX_JOBS
    assert validate(at_limit) == ()
    beyond = periodic("1us", f"{MAX_JOBS}us")
    assert expand(beyond, beyond.modes[0]).job_count == MAX_JOBS + 1
    assert f"has {MAX_JOBS + 1} jobs" in the(beyond, codes.TOO_MANY_JOBS).message


def test_periods_that_make_just_as_many_jobs_as_are_allowed_are_not_the_cause():
    beyond = the(periodic("1us", f"{MAX_JOBS - 1}us", "700ns"), codes.TOO_MANY_JOBS)
    assert "the cause: the period 700ns (task" in beyond.message


def test_guilty_period_and_the_nearest_that_fits():
    system = periodic("5ms", "10ms", "20ms", "33333333ns", "100ms")
    finding = the(system, codes.TOO_MANY_JOBS)
    assert 'the cause: the period 33.333333ms (task "t3"); without it the hyperperiod is 100ms' in finding.message
    assert finding.help == "use 100/3ms (hyperperiod 100ms) instead of 33.333333ms; the mode then has 39 jobs"
    assert finding.path == 'mode "all"'


def test_rounded_period_longer_than_all_others():
    help = the(periodic("25ms", "33333333ns"), codes.TOO_MANY_JOBS).help
    expected = "use 100/3ms (hyperperiod 100ms) or 25ms (hyperperiod 25ms) instead of 33.333333ms"
    assert help == f"{expected}; the mode then has 7 jobs"
    assert validate(periodic("25ms", "25ms")) == ()
    assert validate(periodic("25ms", "100/3ms")) == ()


def test_following_the_help_cures_the_model():
    system = periodic("5ms", "10ms", "20ms", "9973us", "10007us", "100ms")
    help = the(system, codes.TOO_MANY_JOBS).help
    swaps = {
        Duration.parse(old): Duration.parse(new)
        for new, old in re.findall(r"(\S+ms) \(hyperperiod \S+\) instead of (\S+ms)", help)
    }
    assert sorted(swaps) == [ms("9.973ms"), ms("10.007ms")]
    cured = replace(system, tasks=tuple(replace(t, period=swaps.get(t.period, t.period)) for t in system.tasks))
    assert validate(cured) == ()
    assert f"has {expand(cured, cured.modes[0]).job_count} jobs" in help


def test_many_guilty_periods_are_counted():
    primes = [9973, 9967, 9949, 9941, 9931, 9929, 9923, 9907]
    finding = the(periodic(*["10ms"] * 20, *(f"{p}us" for p in primes)), codes.TOO_MANY_JOBS)
    assert "and 3 more" in finding.message
    assert "and 3 more" in finding.help


def test_periods_far_apart_have_no_harmonic_choice():
    finding = the(periodic("1ns", "1s"), codes.TOO_MANY_JOBS)
    assert "shortest (1ns)" in finding.help
    assert "longest (1s)" in finding.help


def test_jobs_on_demand_count():
    chain_of_demands = [task("d0", None, version("v", "1ns"))]
    for i in range(1, 8):
        rows = [after(f"d{i - 1}", 0, n) for n in range(10)]
        chain_of_demands.append(task(f"d{i}", None, version("v", "1ns", "u1", *rows)))
    asks = task("a", "1s", version("v", "1ns", "u1", after("d7", 0, 10)))
    assert "11111112 jobs" in the(model(asks, *chain_of_demands), codes.TOO_MANY_JOBS).message


def test_demands_that_multiply_are_limited_by_themselves():
    chain_of_demands = [task("d0", None, version("v", "1ns"))]
    for i in range(1, 6):
        rows = [after(f"d{i - 1}", 0, n) for n in range(10)]
        chain_of_demands.append(task(f"d{i}", None, version("v", "1ns", "u1", *rows)))

    def asking(number):
        asks = task("a", "1s", version("v", "1ns", "u1", after(f"d{number}", 0, 10)))
        return model(asks, *chain_of_demands[: number + 1])

    assert validate(asking(4)) == ()
    assert 'task "d0" has 100000 jobs' in the(asking(5), codes.TOO_MANY_JOBS).message


def test_the_version_that_demands_most_counts():
    thrifty, greedy = version("v", "1ns"), version("w", "1ns", "u1", after("d", 0, 10), after("d", 0, 20))
    asks = task("a", "1us", thrifty, greedy)
    system = model(asks, task("b", "4s", version("v", "1ns")), task("d", None, version("v", "1ns")))
    assert "has 12000001 jobs" in the(system, codes.TOO_MANY_JOBS).message


def test_jobs_after_the_cure_include_those_on_demand():
    asks = task("a", "10ms", version("v", "1ns", "u1", after("d", 0, 10), after("d", 0, 20)))
    system = model(asks, task("b", "9999999ns", version("v", "1ns")), task("d", None, version("v", "1ns")))
    assert the(system, codes.TOO_MANY_JOBS).help == (
        "use 10ms (hyperperiod 10ms) instead of 9.999999ms; the mode then has 4 jobs"
    )


def test_jobs_after_the_cure_include_those_that_jobs_on_demand_ask_for():
    """One job asks for two, of which each asks for three."""
    asks = task("a", "10ms", version("v", "1ns", "u1", after("d", 0, 10), after("d", 0, 20)))
    passes = task("d", None, version("v", "1ns", "u1", *(after("e", 0, n) for n in (10, 20, 30))))
    asked = task("e", None, version("v", "1ns"))
    system = model(asks, task("b", "9999999ns", version("v", "1ns")), passes, asked)
    assert the(system, codes.TOO_MANY_JOBS).help.endswith("the mode then has 10 jobs")


def test_alternative_that_would_break_the_limit_again_is_not_offered():
    help = the(periodic("1us", "3s", "4000000001ns"), codes.TOO_MANY_JOBS).help
    proposed = "use 4.5s (hyperperiod 9s) or 3s (hyperperiod 3s)"  # 4s would make 12 000 000 jobs
    assert help == f"{proposed} instead of 4.000000001s; the mode then has 9000005 jobs"


def test_hyperperiod_beyond_all_measure_is_still_explained():
    system = periodic(*["10ms"] * 3, *(f"{10**29 + i}/{10**28 + 2 * i + 1}ms" for i in range(300)))
    finding = the(system, codes.TOO_MANY_JOBS)
    assert "is beyond all measure" in finding.message
    assert finding.message.endswith("and 295 more; without them the hyperperiod is 10ms")


def test_one_duration_too_fine_for_64_bits():
    fine = task("a", "1s", version("v", "1/9999999999ns"))
    finding = the(model(fine, task("b", "10ms", version("v", "1ms"))), codes.TOO_MANY_TICKS)
    assert 'the finest: the WCET 1/9999999999ns of task "a"' in finding.message
    rounded = Duration.parse(re.search(r"round it to whole (\S+):", finding.help)[1])
    assert validate(model(replace(fine, versions=(replace(fine.versions[0], wcet=rounded),)))) == ()


FINE = Duration(Fraction(1, 9999999999))


@pytest.mark.parametrize(
    ("parts", "of_task", "what"),
    [
        ([access("r", FINE, "1ms")], {}, "access start"),
        ([access("r", 0, FINE)], {}, "access end"),
        ([after("b", FINE, 20)], {}, "window minimum"),
        ([after("b", 0, FINE)], {}, "window maximum"),
        ([], {"offset": FINE}, "offset"),
        ([], {"period": seconds(1) + FINE}, "period"),
    ],
)
def test_every_duration_that_is_added_up_counts_for_the_tick(parts, of_task, what):
    fine = replace(task("a", "1s", version("v", "1ms", "u1", *parts)), **of_task)
    both = model(fine, task("b", "1s", version("v", "1ms")), resources="r")
    alone = model(fine, resources="r")
    finding = the(alone if what == "period" else both, codes.TOO_MANY_TICKS)
    assert f'the finest: the {what} {FINE if what != "period" else of_task["period"]} of task "a"' in finding.message


def test_durations_that_are_only_compared_do_not_count_for_the_tick():
    system = model(task("a", "1s", version("v", "1ms"), deadline=seconds(1) - FINE, slack=Fraction(1, 9999999999)))
    assert validate(system) == ()


def test_limit_on_ticks_is_exact():
    tick = Duration(Fraction(milliseconds(1).ns, MAX_TICKS - 1))
    system = periodic("1ms")
    for wcet, count in ((tick, 0), (Duration(Fraction(milliseconds(1).ns, MAX_TICKS)), 1)):
        owner = replace(system.tasks[0], versions=(replace(system.tasks[0].versions[0], wcet=wcet),))
        assert len(found(replace(system, tasks=(owner,)), codes.TOO_MANY_TICKS)) == count


@pytest.mark.parametrize(
    ("period", "base", "most", "expected"),
    [
        ("9.5ms", "100ms", "9.5ms", ["9ms", "8ms"]),
        ("9.5ms", "100ms", None, ["10ms"]),
        ("6.66ms", "20ms", None, ["20/3ms", "5ms"]),
        ("6.66ms", "20ms", "6.66ms", ["6ms", "5ms"]),
        ("16.6ms", "100ms", None, ["50/3ms", "20ms"]),
        ("33.333333ms", "100ms", None, ["100/3ms"]),
        ("1.234567s", "100ms", None, ["1.2s", "1.1s"]),
        ("14.93ms", "7ms", None, ["15ms", "14ms"]),
        ("10.1ms", "100ms", "10ms", ["10ms"]),
        ("10.1ms", "100ms", "9.999999ms", ["9ms", "8ms"]),
    ],
)
def test_periods_are_such_as_a_person_would_write(period, base, most, expected):
    found = periods_instead(Duration.parse(period), Duration.parse(base), ms(most))
    assert [str(choice) for choice in found[:2]] == expected


def test_the_period_of_a_poll_does_not_become_longer_than_the_distance():
    system = periodic("10ms", "100ms", "9.999999ms")
    polled = replace(system.tasks[2], distance=ms("9.999999ms"))
    help = the(replace(system, tasks=(*system.tasks[:2], polled)), codes.TOO_MANY_JOBS).help
    assert help.startswith("use 9ms (hyperperiod 900ms) or 8ms (hyperperiod 200ms) instead of 9.999999ms")
    loose = replace(polled, distance=ms(12))
    help = the(replace(system, tasks=(*system.tasks[:2], loose)), codes.TOO_MANY_JOBS).help
    assert help.startswith("use 10ms (hyperperiod 100ms) instead of 9.999999ms")


PERIODS = st.integers(1, 10**6).map(Duration)


@given(PERIODS, PERIODS)
def test_nearest_harmonic_divides_or_is_divided_and_none_is_nearer(period, base):
    near = nearest_harmonic(period, base)
    assert not (base % near and near % base)
    others = [base * k for k in range(1, 4)] + [base / k for k in range(1, 50)]
    assert all(abs(period.ns - near.ns) <= abs(period.ns - other.ns) for other in others)


def test_of_short_times_too_none_is_nearer_and_none_shorter_and_as_near():
    for base in map(Duration, range(1, 21)):
        others = [base * k for k in range(1, 32)] + [base / k for k in range(1, 21)]
        for period in map(Duration, range(1, 31)):
            expected = min(others, key=lambda other, p=period: (abs(p.ns - other.ns), other))
            assert nearest_harmonic(period, base) == expected


@pytest.mark.parametrize(
    ("period", "decades", "thirds"),
    [
        (100, range(70, 140, 10), [100]),
        (99, range(66, 133), []),
        (101, range(70, 140, 10), [100]),
        (15, range(10, 21), [15]),
        (10, range(7, 14), [10]),
        (5, [Fraction(n, 10) for n in range(34, 67)], [5]),
        (33, range(22, 45), [33]),
        (334, range(230, 450, 10), [Fraction(1000, 3)]),
    ],
)
def test_round_periods_have_the_digits_of_the_decade_of_a_period_or_of_three(period, decades, thirds):
    """Up to a third more or less in steps of its second digit; of three periods, one per cent."""
    assert [time.ns for time in _round_periods(Duration(period))] == [*decades, *thirds]


@pytest.mark.parametrize(
    ("time", "digits"),
    [
        *(
            (1, 1),
            (100, 1),
            (120, 2),
            (Fraction(1, 2), 1),
            (Fraction(1, 4), 2),
            (Fraction(1, 5), 1),
            (Fraction(1, 50), 1),
        ),
        *((Fraction(100, 3), 2), (Fraction(20, 3), 2), (Fraction(1, 6), 2), (Fraction(1, 7), 6), (Fraction(1, 11), 8)),
    ],
)
def test_digits_are_those_that_one_writes_and_thirds_count_one_more(time, digits):
    assert _digits(Duration(time)) == digits


@pytest.mark.parametrize(("compared", "first"), [(1, 10), (2, 10), (3, 7), (4, 7)])
def test_periods_are_compared_with_those_of_most_tasks_alone(compared, first, monkeypatch):
    """Of 7, 14 and 28 ms each fits the others, which counts where they are among those that are compared with."""
    counts = {ms(28): 2, ms(10): 3, ms(14): 2, ms(7): 2}
    order = [ms(10), ms(7), ms(14), ms(28)] if first == 10 else [ms(7), ms(14), ms(28), ms(10)]
    monkeypatch.setattr("halpipe.pipeline.validate.hyperperiod._MAX_COMPARED", compared)
    assert _by_fit(counts) == order
    monkeypatch.undo()
    for most in (4 * compared, 4 * compared + 3):
        monkeypatch.setattr("halpipe.pipeline.validate.hyperperiod._MAX_COMPARISONS", most)
        assert _by_fit(counts) == order


@given(PERIODS, PERIODS, PERIODS)
def test_what_is_proposed_is_another_period_within_what_is_allowed(period, base, most):
    found = periods_instead(period, base, most)
    assert all(choice <= most and choice != period for choice in found)
    longer = [least_common_multiple((base, choice)) for choice in found]
    assert not longer or max(longer) == longer[0]


@pytest.mark.parametrize("periods", [("25ms", "1/30s"), ("7ms", "11ms", "13ms"), ("1us", "3us")])
def test_jobs_agree_with_the_expansion(periods):
    system = periodic(*periods)
    assert validate(system) == ()
    hyperperiod = least_common_multiple(Duration.parse(p) for p in periods)
    assert expand(system, system.modes[0]).hyperperiod == hyperperiod


def test_of_the_tasks_of_a_guilty_period_two_are_named():
    system = periodic("100ms", *["10ms"] * 6, *["9.999999ms"] * 4)
    assert 'the period 9.999999ms (task "t7", "t8" and 2 more)' in the(system, codes.TOO_MANY_JOBS).message


@pytest.mark.parametrize(
    ("period", "base", "expected"),
    [
        ("99.99ms", "100ms", ["100ms"]),
        ("100.01ms", "100ms", ["100ms"]),
        ("10.01ms", "1s", ["10ms"]),
        ("1.0001ms", "1ms", ["1ms"]),
        ("0.34ms", "1ms", ["1000/3us"]),
        ("3.3334us", "10us", ["10/3us"]),
        ("1.001s", "1s", ["1s"]),
        ("70.1ms", "10ms", ["70ms"]),
        ("0.101ms", "1ms", ["100us"]),
    ],
)
def test_periods_at_the_ends_of_a_decade_are_rounded_as_well(period, base, expected):
    found = periods_instead(Duration.parse(period), Duration.parse(base), None)
    assert [str(choice) for choice in found[:1]] == expected


def test_the_period_of_polls_does_not_become_longer_than_the_least_of_their_distances():
    system = periodic("100ms", *["10ms"] * 4, "9.999999ms", "9.999999ms")
    for distances in ((ms(12), ms("9.999999ms")), (ms("9.999999ms"), ms(12))):
        polled = [replace(t, distance=d) for t, d in zip(system.tasks[5:], distances, strict=True)]
        help = the(replace(system, tasks=(*system.tasks[:5], *polled)), codes.TOO_MANY_JOBS).help
        assert help.startswith("use 9ms")
