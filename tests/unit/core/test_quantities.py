"""Rationals, sizes and bandwidths: read and printed without loss."""

from fractions import Fraction

import pytest

from halpipe.core.quantities import (
    format_bandwidth,
    format_percent,
    format_rational,
    format_size,
    is_writable,
    parse_address,
    parse_bandwidth,
    parse_frequency,
    parse_rational,
    parse_share,
    parse_signed,
    parse_size,
    quoted,
    whole,
)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.35", Fraction(35, 100)),
        ("1/3", Fraction(1, 3)),
        ("12", Fraction(12)),
        (" 1\t", Fraction(1)),
        ("0.1", Fraction(1, 10)),
        ("00.10", Fraction(1, 10)),
        ("0/5", Fraction(0)),
        ("9" * 999, Fraction(10**999 - 1)),
    ],
)
def test_a_number_is_read_exactly(text, value):
    assert parse_rational(text) == value


def test_a_share_may_be_a_percentage():
    assert [parse_share(text) for text in ("0.35", "7/20", " 35% ", "35 %")] == [Fraction(7, 20)] * 4


def test_a_decimal_comma_is_refused_with_the_point():
    with pytest.raises(ValueError, match=r"not a number; write 1\.5, with"):
        parse_rational("1,5")


@pytest.mark.parametrize("text", ["%", "-5%", "5%%", "5%1"])
def test_what_is_no_share_is_refused(text):
    with pytest.raises(ValueError, match="not a number; write it as"):
        parse_share(text)


@pytest.mark.parametrize("text", ["", "-1", "+1", ".5", "1.", "1e5", "1/", "0.5/2", "1 /2", "½", "nan", "1_0"])
def test_what_is_no_number_is_refused(text):
    with pytest.raises(ValueError, match="not a number; write it as"):
        parse_rational(text)


def test_division_by_zero_is_refused_as_such():
    with pytest.raises(ValueError, match="'1/00' divides by zero"):
        parse_rational("1/00")


def test_the_longest_number_has_a_thousand_characters():
    with pytest.raises(ValueError, match="more than 1000 characters") as refusal:
        parse_rational("1" * 1001)
    assert len(str(refusal.value)) < 200


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (Fraction(3), "3"),
        (Fraction(-3), "-3"),
        (Fraction(1, 8), "0.125"),
        (Fraction(-1, 8), "-0.125"),
        (Fraction(1, 3), "1/3"),
        (Fraction(-7, 6), "-7/6"),
        (Fraction(1001, 1000), "1.001"),
        (Fraction(1, 2**30), f"0.{5**30:030d}"),
        (Fraction(1, 2**31), f"1/{2**31}"),
    ],
)
def test_a_number_prints_as_a_decimal_where_one_of_thirty_digits_exists(value, text):
    assert format_rational(value) == text


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("4320B", 4320),
        ("64KiB", 65536),
        ("64kB", 64000),
        ("1.5MB", 1_500_000),
        ("0.5MiB", 524_288),
        ("1 GiB", 2**30),
        ("2GB", 2 * 10**9),
        ("0B", 0),
        (" 1B ", 1),
    ],
)
def test_a_size_is_read_in_bytes(text, size):
    assert parse_size(text) == size


@pytest.mark.parametrize("text", ["", "4320", "B", "-1B", "4 TB", "64kiB", "64KB", "1/2kB", "1B/s", "1e3B"])
def test_what_is_no_size_is_refused(text):
    with pytest.raises(ValueError, match="not a size; write it as"):
        parse_size(text)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("-5", "too small; write a number from 0 on"),
        ("9" * 21, "too large; write at most 20 digits"),
        ("1.0", "no whole number; write a number from 0 on"),
        ("\u0663", "no whole number"),
    ],
)
def test_a_whole_number_out_of_range_is_still_one(text, fault):
    with pytest.raises(ValueError, match=f"is {fault}"):
        whole(0)(text)


def test_numbers_of_the_most_digits_that_are_read_have_both_limits():
    read = whole(2 * 10**19, 9 * 10**19)
    assert read(str(2 * 10**19)) == 2 * 10**19
    with pytest.raises(ValueError, match="is too small"):
        read(str(2 * 10**19 - 1))
    with pytest.raises(ValueError, match="is too large"):
        read(str(9 * 10**19 + 1))


def test_a_size_has_whole_bytes():
    with pytest.raises(ValueError, match=r"'0\.3B' is not a whole number of bytes"):
        parse_size("0.3B")


@pytest.mark.parametrize(("text", "rate"), [("400MB/s", 4 * 10**8), ("19.2GB/s", 192 * 10**8), ("1KiB/s", 1024)])
def test_a_bandwidth_is_read_in_bytes_per_second(text, rate):
    assert parse_bandwidth(text) == rate


@pytest.mark.parametrize("text", ["0MB/s", "0B/s", "0.0GiB/s"])
def test_a_bandwidth_of_nothing_is_refused(text):
    with pytest.raises(ValueError, match="moves nothing; write a bandwidth above zero"):
        parse_bandwidth(text)


@pytest.mark.parametrize("text", ["", "400MB", "400MB/ms", "/s", "fast", "400Mb/s"])
def test_what_is_no_bandwidth_is_refused(text):
    with pytest.raises(ValueError, match="not a bandwidth; write it as"):
        parse_bandwidth(text)


@pytest.mark.parametrize(
    ("size", "text"),
    [
        (0, "0B"),
        (999, "999B"),
        (1000, "1kB"),
        (1024, "1KiB"),
        (1100, "1.1kB"),
        (1111, "1111B"),
        (1536, "1.5KiB"),
        (2**30, "1GiB"),
        (10**9, "1GB"),
    ],
)
def test_a_size_prints_in_the_largest_unit_with_at_most_one_decimal(size, text):
    assert format_size(size) == text
    assert format_bandwidth(size) == text + "/s"


def test_long_values_are_cut_in_messages():
    assert quoted("short") == "'short'"
    assert quoted("x" * 81) == "'" + "x" * 80 + "'..."


@pytest.mark.parametrize(("text", "value"), [("0x80000000", 1 << 31), ("0XfF", 255), ("010", 10), (" 0 ", 0)])
def test_an_address(text, value):
    assert parse_address(text) == value


@pytest.mark.parametrize("text", ["-5", "1_000", "0b1", "0x", "\uff11", "", "0x" + "f" * 17, "80000000h"])
def test_what_is_no_address(text):
    with pytest.raises(ValueError, match="0x80000000"):
        parse_address(text)


@pytest.mark.parametrize(
    ("text", "hertz"),
    [("1Hz", 1), ("250 kHz", 250_000), ("533.333333MHz", 533_333_333), ("4.2GHz", 4_200_000_000), (" 1MHz ", 10**6)],
)
def test_a_frequency_is_read_in_hertz(text, hertz):
    assert parse_frequency(text) == hertz


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1", "is not a frequency"),
        ("1mHz", "is not a frequency"),
        ("0Hz", "is not a whole number of Hz above zero"),
        ("0.5Hz", "is not a whole number of Hz above zero"),
        ("4294967296Hz", "does not fit into 32 bits"),
    ],
)
def test_what_is_no_frequency_is_refused(text, said):
    with pytest.raises(ValueError, match=said):
        parse_frequency(text)
    assert parse_frequency("4294967295Hz") == 2**32 - 1


@pytest.mark.parametrize(
    ("share", "is_bound", "text"),
    [
        ("1/3", False, "33.3 %"),
        ("1/3", True, "33.4 %"),
        ("1/2", True, "50 %"),
        ("0", False, "0 %"),
        ("1/2000", False, "less than 0.1 %"),
        ("1/2000", True, "0.1 %"),
    ],
)
def test_a_share_prints_in_tenths_of_a_percent(share, is_bound, text):
    assert format_percent(Fraction(share), is_bound=is_bound) == text
    assert is_bound or format_percent(Fraction(share)) == text


def test_numbers_with_a_sign_are_read_and_long_ones_are_not_writable():
    assert [parse_signed(text) for text in ("-1/3", " 2 ", "-0")] == [Fraction(-1, 3), Fraction(2), Fraction(0)]
    with pytest.raises(ValueError, match="is not a number"):
        parse_signed("--1")
    assert is_writable(Fraction(10**998))
    assert not is_writable(Fraction(10**999))
    assert not is_writable(Fraction(1, 3**3000))
