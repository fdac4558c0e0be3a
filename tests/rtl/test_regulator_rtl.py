"""The regulator in Verilog, simulated: right tables pass every traffic, faults in tables or in the Verilog are caught.

Icarus Verilog is enough for the fast tests. Without a simulator they are skipped; `apt-get install iverilog verilator`.
"""

import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import replace
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path

import pytest

import halpipe
import regulator_bundles as bundles
import regulator_mutants as mutants
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.regulator import DEPLOYMENT, codes, stimuli
from halpipe.deploy.regulator.reading import read_tables
from halpipe.deploy.regulator.simulate import (
    CYCLES,
    STEPPED_CYCLES,
    Icarus,
    Verilator,
    design_of,
    judge,
    play,
    simulate,
)
from halpipe.deploy.regulator.stimuli import STEPPED, TRAFFIC, Traffic, plan, unit_address
from one_fault import with_fault
from profiles import in_turn, volume
from regulator_proof import PARTS, missing, prove

RTL = Path(halpipe.__file__).parent / "exporters" / "regulator" / "table" / "rtl"
BENCH = Path(halpipe.__file__).parent / "deploy" / "regulator" / "bench"

icarus = pytest.mark.skipif(not all(map(shutil.which, Icarus.tools)), reason="icarus is not installed")
verilator = pytest.mark.skipif(not all(map(shutil.which, Verilator.tools)), reason="verilator is not installed")
yosys = pytest.mark.skipif(shutil.which("yosys") is None, reason="yosys is not installed")


def sometimes_slow(items, fast):
    """The first `fast` of them in the fast tier, all of them in `make test`."""
    return [item if n < fast else pytest.param(item, marks=pytest.mark.slow) for n, item in enumerate(items)]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return bundles.export(tmp_path_factory.mktemp("bundle"), *bundles.system("100ns"))


@pytest.fixture(scope="module")
def tables(files):
    return read_tables(bundles.target(files).bundle)


@pytest.fixture(scope="module")
def player(files, tables, tmp_path_factory):
    return Icarus().build(design_of(bundles.target(files).bundle, tables), str(tmp_path_factory.mktemp("built")))


def verdict(files, tables, player, run):
    bundle = bundles.target(files).bundle
    return judge(tables, run, play(bundle, tables, player, run), bundle.at("table"))


def found(files, tables, player, traffic, *, seed=1, windows=230):
    run = plan(tables, traffic, seed, windows=windows)
    return {finding.code for finding in verdict(files, tables, player, run).findings}


# ------------------------------------------------------------------------------------------------ what is right passes


@icarus
@pytest.mark.parametrize("traffic", sometimes_slow(TRAFFIC, 1), ids=lambda traffic: traffic.name)
@pytest.mark.parametrize("seed", sometimes_slow([1, 2], 1))
def test_no_traffic_gets_more_than_its_budget(files, tables, player, traffic, seed):
    run = plan(tables, traffic, seed, windows=230)
    result = verdict(files, tables, player, run)
    assert result.findings == []
    assert result.windows == len(run.expected) > 150
    assert result.run.switches >= 1


@pytest.mark.slow
@icarus
def test_greedy_masters_get_exactly_what_is_promised(files, tables, player):
    run = plan(tables, TRAFFIC[0], 3, windows=230)
    result = verdict(files, tables, player, run)
    assert result.used == result.granted


@icarus
@pytest.mark.slow
def test_bursts_are_carried_over_where_the_memory_hesitates(files, tables, player):
    """Otherwise the rule for them would not be tested."""
    assert verdict(files, tables, player, plan(tables, TRAFFIC[2], 1, windows=230)).carried > 0


@icarus
@pytest.mark.parametrize("clock", sometimes_slow(["102999000Hz", "109999999Hz", "104999001Hz"], 1))
def test_windows_of_a_clock_that_does_not_divide_them_keep_to_the_schedule(tmp_path, clock):
    """Tables are switched at the cycles at which exact windows of 640 ns end, rounded down: nothing drifts."""
    odd = bundles.export(tmp_path, *bundles.system("100ns"), window="640ns", clock=clock, capacity="820MB/s")
    tables = read_tables(bundles.target(odd).bundle)
    assert tables.platform.window_ns == 640
    assert tables.platform.window_extra > 0
    built = Icarus().build(design_of(bundles.target(odd).bundle, tables), str(tmp_path))
    for traffic in (TRAFFIC[0], TRAFFIC[2]):
        run = plan(tables, traffic, 2, windows=230)
        result = verdict(odd, tables, built, run)
        assert result.findings == []
        assert result.windows > 150
    name = "table/rtl/halpipe_regulator.v"
    slow = {**odd, name: with_fault(odd[name].decode(), "{31'd0, ~stretch}", "32'd1").encode()}
    drifting = Icarus().build(design_of(bundles.target(slow).bundle, tables), str(tmp_path))
    assert codes.PLAYED_WRONG.id in {f.code for f in verdict(slow, tables, drifting, run).findings}


# ------------------------------------------------------------------------------------------------ faulty tables


@icarus
@pytest.mark.parametrize("fault", sometimes_slow(bundles.FAULTS, 1))
def test_hardware_that_plays_other_tables_is_caught(files, tables, player, fault):
    """The memory images have the fault, tables.json has not: what is played is not what was promised."""
    faulty = {**files, **bundles.forms_of(bundles.changed(files, bundles.FAULTS[fault]))}
    caught = found(faulty, tables, player, TRAFFIC[0], windows=300)
    expected = codes.PLAYED_WRONG if fault == "another successor" else codes.SPENT_TOO_MUCH
    less_only = {"one burst less", "entry dropped"}
    assert caught & {(codes.GOT_TOO_LITTLE if fault in less_only else expected).id, expected.id}


@icarus
@pytest.mark.slow
@pytest.mark.parametrize("fault", ["one burst more", "a window late", "two units swapped"])
def test_excess_is_caught_without_greedy_masters(files, tables, player, fault):
    faulty = {**files, **bundles.forms_of(bundles.changed(files, bundles.FAULTS[fault]))}
    random = Traffic(name="random gaps", flags=stimuli.GAPS)
    assert codes.SPENT_TOO_MUCH.id in found(faulty, tables, player, random)


# ------------------------------------------------------------------------------------------------ faulty Verilog

PLAYER = "table/rtl/halpipe_regulator_player.v"


@icarus
@pytest.mark.parametrize("mutant", sometimes_slow(in_turn([m for m in mutants.MUTANTS if m not in mutants.UNSEEN]), 1))
def test_each_fault_of_the_verilog_is_caught(files, mutant):
    """By the runs that a check does, and requests at further instants."""
    caught = mutants.simulated(mutants.mutated(files, mutant), Icarus())
    assert caught
    assert codes.ENGINE_FAILED.id not in caught


# ------------------------------------------------------------------------------------------------ registers


def reading(tables, orders, windows=3):
    """A run of orders of our own; returns it with nothing expected of registers."""
    calm = plan(tables, Traffic(name="calm", flags=stimuli.GAPS), 1, windows=windows)
    facts = {name: getattr(calm, name) for name in calm.__slots__}
    return type(calm)(**{**facts, "script": tuple(sorted(orders)), "reads": ()})


@icarus
def test_the_registers_are_those_of_the_manual(files, tables, player):
    """Identity, defaults, status with a pending request, window, credit left; and tables are closed while they play."""
    cycles = tables.platform.window_cycles
    first = stimuli.first_window(3) + cycles  # of the first table, after a window without budgets
    one = unit_address(1, 0)
    orders = [
        (0, "w", stimuli.FRAME_CYCLES, cycles),
        (1, "w", one + 0x014, 128),
        (2, "w", one + 0x018, 64),
        (3, "r", one + 0x000, 0),
        (4, "r", one + 0x004, 0),
        (5, "r", one + 0x014, 0),
        (6, "r", one + 0x018, 0),
        (7, "r", stimuli.FRAME_CYCLES, 0),
        (8, "r", 0x004, 0),
        (9, "w", one + 0x008, 1),
        (10, "r", one + 0x008, 0),
        (11, "r", one + 0x00C, 0),
        (12, "r", one + 0x010, 0),
        (first, "r", one + 0x00C, 0),
        (first + 1, "r", one + 0x010, 0),
        (first + 2, "w", one + 0x01C, 2),
        (first + 3, "r", one + 0x00C, 0),
        (first + 4, "w", unit_address(1, 0x1000), 999),
        (first + 5, "w", unit_address(1, 0x1008), 1),
        (first + 6, "w", one + 0x01C, 200),
        (first + 7, "r", one + 0x00C, 0),
        (first + cycles + 1, "r", one + 0x010, 0),
        (first + cycles + 2, "r", 0x010, 0),
    ]
    run = reading(tables, orders, windows=4)
    bundle = bundles.target(files).bundle
    trace = play(bundle, tables, player, run).decode()
    values = [int(line.split()[3]) for line in trace.splitlines() if line.startswith("R")]
    running, pending = 1 << 8, 1 << 9 | 2 << 16
    assert values == [
        0x48425754,
        4 << 24 | 16 << 16 | 1024,
        128,
        64,
        cycles,
        4 << 24 | 1 << 20 | 1 << 16 | 3 << 8 | 3,
        1,
        0,
        2**32 - 1,
        running,
        0,
        running | pending,
        running | pending,  # there is no table 200 in this unit
        1,
        3,
    ]


@icarus
def test_a_request_for_a_table_that_was_never_written_falls_back_to_the_defaults(files, tables, player):
    first, cycles = stimuli.first_window(3), tables.platform.window_cycles
    setup = [(0, "w", stimuli.FRAME_CYCLES, cycles), (1, "w", stimuli.FRAME_GO, 1)]
    ask = (first + cycles + 5, "w", stimuli.FRAME_REQUEST, 9)
    ends = first + 41 * cycles
    looks = [(ends + n * cycles + 3, "r", unit_address(0, 0x010), 0) for n in (-1, 0, 1, 2, 3)]
    trace = play(
        bundles.target(files).bundle, tables, player, reading(tables, [*setup, ask, *looks], windows=46)
    ).decode()
    windows = [int(line.split()[3]) for line in trace.splitlines() if line.startswith("R")]
    assert windows == [39, 2**32 - 1, 2**32 - 1, 0, 1]  # the defaults, then none, then table 0


# ------------------------------------------------------------------------------------------------ the tools agree


@icarus
@verilator
@pytest.mark.slow
@pytest.mark.parametrize("traffic", TRAFFIC, ids=lambda traffic: traffic.name)
def test_both_simulators_give_the_same_trace(files, tables, player, traffic, tmp_path):
    bundle = bundles.target(files).bundle
    native = Verilator().build(design_of(bundle, tables), str(tmp_path))
    run = plan(tables, traffic, 1, windows=150)
    assert play(bundle, tables, native, run) == play(bundle, tables, player, run)


@verilator
@pytest.mark.slow
@pytest.mark.parametrize("units", [1, 12])
def test_any_number_of_units(tmp_path, units):
    """Names of images with two digits, and a memory with more queues than a machine word has bits for."""
    m, s = bundles.wide_system(units)
    files = bundles.export(tmp_path, m, s, units=units, window=str(64 * units))
    checked = DEPLOYMENT.check(bundles.target(files), CheckOptions(engine="verilator", cycles=2))
    assert checked.diagnostics == ()
    assert any("greedy " in line and "100 %" in line for line in checked.lines)


@icarus
@pytest.mark.slow
def test_the_check_reports_every_run(files):
    checked = DEPLOYMENT.check(bundles.target(files), CheckOptions(engine="icarus", seed=5))
    assert checked.diagnostics == ()
    assert checked.lines[1] == "simulation: engine icarus, seed 5"
    assert [line.strip().split("  ")[0] for line in checked.lines[3:]] == [
        traffic.name for traffic in (STEPPED, *TRAFFIC)
    ]
    assert all(line.endswith(" 0") for line in checked.lines[3:])


@icarus
def test_what_is_played_is_the_verilog_of_the_bundle(files):
    broken = {**files, PLAYER: files[PLAYER].replace(b"endmodule", b"")}
    with pytest.raises(halpipe.core.diagnostics.HalpipeError) as refused:
        list(
            simulate(
                bundles.target(broken).bundle, read_tables(bundles.target(broken).bundle), Icarus(), seed=1, cycles=0
            )
        )
    assert refused.value.diagnostics[0].code == codes.ENGINE_FAILED.id
    assert "iverilog" in refused.value.diagnostics[0].message


@verilator
@pytest.mark.parametrize("name", sorted(path.name for path in RTL.glob("*.v")))
def test_the_regulator_is_clean_for_the_strictest_linter(name):
    done = subprocess.run(
        ["verilator", "--lint-only", "-Wall", name], cwd=RTL, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


@verilator
def test_the_bench_is_clean_for_the_strictest_linter():
    command = ["verilator", "--lint-only", "-Wall", "-y", str(RTL), "bench.v"]
    done = subprocess.run(command, cwd=BENCH, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@yosys
@pytest.mark.slow
def test_the_tables_are_synthesized_to_block_ram():
    """The tables of 1024 entries of 96 bits take block RAM and no registers; the unit stays small."""
    sources = " ".join(str(RTL / f"halpipe_regulator{part}.v") for part in ("_gate", "_player", "_unit"))
    with tempfile.TemporaryDirectory() as folder:
        synthesis = "synth_xilinx -family xcup -top halpipe_regulator_unit -flatten; tee -o stat.txt stat"
        script = f"read_verilog {sources}; {synthesis}"
        subprocess.run(["yosys", "-q", "-p", script], cwd=folder, check=True, capture_output=True)
        cells = dict(re.findall(r"^ +(\w+) +(\d+)$", Path(folder, "stat.txt").read_text(), re.MULTILINE))
    memories = sum(int(count) for cell, count in cells.items() if cell.startswith("RAMB"))
    registers = sum(int(count) for cell, count in cells.items() if cell.startswith("FD"))
    lookups = sum(int(count) for cell, count in cells.items() if re.fullmatch(r"LUT\d", cell))
    assert 1 <= memories <= 4
    assert registers < 600
    assert lookups < 1500


@icarus
def test_every_table_is_stepped_through_to_its_end(files, tables, player):
    run = plan(tables, STEPPED, 1, windows=2**31)
    result = verdict(files, tables, player, run)
    assert result.findings == []
    ended = {e.table for e in run.expected if e.window + 1 == tables.tables[e.table].windows}
    assert ended == {table.index for table in tables.tables}
    faulty = {**files, **bundles.forms_of(bundles.changed(files, bundles.FAULTS["one burst less"]))}
    assert codes.GOT_TOO_LITTLE.id in {f.code for f in verdict(faulty, tables, player, run).findings}


@icarus
@pytest.mark.parametrize("cycles", sometimes_slow([800, 12_000], 1))
def test_tables_that_were_not_played_to_their_end_are_named(files, monkeypatch, cycles):
    monkeypatch.setitem(CYCLES, "icarus", (3 * cycles, 300))
    monkeypatch.setitem(STEPPED_CYCLES, "icarus", cycles // 8)
    checked = DEPLOYMENT.check(bundles.target(files), CheckOptions(engine="icarus"))
    told = [line for line in checked.lines if "not played to the end" in line]
    assert told == (
        [] if cycles > 800 else ['  not played to the end: "full", "lean", "full->lean"; --cycles 1 plays all']
    )


@icarus
def test_the_registers_are_reached_through_axi4_lite(tmp_path):
    """Words are written and read once, whatever comes first; part of a word is refused and changes nothing."""
    assert said_by("axil_bench", tmp_path) == [
        "read 0000000 48425746",
        "write 0200014 0",
        "read 0200014 00000400",
        "read 0100014 00000000",
        "write 0100018 0",
        "write 0100018 2",
        "read 0100018 00000123",
    ]


# ------------------------------------------------------------------------------------------------ proof

formal = pytest.mark.skipif(bool(missing()), reason=f"not installed: {missing()}")


@formal
@pytest.mark.slow
@pytest.mark.endurance  # three minutes; the test below proves every part, with a fault in it
def test_the_regulator_is_proven_for_all_traffic(files):
    bundle = bundles.target(files).bundle
    proofs = list(prove(bundle, read_tables(bundle)))
    assert [proof.part for proof in proofs] == [*(part.name for part in PARTS), *(f"image of u{n}" for n in (1, 2, 3))]
    assert all(proof.properties and not proof.findings for proof in proofs)


def for_the_proof():
    """The first fault of each part; in `make endurance` two, and all of those that no simulation shows."""
    tried = Counter()
    unseen = mutants.UNSEEN if volume(1) > 1 else ()
    for mutant, (part, *_) in mutants.MUTANTS.items():
        tried[part] += 1
        if part in ("ports", "store"):  # a second or two each
            yield mutant
        elif tried[part] <= min(volume(1), 2) or mutant in unseen:
            yield pytest.param(mutant, marks=pytest.mark.slow)


@pytest.mark.slow
@formal
@pytest.mark.parametrize("mutant", [*for_the_proof()])
def test_faults_of_the_verilog_are_refuted(files, mutant):
    """By the proof of the part that has it, whether a simulation shows it or not."""
    assert mutants.refuted(mutants.mutated(files, mutant), mutants.MUTANTS[mutant][0])


@formal
@pytest.mark.parametrize(
    "fault",
    sometimes_slow(
        [
            (".all_req_valid(req_valid)", ".all_req_valid(req_valid & (i != 2))", "together"),
            (".s_wlast(s_wlast[i])", ".s_wlast(s_wlast[i % 2])", "ports_in"),
            ("data[chosen]", "data[chosen % 3]", "answers"),
        ],
        1,
    ),
)
def test_faults_of_the_last_unit_are_refuted(files, fault):
    """The block is proven with as many units as the bundle has, not with two for all."""
    old, new, broken = fault
    name = "table/rtl/halpipe_regulator.v"
    found = mutants.refuted({**files, name: with_fault(files[name].decode(), old, new).encode()}, "frame")
    assert f'"{broken}"' in " ".join(found)


@formal
@pytest.mark.slow
@pytest.mark.parametrize(("file", "number"), [*in_turn([("hdr", 1), ("tab", 1), ("tab", 6)])])
def test_images_that_are_not_the_tables_are_refuted(files, file, number):
    """In a word of u1's images one digit is another: the solver tells, without anything that reads them as text."""
    name = f"table/unit0.{file}.memh"
    lines = files[name].decode().splitlines()
    lines[number] = f"{int(lines[number], 16) ^ 0x40:0{len(lines[number])}x}"
    found = mutants.refuted({**files, name: "\n".join([*lines, ""]).encode()}, "image")
    assert found
    assert all(finding.startswith("image of u1: property") for finding in found)


@yosys
@pytest.mark.slow
def test_the_unit_fits_a_device_without_distributed_memory():
    """iCE40: block RAM only; no memory style may be insisted on."""
    sources = " ".join(str(RTL / f"halpipe_regulator{part}.v") for part in ("_gate", "_player", "_unit"))
    with tempfile.TemporaryDirectory() as folder:
        size = "chparam -set DEPTH 256 -set TABLES 8 halpipe_regulator_unit"
        script = f"read_verilog {sources}; {size}; synth_ice40 -top halpipe_regulator_unit; tee -o stat.txt stat"
        subprocess.run(["yosys", "-q", "-p", script], cwd=folder, check=True, capture_output=True)
        text = Path(folder, "stat.txt").read_text()
    assert re.search(r"SB_RAM40_4K +6\b", text)


def said_by(bench, folder, *parameters, seed=1):
    """Lines that a bench of its own prints."""
    sources = [str(path) for path in (Path(__file__).parent / f"{bench}.v", *sorted(RTL.glob("*.v")))]
    built = folder / f"{bench}.vvp"
    subprocess.run(["iverilog", "-g2005-sv", "-s", bench, *parameters, "-o", str(built), *sources], check=True)
    said = subprocess.run(
        ["vvp", "-n", str(built), f"+seed={seed}"], check=True, capture_output=True, text=True, timeout=300
    ).stdout
    return [line for line in said.splitlines() if "finish" not in line]


@icarus
def test_a_burst_longer_than_stated_never_passes_and_is_shown(tmp_path):
    """Without LONGEST it could pass in one table and wait for ever in another."""
    assert said_by("long_bench", tmp_path) == [
        "1 reads, 0 writes, status 00000000",
        "1 reads, 0 writes, status 00000400",
        "1 reads, 0 writes, status 00000000",
        "1 reads, 0 writes, status 00000800",
        "1 reads, 1 writes, status 00000800",
    ]


@icarus
def test_blocks_with_one_time_base_start_in_one_cycle(tmp_path):
    """Both were armed for 0x100000100 and had windows of unlike phase; the first table begins a window of 50 later."""
    instants = ((0, 51), (1, 102), (2, 152), (0, 203))
    assert said_by("start_bench", tmp_path) == [
        "armed 2 2",
        *(f"{block}: window {window} at {at}" for window, at in instants for block in ("one", "two")),
    ]


@icarus
def test_blocks_of_unlike_clocks_keep_to_one_time_base(tmp_path):
    """Windows of 8 us by three clocks, also of a table after another: off by less than a tick and two cycles."""
    begun = {}
    for block, window, instant in (map(int, line.split()) for line in said_by("clocks_bench", tmp_path)):
        begun.setdefault(block, []).append((window, instant))
    periods = (4000, 4001, 30003)
    for block, several in sorted(begun.items()):
        assert [window for window, _ in several] == [*range(12), *range(5), 0, 1]  # of a table, and of its successor
        late = [instant - (5 + 8 + 8 * n) * 10**6 for n, (_, instant) in enumerate(several)]
        assert min(late) > -periods[block]  # ends of windows are rounded down to cycles
        assert max(late) < 10_000 + 2 * periods[block]
    assert sorted(begun) == [0, 1, 2]


@icarus
def test_windows_of_any_clock_slip_by_less_than_a_cycle_in_a_day(tmp_path):
    """From the figures that are loaded, for the windows of a day, and on the Verilog where their number wraps.

    The end of window n is that of the exact one, rounded down: the step from one to the next is what the proof of the
    frame shows, and what is left of a cycle after n windows is known.
    """
    said_by("drift_bench", tmp_path)  # builds it; without figures nothing is said
    draw = random.Random(39)
    for clock in (249_997_498, *(draw.randrange(103 * 10**6, 2**32) for _ in range(10))):
        shape = {"window": "640ns", "clock": f"{clock}Hz", "capacity": "820MB/s"}
        header = bundles.export(tmp_path, *bundles.system("100ns"), **shape)["table/bw_tables.h"].decode()
        cycles, extra, of = (
            int(re.search(rf"BW_WINDOW_{name} (\d+)u", header)[1]) for name in ("CYCLES", "EXTRA", "OF")
        )
        exact = Fraction(64 * clock, 10**8)

        def end(n, cycles=cycles, extra=extra, of=of):
            return n * cycles + n * extra // of

        for n in (1, 2**32 - 1, 2**32, 24 * 3600 * 10**8 // 64):
            assert 0 <= n * exact - end(n) < 1
        before = 2**32 - 3
        given = {"cycles": cycles, "extra": extra, "of": of, "rest": before * extra % of, "number": before, "count": 8}
        said = subprocess.run(
            ["vvp", "-n", tmp_path / "drift_bench.vvp", *(f"+{name}={value}" for name, value in given.items())],
            check=True, capture_output=True, text=True, timeout=300,
        ).stdout  # fmt: skip
        assert [line.split() for line in said.splitlines() if "finish" not in line] == [
            [str(end(before + n) - end(before)), str((before + n) % 2**32)] for n in range(9)
        ]


@icarus
@pytest.mark.parametrize(
    ("banks", "windows"),
    [(2, "200 300 400 300 400 300 400 300 400 300 400 300"), (1, "200 999 0 100 200 100 200 100 200 100 200 100")],
)
def test_a_schedule_is_replaced_while_another_is_played(tmp_path, banks, windows):
    """With two banks no window has the defaults (999) or nothing; with one, the new tables were not written."""
    assert " ".join(said_by("bank_bench", tmp_path, f"-Pbank_bench.BANKS={banks}")) == windows


@icarus
def test_one_request_switches_two_blocks_in_one_cycle(tmp_path):
    """What the second block cannot follow is refused by the first, and reaches neither."""
    assert said_by("link_bench", tmp_path) == [
        "request 1, refused 1",
        "request 1, refused 0",
        "tables 1 1 1",
        "request 9, refused 1",
        "request 0, refused 0",
        "tables 0 0 0",
    ]


@icarus
def test_two_ports_change_budgets_and_load_a_schedule_at_the_same_time(tmp_path):
    """Port 1 requests all the time, also the table that port 0 writes: that is refused until the lock is given back."""
    assert said_by("ports_bench", tmp_path) == [
        "set up: refused 1 and 1",
        "both: refused 0 and 20, 0 wrong windows",
        "then: 10 windows of the new schedule",
        "lock 00000003, 0 wrong windows",
    ]


@icarus
@pytest.mark.parametrize(("buffer", "writes", "stage"), [(16, 99, 0), (0, 0, 0), (16, 99, 1)])
def test_withheld_data_stalls_its_own_manager_alone(tmp_path, buffer, writes, stage):
    """Behind AXI4, with a write buffer; without one the memory waits for the data. IDs, strobes and order stay."""
    assert said_by("axi4_bench", tmp_path, f"-Paxi4_bench.BUFFER={buffer}", f"-Paxi4_bench.STAGE={stage}") == [
        "reads 1, too long 0, status 00000400",
        f"withheld: {writes} writes of the other",
        "then: 1 of its own, 0 wrong",
    ]


@icarus
@pytest.mark.parametrize("build", sometimes_slow([(16, 0, 1), (16, 1, 2), (0, 0, 3), (16, 0, 4)], 1))
def test_bursts_of_all_sizes_pass_whole_or_are_refused(tmp_path, build):
    """Eight managers; of eight, one that always reads gets its 7040 of 8000 B in each window, less nothing.

    Without a write buffer, withheld data stalls the memory and the reader with it.
    """
    buffer, stage, seed = build
    said = said_by("beats_bench", tmp_path, f"-Pbeats_bench.BUFFER={buffer}", f"-Pbeats_bench.STAGE={stage}", seed=seed)
    assert said[:3] == [
        "refused: some reads 1, some writes 1, long ones at the memory 0",
        "passed: some reads 1, some writes 1",
        "wrong 0 and 0, unanswered 0",
    ]
    assert (said[3] == "victim: at most 0 B of 7040 B missed in a window, late by 0 B") == (buffer > 0)
    assert said[4] == f"stalled {int(buffer == 0)}"


@icarus
@pytest.mark.slow
@pytest.mark.skipif(not (find_spec("cocotb") and find_spec("cocotbext")), reason="pip install cocotb cocotbext-axi")
def test_cocotbext_axi_is_answered_as_it_expects(tmp_path):
    """The AXI4 manager and memory of cocotbext-axi, with pauses, and bursts above LONGEST: `regulator_cocotb.py`."""
    sources, top = [str(path) for path in sorted(RTL.glob("*.v"))], "halpipe_regulator_axi4"
    runner = (
        "from cocotb_tools.runner import get_runner; r = get_runner('icarus'); "
        f"r.build(sources={sources!r}, hdl_toplevel={top!r}, build_dir='built', build_args=['-g2005-sv'], "
        "parameters={'UNITS': 1, 'DEPTH': 4, 'TABLES': 2, 'CYCLES': 1000, 'ADDR': 16}); "
        f"r.test(hdl_toplevel={top!r}, test_module='regulator_cocotb', build_dir='built', results_xml='results.xml')"
    )
    paths = {"PYTHONPATH": str(Path(__file__).parent), "PATH": f"{Path(sys.executable).parent}:/usr/bin:/bin"}
    subprocess.run([sys.executable, "-c", runner], cwd=tmp_path, env=paths, check=True, timeout=300)
    (results,) = tmp_path.rglob("results.xml")
    assert "<failure" not in results.read_text()


@icarus
@pytest.mark.parametrize("traffic", sometimes_slow([TRAFFIC[1], TRAFFIC[2], TRAFFIC[4]], 1), ids=lambda t: t.name)
def test_a_victim_among_eight_gets_its_promise(tmp_path, traffic):
    """The memory is promised to its last beat; a reader that always asks misses a burst of its budget at most.

    That is so for the addresses taken in each window, and for the beats served up to a window later. The others ask as
    they like; a narrow, FIXED or WRAP beat of theirs is a beat here, as it is for the memory.
    """
    files = bundles.export(tmp_path, *bundles.wide_system(8), units=8, window="512")
    tables = read_tables(bundles.target(files).bundle)
    built = Icarus().build(design_of(bundles.target(files).bundle, tables), str(tmp_path))
    run = plan(tables, traffic, 5, windows=40)
    victim = tables.units[1]
    run = replace(run, kinds=(run.kinds[0], stimuli.GREEDY, *run.kinds[2:]))
    trace = play(bundles.target(files).bundle, tables, built, run).decode()
    windows = [[int(n) for n in line.split()[2:]] for line in trace.splitlines() if line.startswith("W")]
    granted = tables.tables[0].budgets(victim.name, "read")
    promised = served = before = 0
    for expected, fields in zip(run.expected, windows, strict=True):
        _, _, taken, *_, beats = fields[13 * victim.index : 13 * victim.index + 9]
        budget = granted[expected.window] if expected.running else 0
        assert taken >= budget - 64
        served += beats * 8
        assert served >= before - 64
        before = promised = promised + budget
    assert promised > 10 * 64 * 8
