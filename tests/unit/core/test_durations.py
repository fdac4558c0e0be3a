"""Exact time: what is read, what is printed, what is refused."""

from fractions import Fraction

import pytest

from halpipe.core.durations import (
    ZERO,
    Duration,
    divisors,
    greatest_common_divisor,
    least_common_multiple,
    milliseconds,
    seconds,
)


@pytest.mark.parametrize(
    ("text", "ns"),
    [
        ("25ms", 25_000_000),
        ("0.5ms", 500_000),
        ("40us", 40_000),
        ("1s", 10**9),
        ("7ns", 7),
        ("0.5ns", Fraction(1, 2)),
        ("100/3ms", Fraction(10**8, 3)),
        ("1/30s", Fraction(10**9, 30)),
        ("0ms", 0),
        ("0/7s", 0),
        ("007ms", 7_000_000),
        (" 25ms\n", 25_000_000),
        ("25 ms", 25_000_000),
    ],
)
def test_text_is_read_exactly(text, ns):
    assert Duration.parse(text).ns == ns


@pytest.mark.parametrize(
    "text",
    [
        *(
            "",
            "ms",
            "25",
            "25 m",
            "25MS",
            "-1ms",
            "+1ms",
            "1e3ms",
            ".5ms",
            "5.ms",
            "1/ms",
            "/3ms",
            "1/2/3ms",
            "1.5/3ms",
        ),
        *("25msx", "2 5ms", "٢ms", "²ms", "0x10ms", "inf", "nanms", "1_000ms", "25ms 1us", "25m\0s"),
    ],
)
def test_what_is_no_duration_is_refused_with_an_example(text):
    with pytest.raises(ValueError, match=r"not a duration.*such as 25ms") as refusal:
        Duration.parse(text)
    assert repr(text) in str(refusal.value)


@pytest.mark.parametrize("text", ["1,5ms", "1,5 ms"])
def test_a_decimal_comma_is_refused_with_the_point(text):
    with pytest.raises(ValueError, match=r"not a duration; write 1\.5 ?ms, with a decimal point"):
        Duration.parse(text)


def test_division_by_zero_is_refused_as_such():
    with pytest.raises(ValueError, match="divides by zero"):
        Duration.parse("1/0ms")


def test_endless_text_is_refused_without_repeating_it():
    with pytest.raises(ValueError, match=r"not a duration") as refusal:
        Duration.parse("1" * 10**6 + "ms")
    assert len(str(refusal.value)) < 300


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        ("0s", "0ms"),
        ("1000ms", "1s"),
        ("1500ms", "1.5s"),
        ("999ms", "999ms"),
        ("1/30s", "100/3ms"),
        ("999us", "999us"),
        ("0.001us", "1ns"),
        ("0.25ns", "0.25ns"),
        ("1/3ns", "1/3ns"),
        # A bigger unit would need more digits than a task model may have.
        ("1000." + "0" * 29 + "1ms", "1000." + "0" * 29 + "1ms"),
        ("9" * 30 + "/" + "9" * 29 + "7ms", "9" * 30 + "/" + "9" * 29 + "7ms"),
    ],
)
def test_the_largest_fitting_unit_is_printed(text, printed):
    assert str(Duration.parse(text)) == printed


def test_negative_spans_print_with_their_sign():
    assert str(-Duration.parse("1.5ms")) == "-1.5ms"
    assert repr(ZERO - Duration.parse("1/3ms")) == "Duration('-1000/3us')"


def test_equal_spans_are_equal_whatever_they_are_made_of():
    whole, fraction = Duration(1_000_000), Duration(Fraction(2_000_000, 2))
    assert whole == fraction == Duration.parse("1ms") == milliseconds(1) == seconds(Fraction(1, 1000))
    assert hash(whole) == hash(fraction)
    assert isinstance(fraction.ns, int)
    assert whole != 1_000_000


def test_only_zero_is_false():
    assert not ZERO
    assert Duration(Fraction(1, 10**30))


def test_conversion_to_units_is_exact():
    assert Duration.parse("1ms").in_unit("s") == Fraction(1, 1000)
    assert Duration.parse("1/3ms").in_unit("us") == Fraction(1000, 3)


def test_divisors_and_multiples_of_a_camera_and_a_controller():
    camera, control = Duration.parse("1/30s"), Duration.parse("25ms")
    assert least_common_multiple([camera, control]) == Duration.parse("100ms")
    assert greatest_common_divisor([camera, control]) == Duration.parse("25/3ms")


def test_divisors_and_multiples_of_nothing_are_zero():
    assert greatest_common_divisor([]) == greatest_common_divisor([ZERO, ZERO]) == ZERO
    assert least_common_multiple([]) == ZERO
    assert greatest_common_divisor([ZERO, Duration(6)]) == Duration(6)


@pytest.mark.parametrize(
    ("total", "unit", "factors"),
    [
        ("12ms", "1ms", [1, 2, 3, 4, 6, 12]),
        ("16ms", "1ms", [1, 2, 4, 8, 16]),
        ("1ms", "1ms", [1]),
        ("7ms", "2ms", []),
        ("0ms", "1ms", []),
    ],
)
def test_every_divisor_is_found_from_both_sides_of_the_root(total, unit, factors):
    assert divisors(Duration.parse(total), Duration.parse(unit)) == [milliseconds(factor) for factor in factors]


def test_no_divisors_are_looked_for_beyond_the_bound():
    assert divisors(Duration(10**12), Duration(1))[-1] == Duration(10**12)
    assert divisors(Duration(10**12 + 1), Duration(1)) == []
