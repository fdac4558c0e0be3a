"""Steps of resctrl: the values that each kind of processor takes, what they grant, and what the kernel shows."""

from fractions import Fraction

import pytest
from regulator_samples import PLATFORM, files, low_bounds, made, nearly_all, platform

from halpipe.exporters.regulator import codes
from halpipe.exporters.regulator.rates import coarse
from halpipe.exporters.regulator.resctrl.writer import EIGHTH, Steps
from halpipe.exporters.regulator.writing import backend

PEAK = 8_000_000


def steps(tmp_path, settings):
    return Steps(platform(tmp_path, resctrl=f"{{{settings}}}", peak="8MB/s"))


@pytest.mark.parametrize(
    ("settings", "values"),
    [
        ("kind: intel", range(10, 101, 10)),
        ("kind: intel, min: 15", range(20, 101, 10)),
        ("kind: intel, min: 0, step: 25", range(25, 101, 25)),  # 0 would stop a group
        ("kind: intel, min: 60, step: 70", [70]),  # 100 would be rounded up beyond what there is
        ("kind: intel, max: 45", [10, 20, 30, 40]),
        ("kind: intel, levels: 20=1MB/s 50=3MB/s 100=7MB/s", [20, 50, 100]),
        ("kind: amd", range(1, 2049)),
        ("kind: amd, step: 3, max: 10", [3, 6, 9]),
    ],
)
def test_values_that_the_kernel_takes(tmp_path, settings, values):
    found = steps(tmp_path, settings)
    assert found.values == list(values)
    assert [found.shown(value) for value in found.values] == found.values
    grants = [found.given(value) for value in found.values]
    assert grants == sorted(grants)


def test_what_values_grant(tmp_path):
    intel = steps(tmp_path, "kind: intel")
    assert [intel.given(value) for value in (10, 15, 100)] == [PEAK // 10, PEAK // 5, PEAK]
    assert intel.rounded(21) == 30
    assert steps(tmp_path, "kind: amd, step: 4").given(5) == 8 * EIGHTH == 10**9
    assert steps(tmp_path, "kind: intel, levels: 20=1MB/s 50=3MB/s").given(50) == 3_000_000


def test_the_smallest_value_that_grants_a_rate_is_taken(tmp_path):
    found = steps(tmp_path, "kind: intel")
    rates = (Fraction(0), Fraction(PEAK, 10), Fraction(PEAK, 10) + 1, Fraction(PEAK * 2))
    assert [found.value_for(rate) for rate in rates] == [10, 10, 20, 100]


def test_mpam_takes_parts_of_the_largest(tmp_path):
    """Of three bits: eighths, by percentages in steps of 13, which the kernel shows rounded to the nearest."""
    found = steps(tmp_path, "kind: mpam, width: 3")
    assert (found.least, found.step) == (13, 13)
    assert found.values == [13, 26, 39, 52, 65, 78, 91, 100]
    assert [found.given(value) for value in found.values] == [PEAK * n // 8 for n in range(1, 9)]
    assert [found.shown(value) for value in found.values] == [13, 25, 38, 50, 63, 75, 88, 100]


@pytest.mark.parametrize(("width", "least", "step"), [(1, 50, 50), (2, 25, 25), (8, 0, 1), (16, 0, 1)])
def test_steps_of_mpam_by_the_width_of_its_field(tmp_path, width, least, step):
    found = steps(tmp_path, f"kind: mpam, width: {width}")
    assert (found.least, found.step, found.values[-1]) == (least, step, 100)
    assert found.given(100) == PEAK
    assert found.given(found.values[0]) == Fraction(PEAK, 2**width)  # there is no part of nothing


def test_a_value_beyond_the_field_of_mpam_wraps_and_is_not_written(tmp_path):
    """In steps of 30, a value of 100 is 120 per cent of four parts: the fifth, which the field holds as the first."""
    found = steps(tmp_path, "kind: mpam, width: 2, min: 30, step: 30")
    assert found.values == [30, 60, 90]
    assert [found.given(value) * 4 / PEAK for value in (30, 60, 90, 100)] == [1, 2, 4, 1]
    assert found.shown(100) == 25


def test_scripts_compare_with_what_the_kernel_shows(tmp_path):
    script = files(tmp_path, "resctrl", resctrl="{kind: mpam, width: 3}", peak="16MB/s")["0-fast.sh"].decode()
    assert "put . 'MB:0=13' 'MB:0=13'" in script
    assert "put one 'MB:0=13' 'MB:0=13'" in script  # 1.6 MB/s of 16
    narrow = files(tmp_path, "resctrl", resctrl="{kind: mpam, width: 3}", peak="17MB/s", capacity="12MB/s")
    assert "put two 'MB:0=26' 'MB:0=25'" in narrow["1-slow.sh"].decode()  # 2.56 MB/s of 17


def told(tmp_path, settings, **changes):
    found = made(tmp_path, "resctrl", low_bounds, resctrl=f"{{{settings}}}", **changes)[1]
    return [(d.code, d.message) for d in found if d.path == "platform resctrl"]


@pytest.mark.parametrize(
    ("settings", "strange"),
    [
        ("levels: 10=2MB/s 100=16MB/s", None),
        ("min: 1, step: 1, levels: 1=2MB/s 100=16MB/s", None),
        ("levels: 15=2MB/s 100=16MB/s", "15 is of no value from 10 to 100 in steps of 10"),
        ("min: 10, step: 5, levels: 5=2MB/s 100=16MB/s", "5 is of no value from 10 to 100 in steps of 5"),
        ("levels: 10=2MB/s 110=16MB/s", "110 is of no value from 10 to 100 in steps of 10"),
        ("min: 0, levels: 0=2MB/s 100=16MB/s", "0 is of no value from 0 to 100 in steps of 10"),
    ],
)
def test_levels_are_of_values_that_the_kernel_takes(tmp_path, settings, strange):
    expected = [(codes.RATE_DOES_NOT_FIT.id, f"the level of {strange}")] if strange else []
    assert told(tmp_path, settings) == expected


@pytest.mark.parametrize("kind", ["amd", "mpam"])
def test_levels_are_measured_for_percentages_of_intel(tmp_path, kind):
    message = f"levels are of kind intel, the platform states {kind}"
    assert told(tmp_path, f"kind: {kind}, levels: 10=2MB/s 100=16MB/s") == [(codes.RATE_DOES_NOT_FIT.id, message)]


def test_a_range_without_a_value(tmp_path):
    message = "there is no value from 60 to 50 in steps of 60"
    assert told(tmp_path, "kind: amd, step: 40, max: 30")[0][1] == "there is no value from 0 to 30 in steps of 40"
    assert told(tmp_path, "min: 60, step: 60, max: 50") == [(codes.RATE_DOES_NOT_FIT.id, message)]


def test_shares_of_what_was_not_measured_are_approximate(tmp_path):
    assert [code for code, _ in told(tmp_path, "kind: intel", peak="16MB/s")] == [codes.APPROXIMATE.id]
    assert [code for code, _ in told(tmp_path, "kind: mpam")] == [codes.APPROXIMATE.id]
    assert told(tmp_path, "kind: mpam", peak="16MB/s") == []


def test_more_than_the_largest_share_is_refused_with_both(tmp_path):
    found = made(tmp_path, "resctrl", low_bounds, resctrl="{levels: 10=1MB/s 100=2MB/s}")[1]
    refused = {d.path: (d.code, d.message) for d in found if d.is_error}
    code, message = refused['mode "slow" unit "u2"']
    assert code == codes.RATE_DOES_NOT_FIT.id
    assert message == "is promised 2.56MB/s; the largest share is 2MB/s"
    assert 'mode "fast" unit "u1"' not in refused  # 1.6 MB/s


def test_a_group_of_a_name_that_resctrl_has_itself(tmp_path):
    found = made(tmp_path, "resctrl", text=PLATFORM.replace("group: one", "group: info"))[1]
    assert [(d.code, d.path, d.message) for d in found if d.is_error] == [
        (codes.NO_MANAGER.id, 'unit "u1"', 'has the group "info"')
    ]


@pytest.mark.parametrize(("given", "promised", "is_coarse"), [(499, 400, False), (500, 400, True), (500, 0, False)])
def test_a_quarter_more_than_promised_is_coarse(tmp_path, given, promised, is_coarse):
    tables, _ = made(tmp_path, "resctrl")
    found = coarse(tables.tables[0], "u1", Fraction(given), Fraction(promised))
    assert [d.code for d in found] == [codes.COARSE_RATE.id] * is_coarse


@pytest.mark.parametrize(("settings", "least"), [("kind: intel", 10), ("kind: amd", 1), ("min: 30, step: 10", 30)])
def test_what_belongs_to_no_unit_gets_the_least(tmp_path, settings, least):
    tables, _ = made(tmp_path, "resctrl", resctrl=f"{{{settings}}}")
    assert backend("resctrl").facts(tables)["least"] == least


@pytest.mark.parametrize(
    ("settings", "is_named"),
    [
        ("kind: intel", False),  # a larger capacity would be above the peak, of which shares are parts
        ("kind: intel, levels: 10=600MB/s 60=3000MB/s 100=6400MB/s", True),
        ("kind: amd", True),
    ],
)
def test_a_larger_capacity_is_a_remedy_where_shares_are_no_parts_of_it(tmp_path, settings, is_named):
    rates = {"guaranteed": "6.4GB/s", "capacity": "6.4GB/s", "peak": "6.4GB/s", "clock": "1GHz", "window": "1ms"}
    found = made(tmp_path, "resctrl", nearly_all, resctrl=f"{{{settings}}}", **rates)[1]
    (refused,) = [d for d in found if d.is_error]
    assert "comes to" in refused.message
    assert ("capacity: " in refused.help) == is_named
