"""Fixed-point arithmetic of the tasks, held against exact integers and real functions."""

import ctypes
import math
import statistics

import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from profiles import examples

ONE = 65536
TURN = 2**32
FAST = examples(200, HealthCheck.function_scoped_fixture)
metres = st.integers(-60 * ONE, 60 * ONE)


@given(st.integers(0, TURN - 1))
@FAST
def test_sine_and_cosine_are_exact_to_two_units(probe, angle):
    real = 2 * math.pi * angle / TURN
    assert abs(probe.probe_sine(ctypes.c_uint32(angle)) - ONE * math.sin(real)) <= 2
    assert abs(probe.probe_cosine(ctypes.c_uint32(angle)) - ONE * math.cos(real)) <= 2


def test_sine_of_quarter_turns_is_exact(probe):
    assert [probe.probe_sine(ctypes.c_uint32(k << 30)) for k in range(4)] == [0, ONE, 0, -ONE]


@given(metres, metres)
@FAST
def test_direction_is_that_of_atan2(probe, y, x):
    if abs(x) + abs(y) < 64:
        return  # so short that the direction is in the last digits
    away = probe.probe_direction(y, x) - math.atan2(y, x) / (2 * math.pi) * TURN
    assert abs((away + TURN / 2) % TURN - TURN / 2) < TURN / 360 / 500


@given(st.integers(0, 2**64 - 1))
@FAST
def test_square_root_is_exact(probe, n):
    assert probe.probe_square_root(n) == math.isqrt(n)


@pytest.mark.parametrize("n", [0, 1, 3, 4, 2**32 - 1, 2**32, 2**62 - 1, 2**62, 2**64 - 1])
def test_square_root_at_its_limits(probe, n):
    assert probe.probe_square_root(n) == math.isqrt(n)


@given(metres, metres)
@FAST
def test_length_is_that_of_hypot(probe, x, y):
    assert probe.probe_length(x, y) == math.isqrt(x * x + y * y)


@given(metres, st.integers(-500 * ONE, 500 * ONE))
@FAST
def test_products_and_quotients_round_as_stated(probe, a, b):
    assert probe.probe_multiply(a, b) == ctypes.c_int32(a * b >> 16).value
    if abs(b) > ONE:
        quotient = abs(a * ONE) // abs(b)
        assert probe.probe_divide(a, b) == (quotient if (a >= 0) == (b > 0) else -quotient)


def test_random_numbers_do_not_repeat_soon_and_are_nearly_normal(probe):
    state = ctypes.c_uint32(2463534242)
    assert probe.probe_random(ctypes.byref(state)) == 723471715  # Marsaglia, Xorshift RNGs, 2003: the first of xor32
    drawn = [probe.probe_normal(ctypes.byref(state)) for _ in range(20000)]
    assert abs(statistics.mean(drawn)) < 4
    assert 145 < statistics.stdev(drawn) < 151
    assert len({probe.probe_random(ctypes.byref(state)) for _ in range(20000)}) == 20000
