"""What an export says: lag of every phase, warnings about phases, the JSON forms, the summary and the picture."""

import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from fractions import Fraction

import pytest
from regulator_samples import FULL, build, gang, one_mode, switching, two_units

from halpipe.exporters.regulator import codes
from halpipe.exporters.regulator.frames import Row
from halpipe.exporters.regulator.picture import COLUMNS, Steps, draw_bounds
from halpipe.exporters.regulator.report import (
    check_phases,
    describe_export,
    describe_tables,
    format_json,
    served,
    summarise,
)
from halpipe.exporters.regulator.windows import cut
from halpipe.exporters.regulator.words import CONTROLLED, WHOLE
from halpipe.exporters.regulator.writing import backend
from halpipe.models import Resource, Transfer
from support import access, job, model, task, version


def tenth(bound="0.333", end=3):
    """One unit with a bound that is no whole number of bursts, while another takes nearly all of the rest."""
    t = task("t", 10, version("v", 8, "u1", access("mem", 0, end, bound, "read")))
    o = task("o", 10, version("v", 8, "u2", access("mem", 0, end, 1 - Fraction(bound), "read")))
    system = model(t, o, units="u1 u2", resources="mem")
    return system, one_mode(system, 10, job(system, "t", 0, 0, "u1"), job(system, "o", 0, 0, "u2"))


def test_lag_is_what_a_row_is_behind_when_its_phase_ends(tmp_path):
    tables, _ = build(tmp_path, *tenth(), CONTROLLED)
    (table,) = tables.tables
    for found in served(tables, table):
        exact = found.phase.bound * 19200
        given = sum(table.row(found.phase.row)[:3]) * 64
        assert found.promised == exact
        assert found.lag == max(0, exact - given)
        assert found.granted == exact - found.lag
        assert found.wait == found.lag / (found.phase.bound * 6400) * 10**6
    assert any(found.lag for found in served(tables, table))
    assert all(found.lag < 64 for found in served(tables, table))


def test_nobody_lags_where_every_window_is_rounded_up(tmp_path):
    tables, _ = build(tmp_path, *tenth(), WHOLE, capacity="6.5MB/s")
    found = list(served(tables, tables.tables[0]))
    assert [s.lag for s in found] == [0, 0]
    assert [(s.phase.job.task, s.granted) for s in found] == [("t", 3 * 34 * 64), ("o", 3 * 67 * 64)]


def test_a_phase_that_wraps_is_counted_on_both_sides(tmp_path):
    t = task("t", 10, version("v", 4, "u1", access("mem", 0, 4, "0.5", "read")))
    system = model(t, units="u1 u2", resources="mem")
    schedule = one_mode(system, 10, job(system, "t", 0, 8, "u1"))
    for rule in (WHOLE, CONTROLLED):
        tables, _ = build(tmp_path, system, schedule, rule)
        (found,) = served(tables, tables.tables[0])
        assert (found.promised, found.granted, found.lag) == (12800, 12800, 0)
        assert tables.tables[0].row(Row("u1", "read")) == [50, 50, 0, 0, 0, 0, 0, 0, 50, 50]


@pytest.mark.parametrize(("start", "windows"), [(0, 4), (3, 4), ("5.5ms", 5), (6, 4), ("6.5ms", 5), ("9.5ms", 5)])
def test_where_windows_are_rounded_up_those_that_a_phase_touches_count_in_full(tmp_path, start, windows):
    """A phase of 4 ms, within the circle of 10 ms, up to its end, and beyond it."""
    t = task("t", 10, version("v", 4, "u1", access("mem", 0, 4, "0.5", "read")))
    system = model(t, units="u1 u2", resources="mem")
    tables, _ = build(tmp_path, system, one_mode(system, 10, job(system, "t", 0, start, "u1")), WHOLE)
    (found,) = served(tables, tables.tables[0])
    bursts = 50 * 4 if windows == 4 else 50 * 3 + 25 * 2
    assert (found.promised, found.granted, found.lag, found.wait) == (12800, bursts * 64, 0, 0)


def test_phases_that_end_in_the_mode_after_are_counted_there(tmp_path):
    tables, _ = build(tmp_path, *switching())
    there = [(s.phase.job.task, s.phase.row.direction) for s in served(tables, tables.tables[2])]
    assert there == [("a", "read"), ("b", "read"), ("b", "write")]  # not those of the job that goes on in `slow`


def test_a_phase_that_ends_with_its_table_is_counted_in_it(tmp_path):
    system, schedule = switching()
    modes = (schedule.modes[0], replace(schedule.modes[1], jobs=(job(system, "b", 0, 2, "u2"),)))
    tables, _ = build(tmp_path, system, replace(schedule, modes=modes))
    there = [(s.phase.job.task, s.phase.end // tables.grid.window) for s in served(tables, tables.tables[2])]
    assert there == [("a", 2), ("b", 3), ("b", 3), ("b", 6), ("b", 6)]


def test_of_a_phase_that_began_in_the_mode_before_its_windows_in_this_one_count(tmp_path):
    tables, _ = build(tmp_path, *switching(), WHOLE)
    (found,) = (s for s in served(tables, tables.tables[2]) if s.phase.job.task == "a")
    assert (found.phase.begin, found.granted) == (-3 * tables.grid.window, 2 * 25 * 64)


def test_a_table_without_a_phase_lags_by_nothing(tmp_path):
    system, schedule = two_units()
    tables, _ = build(tmp_path, system, replace(schedule, modes=(replace(schedule.modes[0], jobs=()),)))
    assert summarise(tables, backend("table"), "").splitlines()[8].split()[-2:] == ["0", "1"]
    (table,) = describe_export(tables, backend("table"), [], "")["tables"]
    assert (table["worst_lag_bytes"], table["phases"]) == ("0", [])


# ------------------------------------------------------------------------------------------------------ warnings


def found_in(tmp_path, system, schedule, rule=CONTROLLED, **changes):
    tables, _ = build(tmp_path, system, schedule, rule, **changes)
    return check_phases(system, tables)


def test_a_bound_below_one_burst_is_answered_with_the_nearest_that_is_not(tmp_path):
    system, schedule = tenth("0.0025")
    (found,) = found_in(tmp_path, system, schedule, **FULL)
    assert found.code == codes.BELOW_BURST.id
    assert "bound 0.0025 is 0.25 bursts of 64 bytes per window" in found.message
    assert "one burst every 4 windows" in found.message
    assert "a bound of at least 0.01, or use" not in found.help
    assert found.help == "use a bound of at least 0.01, or a window of at least 4000 cycles"
    assert found_in(tmp_path, *tenth("0.01"), **FULL) == []
    (nearly,) = found_in(tmp_path, *tenth("0.009995"), **FULL)
    assert "bound 0.009995 is 0.999 bursts of 64 bytes per window" in nearly.message


def test_a_whole_burst_in_each_window_is_no_ration(tmp_path):
    system, schedule = tenth("0.0025")
    assert found_in(tmp_path, system, schedule, WHOLE, capacity="7MB/s") == []


def test_a_gang_needs_a_burst_for_each_of_its_units(tmp_path):
    system, schedule = gang()
    version_ = replace(system.tasks[0].versions[0], accesses=(access("mem", 1, 3, "0.01", "read"),))
    system = replace(system, tasks=(replace(system.tasks[0], versions=(version_,)),))
    (found,) = found_in(tmp_path, system, schedule)
    assert "0.5 bursts" in found.message
    assert "at least 0.02" in found.help


def test_phases_inside_windows_are_counted_and_the_widest_is_named(tmp_path):
    t = task("t", 10, version("v", 3, "u1", access("mem", "0.5ms", 2, "0.1"), access("mem", 2, 3, "0.2")))
    o = task("o", 10, version("v", 3, "u2", access("mem", "0.5ms", 1, "0.3")))
    system = model(t, o, units="u1 u2", resources="mem")
    schedule = one_mode(system, 10, job(system, "t", 0, 0, "u1"), job(system, "o", 0, 0, "u2"))
    (found,) = found_in(tmp_path, system, schedule, WHOLE)
    assert (found.code, found.path) == (codes.OFF_GRID.id, 'task "o"')
    assert "up to 1920 bytes" in found.message
    assert "2 of 3 phases, of 2 tasks" in found.message


@pytest.mark.parametrize(("size", "expected"), [(6400, []), (6401, [codes.SHORT_PHASE.id])])
def test_a_phase_must_be_long_enough_for_its_transfers(tmp_path, size, expected):
    moved = replace(access("mem", 0, 2, "0.5", "read"), transfers=(Transfer(buffer="b", symbol="s", size=size),))
    t = task("t", 10, version("v", 3, "u1", moved))
    system = model(t, units="u1 u2", resources="mem")
    found = found_in(tmp_path, system, one_mode(system, 10, job(system, "t", 0, 0, "u1")))
    assert [d.code for d in found] == expected
    if expected:
        assert "6400 bytes are promised, its transfers need 6401" in found[0].message
        assert found[0].help == "let it last at least 2000313ns, or bind it to 0.501"


@pytest.mark.parametrize(("size", "said"), [(12793, ", or bind it to 1"), (12800, ", or bind it to 1"), (12801, "")])
def test_a_short_phase_may_be_bound_to_all_of_the_bandwidth_at_most(tmp_path, size, said):
    moved = replace(access("mem", 1, 3, "0.5", "read"), transfers=(Transfer(buffer="b", symbol="s", size=size),))
    system = model(task("t", 10, version("v", 3, "u1", moved)), units="u1 u2", resources="mem")
    (found,) = found_in(tmp_path, system, one_mode(system, 10, job(system, "t", 0, 0, "u1")))
    assert found.help == f"let it last at least {-(-size * 10**9 // 3_200_000)}ns{said}"


# ------------------------------------------------------------------------------------------------------ JSON, text


def test_the_table_object_as_json(tmp_path):
    tables, _ = build(tmp_path, *switching(), overshoot="64B", capacity="7.6MB/s")
    found = json.loads(format_json(describe_tables(tables, "ab" * 32, "cd" * 32)))
    assert (found["schedule_sha256"], found["model_sha256"]) == ("ab" * 32, "cd" * 32)
    assert (found["window_ns"], found["promise_bytes"], found["capacity_bytes"]) == ("1000000", "6400", 7600)
    assert [(t["name"], t["kind"], t["windows"], t["successor"]) for t in found["tables"]] == [
        ("fast", "mode", 10, 0), ("slow", "mode", 5, 1),
        ("fast->slow", "transition", 6, 1), ("slow->fast", "transition", 10, 0),
    ]  # fmt: skip
    assert (found["tables"][2]["length_ns"], found["tables"][2]["cycles"]) == ("1000000", 1)
    assert found["switches"][0] == {"from": "fast", "to": "slow", "request": 2}
    for described, table in zip(found["tables"], tables.tables, strict=True):
        for unit in ("u1", "u2"):
            seen = []
            for entry, after in zip(
                described["entries"][unit], [*described["entries"][unit][1:], {"window": table.windows}], strict=True
            ):
                assert entry["read_bytes"] == 64 * entry["read_bursts"]
                seen += [(entry["read_bursts"], entry["write_bursts"])] * (after["window"] - entry["window"])
            assert seen == list(zip(table.row(Row(unit, "read")), table.row(Row(unit, "write")), strict=True))


def test_the_report_sums_every_window_and_names_every_phase(tmp_path):
    tables, findings = build(tmp_path, *two_units(), **FULL)
    found = json.loads(format_json(describe_export(tables, backend("table"), findings, "ab" * 32)))
    (table,) = found["tables"]
    assert (table["peak_bytes"], table["peak_window"]) == (6400, 0)
    assert table["mean_bytes"] == "1920"  # (100 + 4 * 25 + 2 * 50) * 64 / 10
    assert table["window_sums"][:3] == [
        {"window": 0, "bytes": 6400}, {"window": 1, "bytes": 1600}, {"window": 5, "bytes": 3200},
    ]  # fmt: skip
    assert {(p["task"], p["direction"], p["promised_bytes"], p["lag_bytes"]) for p in table["phases"]} == {
        ("reader", "read", "6400", "0"), ("writer", "write", "6400", "0"), ("writer", "read", "6400", "0"),
    }  # fmt: skip
    assert found["backend"]["entries"] == {"u1": 4, "u2": 5}


def test_json_has_one_entry_to_a_line():
    value = {"a": [{"b": 1}] * 40, "c": {}}
    text = format_json(value).decode()
    assert json.loads(text) == value
    assert text.count('  {"b": 1}') == 40


def test_the_summary_has_a_line_for_every_table(tmp_path):
    tables, _ = build(tmp_path, *two_units(), **FULL)
    text = summarise(tables, backend("table"), "ab" * 32)
    assert "window 1000 cycles = 1ms, burst 64 B, guaranteed 6.4MB/s" in text
    assert "room for 103 bursts per window" in text
    assert "windows end within a cycle of exact ones; a clock off by 1 ppm slips one window in 1000s" in text
    assert text.splitlines()[8].split() == ["all", "10", "all", "whole", "96.96", "%", "29.09", "%", "0", "4"]


def test_the_columns_of_the_summary_are_aligned(tmp_path):
    tables, _ = build(tmp_path, *switching())
    lines = summarise(tables, backend("table"), "").splitlines()
    rows = lines[7 : 8 + len(tables.tables)]
    assert [row.split()[0] for row in rows] == ["table", "fast", "slow", "fast->slow", "slow->fast"]
    for heading in ("windows", "then", "rounding", "peak", "mean", "worst", "entries"):
        at = rows[0].index(heading)
        assert {(row[at - 2 : at], row[at] != " ") for row in rows} == {("  ", True)}


def test_the_worst_lag_of_a_table_is_that_of_its_phase_that_lags_most(tmp_path):
    tables, _ = build(tmp_path, *tenth(), CONTROLLED)
    lags = [found.lag for found in served(tables, tables.tables[0])]
    assert min(lags) < max(lags)
    assert f"  {cut(max(lags))} B  " in summarise(tables, backend("table"), "").splitlines()[8]
    (table,) = describe_export(tables, backend("table"), [], "")["tables"]
    assert Fraction(table["worst_lag_bytes"]) == Fraction(round(max(lags) * 1000), 1000)


# ------------------------------------------------------------------------------------------------------- pictures


def areas(svg):
    root = ET.fromstring(svg)
    space = "{http://www.w3.org/2000/svg}"
    return {
        p.find(f"{space}title").text: p.get("d")
        for p in root.iter(f"{space}path")
        if p.find(f"{space}title") is not None
    }


def bounds_of(system, schedule):
    (picture,) = draw_bounds(replace(system, resources=(Resource(name="mem", bandwidth=10**9),)), schedule).values()
    return picture


def test_the_picture_stacks_the_units_under_the_capacity():
    found = areas(bounds_of(*two_units()))
    assert set(found) == {"u1 read", "u2 read", "u2 write", "capacity"}
    assert found["u1 read"] == "M90 90L450 90L450 120L90 120Z"  # a quarter of 120, from 1 to 5 of 10
    assert found["u2 write"] == "M450 60L630 60L630 120L450 120Z"


@pytest.mark.parametrize(("jobs", "means"), [(COLUMNS // 2, False), (COLUMNS // 2 + 1, True), (COLUMNS, True)])
def test_long_tables_are_drawn_as_means(jobs, means):
    t = task("t", 1, version("v", "0.5ms", "u1", access("mem", 0, "0.5ms", "0.335", "read")))
    system = model(t, units="u1 u2", resources="mem")
    picture = bounds_of(system, one_mode(system, jobs, *(job(system, "t", n, n, "u1") for n in range(jobs))))
    assert ("each step is the mean" in picture) == means
    path = areas(picture)["u1 read"]
    assert path.count("L") < 4 * COLUMNS
    if jobs == COLUMNS:  # half of 0.335 in each millisecond
        upper, lower = ([f"{x} {y}" for x in range(COLUMNS + 1)] for y in (99.9, 120))
        assert path == f"M{'L'.join([*upper, *reversed(lower)])}Z"


def test_a_table_of_one_step_more_than_there_are_columns_is_drawn_as_means():
    t = task("t", 1, version("v", "0.5ms", "u1", access("mem", 0, "0.5ms", "0.335", "read")))
    system = model(t, units="u1 u2", resources="mem")
    jobs = [job(system, "t", n, n, "u1") for n in range(COLUMNS // 2 + 1)]
    assert "each step is the mean" in bounds_of(system, one_mode(system, f"{COLUMNS // 2}.5ms", *jobs))


def test_a_picture_is_exact_where_a_tick_is_wide():
    t = task("t", "10ns", version("v", "4ns", "u1", access("mem", 0, "4ns", "0.25", "read")))
    system = model(t, units="u1", resources="mem")
    picture = bounds_of(system, one_mode(system, "10ns", job(system, "t", 0, 0, "u1")))
    assert areas(picture)["u1 read"] == "M0 90L360 90L360 120L0 120Z"


def test_areas_of_steps_are_exact():
    steps = Steps([0, 3, 7], [2, 0, 5])
    assert steps.areas([0, 1, 3, 5, 7, 10]) == [0, 2, 6, 6, 6, 21]


def test_bounds_can_be_drawn_without_a_platform():
    system, schedule = two_units()
    assert draw_bounds(system, schedule) == {}  # no resource has a bandwidth
    system = replace(system, resources=(Resource(name="mem", bandwidth=10**9), Resource(name="other", bandwidth=1)))
    (picture,) = draw_bounds(system, schedule).values()
    assert areas(picture)["u2 write"] == "M450 60L630 60L630 120L450 120Z"
    assert "mem: bounds, capacity 1GB/s" in picture
