"""Periods: what was measured comes back as what was meant, exactly."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.durations import Duration, seconds
from halpipe.importers.ros.graph import MEASURED, STATED, snap


@pytest.mark.parametrize(
    ("measured_ns", "meant"),
    [
        (100_001_000, "100ms"),
        (19_999_999, "20ms"),
        (1_000_000_099, "1s"),
        (30_000_000, "30ms"),
        (33_333_333, "1/30s"),
        (16_666_667, "1/60s"),
        (8_333_333, "1/120s"),
        (12_500_000, "12.5ms"),
        (99_000_000, "99ms"),
        (1_000_100, "1ms"),
        (20_101_000_000, "20.1s"),
        (20_011_000_000, "20.01s"),
        (20_013_100_000, "20.013s"),
        (2_000_300_001, "2.0003s"),
        (200_131_001, "200.13ms"),
        (20_013_001, "20.013ms"),
    ],
)
def test_timers(measured_ns, meant):
    assert snap(Duration(measured_ns), STATED) == Duration.parse(meant)


@pytest.mark.parametrize(
    ("messages", "duration_ns", "meant"),
    [
        (21052, 525_154_215_868, "25ms"),
        (5252, 525_154_215_868, "100ms"),
        (8038, 405_935_763_614, "50ms"),
        (1201, 40_000_000_000, "1/30s"),
        (100, 307_989_000_000, "3.1s"),
    ],
)
def test_recorded_rates(messages, duration_ns, meant):
    assert snap(Duration(duration_ns) / (messages - 1), MEASURED) == Duration.parse(meant)


def test_a_timer_is_not_pulled_as_far_as_a_recorded_rate():
    assert snap(Duration(24_947_000), STATED) == Duration(24_947_000)
    assert snap(Duration(24_947_000), MEASURED) == Duration(25_000_000)


def test_absolute_tolerance_does_not_swallow_short_periods():
    assert snap(Duration(5_300), STATED) == Duration(5_300)
    assert snap(Duration(201_000), STATED) == Duration(201_000)


@given(
    st.fractions(min_value=Fraction(1, 10), max_value=10**13).filter(bool),
    st.sampled_from([STATED, MEASURED]),
)
def test_snapping_moves_within_tolerance_to_a_round_value_or_not_at_all(ns, tolerance):
    period = Duration(ns)
    snapped = snap(period, tolerance)
    assert abs((snapped - period).fraction) <= tolerance.of(period).fraction
    is_whole_microseconds = (snapped / Duration(1000)).denominator == 1
    is_whole_rate = (seconds(1) / snapped).denominator == 1
    assert snapped == period or is_whole_microseconds or is_whole_rate


@given(st.integers(1, 1000))
def test_whole_rates_cut_to_nanoseconds_come_back_or_stay_close(rate):
    cut = Duration(10**9 // rate)
    snapped = snap(cut, STATED)
    assert abs((snapped - seconds(1) / rate).fraction) <= STATED.of(cut).fraction + 1


@pytest.mark.parametrize("ns", [0, -1, -(10**9)])
@pytest.mark.parametrize("tolerance", [STATED, MEASURED])
def test_what_is_no_period_is_left_alone(ns, tolerance):
    assert snap(Duration(ns), tolerance) == Duration(ns)
