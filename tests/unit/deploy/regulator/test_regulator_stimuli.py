"""The script of the software in a simulation, and which table must be played in every window because of it."""

import re
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

import halpipe
import regulator_bundles as bundles
from halpipe.deploy.regulator import stimuli
from halpipe.deploy.regulator.reading import read_tables
from halpipe.deploy.regulator.stimuli import NOT_RUNNING, STEPPED, TRAFFIC, Traffic, plan
from profiles import examples

REGISTERS = {
    "unit": {"PARAMS": "PARAMS", "UNIT_WINDOW": "WINDOW", "UNIT_DEF_READ": "DEF_RD", "UNIT_DEF_WRITE": "DEF_WR",
             "UNIT_REQUEST": "REQ_TABLE"},
    "arrays": {"UNIT_HEADERS": "HDR", "UNIT_ENTRIES": "TAB"},
    "windows": {"FRAME_ID": "ID", "FRAME_GO": "CTRL", "FRAME_WINDOW": "WINDOW", "FRAME_CYCLES": "CYCLES",
                "FRAME_REQUEST": "REQ_TABLE", "FRAME_EXTRA": "EXTRA", "FRAME_OF": "OF", "FRAME_LONGEST": "LONGEST"},
}  # fmt: skip
"""The addresses that the software of a simulation uses, and the registers of the description that they are of."""


@pytest.mark.parametrize("block", REGISTERS)
def test_addresses_are_those_of_the_description_of_the_registers(block):
    described = Path(halpipe.__file__).with_name("exporters").joinpath("regulator", "table", "registers.j2").read_text()
    (lines,) = re.findall(rf"set {block} = \[\n(.*?)\n\] %}}", described, re.DOTALL)
    known = dict(re.findall(r'^  \("(\w+)", (?:"\w+", )?(0x[0-9a-f]+),', lines, re.MULTILINE))
    used = {name: getattr(stimuli, name) for name in REGISTERS[block]}
    assert used == {name: int(known[register], 16) for name, register in REGISTERS[block].items()}


def tables_of(folder, *, window="64"):
    return read_tables(bundles.target(bundles.export(folder, *bundles.system(), window=window)).bundle)


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    return tables_of(tmp_path_factory.mktemp("bundle"))


def follow(tables, run):
    """Which window of which table is played, cycle by cycle, from the orders and the documented rules alone.

    GO counts for the end of a window if it was written before its last cycle, a request two cycles before it. A window
    without budgets lies before the first table; a request that is late for an end at which another is followed is lost.
    """
    cycles, first = run.cycles, stimuli.first_window(len(tables.units))
    _, headers = stimuli.sizes(tables)
    orders = {
        cycle: (address & 0x3FFFFFF, value)
        for cycle, order, address, value in run.script
        if order == "w" or (order == "l" and address >> 26 == stimuli.WHOLE)
    }
    known = {table.index: (table.windows, table.successor) for table in tables.tables}
    orders = {c: (a, v) for c, (a, v) in orders.items() if a != stimuli.FRAME_REQUEST or v < headers}
    go, running, calm, table, window, requests, seen = False, False, False, 0, 0, [], []
    for cycle in range(first + cycles * len(run.expected)):
        if cycle >= first and (cycle - first) % cycles == 0:
            seen.append((table, window) if running else (0, NOT_RUNNING))
        if (cycle + 1 - first) % cycles == 0 and cycle + 1 >= first:
            in_time = [request for written, request in requests if written <= cycle - 2]
            ends = not running or window + 1 == known[table][0]
            calms = go and not running and not calm
            if go and ends and in_time and not calms and orders.get(cycle, (None, None))[0] == stimuli.FRAME_REQUEST:
                del orders[cycle]
            if calms:
                pass
            elif go and ends:
                table = in_time[-1] if in_time else known[table][1] if running else 0
                late = [(written, request) for written, request in requests if written > cycle - 2]
                requests = [] if in_time else late
                window = 0
            elif go:
                window += 1
            running, calm = go and not calms and table in known, calms
        address, value = orders.get(cycle, (None, None))
        if address == stimuli.FRAME_GO:
            go = bool(value)
        elif address == stimuli.FRAME_REQUEST:
            requests.append((cycle, value))
    return seen


@examples(25)
@given(seed=st.integers(0, 10**6), traffic=st.sampled_from((STEPPED, *TRAFFIC)))
def test_what_is_expected_follows_from_the_script(seed, traffic, tables):
    run = plan(tables, traffic, seed, windows=400)
    assert follow(tables, run) == [(e.table, e.window) for e in run.expected]
    assert run.expected[[e.running for e in run.expected].index(True) - 1].is_calm


def test_the_runs_have_requests_too_late_in_time_and_replaced(tables):
    """Otherwise the rule of the last two cycles would not be tested."""
    gaps, replaced = set(), 0
    for seed in range(30):
        run = plan(tables, TRAFFIC[0], seed, windows=400)
        cycles, first = tables.platform.window_cycles, stimuli.first_window(len(tables.units))
        written = [cycle for cycle, _, address, _ in run.script if address == stimuli.FRAME_REQUEST]
        gaps |= {(first - 1 - cycle) % cycles for cycle in written}
        replaced += len(written) > run.switches
    assert {0, 1, 2} <= gaps
    assert replaced


@pytest.mark.parametrize("traffic", TRAFFIC, ids=lambda traffic: traffic.name)
def test_every_table_is_played_and_every_switch_made(tables, traffic):
    run = plan(tables, traffic, 1, windows=2**31)
    played = [e.table for e in run.expected if e.running]
    assert set(played) == {0, 1, 2}
    steps = {(a, b) for a, b in pairwise(played) if a != b}
    assert steps >= {(0, 2), (2, 1), (1, 0)}


def test_modes_without_switches_are_started_one_after_the_other(tmp_path):
    files = bundles.export(tmp_path, *bundles.system())
    alone = bundles.changed(files, lambda data: (data["switches"].clear(), data["tables"].pop()))
    run = plan(read_tables(bundles.target(alone).bundle), TRAFFIC[0], 1, windows=2**31)
    assert {e.table for e in run.expected if e.running} == {0, 1}
    restarts = [v for _, order, address, v in run.script if order in "wl" and address & 0x3FFFFFF == stimuli.FRAME_GO]
    assert restarts == [1, 0, 1]


def test_more_cycles_repeat_the_modes(tables):
    once, thrice = (plan(tables, TRAFFIC[0], 1, windows=2**31, repeats=n) for n in (1, 3))
    plays = [[e for e in run.expected if (e.table, e.window) == (0, 0)] for run in (once, thrice)]
    assert len(plays[1]) >= len(plays[0]) + 2


def test_the_windows_are_bounded(tables):
    assert len(plan(tables, TRAFFIC[0], 1, windows=17).expected) == 17


def test_equal_seeds_give_equal_runs_and_others_do_not(tables):
    assert plan(tables, TRAFFIC[4], 5, windows=300) == plan(tables, TRAFFIC[4], 5, windows=300)
    assert plan(tables, TRAFFIC[4], 5, windows=300).script != plan(tables, TRAFFIC[4], 6, windows=300).script


def test_software_writes_the_tables_before_go(tables):
    run = plan(tables, Traffic(name="t", by_software=True), 1, windows=100)
    go = next(
        cycle for cycle, order, address, _ in run.script if order == "l" and address & 0xFFFFFF == stimuli.FRAME_GO
    )
    writes = [address for cycle, order, address, _ in run.script if order == "w" and cycle < go]
    entries = sum(len(e) for table in tables.tables for e in table.entries.values())
    in_tables = [address for address in writes if address & 0xFFFFF >= stimuli.UNIT_ENTRIES]
    beyond = 3  # an entry that there is not
    assert len(in_tables) == 3 * entries + len(tables.units) + beyond  # with a terminator each
    assert [cycle for cycle, *_ in run.script] == sorted({cycle for cycle, *_ in run.script})


def test_the_script_is_lines_of_text():
    assert stimuli.format_script([(3, "w", 0x100018, 255), (9, "r", 16, 0)]) == b"3 w 100018 ff\n9 r 10 0\n"


def test_an_excerpt_has_every_budget_and_follows_the_table(tables):
    """Stretches are shortened; what does not fit is cut out, with a window without budgets in its place."""
    rows = list(tables.rows())

    def columns(table):
        return list(zip(*(table.budgets(unit.name, direction) for unit, direction in rows), strict=True))

    short, shorter = (stimuli.excerpt(tables, windows) for windows in (13 * 30, 13 * 12))
    assert any(table.windows < before.windows for table, before in zip(short.tables, tables.tables, strict=True))
    for table, before in zip(short.tables, tables.tables, strict=True):
        assert {*columns(table)} == {*columns(before)}
    nothing = (0,) * len(rows)
    for table, before in zip((*short.tables, *shorter.tables), 2 * tables.tables, strict=True):
        steps, known = list(pairwise(columns(table))), set(pairwise(columns(before)))
        assert all(step in known or nothing in step for step in steps)
        assert (columns(table)[0], columns(table)[-1]) == (columns(before)[0], columns(before)[-1])
    assert max(table.windows for table in shorter.tables) == 12


@pytest.mark.parametrize("traffic", TRAFFIC[1:], ids=lambda traffic: traffic.name)
def test_random_traffic_meets_every_table_to_its_end(tables, traffic):
    """And makes every switch, within the windows that a check simulates."""
    short = stimuli.excerpt(tables, 320)
    run = plan(short, traffic, 1, windows=320)
    ended = {e.table for e in run.expected if e.running and e.window + 1 == short.tables[e.table].windows}
    assert ended == {table.index for table in tables.tables}
    assert run.switches >= len(tables.switches)


# ------------------------------------------------------------------------------------------------ registers

REACH = (1 << 26) - 1
"""Bits of an address in an order; what is above are the strobes of AXI4-Lite."""


def registers(tables, run):
    """Execute a script on the registers as docs/reference/regulator-unit.md has them.

    Return what each look at a register shows, the memories of the units when GO is written, and what is written later.
    """
    frame = {stimuli.FRAME_GO: 0, stimuli.FRAME_OF: 1, stimuli.FRAME_EXTRA: 0, stimuli.FRAME_LONGEST: 0xFFFF}
    defaults, memory, late, shown = {}, {}, [], []
    entries, headers = stimuli.sizes(tables)
    played, first = follow(tables, run), stimuli.first_window(len(tables.units))
    before = None

    def window_of(cycle):
        """Windows since reset, and the one that is in force; that before the first one counts as none."""
        number = (cycle - first) // run.cycles if cycle >= first else -1
        return number + 1, played[number] if number >= 0 else (0, NOT_RUNNING)

    def read(cycle, unit, offset):
        count, (_, window) = window_of(cycle)
        if unit < 0:
            known = {
                stimuli.FRAME_ID: 0x48425746,
                stimuli.PARAMS: 4 << 24 | 1 << 20 | 1 << 16 | 3 << 8 | len(tables.units),
                stimuli.FRAME_WINDOW: count,
            }
            return known[offset] if offset in known else frame[offset]
        known = {
            stimuli.FRAME_ID: 0x48425754,
            stimuli.PARAMS: 4 << 24 | headers % 256 << 16 | entries,
            stimuli.UNIT_WINDOW: window,
        }
        return known[offset] if offset in known else defaults[unit, offset]

    for cycle, order, address, value in run.script:
        strobes, unit, offset = address >> 26, (address & REACH) // 2**20 - 1, address & 0xFFFFF
        if order in "ra":
            shown.append((cycle, address, read(cycle, unit, offset)))
            continue
        if order == "l":
            shown.append((cycle, address, stimuli.OKAY if strobes == stimuli.WHOLE else stimuli.SLVERR))
            if strobes != stimuli.WHOLE:
                continue
        if offset == stimuli.FRAME_GO and unit < 0:
            before = dict(memory) if before is None else before
            frame[offset] = value
        elif unit < 0 and offset != stimuli.FRAME_REQUEST:
            least = {stimuli.FRAME_CYCLES: 4, stimuli.FRAME_OF: 1}.get(offset, 0)
            frame[offset] = max(value, least)
        elif unit >= 0 and offset in (stimuli.UNIT_DEF_READ, stimuli.UNIT_DEF_WRITE):
            defaults[unit, offset] = value
        elif before is None:
            memory[unit, offset] = value
        else:
            late.append((cycle, unit, offset, value))
    return shown, before, late


@examples(20)
@given(seed=st.integers(0, 10**6), traffic=st.sampled_from((STEPPED, *TRAFFIC)))
def test_registers_show_what_was_written_and_what_is_played(seed, traffic, tables):
    run = plan(tables, traffic, seed, windows=300)
    shown, _, _ = registers(tables, run)
    assert sorted(shown) == list(run.reads)
    assert len(run.reads) > stimuli.READS // 2
    through_lite = [cycle for cycle, order, *_ in run.script if order in "al"]
    assert all(later - earlier >= stimuli.LITE_CYCLES for earlier, later in pairwise(through_lite))


@pytest.mark.parametrize("seed", range(3))
def test_the_tables_that_software_writes_are_those_of_the_memory_images(tables, seed):
    """Beside them it writes the first header and the first entry that there are not, which changes nothing."""
    run = plan(tables, Traffic(name="t", by_software=True), seed, windows=100)
    _, memory, _ = registers(tables, run)
    entries, headers = stimuli.sizes(tables)
    beyond = {offset for _, offset in memory if offset >= stimuli.UNIT_ENTRIES + 16 * entries}
    beyond |= {o for _, o in memory if stimuli.UNIT_HEADERS + 8 * headers <= o < stimuli.UNIT_ENTRIES}
    assert beyond == {
        *(stimuli.UNIT_HEADERS + 8 * headers + at for at in (0, 4)),
        *(stimuli.UNIT_ENTRIES + 16 * entries + at for at in (0, 4, 8)),
    }
    for unit in tables.units:
        due, index = {}, 0
        for table in tables.tables:
            at = stimuli.UNIT_HEADERS + 8 * table.index
            due |= {at: table.windows, at + 4: table.successor << 24 | index}
            for entry in table.entries[unit.name]:
                at = stimuli.UNIT_ENTRIES + 16 * index
                due |= {at: entry.write, at + 4: entry.read, at + 8: entry.window}
                index += 1
        due[stimuli.UNIT_ENTRIES + 16 * index + 8] = NOT_RUNNING
        found = {offset: value for (number, offset), value in memory.items() if number == unit.index}
        assert {offset: value for offset, value in found.items() if offset not in beyond} == due


def test_orders_that_change_nothing_are_given_while_a_table_is_played(tables):
    """To headers and starts of entries that there are, which are closed then; and requests of tables that are not."""
    _, headers = stimuli.sizes(tables)
    kinds = set()
    for seed in range(8):
        run = plan(tables, TRAFFIC[0], seed, windows=300)
        played, first = follow(tables, run), stimuli.first_window(len(tables.units))
        _, _, late = registers(tables, run)
        for cycle, unit, offset, value in late:
            number = (cycle - first) // run.cycles
            if offset == (stimuli.FRAME_REQUEST if unit < 0 else stimuli.UNIT_REQUEST):
                if value >= headers:
                    kinds.add(("request", unit >= 0))
                    assert value < stimuli.MOST_TABLES
                continue
            assert all(window != NOT_RUNNING for _, window in played[number : number + 2])
            own = sum(len(table.entries[tables.units[unit].name]) for table in tables.tables)
            known = {stimuli.UNIT_HEADERS + 8 * table.index + at for table in tables.tables for at in (0, 4)}
            known |= {stimuli.UNIT_ENTRIES + 16 * index + 8 for index in range(own)}
            assert offset in known
            kinds.add(offset & 0x1004 if offset < stimuli.UNIT_ENTRIES else "entry")
    assert kinds == {("request", False), ("request", True), 0, 4, "entry"}


def test_software_starts_the_tables_in_any_cycle_of_two_windows(tables):
    first, cycles = stimuli.first_window(len(tables.units)), tables.platform.window_cycles
    runs = [plan(tables, TRAFFIC[0], seed, windows=20) for seed in range(60)]
    starts = [
        next(cycle for cycle, order, address, _ in run.script if order == "l" and address & REACH == stimuli.FRAME_GO)
        for run in runs
    ]
    assert all(first <= start < first + 2 * cycles for start in starts)
    assert {(start - first) * 4 // cycles for start in starts} == {*range(8)}


def test_requests_are_made_at_any_time_of_a_table(tables):
    """Before its middle one that is replaced, after it one that counts, and within the last two cycles a late one."""
    cycles, first = tables.platform.window_cycles, stimuli.first_window(len(tables.units))
    places = set()
    for seed in range(60):
        run = plan(tables, TRAFFIC[0], seed, windows=300)
        for cycle, order, address, value in run.script:
            if order == "w" and address == stimuli.FRAME_REQUEST and value < len(tables.tables):
                number = (cycle - first) // cycles
                expected = run.expected[number] if 0 <= number < len(run.expected) else None
                if expected and expected.running:
                    windows = tables.tables[expected.table].windows
                    at = expected.window * cycles + (cycle - first) % cycles
                    places.add(min(at * 8 // (windows * cycles), 7))
    assert places >= {*range(8)}


def test_managers_of_a_mixed_run_differ_and_those_of_a_silent_one_rest(tables):
    """A half of a manager is greedy, with any of three habits; in a quarter of the cases one of the halves rests."""
    halves = Counter()
    for seed in range(200):
        kinds = TRAFFIC[4].kinds(tables, stimuli.Draw(seed))
        assert len(kinds) == len(tables.units)
        for kind in kinds:
            assert kind & 0xF or kind >> 4
            halves.update((kind & 0xF, kind >> 4))
    assert {*halves} == {0, *(stimuli.GREEDY | habits << 1 for habits in range(8))}
    assert 1 / 12 < halves[0] / halves.total() < 1 / 6
    assert STEPPED.kinds(tables, stimuli.Draw(1)) == [0] * len(tables.units)
    both = stimuli.GREEDY | stimuli.LENGTHS | stimuli.GAPS
    assert TRAFFIC[1].kinds(tables, stimuli.Draw(1)) == [both | both << 4] * len(tables.units)


def test_drawn_numbers_are_all_those_below_the_limit():
    draw = stimuli.Draw(1, "purpose")
    found = Counter(draw.below(5) for _ in range(500))
    assert {*found} == {*range(5)}
    assert min(found.values()) > 60
    assert [stimuli.Draw(1, "a").below(2**60)] != [stimuli.Draw(1, "b").below(2**60)]


@pytest.mark.parametrize("seed", range(4))
def test_many_runs_expect_what_follows_from_their_scripts(tables, seed):
    """Late requests, and parts of words that change nothing, are drawn in few of the runs."""
    for number in range(10 * seed, 10 * seed + 10):
        run = plan(tables, TRAFFIC[0], number, windows=120)
        assert follow(tables, run) == [(e.table, e.window) for e in run.expected]
        strobes = {address >> 26 for _, order, address, _ in run.script if order == "l"}
        assert len(strobes) == 2
        assert max(strobes) == stimuli.WHOLE
        assert min(strobes) > 0


@pytest.mark.parametrize(("entries", "size"), [(1, 1024), (1023, 1024), (1024, 2048), (2047, 2048), (2048, 4096)])
def test_a_unit_has_room_for_its_entries_and_the_terminator(entries, size):
    table = SimpleNamespace(entries={"u1": range(entries - 1), "u2": ()})
    rest = SimpleNamespace(entries={"u1": range(1), "u2": ()})
    units = [SimpleNamespace(name=name) for name in ("u1", "u2")]
    assert stimuli.sizes(SimpleNamespace(tables=[table, rest], units=units)) == (size, 16)


def test_habits_of_managers_are_the_bits_of_the_bench():
    """``kind`` of ``bench/traffic.v``: on, random lengths, random gaps, clusters."""
    bench = Path(halpipe.__file__).with_name("deploy").joinpath("regulator", "bench", "traffic.v").read_text()
    stated = re.search(r"kind, +// bit 0 on, bit 1 random lengths, bit 2 random gaps, bit 3 comes in clusters", bench)
    assert stated
    assert (stimuli.GREEDY, stimuli.LENGTHS, stimuli.GAPS, stimuli.CLUSTERS) == (1 << 0, 1 << 1, 1 << 2, 1 << 3)


def test_the_defaults_are_written_before_the_first_window_that_counts(tmp_path):
    files = bundles.export(tmp_path, *bundles.wide_system(32), window="2048", units=32)
    tables = read_tables(bundles.target(files).bundle)
    run = plan(tables, TRAFFIC[0], 1, windows=4)
    defaults = {
        stimuli.unit_address(unit, at) for unit in range(32) for at in (stimuli.UNIT_DEF_READ, stimuli.UNIT_DEF_WRITE)
    }
    written = [cycle for cycle, order, address, _ in run.script if order == "w" and address in defaults]
    assert len(written) == 2 * 32
    assert max(written) < stimuli.first_window(32)


def alone(folder, *, windows=0):
    """Tables of two modes without a switch; with `windows`, of so many windows each, which have one budget."""
    files = bundles.changed(
        bundles.export(folder, *bundles.system()), lambda data: (data["switches"].clear(), data["tables"].pop())
    )
    tables = read_tables(bundles.target(files).bundle)
    if not windows:
        return tables
    short = (
        replace(table, windows=windows, entries={unit: several[:1] for unit, several in table.entries.items()})
        for table in tables.tables
    )
    return replace(tables, tables=tuple(short))


@pytest.mark.parametrize("windows", [1, 2])
@pytest.mark.parametrize("traffic", [STEPPED, TRAFFIC[0]], ids=lambda traffic: traffic.name)
def test_modes_are_stopped_and_started_in_any_cycle_of_a_window(tmp_path, traffic, windows):
    tables = alone(tmp_path, windows=windows)
    for seed in range(25):
        run = plan(tables, traffic, seed, windows=60)
        assert follow(tables, run) == [(e.table, e.window) for e in run.expected]


@pytest.mark.parametrize("windows", [1, 2, 3])
def test_requests_in_the_shortest_tables_count_for_their_end(tables, windows):
    """A table of one window of four cycles has no time for others than those that come just in time."""
    short = (
        replace(table, windows=windows, entries={unit: several[:1] for unit, several in table.entries.items()})
        for table in tables.tables
    )
    shortest = replace(tables, tables=tuple(short))
    for seed in range(40):
        run = plan(shortest, STEPPED, seed, windows=60)
        assert follow(shortest, run) == [(e.table, e.window) for e in run.expected]


@pytest.mark.parametrize(("repeats", "plays"), [(1, 2), (2, 2), (3, 3)])
def test_the_end_of_a_mode_that_leads_nowhere_is_followed_by_its_begin(tmp_path, repeats, plays):
    run = plan(alone(tmp_path), TRAFFIC[0], 1, windows=2**31, repeats=repeats)
    begins = Counter(e.table for e in run.expected if e.running and e.window == 0)
    assert begins[0] == plays + 2  # once when it is stopped, and once after a request of a table that there is not
    assert begins[1] in (plays + 1, plays + 2)  # with that request, which may come too late


def test_with_tables_only_a_run_ends_when_every_table_was_played(tables):
    for seed in range(8):
        assert plan(tables, STEPPED, seed, windows=2**31).switches == 2


def test_where_all_headers_are_taken_nothing_is_written_behind_them(tables):
    """The entries begin there."""
    modes = (replace(tables.tables[0], index=n, successor=n, mode=f"m{n}") for n in range(255))
    full = replace(tables, tables=tuple(modes), switches=())
    run = plan(full, TRAFFIC[0], 1, windows=4)
    _, memory, _ = registers(full, run)
    entries, headers = stimuli.sizes(full)
    assert headers == stimuli.MOST_TABLES
    assert {offset for _, offset in memory} == {stimuli.UNIT_ENTRIES + 16 * entries + at for at in (0, 4, 8)}
