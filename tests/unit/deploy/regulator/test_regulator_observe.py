"""The verdict on a trace: traces made by hand, at the limit and one beyond it."""

import re
from fractions import Fraction
from types import SimpleNamespace

import pytest

import regulator_bundles as bundles
from halpipe.core.diagnostics import Location
from halpipe.deploy import regulator
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.regulator import codes, simulate
from halpipe.deploy.regulator.reading import read_tables
from halpipe.deploy.regulator.simulate import Verdict, judge
from halpipe.deploy.regulator.stimuli import _CALM, Expected, Run, Traffic

AT = Location("cfg/table")


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    files = bundles.export(tmp_path_factory.mktemp("bundle"), *bundles.system())
    return read_tables(bundles.target(files).bundle)


def run_of(windows, *, greedy=True, reads=()):
    """A run that plays windows of table 0, from window 20 on, where u1 may read 4 bursts and u2 nothing or 2."""
    return Run(
        traffic=Traffic(name="t", greedy=greedy),
        seed=7,
        cycles=64,
        extra=Fraction(0),
        kinds=(0x11, 0x11, 0x11),
        script=((0, "w", 0, 0),),
        expected=tuple(Expected(table=0, window=20 + n) for n in range(windows)),
        reads=tuple(reads),
    )


def window(tables, number, **changes):
    """A line of the trace in which everybody gets the whole budget, with some figures changed: ``u1_read=256``."""
    line = ["W", number]
    for unit in tables.units:
        counts = []
        for direction in ("read", "write"):
            budget = tables.tables[0].budgets(unit.name, direction)[20 + number]
            counts += [changes.get(f"{unit.name}_{direction}{part}", value) for part, value in
                       (("", budget), ("_carried", 0), ("_waiting", 0))]  # fmt: skip
        line += [changes.get("table", 0), changes.get("window", 20 + number), *counts, 0, 0]
        line += [changes.get(f"{unit.name}_faults", 0)]
        for direction in ("read", "write"):
            budget = tables.tables[0].budgets(unit.name, direction)[20 + number]
            row = f"{unit.name}_{direction}"
            line += [changes.get(f"{row}_left", max(0, budget - changes.get(f"{row}_carried", 0)))]
    return " ".join(map(str, line))


def verdict(tables, run, *lines):
    return judge(tables, run, "\n".join(lines).encode(), AT)


def found(tables, *lines, greedy=True):
    return [f.code for f in verdict(tables, run_of(len(lines), greedy=greedy), *lines).findings]


def test_the_whole_budget_and_no_more(tables):
    assert found(tables, window(tables, 0)) == []
    assert found(tables, window(tables, 0, u1_read=256 + 8)) == [codes.SPENT_TOO_MUCH.id]


def test_a_master_that_always_asks_gets_all(tables):
    assert found(tables, window(tables, 0, u1_read=192)) == [codes.GOT_TOO_LITTLE.id]
    assert found(tables, window(tables, 0, u1_read=192), greedy=False) == []


def test_a_master_that_is_silent_gets_nothing_and_that_is_right(tables):
    run = run_of(1)
    silent = Run(**{name: getattr(run, name) for name in run.__slots__} | {"kinds": (0x10, 0x11, 0x11)})
    assert verdict(tables, silent, window(tables, 0, u1_read=0)).findings == []


def test_a_burst_carried_over_is_charged_to_both_windows(tables):
    """Shown in the first window, taken in the second: 3 + 1 waiting, then the 1 and 3 more."""
    first = window(tables, 0, u1_read=192, u1_read_waiting=64)
    assert found(tables, first, window(tables, 1, u1_read=256, u1_read_carried=64)) == []
    spent = window(tables, 1, u1_read=320, u1_read_carried=64)
    assert found(tables, first, spent) == [codes.SPENT_TOO_MUCH.id]


def test_a_burst_carried_into_a_window_without_budget_passes_alone(tables):
    """u1 reads 4 bursts until window 25, and none from 26 on."""
    run = Run(
        traffic=Traffic(name="t", greedy=True),
        seed=7,
        cycles=64,
        extra=Fraction(0),
        kinds=(0x11, 0x11, 0x11),
        script=(),
        expected=(Expected(table=0, window=25), Expected(table=0, window=26)),
        reads=(),
    )
    last = window(tables, 5, u1_read=192, u1_read_waiting=64).replace("W 5", "W 0")
    alone = window(tables, 6, u1_read=64, u1_read_carried=64).replace("W 6", "W 1")
    assert verdict(tables, run, last, alone).findings == []
    assert verdict(tables, run, last, alone).carried == 1
    another = window(tables, 6, u1_read=128, u1_read_carried=64).replace("W 6", "W 1")
    assert [f.code for f in verdict(tables, run, last, another).findings] == [codes.SPENT_TOO_MUCH.id]


def test_what_all_take_in_a_window_is_within_the_capacity(tables):
    capacity = tables.platform.capacity_bytes
    others = sum(tables.tables[0].budgets(unit.name, d)[20] for unit in tables.units for d in ("read", "write"))
    others -= tables.tables[0].budgets("u1", "read")[20]
    assert codes.SHARED_TOO_MUCH.id not in found(tables, window(tables, 0, u1_read=capacity - others))
    assert codes.SHARED_TOO_MUCH.id in found(tables, window(tables, 0, u1_read=capacity - others + 1))


def test_a_fault_of_several_windows_is_reported_once_with_their_number(tables):
    lines = [window(tables, n, u1_read=256 + 8) for n in range(3)]
    for count, tail in ((1, ""), (2, ", and 1 windows more"), (3, ", and 2 windows more")):
        (fault,) = verdict(tables, run_of(3), *lines[:count], *(window(tables, n) for n in range(count, 3))).findings
        assert fault.message.startswith("264 B in window 0 (")
        assert fault.message.endswith(f"the budget is 256 B{tail} (traffic: t, seed 7)")


def test_windows_that_are_missing_or_too_many_are_counted(tables):
    for simulated in (1, 3):
        (fault,) = verdict(tables, run_of(2), *(window(tables, n) for n in range(simulated))).findings
        assert (fault.code, fault.path) == (codes.PLAYED_WRONG.id, "trace")
        assert fault.message.startswith(f"the trace has {simulated} windows, 2 were simulated")


def test_what_was_granted_and_used_is_summed(tables):
    seen = verdict(tables, run_of(2), window(tables, 0), window(tables, 1, u1_read=192, u1_read_waiting=64))
    budgets = [
        tables.tables[0].budgets(unit.name, d)[20 + n]
        for unit in tables.units for d in ("read", "write") for n in (0, 1)
    ]  # fmt: skip
    assert (seen.windows, seen.granted, seen.used, seen.carried) == (2, sum(budgets), sum(budgets) - 64, 0)
    assert seen.largest_sum == max(sum(budgets[::2]), sum(budgets[1::2]) - 64)


def test_nothing_is_carried_that_was_not_shown_before(tables):
    assert found(tables, window(tables, 0, u1_read=64, u1_read_carried=64, u1_read_left=256), greedy=False) == [
        codes.SPENT_TOO_MUCH.id
    ]


def test_no_byte_passes_between_the_defaults_and_the_first_table(tables):
    run = run_of(1, greedy=False)
    calm = Run(**{name: getattr(run, name) for name in run.__slots__} | {"expected": (_CALM,)})
    rows = [f"{unit.name}_{direction}" for unit in tables.units for direction in ("read", "write")]
    nothing = {"table": 0, "window": _CALM.window} | dict.fromkeys([*rows, *(f"{row}_left" for row in rows)], 0)
    assert verdict(tables, calm, window(tables, 0, **nothing)).findings == []
    spent = verdict(tables, calm, window(tables, 0, **nothing | {"u1_read": 1})).findings
    assert [f.code for f in spent] == [codes.SPENT_TOO_MUCH.id]


@pytest.mark.parametrize(("left", "code"), [(320, codes.SPENT_TOO_MUCH), (192, codes.GOT_TOO_LITTLE)])
def test_a_window_begins_with_its_budget_whoever_asks(tables, left, code):
    assert found(tables, window(tables, 0, u1_read_left=left), greedy=False) == [code.id]


def test_what_is_called_carried_must_have_been_waiting(tables):
    assert codes.SPENT_TOO_MUCH.id in found(
        tables, window(tables, 0), window(tables, 1, u1_read=320, u1_read_carried=64)
    )


def test_a_burst_may_wait_for_windows(tables):
    waiting = {"u1_read": 0, "u1_read_waiting": 64, "u1_read_left": 192}
    first = window(tables, 0, u1_read=192, u1_read_waiting=64)
    assert found(tables, first, window(tables, 1, **waiting), window(tables, 2, **waiting), greedy=False) == []


def after(tables, **changes):
    """The findings of window 25, in which a burst is left waiting, and window 26, in which u1 may read nothing."""
    run = run_of(2, greedy=False)
    expected = (Expected(table=0, window=25), Expected(table=0, window=26))
    run = Run(**{name: getattr(run, name) for name in run.__slots__} | {"expected": expected})
    first = window(tables, 5, u1_read=192, u1_read_waiting=64).replace("W 5", "W 0")
    return [f.code for f in verdict(tables, run, first, window(tables, 6, **changes).replace("W 6", "W 1")).findings]


def test_a_burst_that_still_waits_spends_nothing_and_another_does(tables):
    assert after(tables, u1_read_waiting=64) == []
    assert after(tables, u1_read_waiting=128) == [codes.SPENT_TOO_MUCH.id]


def test_the_sum_is_held_against_the_capacity(tables):
    lines = [window(tables, 0, u1_read=520)]
    assert set(found(tables, *lines)) == {codes.SPENT_TOO_MUCH.id, codes.SHARED_TOO_MUCH.id}
    full = [window(tables, 0, u1_read=512)]
    assert set(found(tables, *full)) == {codes.SPENT_TOO_MUCH.id}


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"table": 1}, 'table 1 "lean", window 20'),
        ({"table": 3}, 'table 3 "unknown", window 20'),
        ({"window": 21}, 'table 0 "full", window 21'),
        ({"window": 2**32 - 1}, "its defaults"),
    ],
)
def test_another_table_or_window_is_told(tables, wrong, said):
    faults = verdict(tables, run_of(1), window(tables, 0, **wrong)).findings
    assert [(f.code, f.path) for f in faults] == [(codes.PLAYED_WRONG.id, f'unit "u{n}"') for n in (1, 2, 3)]
    assert faults[0].message.startswith(f'plays {said} in window 0, it must play table 0 "full", window 20 (')


@pytest.mark.parametrize(
    ("bit", "code"),
    [(0, codes.BROKE_PROTOCOL), (1, codes.BROKE_PROTOCOL), (2, codes.BROKE_PROTOCOL), (3, codes.BROKE_PROTOCOL),
     (4, codes.PLAYED_WRONG), (5, codes.BROKE_PROTOCOL), (6, codes.BROKE_PROTOCOL)],
)  # fmt: skip
def test_each_fault_of_the_bus_is_told_once(tables, bit, code):
    lines = [window(tables, n, u2_faults=1 << bit) for n in range(2)]
    (fault,) = verdict(tables, run_of(2), *lines).findings
    assert (fault.code, fault.path) == (code.id, 'unit "u2"')
    assert fault.message.endswith(", seen in window 0 (traffic: t, seed 7)")


def test_every_register_read_is_compared(tables):
    read = (5, 0x100010, 20)
    good = [window(tables, 0), f"R 5 {0x100010} 20"]
    assert verdict(tables, run_of(1, reads=[read]), *good).findings == []
    bad = [window(tables, 0), f"R 5 {0x100010} 21"]
    (finding,) = verdict(tables, run_of(1, reads=[read]), *bad).findings
    assert finding.code == codes.BROKE_PROTOCOL.id
    assert "0x15" in finding.message
    (finding,) = verdict(tables, run_of(1, reads=[read]), window(tables, 0)).findings
    assert finding.message.startswith("register 0x100010 was not read in cycle 5")


def test_a_trace_that_ends_early_is_no_proof(tables):
    (finding,) = verdict(tables, run_of(2), window(tables, 0)).findings
    assert finding.code == codes.PLAYED_WRONG.id
    assert "1 windows, 2 were simulated" in finding.message


def test_an_unknown_value_is_a_wrong_value(tables):
    line = window(tables, 0).replace("W 0 0 20", "W 0 x 20")
    assert codes.PLAYED_WRONG.id in found(tables, line)


def test_equal_findings_are_told_once_with_their_number(tables):
    lines = [window(tables, n, u1_read=320) for n in range(3)]
    (finding,) = verdict(tables, run_of(3), *lines).findings
    assert finding.path == 'unit "u1", read'
    assert finding.message.startswith(
        '320 B in window 0 (table 0 "full", window 20), the budget is 256 B, and 2 windows'
    )
    assert finding.message.endswith("(traffic: t, seed 7)")


def test_figures_of_a_run(tables):
    result = verdict(tables, run_of(2), window(tables, 0), window(tables, 1))
    assert (result.windows, result.carried) == (2, 0)
    assert result.used == result.granted
    assert result.largest_sum == 256 + 0 + 128  # u1, u2 and u3 in window 21


def test_runs_are_listed_with_their_figures_in_columns(tables):
    """Where nothing was granted, all of it was used."""
    runs = [
        Verdict(run_of(20), windows=20, granted=1000, used=999, carried=3, largest_sum=384),
        Verdict(run_of(2), windows=2, findings=[SimpleNamespace()]),
    ]
    head, *lines = (re.split(" {2,}", line.strip()) for line in regulator._table(tables, runs))
    assert lines == [
        ["t", "20", "1 of 3", "0", "99 %", "384 of 512 B", "3", "0"],
        ["t", "2", "1 of 3", "0", "100 %", "0 of 512 B", "0", "1"],
    ]
    assert len(head) == len(lines[0])
    assert regulator._unplayed(tables, runs) == ['  not played to the end: "lean", "full->lean"; --cycles 1 plays all']
    assert regulator._unplayed(tables, runs[1:])[0].count('"') == 6


@pytest.mark.parametrize(("engine", "more"), [("verilator", ["  compiled anew each time: no room"]), ("icarus", [])])
def test_a_bench_that_cannot_be_kept_is_pointed_out(tables, monkeypatch, engine, more):
    monkeypatch.setattr("halpipe.core.caches.why_no_cache", lambda name: "no room")
    monkeypatch.setattr(simulate, "choose_engine", lambda name: (SimpleNamespace(name=engine), "engine"))
    monkeypatch.setattr(simulate, "simulate", lambda *_, **__: [])
    _, lines = regulator._simulate(SimpleNamespace(bundle=None), tables, CheckOptions(engine=engine))
    assert lines[3:] == more
