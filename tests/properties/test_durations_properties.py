"""Exact time and quantities: they agree with Fraction, and what is printed is read back."""

from contextlib import suppress
from fractions import Fraction
from functools import reduce

from hypothesis import assume, given
from hypothesis import strategies as st

import strategies
from halpipe.core.durations import ZERO, Duration, greatest_common_divisor, least_common_multiple
from halpipe.core.quantities import (
    format_bandwidth,
    format_rational,
    format_size,
    parse_bandwidth,
    parse_rational,
    parse_size,
)
from profiles import examples

FAST = examples(100)

rationals = st.fractions(min_value=0, max_value=10**12, max_denominator=10**9)
spans = rationals.map(Duration)
positive = spans.filter(bool)


@FAST
@given(strategies.durations)
def test_a_printed_duration_is_read_back(duration):
    assert Duration.parse(str(duration)) == duration
    assert str(Duration.parse(str(duration))) == str(duration)


@FAST
@given(strategies.rational_texts(), st.sampled_from(sorted(strategies.UNIT_SIZES)))
def test_a_duration_is_its_number_times_its_unit(text, unit):
    duration = Duration.parse(text + unit)
    assert duration.fraction == Fraction(text) * strategies.UNIT_SIZES[unit]
    assert duration.in_unit(unit) == Fraction(text)
    assert isinstance(duration.ns, int) == (duration.fraction.denominator == 1)


@FAST
@given(rationals, rationals)
def test_arithmetic_is_that_of_fractions(a, b):
    x, y = Duration(a), Duration(b)
    assert (x + y).fraction == a + b
    assert (x - y).fraction == a - b
    assert (-x).fraction == -a
    assert (x * b).fraction == (b * x).fraction == a * b
    assert (x < y, x <= y, x == y, x > y, x >= y) == (a < b, a <= b, a == b, a > b, a >= b)
    assert bool(x) == bool(a)
    if a == b:
        assert hash(x) == hash(y)


@FAST
@given(rationals, rationals.filter(bool))
def test_division_is_that_of_fractions(a, b):
    x, y = Duration(a), Duration(b)
    assert x / y == a / b
    assert (x / b).fraction == a / b
    assert x // y == a // b
    assert (x % y).fraction == a % b
    assert y * (x // y) + x % y == x
    assert (-x % y).fraction == -a % b


@FAST
@given(st.lists(spans, max_size=5), positive)
def test_the_common_divisor_is_the_greatest(durations, scale):
    divisor = greatest_common_divisor(durations)
    if not any(durations):
        assert divisor == ZERO
        return
    quotients = [d / divisor for d in durations]
    assert all(q.denominator == 1 for q in quotients)
    assert reduce(lambda a, b: Fraction(_euclid(a, b)), quotients) == 1
    assert greatest_common_divisor([d * scale.fraction for d in durations]) == divisor * scale.fraction


@FAST
@given(st.lists(positive, min_size=1, max_size=4))
def test_the_common_multiple_is_the_least(durations):
    multiple = least_common_multiple(durations)
    counts = [multiple / d for d in durations]
    assert all(count.denominator == 1 and count > 0 for count in counts)
    # A smaller common multiple would leave a common factor in how often each duration fits.
    assert reduce(lambda a, b: Fraction(_euclid(a, b)), counts) == 1


def _euclid(a, b):
    return _euclid(b, a % b) if b else a


@FAST
@given(positive, positive)
def test_two_durations_are_their_divisor_times_their_multiple(a, b):
    divisor, multiple = greatest_common_divisor([a, b]), least_common_multiple([a, b])
    assert divisor.fraction * multiple.fraction == a.fraction * b.fraction


@FAST
@given(strategies.metrics)
def test_a_printed_number_is_read_back(value):
    sign, text = (-1, format_rational(value)[1:]) if value < 0 else (1, format_rational(value))
    assume(len(text) <= 1000)
    assert sign * parse_rational(text) == value


@FAST
@given(strategies.rational_texts())
def test_a_number_is_read_as_python_reads_it(text):
    assert parse_rational(text) == Fraction(text)


@FAST
@given(strategies.digits)
def test_a_printed_size_is_read_back(size):
    assert parse_size(format_size(size)) == size
    assert parse_bandwidth(format_bandwidth(size + 1)) == size + 1  # none of zero


@FAST
@given(strategies.digits, st.sampled_from(sorted(strategies.SIZE_UNITS)))
def test_a_size_is_its_number_times_its_unit(number, unit):
    assert parse_size(f"{number}{unit}") == number * strategies.SIZE_UNITS[unit]


@FAST
@given(st.text(max_size=20))
def test_any_text_is_read_as_something_not_negative_or_refused(text):
    for parse, nothing in ((Duration.parse, ZERO), (parse_rational, 0), (parse_size, 0), (parse_bandwidth, 0)):
        with suppress(ValueError):
            assert parse(text) >= nothing
