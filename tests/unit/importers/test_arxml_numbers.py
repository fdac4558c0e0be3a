"""Numbers are read exactly as AUTOSAR writes them, never through a binary float."""

from decimal import Decimal
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.durations import Duration
from halpipe.importers.arxml.files.words import is_symbolic, parse_cse, parse_double, parse_number, parse_seconds


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


@given(st.integers(min_value=0, max_value=2**40), st.integers(min_value=0, max_value=6))
def test_codes_of_time_are_powers_of_ten_apart(factor, code):
    time = parse_cse(str(code), str(factor))
    assert time == Duration(factor * 1000 * 10**code)
    assert parse_cse(str(code + 1), str(factor)) == time * 10


@pytest.mark.parametrize(
    ("code", "time"),
    [
        ("0", "1us"),
        ("3", "1ms"),
        ("6", "1s"),
        ("8", "60s"),
        ("9", "3600s"),
        ("26", "1ns"),
        ("28", "100ns"),
        ("0x1", "10us"),
    ],
)
def test_codes_name_their_unit(code, time):
    assert parse_cse(code, "1") == Duration.parse(time)


@pytest.mark.parametrize(
    ("code", "factor"), [("100", "5"), ("11", "5"), ("", "5"), ("0.5", "5"), ("0", "-5"), ("0", "x")]
)
def test_what_counts_no_time_is_none(code, factor):
    assert parse_cse(code, factor) is None
