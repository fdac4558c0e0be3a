"""The table object: windows, units, defaults, overshoot, successors and switches, and what is said when it fails."""

import random
from dataclasses import replace
from fractions import Fraction
from itertools import accumulate
from math import ceil

import pytest
from regulator_samples import FULL, PLATFORM, build, gang, one_mode, switching, two_units

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.regulator import codes
from halpipe.exporters.regulator.frames import Row
from halpipe.exporters.regulator.rounding import Overload, Promise, overload
from halpipe.exporters.regulator.tables import Entry, Switch, _Plan, _settle
from halpipe.exporters.regulator.windows import cut
from halpipe.exporters.regulator.words import CONTROLLED, WHOLE
from halpipe.models import ModeSchedule, Resource, Schedule, Status, TransitionTable
from support import access, job, mode, model, ms, task, version


def refusal(*arguments, **changes):
    with pytest.raises(HalpipeError) as refused:
        build(*arguments, **changes)
    return refused.value.diagnostics


def one_phase(start, end, bound=1, hyperperiod=10, at=0, kind="read"):
    t = task("t", hyperperiod, version("v", 8, "u1", access("mem", start, end, bound, kind)))
    system = model(t, units="u1 u2", resources="mem")
    return system, one_mode(system, hyperperiod, job(system, "t", 0, at, "u1"))


def test_modes_repeat_and_transitions_lead_to_their_target(tmp_path):
    tables, _ = build(tmp_path, *switching())
    assert [(t.index, t.name, t.windows, t.successor) for t in tables.tables] == [
        (0, "fast", 10, 0),
        (1, "slow", 5, 1),
        (2, "fast->slow", 6, 1),
        (3, "slow->fast", 10, 0),
    ]
    assert tables.switches == (Switch("fast", "slow", 2), Switch("slow", "fast", 3))


def test_a_switch_without_a_table_requests_the_mode_itself(tmp_path):
    system, schedule = switching()
    modes = tuple(
        replace(m, jobs=tuple(replace(j, start=ms(0), end=j.end - j.start) for j in m.jobs)) for m in schedule.modes
    )
    schedule = replace(schedule, modes=modes, transitions=schedule.transitions[1:])
    tables, _ = build(tmp_path, system, schedule)
    assert tables.switches == (Switch("slow", "fast", 0),)


def test_entries_are_run_length_over_windows_and_cover_both_directions(tmp_path):
    tables, _ = build(tmp_path, *two_units(), **FULL)
    (table,) = tables.tables
    assert table.entries("u1") == [Entry(0, 0, 0), Entry(1, 25, 0), Entry(5, 0, 0)]
    assert table.entries("u2") == [Entry(0, 100, 0), Entry(1, 0, 0), Entry(5, 0, 50), Entry(7, 0, 0)]


def test_units_of_the_model_come_in_its_order_with_their_managers(tmp_path):
    tables, findings = build(tmp_path, *two_units(), **FULL)
    assert [(u.index, u.name, u.manager) for u in tables.units] == [(0, "u1", 0), (1, "u2", 2)]
    assert tables.rows == [Row("u1", "read"), Row("u2", "read"), Row("u2", "write")]
    assert findings == []  # u3 has no regulator and needs none


def test_a_unit_that_uses_the_resource_needs_a_manager(tmp_path):
    t = task("t", 10, version("v", 4, "u9", access("mem", 0, 1)))
    system = model(t, units="u1 u9", resources="mem")
    *others, found = refusal(tmp_path, system, one_mode(system, 10, job(system, "t", 0, 0, "u9")))
    assert (found.code, found.path) == (codes.NO_MANAGER.id, 'unit "u9"')
    assert "u9: {manager: 1}" in found.help  # 0 and 2 are taken
    assert [d.code for d in others] == [codes.UNKNOWN_UNIT.id]


def test_a_unit_that_the_model_lacks_is_only_a_warning(tmp_path):
    system, schedule = one_phase(0, 1)
    system = replace(system, units=system.units[:1])
    tables, (found,) = build(tmp_path, system, schedule)
    assert (found.code, found.is_error, found.path) == (codes.UNKNOWN_UNIT.id, False, 'unit "u2"')
    assert found.help == 'did you mean "u1"?'
    assert [unit.name for unit in tables.units] == ["u1"]


def test_a_platform_without_a_unit_of_the_model_regulates_nothing(tmp_path):
    t = task("t", 10, version("v", 4, "u8"))
    system = model(t, units="u8", resources="mem")
    *others, found = refusal(tmp_path, system, one_mode(system, 10, job(system, "t", 0, 0, "u8")))
    assert (found.code, found.path) == (codes.NO_UNIT.id, "platform units")
    assert "u8" in found.help
    assert {d.code for d in others} == {codes.UNKNOWN_UNIT.id}


# ------------------------------------------------------------------------------------------------ windows


def test_a_window_that_does_not_divide_is_answered_with_the_nearest_that_do(tmp_path):
    found = refusal(tmp_path, *one_phase(0, 1), window="1500")
    (single,) = found
    assert single.code == codes.WINDOW_DOES_NOT_DIVIDE.id
    assert "hyperperiod 10ms is 6.66 windows; the window of 1500 cycles (1.5ms) does not divide it" in single.message
    assert single.help.endswith("1250 cycles (1.25ms) or 2000 cycles (2ms)")
    for cycles in (1250, 2000):
        build(tmp_path, *one_phase(0, 1), window=cycles)


def test_every_table_with_windows_that_do_not_divide_is_named(tmp_path):
    system, schedule = switching()
    longer = replace(schedule.transitions[0], length=ms("0.7ms"))
    schedule = replace(schedule, transitions=(longer, schedule.transitions[1]))
    (found,) = refusal(tmp_path, system, schedule)
    assert (found.path, "700us is 0.70 windows" in found.message) == ('transition "fast->slow"', True)
    found = refusal(tmp_path, system, schedule, window="3000")
    assert [d.path for d in found] == ['mode "fast"', 'mode "slow"', 'transition "fast->slow"']
    assert all("100 cycles (100us)" in d.help for d in found)


def test_no_window_divides_what_is_not_whole_cycles(tmp_path):
    t = task("t", "1/30s", version("v", 4, "u1", access("mem", 0, 1)))
    system = model(t, units="u1 u2", resources="mem")
    (found,) = refusal(tmp_path, system, one_mode(system, "1/30s", job(system, "t", 0, 0, "u1")))
    assert found.help.startswith('state "window: 100/99ms", which divides all of them')


def test_windows_are_counted_before_they_are_made(tmp_path):
    t = task("t", "1100s", version("v", 4, "u1", access("mem", 0, 1)))
    system = model(t, units="u1 u2", resources="mem")
    schedule = one_mode(system, "1100s", job(system, "t", 0, 0, "u1"))
    (found,) = refusal(tmp_path, system, schedule)
    assert (found.code, "1100000 windows" in found.message) == (codes.DOES_NOT_FIT.id, True)
    least = int(found.help.split()[-2])
    assert (1100 * 10**6 % least, 1100 * 10**6 // least <= 2**20) == (0, True)
    assert not any(1100 * 10**6 % n == 0 for n in range(1050, least))  # the first that is long enough and divides


def test_a_window_that_nearly_divides_is_shown_exactly(tmp_path):
    found = refusal(tmp_path, *one_phase(0, 1), window="9999")
    assert "is 1 and 1/9999 windows" in found[0].message


def test_numbers_for_people_are_cut():
    assert (cut(Fraction(20, 3)), cut(Fraction(5)), cut(Fraction(1, 200))) == ("6.66", "5.00", "0.00")


# --------------------------------------------------------------------------------------- capacity and overshoot


def test_a_burst_of_the_mode_before_needs_room_in_the_first_window(tmp_path):
    """Unit u1 has all of the last window of a mode, and u2 all of the first one of the mode that follows."""
    last, first = (
        task(name, 10, version("v", 1, unit, access("mem", 0, 1, 1))) for name, unit in (("a", "u1"), ("b", "u2"))
    )
    modes = (mode("before", [last]), mode("after", [first]))
    system = model(last, first, units="u1 u2", resources="mem", modes=modes, transitions=[("before", "after", None)])
    jobs = {"before": job(system, "a", 0, 9, "u1"), "after": job(system, "b", 0, 0, "u2")}
    tables = [ModeSchedule(name=n, hyperperiod=ms(10), status=Status.VALID, jobs=(j,)) for n, j in jobs.items()]
    plain = TransitionTable(source="before", target="after", length=ms(0), worst_latency=ms(10), status=Status.VALID)
    schedule = Schedule(model=system.name, model_sha256="", modes=tuple(tables), transitions=(plain,))
    (found,) = refusal(tmp_path, system, schedule)
    assert (found.code, found.path) == (codes.OVER_CAPACITY.id, 'mode "after"')
    assert "window 0 needs 101 bursts of 64 bytes, there is room for 100" in found.message
    assert build(tmp_path, system, schedule, capacity="6.464MB/s")[0].room == 101
    earlier = replace(tables[0], jobs=(job(system, "a", 0, 8, "u1"),))  # nothing is left of it in the last window
    build(tmp_path, system, replace(schedule, modes=(earlier, tables[1])))
    plain = {"backend_name": "axi-realm", "capacity": "6.912MB/s"}  # withdraws it: 512 bytes are kept for other things
    assert build(tmp_path, system, schedule, **plain)[0].room == 100


def test_exactly_full_fits_and_one_burst_more_does_not(tmp_path):
    t = task("t", 10, version("v", 2, "u1", access("mem", 0, 1, "0.75")))
    o = task("o", 10, version("v", 2, "u2", access("mem", 0, 1, "0.25")))
    system = model(t, o, units="u1 u2", resources="mem")
    schedule = one_mode(system, 10, job(system, "t", 0, 0, "u1"), job(system, "o", 0, 0, "u2"))
    tables, _ = build(tmp_path, system, schedule, WHOLE)
    assert max(tables.tables[0].totals) == tables.room == 100
    build(tmp_path, system, schedule, WHOLE, capacity="6.402MB/s", overshoot="1B")
    (found,) = refusal(tmp_path, system, schedule, WHOLE, capacity="6.401MB/s", overshoot="1B")
    assert found.code == codes.OVER_CAPACITY.id
    assert "needs 100 bursts of 64 bytes, there is room for 99" in found.message
    assert "of which 2 bytes are reserved for overshoot" in found.message


def test_whole_falls_back_to_controlled_where_only_that_fits(tmp_path):
    thirds = [task(n, 10, version("v", 3, u, access("mem", 0, 3, "1/3"))) for n, u in (("a", "u1"), ("b", "u2"))]
    system = model(*thirds, units="u1 u2", resources="mem")
    schedule = one_mode(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 0, "u2"))
    changes = {"guaranteed": "224kB/s"}  # 3.5 bursts per window, 1.17 for each, room for 3
    assert build(tmp_path, system, schedule, **changes)[0].tables[0].rounding == CONTROLLED
    assert build(tmp_path, system, schedule, capacity="256kB/s", **changes)[0].tables[0].rounding == WHOLE
    (found,) = refusal(tmp_path, system, schedule, WHOLE, **changes)
    assert "needs 4 bursts of 64 bytes, there is room for 3" in found.message
    assert '"capacity: 250KiB/s"' in found.help  # 4 bursts of 64 bytes, 1000 times a second


def test_the_remedies_that_are_named_work(tmp_path):
    system, schedule = two_units()
    (found,) = refusal(tmp_path, system, schedule, CONTROLLED, overshoot="640B", bus="128bit")
    capacity = found.help.split('"capacity: ')[1].split('"')[0]
    lower = found.help.split('"guaranteed: ')[1].split('"')[0]
    build(tmp_path, system, schedule, CONTROLLED, overshoot="640B", capacity=capacity, bus="128bit")
    build(tmp_path, system, schedule, CONTROLLED, overshoot="640B", guaranteed=lower, capacity="6.4MB/s")


def test_a_lower_guarantee_leaves_room_for_what_is_carried_over(tmp_path):
    """Of 100 bursts one is for overshoot, and one may be carried over: 98 can be guaranteed, and 102 are needed."""
    (found,) = refusal(tmp_path, *one_phase(0, 1), CONTROLLED, overshoot="64B")
    assert found.help.startswith('any of these helps: "capacity: 6375KiB/s", "guaranteed: 6125KiB/s"')
    for key, least in (("capacity", "6.528MB/s"), ("guaranteed", "6.272MB/s")):
        build(tmp_path, *one_phase(0, 1), CONTROLLED, **{"overshoot": "64B", "capacity": "6.4MB/s", key: least})


@pytest.mark.parametrize(("guaranteed", "is_named"), [("7.872MB/s", True), ("7.936MB/s", False)])
def test_a_capacity_is_named_up_to_what_the_bus_carries(tmp_path, guaranteed, is_named):
    """Of 8 MB/s are 64 bytes in 1 ms for overshoot, and 64 for what is carried over: there is room for 123 bursts."""
    (found,) = refusal(tmp_path, *one_phase(0, 1), CONTROLLED, overshoot="64B", guaranteed=guaranteed)
    assert ('"capacity: 8MB/s"' in found.help) == is_named
    assert ('"capacity: ' in found.help) == is_named


def test_scheduling_on_the_grid_is_only_named_where_it_can_help(tmp_path):
    system, schedule = two_units()  # has a phase that takes all of the bandwidth
    (found,) = refusal(tmp_path, system, schedule, overshoot="640B", **FULL)
    assert "--quantise" not in found.help
    t = task("t", 10, version("v", 2, "u1", access("mem", 0, 1, "0.6")))
    o = task("o", 10, version("v", 2, "u2", access("mem", 0, 1, "0.4")))
    system = model(t, o, units="u1 u2", resources="mem")
    schedule = one_mode(system, 10, job(system, "t", 0, 0, "u1"), job(system, "o", 0, 0, "u2"))
    (found,) = refusal(tmp_path, system, schedule, overshoot="320B")
    assert "needs 100 bursts of 64 bytes, there is room for 90" in found.message
    assert "--quantise" in found.help
    for overshoot, can_help in (("1216B", True), ("1248B", False)):  # room for 62 and 61: 60, and one to carry of each
        (found,) = refusal(tmp_path, system, schedule, overshoot=overshoot)
        assert ("--quantise" in found.help) == can_help


def test_overshoot_is_reserved_for_the_rows_that_are_used(tmp_path):
    tables, _ = build(tmp_path, *two_units(), overshoot="64B", capacity="7MB/s")
    assert {u.name: dict(u.overshoot) for u in tables.units} == {
        "u1": {"read": 64, "write": 0},
        "u2": {"read": 64, "write": 64},
    }
    assert (tables.reserve, tables.room) == (192, (7000 - 192) // 64)


def test_axi_realm_reserves_a_burst_for_overshoot_and_one_that_it_cannot_deny(tmp_path):
    tables, _ = build(tmp_path, *one_phase(0, 1), backend_name="axi-realm", capacity="7MB/s")
    assert tables.reserve == 256  # of writes, too, which the unit never does and which cannot be denied on their own


def test_less_overshoot_than_the_back_end_has_is_refused(tmp_path):
    found = refusal(tmp_path, *one_phase(0, 1), backend_name="axi-realm", capacity="7MB/s", overshoot="63B")
    assert [d.code for d in found] == [codes.OVERSHOOT_TOO_LOW.id]
    assert "overshoot: 64B" in found[0].help
    build(tmp_path, *one_phase(0, 1), backend_name="axi-realm", capacity="7MB/s", overshoot="64B")


def test_more_than_the_resource_has_is_a_warning(tmp_path):
    system, schedule = one_phase(0, 1)
    for rate, expected in ((6_400_000, []), (6_399_999, [codes.ABOVE_RESOURCE.id])):
        limited = replace(system, resources=(Resource(name="mem", bandwidth=rate),))
        assert [d.code for d in build(tmp_path, limited, schedule)[1]] == expected


def test_a_burst_of_the_end_of_a_mode_needs_room_at_its_begin(tmp_path):
    """Unit u1 has all of the last window, and u2 all of the first one."""
    last, first = (
        task(name, 10, version("v", 1, unit, access("mem", 0, 1, 1))) for name, unit in (("a", "u1"), ("b", "u2"))
    )
    system = model(last, first, units="u1 u2", resources="mem")
    schedule = one_mode(system, 10, job(system, "a", 0, 9, "u1"), job(system, "b", 0, 0, "u2"))
    (found,) = refusal(tmp_path, system, schedule)
    assert "window 0 needs 101 bursts of 64 bytes, there is room for 100" in found.message
    build(tmp_path, system, schedule, capacity="6.464MB/s")


def test_every_table_has_room_for_what_those_before_it_carry_over():
    """Random tables that lead to each other; of one that is rounded anew others may be carried into the next."""
    for seed in range(700):
        dice = random.Random(seed)
        count, room = dice.choice([1, 2, 3]), dice.randint(2, 4)
        plans = []
        for _ in range(count):
            windows = dice.choice([2, 3])
            promised = {}
            for unit in dice.sample("abc", dice.choice([2, 3])):
                sixtieths = [dice.choice([0, 30, 45, 60, 90]) for _ in range(windows)]
                promised[Row(unit, "read")] = Promise([0, *accumulate(sixtieths)], 60)
            plans.append(_Plan(windows, promised, CONTROLLED, room))
        leads = [{dice.randrange(count) for _ in range(2)} for _ in range(count)]
        _settle(plans, leads)
        for plan, before in zip(plans, leads, strict=True):
            if not isinstance(plan.found, Overload):
                carried = set().union(*(plans[n].last() for n in before))
                assert overload(plan.found, plan.windows, room, carried) is None


# ------------------------------------------------------------------------------------------------ defaults

UNITS = "\nunits:\n  u1: {{manager: 0{}}}\n  u2: {{manager: 1{}}}\n"


def defaults(tmp_path, first="", second="", sample=two_units, **changes):
    text = PLATFORM[: PLATFORM.index("units:")].rstrip() + UNITS.format(first, second)
    tables, _ = build(tmp_path, *sample(), text=text, **changes)
    return {u.name: dict(u.default) for u in tables.units}


def test_defaults_share_the_capacity_equally_among_the_rows_that_are_used(tmp_path):
    expected = {"u1": {"read": 2176, "write": 0}, "u2": {"read": 2176, "write": 2176}}
    assert defaults(tmp_path, **FULL) == expected
    assert 3 * 2176 <= 6600 < 3 * (2176 + 64)


def test_one_row_has_all_of_it(tmp_path):
    assert defaults(tmp_path, sample=lambda: one_phase(0, 1))["u1"] == {"read": 6400, "write": 0}


def test_stated_defaults_are_kept_and_the_others_share_the_rest(tmp_path):
    found = defaults(tmp_path, ", default-read: 640B, default-write: 64B", **FULL)
    assert found == {"u1": {"read": 640, "write": 64}, "u2": {"read": 2944, "write": 2944}}


@pytest.mark.parametrize(
    ("first", "changes", "numbers"),
    [
        (", default-read: 6464B", {}, "sum to 6464 bytes"),
        (
            ", default-read: 6400B",
            {"overshoot": "64B", "guaranteed": "6MB/s", "capacity": "6.4MB/s"},
            "sum to 6592 bytes",
        ),
        (", default-read: 100B", {}, "is 100 bytes per window"),
        (", default-read: 0B", {}, "is 0 bytes per window"),
        (", default-read: 6400B", {}, "is 0 bytes per window"),  # nothing is left for the others
    ],
)
def test_unsafe_defaults_are_refused_with_the_numbers(tmp_path, first, changes, numbers):
    with pytest.raises(HalpipeError) as refused:
        defaults(tmp_path, first, **changes)
    assert {d.code for d in refused.value.diagnostics} == {codes.UNSAFE_DEFAULTS.id}
    assert any(numbers in d.message and d.help for d in refused.value.diagnostics)


def test_gangs_are_shared_by_their_units(tmp_path):
    tables, _ = build(tmp_path, *gang())
    each = ceil(Fraction(3, 16) * 100)
    for unit in ("u1", "u2"):
        assert tables.tables[0].row(Row(unit, "read")) == [0, each, each, 0, 0, 0, 0, 0, 0, 0]


def test_more_tables_than_numbers(tmp_path, monkeypatch):
    monkeypatch.setattr("halpipe.exporters.regulator.tables.MAX_TABLES", 4)
    assert len(build(tmp_path, *switching())[0].tables) == 4
    monkeypatch.setattr("halpipe.exporters.regulator.tables.MAX_TABLES", 3)
    (found,) = refusal(tmp_path, *switching())
    assert (found.code, "4 modes and transitions" in found.message) == (codes.DOES_NOT_FIT.id, True)
