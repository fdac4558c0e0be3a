"""Promises against a brute-force integral, and the two rules by hand."""

from fractions import Fraction
from math import ceil, floor

import pytest
from regulator_samples import FULL, build, gang, one_mode, switching, two_units

from halpipe.exporters.regulator.frames import Row
from halpipe.exporters.regulator.rounding import (
    Overload,
    Promise,
    charged,
    controlled,
    controlled_seams,
    overload,
    whole,
)
from halpipe.exporters.regulator.words import CONTROLLED, WHOLE
from support import access, job, model, task, version

A, B = Row("a", "read"), Row("b", "read")


def integral(system, schedule, unit, direction, window, per_window):
    """Bytes promised to a unit in one window of the only mode: over all jobs, phases and turns of the circle."""
    total = Fraction(0)
    table = schedule.modes[0]
    begin, end = (Fraction(n * 10**6) for n in (window, window + 1))
    for j in table.jobs:
        for a in system.task(j.task).version(j.version).accesses:
            kind = "write" if a.kind == "write" else "read"
            if a.resource != "mem" or kind != direction or unit not in j.units:
                continue
            for turn in (0, 1):
                shift = j.start.fraction - turn * table.hyperperiod.fraction
                overlap = min(shift + a.end.fraction, end) - max(shift + a.start.fraction, begin)
                total += max(Fraction(0), overlap) / 10**6 * a.bound / len(j.units) * per_window
    return total


def thirds_and_sevenths():
    """Phases of one row whose bounds have no denominator in common, at once and inside windows."""
    phases = (access("mem", 0, "2.5ms", "1/3", "read"), access("mem", "2.5ms", 4, "1/7", "read"))
    t = task("t", 10, version("v", 4, "u1", *phases))
    o = task("o", 10, version("v", 1, "u1", access("mem", "0.2ms", "0.9ms", "2/5", "read")))
    system = model(t, o, units="u1 u2", resources="mem")
    return system, one_mode(system, 10, job(system, "t", 0, 8, "u1"), job(system, "o", 0, 5, "u1"))


@pytest.mark.parametrize("sample", [two_units, gang, thirds_and_sevenths])
@pytest.mark.parametrize("rounding", [WHOLE, CONTROLLED])
def test_promises_are_the_integral_of_the_bounds(tmp_path, sample, rounding):
    system, schedule = sample()
    tables, _ = build(tmp_path, system, schedule, rounding, **FULL)
    (table,) = tables.tables
    for unit in ("u1", "u2"):
        for direction in ("read", "write"):
            row = Row(unit, direction)
            expected = [integral(system, schedule, unit, direction, k, 6400) / 64 for k in range(10)]
            promise = table.promised.get(row)
            found = [promise.at(k + 1) - promise.at(k) for k in range(10)] if promise else [0] * 10
            assert found == expected
            assert table.row(row) == [ceil(x) for x in expected] if rounding == WHOLE else True


def test_a_whole_burst_phase_gets_just_that_by_either_rule(tmp_path):
    for rounding in (WHOLE, CONTROLLED):
        tables, _ = build(tmp_path, *two_units(), rounding, **FULL)
        (table,) = tables.tables
        assert table.row(Row("u1", "read")) == [0, 25, 25, 25, 25, 0, 0, 0, 0, 0]
        assert table.row(Row("u2", "write")) == [0, 0, 0, 0, 0, 50, 50, 0, 0, 0]
        assert table.row(Row("u2", "read")) == [100, 0, 0, 0, 0, 0, 0, 0, 0, 0]
        assert table.totals == [100, 25, 25, 25, 25, 50, 50, 0, 0, 0]


def test_a_phase_between_windows_contributes_its_overlap(tmp_path):
    t = task("t", 10, version("v", 4, "u1", access("mem", "0.5ms", "2.25ms", "0.1", "read")))
    system = model(t, units="u1", resources="mem")
    schedule = one_mode(system, 10, job(system, "t", 0, 0, "u1"))
    tables, _ = build(tmp_path, system, schedule, WHOLE)
    assert tables.tables[0].row(Row("u1", "read")) == [5, 10, 3, 0, 0, 0, 0, 0, 0, 0]  # of 5, 10, 2.5
    tables, _ = build(tmp_path, system, schedule, CONTROLLED)
    assert tables.tables[0].row(Row("u1", "read")) == [
        5,
        10,
        3,
        0,
        0,
        0,
        0,
        0,
        0,
        0,
    ]  # there is room: ahead, not behind


def test_lines_promise_what_is_still_at_work(tmp_path):
    tables, _ = build(tmp_path, *switching())
    there, back = tables.tables[2:]
    assert there.row(Row("u1", "read")) == [25, 25, 0, 0, 0, 0]
    assert there.row(Row("u2", "read")) == [50, 50, 50, 0, 0, 50]
    assert there.row(Row("u2", "write")) == [0, 0, 10, 0, 0, 0]
    assert back.row(Row("u2", "read")) == [50, 50, 0, 0, 0, 0, 0, 0, 0, 0]
    assert back.row(Row("u2", "write")) == [0, 10, 0, 0, 0, 0, 0, 0, 0, 0]
    assert back.row(Row("u1", "read")) == [0] * 7 + [25] * 3


def promise(*per_window):
    values = [Fraction(x) for x in per_window]
    sums = [sum(values[:k], Fraction(0)) for k in range(len(values) + 1)]
    return Promise([int(s * 60) for s in sums], 60)


def test_controlled_keeps_every_row_within_a_burst_of_its_promise_and_the_room():
    promised = {A: promise("1/2", "1/2", "1/2", "1/2"), B: promise("1/2", "1/2", "1/2", "1/2")}
    found = controlled(promised, 4, 1)
    assert not isinstance(found, Overload)
    assert [a + b for a, b in zip(found[A], found[B], strict=True)] == [1, 1, 1, 1]
    for row, bursts in found.items():
        for k in range(5):
            exact = promised[row].at(k)
            assert floor(exact) <= sum(bursts[:k]) <= ceil(exact)


def test_controlled_gives_spare_slots_to_what_is_due_first():
    promised = {A: promise("1/5", "1/5", "1/5", "2/5", 0), B: promise("1/2", "1/2", 0, 0, 0)}
    assert controlled(promised, 5, 1) == {A: [0, 1, 0, 0, 0], B: [1, 0, 0, 0, 0]}
    soon = {A: promise("1/4", "1/4", "1/2"), B: promise("1/2", "1/2", 0)}  # due in the window after the next, and in it
    assert controlled(soon, 3, 1) == {A: [0, 1, 0], B: [1, 0, 0]}


def test_controlled_reports_the_first_window_that_cannot_hold_what_is_due():
    assert controlled({A: promise(1, 2, 0), B: promise(1, 2, 0)}, 3, 2) == Overload(1, 4, 2)


def test_without_any_room_whatever_is_due_is_an_overload():
    assert controlled({A: promise("1/2", "1/2")}, 2, 0) == Overload(1, 1, 0)
    assert controlled({A: promise("1/2", "1/4")}, 2, 0) == {A: [0, 0]}


def test_whole_rounds_every_window_up_and_overload_names_the_worst():
    promised = {A: promise("5/2", "1/3", 0), B: promise(1, "3/2", 0)}
    bursts = whole(promised)
    assert bursts == {A: [3, 1, 0], B: [1, 2, 0]}
    assert overload(bursts, 3, 4) is None
    assert overload(bursts, 3, 3) == Overload(0, 4, 3)


def test_a_burst_of_the_window_before_is_charged_where_there_is_no_budget():
    bursts = {A: [2, 0, 0, 3], B: [0, 4, 0, 0]}
    assert charged(bursts, 4, [A, B]) == [3, 5, 1, 3]  # before window 0, either may have been served
    assert charged({A: [2, 0, 0, 3]}, 4, [A, B]) == [3, 1, 0, 3]  # B is used in other tables
    assert overload(bursts, 4, 4, [A, B]) == Overload(1, 5, 4)
    assert overload(bursts, 4, 4) is None


def test_controlled_leaves_room_for_what_is_carried_over():
    turns = {A: promise(3, 0, 3, 0), B: promise(0, 3, 0, 3)}
    found = controlled_seams(turns, 4, 4, [A, B])
    assert found == {A: [3, 0, 3, 0], B: [0, 3, 0, 3]}
    assert controlled_seams(turns, 4, 3, [A, B]) == Overload(0, 4, 3)


def test_no_more_is_kept_for_what_is_carried_over_than_it_takes():
    """With one burst kept, all of the first fits, and two leave no room in window 1.

    Of the others two are needed, since with one window 1 has one too many, and three leave no room for D.
    """
    promised = {A: promise(1, 0, 3), B: promise(0, 2, 0), Row("c", "read"): promise("1/2", 3, 0)}
    assert [*controlled_seams(promised, 3, 5, [*promised]).values()] == [[1, 0, 3], [0, 2, 0], [1, 2, 1]]
    c, d = Row("c", "read"), Row("d", "read")
    promised = {A: promise("1/2", 1), B: promise(2, 0), c: promise("1/2", 0), d: promise(0, 3)}
    assert controlled_seams(promised, 2, 5, [*promised]) == {A: [1, 0], B: [2, 0], c: [0, 0], d: [0, 3]}
