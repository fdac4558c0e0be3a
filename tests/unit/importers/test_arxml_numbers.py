"""Numbers are read exactly as AUTOSAR writes them, never through a binary float."""

from decimal import Decimal
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from halpipe.durations import Duration
from halpipe.importers.arxml.numbers import is_symbolic, parse_double, parse_number, parse_seconds


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("20", 20),
        ("0x14", 20),
        ("0X1f", 31),
        ("0b101", 5),
        ("017", 15),
        ("0", 0),
        ("00", 0),
        ("-0x10", -16),
        ("2.5E-8", Fraction(25, 10**9)),
        ("+.5", Fraction(1, 2)),
        (" 1. ", 1),
        ("089", 89),
    ],
)
def test_configuration_numbers(text, value):
    assert parse_number(text) == value


@pytest.mark.parametrize(
    "text", ["", ".", "INF", "-INF", "NaN", "ten", "1,5", "0x", "1e", "1e999", "--1", "1 2", "9" * 50]
)
def test_what_is_no_number(text):
    assert parse_double(text) is None


@pytest.mark.parametrize(
    ("text", "period"), [("0.0157", "15.7ms"), ("1E-3", "1ms"), ("10", "10s"), ("5e-10", "0.5ns"), ("0.0", "0ms")]
)
def test_seconds_are_exact(text, period):
    assert parse_seconds(text) == Duration.parse(period)


def test_negative_seconds_are_no_time():
    assert parse_seconds("-0.01") is None


@given(st.decimals(allow_nan=False, allow_infinity=False, min_value=0, max_value=10**9, places=12))
def test_every_decimal_survives(value: Decimal):
    for text in (f"{value:f}", f"{value:E}"):
        assert parse_double(text) == Fraction(value)


@given(st.integers(min_value=0, max_value=2**64))
def test_every_integer_survives_in_every_base(value):
    assert {parse_number(text) for text in (str(value), hex(value), bin(value), f"0{value:o}")} == {value}


@given(st.text(max_size=30))
def test_no_text_breaks_the_readers(text):
    number = parse_number(text)
    assert number is None or isinstance(number, Fraction)
    assert not (is_symbolic(text) and number is not None)


@pytest.mark.parametrize(
    ("text", "symbolic"),
    [("CanMainPeriod", True), ("_P1", True), ("NaN", False), ("INF", False), ("0.1", False), ("a b", False)],
)
def test_names_in_place_of_numbers(text, symbolic):
    assert is_symbolic(text) is symbolic
