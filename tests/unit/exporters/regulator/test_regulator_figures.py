"""Figures of regulator exports against what they are of: facts against scripts, settings against bounds in force."""

import json
import re
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from math import ceil
from types import SimpleNamespace

import pytest
from regulator_samples import (
    DIGEST,
    PLATFORM,
    ROOMY,
    build,
    files,
    low_bounds,
    made,
    nearly_all,
    one_mode,
    platform,
    platform_file,
    switching,
    two_units,
)

from halpipe.core.bundles import MODEL, SCHEDULE
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.core.files import MANIFEST
from halpipe.core.quantities import parse_bandwidth
from halpipe.devices.registers import RegisterFile
from halpipe.exporters.regulator import RegulatorExporter, RegulatorOptions, codes, windows
from halpipe.exporters.regulator.embedded import embedded
from halpipe.exporters.regulator.frames import Row
from halpipe.exporters.regulator.memguard import writer as memguard
from halpipe.exporters.regulator.platform import DIRECTIONS, LEAST_CYCLES, read_platform
from halpipe.exporters.regulator.report import _below_burst, format_json, summarise
from halpipe.exporters.regulator.table.writer import header_lines
from halpipe.exporters.regulator.writing import backend, file_names
from support import access, job, model, ms, task, version

SAMPLES = [low_bounds, two_units, switching, nearly_all]
"""Tables whose bounds change, wrap round the end and reach over switches."""


def by_name(samples=SAMPLES):
    return pytest.mark.parametrize("sample", samples, ids=lambda sample: sample.__name__)


# ---------------------------------------------------------------------------------------------------- AXI-REALM


@by_name()
def test_the_most_writes_of_a_window_are_those_of_the_scripts(tmp_path, sample):
    """A handler may have to write every budget that a script sets at its start: at a switch."""
    tables, _ = made(tmp_path, "axi-realm", sample)
    realm = backend("axi-realm")
    written = realm.write(tables, DIGEST)
    most = []
    for table, stem in zip(tables.tables, file_names(t.name for t in tables.tables), strict=True):
        at = [int(window) for window in re.findall(r"WRITE\((-?\d+),", written[f"{stem}.txt"].decode())]
        most += [(at.count(window), f"{table.frame.path} window {window}" if window >= 0 else "any switch")
                 for window in dict.fromkeys(at)]  # fmt: skip
    facts = realm.facts(tables)
    assert facts["writes_per_window"] == max(count for count, _ in most)
    assert (facts["writes_per_window"], facts["worst_window"]) in most


@pytest.mark.parametrize(("managers", "free"), [(3, "1"), (4, "1 3"), (8, "1 3 4 5 6 7")])
def test_managers_without_a_unit_are_named(tmp_path, managers, free):
    tables, _ = made(tmp_path, "axi-realm", **{"axi-realm": f"{{managers: {managers}}}"})
    assert backend("axi-realm").facts(tables)["managers_not_regulated"] == free


def test_a_manager_that_does_not_exist_needs_a_file_of_one_more(tmp_path):
    (found,) = [d for d in made(tmp_path, "axi-realm", **{"axi-realm": "{managers: 2}"})[1] if d.is_error]
    assert found.help == 'use 0 to 1, or state "axi-realm: {managers: 3}"'
    assert not [d for d in made(tmp_path, "axi-realm", **{"axi-realm": "{managers: 3}"})[1] if d.is_error]


@by_name([low_bounds, two_units, nearly_all])
@pytest.mark.parametrize("default", ["", ", default-read: 64B", ", default-read: 3200B"])
def test_a_register_file_holds_the_largest_budget_that_is_written(tmp_path, sample, default):
    text = PLATFORM.replace("manager: 0", f"manager: 0{default}")
    written = files(tmp_path, "axi-realm", sample, text=text, capacity="14MB/s", bus="128bit")
    registers, found = RegisterFile("axi_realm", 8, 2), []
    regulated = {registers.offset(f"{d}_budget", 2 * manager) for d in DIRECTIONS for manager in (0, 2)}
    for name in written:
        steps = re.findall(r"WRITE\(-?\d+, (0x\w+), (0x\w+)\)", written[name].decode())
        found += [int(value, 16) for offset, value in steps if int(offset, 16) in regulated]
    width = f"{registers.offset('budget_width'):#05x}, 0xffffffff, {max(found).bit_length():#010x}"
    assert f"READ({width}, 0xffffffff)" in written["setup.txt"].decode()


@pytest.mark.parametrize(("cycles", "bits"), [(1000, 10), (1024, 10), (1025, 11)])
def test_a_register_file_holds_the_period_that_is_written(tmp_path, cycles, bits):
    """A period register has the cycles of a window less one."""
    t = task("t", f"{cycles}us", version("v", "10us", "u1", access("mem", 0, "10us", "0.5", "read")))
    system = model(t, units="u1", resources="mem")
    schedule = one_mode(system, f"{cycles}us", job(system, "t", 0, 0, "u1"))
    setup = files(tmp_path, "axi-realm", lambda: (system, schedule), window=cycles)["setup.txt"].decode()
    registers = RegisterFile("axi_realm", 8, 2)
    assert f"WRITE(-1, {registers.offset('read_period', 0):#05x}, {cycles - 1:#010x})" in setup
    assert f"READ({registers.offset('period_width'):#05x}, 0xffffffff, {bits:#010x}, 0xffffffff)" in setup


def test_the_least_budget_of_any_window_is_what_may_be_slow_to_stop(tmp_path):
    phases = (
        access("mem", 0, 1, "0.1", "read"),
        access("mem", 1, 2, "0.5", "read"),
        access("mem", 2, 3, "0.2", "read"),
    )
    t = task("t", 10, version("v", 3, "u1", *phases))
    system = model(t, units="u1", resources="mem")
    schedule = one_mode(system, 10, job(system, "t", 0, 0, "u1"))
    for pending, said in (
        (10, []),
        (11, ["read budget is 640 bytes in some window, 704 may be pending: slow to stop"]),
    ):
        found = made(tmp_path, "axi-realm", lambda: (system, schedule), **{"axi-realm": f"{{pending: {pending}}}"})[1]
        assert [d.message for d in found if "pending" in d.message] == said


def test_a_unit_that_never_uses_the_resource_is_isolated(tmp_path):
    """A budget of 0 does that; those of units that are bound are 1 burst at least."""
    text = PLATFORM + "  u3: {manager: 3}\n"
    setup = files(tmp_path, "axi-realm", two_units, text=text, capacity="8MB/s")["setup.txt"].decode()
    registers = RegisterFile("axi_realm", 8, 2)
    for d in DIRECTIONS:
        assert f"WRITE(-1, {registers.offset(f'{d}_budget', 2 * 3):#05x}, 0x00000000)" in setup
        assert f"READ({registers.offset(f'{d}_budget_left', 2 * 3):#05x}, 0xffffffff, 0x00000000, 0x00000000)" in setup


# ----------------------------------------------------------------------------------------------------- MemGuard


def in_force(table, row, begin, end):
    """The largest bound of a row within [begin, end) ticks from the start of a table, modes over and over."""
    frame = table.frame
    turns = range(-1, 1 + ceil(end / frame.span)) if table.successor == table.index else (0,)
    spans = [
        (max(p.begin + turn * frame.span, begin), min(p.end + turn * frame.span, end), p.bound)
        for turn in turns
        for p in frame.phases
        if p.row == row
    ]
    if table.successor != table.index:  # a table of a switch ends where it does
        spans = [(low, min(high, frame.span), bound) for low, high, bound in spans]
    spans = [(low, high, bound) for low, high, bound in spans if low < high]
    return max((sum(b for low, high, b in spans if low <= at < high) for at, *_ in spans), default=Fraction(0))


@pytest.mark.parametrize("period", [1000, 2500])
@by_name()
def test_a_setting_serves_all_that_is_in_force_until_the_next_one_holds(tmp_path, sample, period):
    """It is written at the begin of a period, holds from the end of one that runs, and until the next does."""
    settings = f"{{granularity: phase, period: {period}us, write-refills: 0, write-backs: 0}}"
    tables, _ = made(tmp_path, "memguard", sample, memguard=settings)
    for table in tables.tables:
        found = dict(memguard._settings(tables, table))
        limits = found[0]
        ticks = tables.grid.ticks(period * 1000)
        for number in range(ceil(table.frame.span / ticks)):
            limits = found.get(number * period * 1000, limits)
            end = min((number + 1) * ticks, table.frame.span) + ticks
            for unit in tables.units:
                core = tables.platform.units[unit.name].core
                for d in DIRECTIONS:
                    rate = in_force(table, Row(unit.name, d), number * ticks, end) * tables.platform.guaranteed
                    assert limits[d, core] == max(1, ceil(rate * period / 10**6 / 64)), (table.name, number, unit, d)
        assert len({*map(str, found.values())}) == len(found) or len(found) > 2  # what does not change is not set


@by_name([low_bounds, two_units, switching])
def test_limits_fall_before_others_rise(tmp_path, sample):
    """What is written first takes no core above what it had or gets; afterwards each has what the setting states."""
    changes = {"memguard": "{granularity: phase}", "capacity": "16MB/s"}
    tables, _ = made(tmp_path, "memguard", sample, **changes)
    for table in tables.tables:
        settings = memguard._settings(tables, table)
        assert [at for at, _ in memguard._blocks(tables, table)] == [at for at, _ in settings]
        now = None
        for (at, lines), (_, due) in zip(memguard._blocks(tables, table), settings, strict=True):
            written = dict(now or {})
            for d, limits in lines:
                new = {(d, core): n for core, n in enumerate(limits)}
                rising = now and any(n > written[key] for key, n in new.items())
                assert not rising or all(written[key] <= due[key] for key in due)  # all have fallen
                assert not at or new != {key: written[key] for key in new}  # only changes
                written |= new
            assert written == due
            now = written


def test_a_script_by_phases_waits_for_each_setting(tmp_path):
    tables, _ = made(tmp_path, "memguard", two_units, memguard="{granularity: phase}", capacity="16MB/s")
    facts = backend("memguard").facts(tables)
    (table,) = tables.tables
    assert facts["settings"] == {table.name: len(memguard._settings(tables, table))}
    assert len(memguard._settings(tables, table)) > 1
    whole, _ = made(tmp_path, "memguard", two_units, capacity="16MB/s")
    assert backend("memguard").facts(whole)["settings"] == {table.name: 1}


@pytest.mark.parametrize(("cores", "count"), [("{}", 2), ("{cores: 2}", 2), ("{cores: 5}", 5)])
def test_the_machine_has_the_cores_that_are_stated_or_those_of_the_units(tmp_path, cores, count):
    tables, _ = made(tmp_path, "memguard", memguard=cores)
    facts = backend("memguard").facts(tables)
    assert facts["cores"] == count
    assert {len(limits) for events in facts["events"].values() for limits in events.values()} == {count}


def test_cores_of_no_unit_are_named_with_the_number_to_state(tmp_path):
    text = PLATFORM.replace("core: 1", "core: 3")
    found = made(tmp_path, "memguard", text=text)[1]
    assert [d.message for d in found] == ["cores 1, 2 belong to no unit, and MemGuard wants a limit for every core"]
    assert 'state "memguard: {cores: 4}"' in found[0].help
    assert made(tmp_path, "memguard", text=text, memguard="{cores: 4}")[1] == []
    (found,) = made(tmp_path, "memguard", text=text, memguard="{cores: 3}")[1]
    assert (found.message, found.path) == ("core 3 does not exist; the platform has 3 cores", 'unit "u2"')
    assert found.help == 'use 0 to 2, or state "memguard: {cores: 4}"'


def test_two_units_on_one_core_are_refused_with_one_that_is_free(tmp_path):
    found = made(tmp_path, "memguard", text=PLATFORM.replace("core: 1", "core: 0"))[1]
    (shared,) = [d for d in found if d.code == codes.SHARED_MANAGER.id]
    assert shared.help.startswith('state "core: 1", which is free')
    three = PLATFORM.replace("core: 1", "core: 2") + "  u3: {manager: 3, core: 2}\n"
    (shared, *_) = made(tmp_path, "memguard", two_units, text=three, capacity="8MB/s")[1]
    assert shared.help.startswith('state "core: 1", which is free')


@pytest.mark.parametrize(
    ("period", "help"),
    [
        (999, "{period: 1000us}"),
        (1000, None),
        (4096, "{period: 4095us}"),
        (8192, "{period: 8191us}"),
        (10**6, None),
        (10**6 + 1, "{period: 1000000us}"),
    ],
)
def test_periods_that_the_module_cannot_count(tmp_path, period, help):
    found = [
        d for d in made(tmp_path, "memguard", memguard=f"{{period: {period}us}}")[1] if d.path == "platform memguard"
    ]
    assert [help in d.help for d in found] == ([True] if help else [])


def test_phases_are_a_remedy_where_they_are_one(tmp_path):
    """The largest bounds of two_units come at different times: with one limit for the mode they do not fit."""
    seen = set()
    alone = "write-refills: 0, write-backs: 0"
    for capacity in range(7, 17):
        rates = ROOMY | {"capacity": f"{capacity}MB/s"}
        whole = [d for d in made(tmp_path, "memguard", two_units, **rates, memguard=f"{{{alone}}}")[1] if d.is_error]
        phases = f"{{granularity: phase, {alone}}}"
        by_phase = [d for d in made(tmp_path, "memguard", two_units, **rates, memguard=phases)[1] if d.is_error]
        assert ["granularity: phase" in found.help for found in whole] == [not by_phase] * len(whole)
        seen.add((bool(whole), bool(by_phase)))
    assert seen == {(True, True), (True, False), (False, False)}


def test_phases_are_a_remedy_up_to_all_that_there_is_room_for(tmp_path):
    alone = "{write-refills: 0, write-backs: 0}"
    tables, _ = made(tmp_path, "memguard", two_units, memguard=alone)
    phases = [limits for _, limits in memguard._settings(tables, tables.tables[0], "phase")]
    most = sum(memguard._worst(tables.tables[0], phases).values()) * 64_000 + tables.reserve * 1000
    for capacity, is_one in ((most, True), (most - 1, False)):
        rates = ROOMY | {"capacity": f"{capacity}B/s", "guaranteed": "6.4MB/s"}
        (found,) = [d for d in made(tmp_path, "memguard", two_units, **rates, memguard=alone)[1] if d.is_error]
        assert ('or set "memguard: {granularity: phase}", or use the back-end table' in found.help) == is_one
        assert "u1 write 0.064MB/s for 0MB/s" in found.message


def test_what_lines_bring_is_to_be_measured_where_it_is_too_much(tmp_path):
    ratios = "{write-backs: 1, write-refills: 1/3}"
    (found,) = [d for d in made(tmp_path, "memguard", nearly_all, memguard=ratios, capacity="7MB/s")[1] if d.is_error]
    remedies = (
        'state "memguard: {write-backs: ...}", measured, which is 1 lines written per line read',
        'state "memguard: {write-refills: ...}", measured, which is 1/3 lines refilled per line written',
        "use the back-end table or axi-realm",
    )
    assert found.help.endswith(f", or {', or '.join(remedies)}")


def test_cores_have_one_line_each_where_there_is_no_more(tmp_path):
    t = task("t", 10, version("v", 5, "u1", access("mem", 0, 5, "0.1", "read")))
    system = model(t, units="u1 u2", resources="mem")
    schedule = one_mode(system, 10, job(system, "t", 0, 0, "u1"))
    for lines in (4, 3):
        text = PLATFORM.replace("manager: 0", f"manager: 0, default-read: {64 * lines}B")
        rates = {"capacity": f"{64 * lines}kB/s", "guaranteed": "64kB/s"}
        tables, _ = build(tmp_path, system, schedule, backend_name="memguard", text=text, **rates)
        assert memguard._defaults(tables) == {"read": [1, 1], "write": [1, 1]}


@pytest.mark.parametrize(
    ("ratios", "read", "write"),
    [
        ("write-backs: 0, write-refills: 0", [1 + 123, 1, 1, 1], [1, 1 + 61, 1, 1]),
        ("write-backs: 1, write-refills: 1/3", [1 + 61, 1 + 15, 1, 1], [1 + 61, 1 + 46, 1, 1]),
    ],
)
def test_before_the_first_table_all_cores_together_have_what_memory_serves(tmp_path, ratios, read, write):
    """254 lines of 64 bytes in 1 ms: one of each for each of 4 cores, and of 246 the shares of the stated budgets."""
    text = PLATFORM.replace("manager: 0", "manager: 0, default-read: 8128B")
    text = text.replace("manager: 2", "manager: 2, default-write: 4064B, default-read: 1B")
    changes = {"capacity": "16.256MB/s", "bus": "256bit", "memguard": f"{{cores: 4, {ratios}}}"}
    tables, _ = made(tmp_path, "memguard", text=text, **changes)
    assert memguard._defaults(tables) == {"read": read, "write": write}
    assert sum(read + write) <= 254
    fine = {**changes, "memguard": f"{{cores: 4, line: 1B, period: 2ms, {ratios}}}"}
    tables, _ = made(tmp_path, "memguard", text=text, **fine)
    assert [limits[2:] for limits in memguard._defaults(tables).values()] == [[1, 1], [1, 1]]


@pytest.mark.parametrize(("cores", "is_taken"), [(128, True), (129, False)])
def test_the_module_takes_255_characters_of_a_line(tmp_path, cores, is_taken):
    t = task("t", 10, version("v", 5, "u1", access("mem", 0, 5, "0.001", "read")))
    system = model(t, units="u1", resources="mem")
    schedule = one_mode(system, 10, job(system, "t", 0, 0, "u1"))
    settings = {"memguard": f"{{cores: {cores}, write-backs: 0}}", "capacity": "64MB/s", "bus": "512bit"}
    found = [d for d in made(tmp_path, "memguard", lambda: (system, schedule), **settings)[1] if d.is_error]
    assert [f"of {cores} cores are {2 * cores - 1} characters" in d.message for d in found] == [True, True] * (
        not is_taken
    )


def test_the_last_setting_of_a_mode_is_followed_by_its_first_and_of_a_switch_by_none():
    low, high = {("read", 0): 1, ("read", 1): 9}, {("read", 0): 8, ("read", 1): 1}
    mode, switch = (SimpleNamespace(index=0, successor=successor) for successor in (0, 1))
    both = {("read", 0): 8, ("read", 1): 9}
    assert memguard._worst(mode, [low]) == memguard._worst(switch, [low]) == low
    assert memguard._worst(mode, [low, high]) == memguard._worst(switch, [low, high]) == both
    some = {("read", 0): 7, ("read", 1): 1}
    assert memguard._worst(mode, [low, some, high]) == both  # from the last to the first
    assert memguard._worst(switch, [low, some, high]) == {("read", 0): 7, ("read", 1): 9}


# ------------------------------------------------------------------------------------------------------ the unit


def parameters(component):
    """The values by which an IP-XACT component is built."""
    pattern = r'<ipxact:parameter parameterId="(\w+)".*?<ipxact:value>([^<]*)</ipxact:value>'
    return dict(re.findall(pattern, component.decode(), re.DOTALL))


@pytest.mark.parametrize(
    ("burst", "bus", "buffer"), [("64B", 64, 16), ("128B", 64, 16), ("136B", 64, 32), ("8B", 64, 16)]
)
def test_the_component_is_built_as_its_tables_need_it_and_otherwise_as_its_verilog_is(tmp_path, burst, bus, buffer):
    """A write that is longer than the buffer is refused."""
    written = files(tmp_path, "table", burst=burst, table="{depth: 2048}", capacity="7.9MB/s")
    stated = parameters(written["component.xml"])
    source = written["rtl/halpipe_regulator_axi4.v"].decode()
    known = dict(re.findall(r"parameter\s+(?:integer|\[31:0\])?\s*(\w+)\s*=\s*(\S+?),?\s", source))
    due = {"UNITS": "2", "DEPTH": "2048", "TABLES": "16", "SIZE": "3", "CYCLES": "1000", "BUFFER": str(buffer)}
    for name in ("BANKS", "PORTS", "ADDR", "ID", "STAGE"):
        due[name] = known[name]
    assert {name: stated[name] for name in due} == due


@pytest.mark.parametrize(
    ("tables", "lines"), [(1, 16), (15, 16), (16, 32), (31, 32), (32, 64), (127, 128), (255, 256), (256, 256)]
)
def test_a_header_that_no_table_has_ends_the_images_as_far_as_there_are_any(tables, lines):

    assert header_lines(tables) == lines


def plain_switches():
    """Two modes of which nothing reaches over the switches between them."""
    system, schedule = switching()
    modes = tuple(
        replace(m, jobs=tuple(replace(j, start=ms(0), end=j.end - j.start) for j in m.jobs)) for m in schedule.modes
    )
    there, back = schedule.transitions
    switches = (replace(there, length=ms(0), jobs=()), back)
    return system, replace(schedule, modes=modes, transitions=switches)


@pytest.mark.parametrize(
    ("name", "stated", "count"), [("table", "all", 4), ("table", "needed", 2), ("axi-realm", "all", 2)]
)
def test_every_switch_has_a_table_where_that_is_stated_of_the_unit(tmp_path, name, stated, count):
    tables, _ = build(tmp_path, *plain_switches(), backend_name=name, table=f"{{switches: {stated}}}", **ROOMY)
    assert len(tables.tables) == count


# ------------------------------------------------------------------------------------------------------ windows


def divides(n, spans, clock=10**6):
    return all((Fraction(span.ns) * clock / 10**9 / n).denominator == 1 for span in spans if span)


@pytest.mark.parametrize("cycles", [900, 999, 1000, 1001, 1700, 3001, 60, 130, 11])
@pytest.mark.parametrize("capacity", ["6.4MB/s", "6.6MB/s", "7.1MB/s"])
def test_the_nearest_windows_divide_all_spans_and_carry_whole_bursts_where_any_does(tmp_path, cycles, capacity):
    spans = [ms(10), ms(6), ms(0)]
    p = platform(tmp_path, window=cycles, capacity=capacity, guaranteed="1MB/s")
    fit = [n for n in range(LEAST_CYCLES, 2001) if divides(n, spans) and p.capacity * n >= 64 * 10**6]
    whole = [n for n in fit if p.capacity * n % (64 * 10**6) == 0] or fit
    below, above = [n for n in whole if n < cycles], [n for n in whole if n > cycles]
    assert windows.nearest_windows(p, [span for span in spans if span]) == below[-1:] + above[:1]


@pytest.mark.parametrize("span", ["1000.01ms", "0.1ms", "7ms"])
def test_a_window_of_parts_of_cycles_that_is_proposed_divides_all(tmp_path, span):
    p = platform(tmp_path, clock="999999Hz", guaranteed="6MB/s")
    said = windows.nearest_help(p, [Duration.parse(span)])
    if said.startswith("no window"):
        assert Duration.parse(span) / p.cycle < p.least_cycles
        return
    found = re.search(r'state "window: ([^"]+)"', said)
    assert found
    window = Duration.parse(found[1])
    assert (Duration.parse(span) / window).denominator == 1
    assert window / p.cycle >= p.least_cycles


def test_the_shortest_window_that_is_not_too_many_is_proposed(tmp_path):
    t = task("t", "30s", version("v", 1, "u1", access("mem", 0, 1, "0.25", "read")))
    system = model(t, units="u1", resources="mem")
    schedule = one_mode(system, "30s", job(system, "t", 0, 0, "u1"))
    with pytest.raises(HalpipeError) as refused:
        build(tmp_path, system, schedule, window=20)
    (found,) = refused.value.diagnostics
    assert found.message == f"hyperperiod 30s has 1500000 windows; at most {2**20} can be exported"
    least = next(n for n in range(LEAST_CYCLES, 100) if 30_000_000 % n == 0 and 30_000_000 // n <= 2**20)
    assert found.help == f"use a window of at least {least} cycles"


def test_a_window_that_is_proposed_is_long_enough_for_a_regulator(tmp_path):
    """Three cycles would do but for that."""
    span = f"{3 * 2**20}us"
    t = task("t", span, version("v", 1, "u1", access("mem", 0, 1, "0.25", "read")))
    system = model(t, units="u1", resources="mem")
    with pytest.raises(HalpipeError) as refused:
        build(tmp_path, system, one_mode(system, span, job(system, "t", 0, 0, "u1")), window=2, burst="8B")
    assert [d.help for d in refused.value.diagnostics] == [f"use a window of at least {LEAST_CYCLES} cycles"]


@pytest.mark.parametrize(("longest", "least"), [(22, 4), (25, 32)])  # powers of 2 in cycles: just 2^20 windows
def test_a_window_that_is_proposed_is_long_enough_for_the_longest_table(tmp_path, longest, least):
    _, schedule = switching()
    spans = (ms(f"{2**longest}us"), ms(f"{2**21}us"))
    modes = [replace(mode, hyperperiod=span) for mode, span in zip(schedule.modes, spans, strict=True)]
    p = platform(tmp_path, window=2, burst="8B")
    (found,) = windows.check_windows(replace(schedule, modes=tuple(modes), transitions=()), p)
    assert found.help == f"use a window of at least {least} cycles"


@pytest.mark.parametrize(
    ("cycles", "span", "help"),
    [
        (10, "15.1us", "15.1us"),  # half of it would not carry a burst
        (10, "25.1us", "12.55us"),
        (1000, "25.1us", "25.1us"),  # the nearest
    ],
)
def test_of_windows_of_parts_of_cycles_the_nearest_that_carries_a_burst_is_proposed(tmp_path, cycles, span, help):
    said = windows.nearest_help(platform(tmp_path, window=cycles), [Duration.parse(span)])
    assert said.startswith(f'state "window: {help}"')


# ------------------------------------------------------------------------------------------------------ budgets


@pytest.mark.parametrize("stated", [0, 1, 63, 64, 65, 128])
def test_a_default_of_a_row_in_use_is_whole_bursts_from_1_on(tmp_path, stated):
    text = PLATFORM.replace("manager: 0,", f"manager: 0, default-read: {stated}B,")
    least = max(64, -(-stated // 64) * 64)
    if stated == least:
        tables, found = build(tmp_path, *two_units(), text=text, capacity="7MB/s")
        assert not [d for d in found if d.is_error]
        assert tables.units[0].default["read"] == stated
        return
    with pytest.raises(HalpipeError) as refused:
        build(tmp_path, *two_units(), text=text, capacity="7MB/s")
    (found,) = refused.value.diagnostics
    assert found.message == f"default for reads is {stated} bytes per window, which is not whole bursts from 1 on"
    assert found.help.startswith(f"state {least} bytes")


def test_a_capacity_is_a_remedy_where_the_bus_carries_it(tmp_path):
    """A bus of 8 bits carries 1 MB/s at 1 MHz, one of 16 bits 2 MB/s."""
    proposed = []
    for bus, most in (("8bit", 10**6), ("16bit", 2 * 10**6)):
        for thousands in range(700, 2000, 50):
            rates = {"bus": bus, "guaranteed": f"{thousands}kB/s", "capacity": f"{thousands}kB/s"}
            with suppress(HalpipeError):
                build(tmp_path, *nearly_all(), **rates)
                continue
            with pytest.raises(HalpipeError) as refused:
                build(tmp_path, *nearly_all(), **rates)
            for said in re.findall(r'"capacity: ([^"]+)"', " ".join(d.help for d in refused.value.diagnostics)):
                proposed.append((most, parse_bandwidth(said)))
                build(tmp_path, *nearly_all(), **rates | {"capacity": said})
    assert proposed
    assert all(capacity <= most for most, capacity in proposed)


def test_defaults_may_take_all_of_a_window(tmp_path):
    """Of 6600 bytes 6592 are whole bursts; a burst more does not fit."""
    for burst, is_safe in ((103, True), (104, False)):
        text = PLATFORM.replace("manager: 0,", f"manager: 0, default-read: {64 * burst - 192}B,")
        text = text.replace("manager: 2,", "manager: 2, default-write: 64B, default-read: 128B,")
        changes = {"text": text, "capacity": "6.592MB/s"}
        if is_safe:
            assert not [d for d in build(tmp_path, *two_units(), **changes)[1] if d.is_error]
            continue
        with pytest.raises(HalpipeError) as refused:
            build(tmp_path, *two_units(), **changes)
        assert [d.message for d in refused.value.diagnostics] == ["defaults and overshoot sum to 6656 bytes per window"]


@pytest.mark.parametrize("clock", ["1MHz", "999999Hz", "100MHz"])
def test_a_cycle_is_the_time_of_one(tmp_path, clock):
    p = platform(tmp_path, clock=clock, guaranteed="64kB/s", window=1000000)
    assert p.cycle * p.clock == Duration.parse("1s")


# ------------------------------------------------------------------------------------------------------ report


def test_reports_are_ascii_with_one_entry_on_a_line():
    """What fits a line of 160 characters beside its depth stands on one; others have a line for each of their items."""
    row = {"name": "\u00fc", "n": [*range(20)]}
    value = {"rows": [row] * 9, "empty": {}, "text": "x" * 300}
    lines = format_json(value).decode("ascii").splitlines()
    assert json.loads(format_json(value)) == value
    assert lines[0] == "{"
    assert lines[1] == ' "rows": ['
    assert lines[2:11] == [f"  {json.dumps(row)},"] * 8 + [f"  {json.dumps(row)}"]
    assert lines[11:] == [" ],", ' "empty": {},', f' "text": "{"x" * 300}"', "}"]


@pytest.mark.parametrize("length", [156, 157])
def test_a_line_of_a_report_has_160_characters_at_most(length):
    """At depth 1 a list of one text may have 159."""
    (_, *lines, _) = format_json([["x" * (length - 1)], "y" * 20]).decode().splitlines()
    assert (len(lines) == 2) == (length == 156)


def test_units_without_access_are_named_so(tmp_path):
    system, schedule = two_units()
    text = PLATFORM + "  u3: {manager: 4}\n"
    tables, _ = build(tmp_path, system, schedule, text=text, capacity="7MB/s")
    assert "units: u1, u2, u3 (no access)" in summarise(tables, backend("table"), DIGEST).splitlines()


def test_a_bound_below_a_burst_states_the_bursts_of_a_window(tmp_path):
    t = task("t", 10, version("v", 5, "u1", access("mem", 0, 5, "0.007", "read")))
    system = model(t, units="u1", resources="mem")
    tables, _ = build(tmp_path, system, one_mode(system, 10, job(system, "t", 0, 0, "u1")), "controlled")
    (found,) = _below_burst(tables)
    assert found.message == (
        'bound 0.007 is 0.7 bursts of 64 bytes per window for unit "u1": one burst every 2 windows'
    )
    assert found.help == "use a bound of at least 0.01, or a window of at least 1429 cycles"


@pytest.mark.parametrize(
    ("value", "shown"),
    [("5", "5 and 0/1"), ("501/100", "5.01"), ("506/101", "5 and 1/101"), ("499/100", "4.99"), ("1/3", "0.33")],
)
def test_a_number_of_windows_does_not_look_whole_unless_it_is(value, shown):
    assert windows._shown(Fraction(value)) == shown


@pytest.mark.parametrize(("capacity", "clock", "burst", "least"), [
    (6_400_000, 10**6, 64, 10), (6_400_001, 10**6, 64, 10), (6_399_999, 10**6, 64, 11), (6_400_000, 10**5, 64, 4),
])  # fmt: skip
def test_the_shortest_window_carries_a_burst(tmp_path, capacity, clock, burst, least):
    p = replace(platform(tmp_path), capacity=capacity, clock=clock, burst=burst)
    assert p.least_cycles == least == max(LEAST_CYCLES, ceil(Fraction(burst * clock, capacity)))


@pytest.mark.parametrize(("bound", "said"), [("0.5", "a bound of at least 1, or "), ("0.6", "")])
def test_a_bound_is_a_remedy_up_to_1(tmp_path, bound, said):
    """A window of 32 bytes carries half a burst at a bound of 1/2; where it carries less, no bound does."""
    t = task("t", 10, version("v", 5, "u1", access("mem", 0, 5, bound, "read")))
    system = model(t, units="u1", resources="mem")
    schedule = one_mode(system, 10, job(system, "t", 0, 0, "u1"))
    rate = "64kB/s" if said else "50kB/s"
    tables, _ = build(tmp_path, system, schedule, "controlled", guaranteed=rate, capacity="200kB/s", bus="8bit")
    (found,) = _below_burst(tables)
    assert found.help.startswith(f"use {said}a window of at least ")


def test_bundles_of_cores_have_the_files_of_their_regulators_but_those_of_the_system(tmp_path):
    """Model, schedule and manifest are the bundle's own."""
    path = platform_file(tmp_path, capacity="7MB/s")
    alone = RegulatorExporter().write(*two_units(), RegulatorOptions(platform=path))
    files, known = embedded(*two_units(), path)
    own = (MANIFEST, MODEL, SCHEDULE)
    assert files == {f"regulator/{name}": data for name, data in alone.items() if name not in own}
    assert {*own} <= {*alone}
    assert known == read_platform(path)
    assert embedded(*two_units(), "") == ({}, None)
