"""Counters of bytes from a board against the budgets of a bundle: at the limit, and one byte beyond it."""

import pytest

import regulator_bundles as bundles
from halpipe.core.diagnostics import HalpipeError
from halpipe.deploy.regulator import codes
from halpipe.deploy.regulator.counters import compare_counters

NS = 640
"""A window."""


@pytest.fixture(scope="module")
def target(tmp_path_factory):
    """Of u1 in the table "full": 4 bursts of 64 B to read in windows 20 to 25, none in 26."""
    return bundles.target(bundles.export(tmp_path_factory.mktemp("bundle"), *bundles.system()))


def found(target, *rows, header="table,unit,direction,window,bytes", mode=""):
    return [
        (d.code, d.at.line) for d in compare_counters(target, "\n".join([header, *rows]), "c.csv", mode).diagnostics
    ]


def test_the_whole_budget_and_no_more(target):
    assert found(target, "full,u1,read,20,256") == []
    assert found(target, "full,u1,read,20,256", "full,u1,read,21,257") == [(codes.USED_ABOVE_BUDGET.id, 3)]


def test_a_burst_that_was_waiting_passes_after_the_last_window(target):
    assert found(target, "full,u1,read,26,64") == []
    assert found(target, "full,u1,read,26,65") == [(codes.USED_ABOVE_BUDGET.id, 2)]
    assert found(target, "full,u1,read,27,1") == [(codes.USED_ABOVE_BUDGET.id, 2)]


def test_intervals_have_the_budgets_of_all_windows_that_they_touch(target):
    header = "unit,direction,start_us,end_us,bytes"
    rows = [f"u1,read,{20 * 0.64},{22 * 0.64},512", "u1,read,12.9,13.5,512"]
    assert found(target, *rows, header=header, mode="full") == []
    assert found(target, "u1,read,12.9,13.4,257", header=header, mode="full") == [(codes.USED_ABOVE_BUDGET.id, 2)]


def test_half_a_window_is_promised_half_its_bytes(target):
    row = "u1,read,13.12,13.44,0"  # the second half of window 20
    counted = compare_counters(target, f"unit,direction,start_us,end_us,bytes\n{row}", "c.csv", "full")
    assert counted.usage["full", "u1", "read"].promised == 128


def test_the_largest_number_of_a_counter_is_read(target):
    assert found(target, "full,u1,read,20," + "1" * 18)[0] == (codes.USED_ABOVE_BUDGET.id, 2)


def test_modes_repeat_and_switches_do_not(target):
    assert found(target, "full,u1,read,60,256") == []
    assert found(target, "full,u1,read,60,257") == [(codes.USED_ABOVE_BUDGET.id, 2)]
    assert found(target, "full->lean,u2,read,4000,0") == [(codes.BROKEN_COUNTERS.id, 2)]


def test_all_together_are_held_against_the_capacity(target):
    rows = [f"full,{unit},{direction},21,100" for unit in ("u1", "u2", "u3") for direction in ("read", "write")]
    assert (codes.USED_ABOVE_CAPACITY.id, 2) in found(target, *rows)
    assert (codes.USED_ABOVE_CAPACITY.id, 2) not in found(target, *rows[:5])


def test_promised_granted_and_used_bytes_are_summed(target):
    counted = compare_counters(
        target, "table,unit,direction,window,bytes\nfull,u1,read,20,200\nfull,u1,read,21,56", "c.csv"
    )
    usage = counted.usage["full", "u1", "read"]
    assert (usage.samples, usage.promised, usage.granted, usage.used) == (2, 512, 512, 256)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("full,u9,read,20,1", "no unit 'u9'"),
        ("fool,u1,read,20,1", 'did you mean "full"'),
        ("full,u1,both,20,1", "no direction 'both'"),
        ("full,u1,read,20,-1", "not a whole number"),
        ("full,u1,read,1e3,1", "not a whole number"),
        ("full,u1,read,20," + "1" * 19, "not a whole number"),
        ("full,u1,read", "is not a number"),
        (",u1,read,20,1", "no table"),
    ],
)
def test_rows_that_cannot_be_used_are_named(target, row, said):
    (finding,) = compare_counters(target, f"table,unit,direction,window,bytes\n{row}", "c.csv").diagnostics
    assert (finding.code, finding.at.line) == (codes.BROKEN_COUNTERS.id, 2)
    assert said in finding.message


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("", "lacks the columns unit"),
        ("unit,direction,bytes", "start, end"),
        ("unit,unit", "twice"),
        ("uint", "not known"),
    ],
)
def test_columns_that_are_missing_or_unknown(target, header, said):
    with pytest.raises(HalpipeError) as refused:
        compare_counters(target, header, "c.csv")
    assert said in refused.value.diagnostics[0].message
    assert refused.value.diagnostics[0].at.line == 1


@pytest.mark.parametrize(
    ("start", "end", "said"),
    [
        ("640", "640", "the interval from 640 to 640 ns is empty"),
        ("0", "12801", 'ends at 12801 ns; the table "full->lean" is 12800 ns long'),
        ("0", "12800", None),
    ],
)
def test_an_interval_lies_within_the_table_of_a_switch(target, start, end, said):
    text = f"table,unit,direction,start,end,bytes\nfull->lean,u2,read,{start},{end},0"
    assert [d.message for d in compare_counters(target, text, "c.csv").diagnostics] == [said] * (said is not None)


def test_a_back_end_of_rates_has_no_budgets(target):
    other = bundles.target(bundles.changed(target.bundle.files, lambda data: data.update(backend="qos400")))
    with pytest.raises(HalpipeError) as refused:
        compare_counters(other, "", "c.csv")
    assert "qos400 has no budgets" in refused.value.diagnostics[0].message
