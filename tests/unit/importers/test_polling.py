"""Periods at which sporadic arrivals are looked for."""

import pytest

from halpipe.core.durations import Duration
from halpipe.importers.common.polling import polling_period


def ms(text):
    return Duration.parse(text)


@pytest.mark.parametrize(
    ("distance", "periods", "period"),
    [
        ("6.66ms", ["10ms", "1000ms"], "5ms"),  # an engine at 9000 rpm: 20/3 ms, cut by its file
        ("20/3ms", ["5ms", "2ms"], "5ms"),
        ("12ms", ["10ms", "40ms"], "8ms"),
        ("12ms", ["10ms"], "5ms"),  # 8 ms is no part of the hyperperiod, 10/2 is
        ("700us", ["1ms", "50ms"], "0.5ms"),
        ("100ms", ["1/30s"], "1/30s"),  # 80 ms is beyond the hyperperiod: at most all of it
        ("8ms", ["33ms", "15ms"], "5.5ms"),
        ("1.625ms", ["10ms"], "1ms"),  # 1.25 ms is the largest part, and has three digits
        ("7ms", [], "5ms"),
        ("2ns", [], "1ns"),
        ("1/3ns", [], "4/15ns"),
    ],
)
def test_polling_keeps_the_hyperperiod(distance, periods, period):
    assert polling_period(ms(distance), [ms(text) for text in periods]) == ms(period)
