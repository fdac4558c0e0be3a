"""The DMA engine in Verilog: every byte arrives, registers and times are those of the co-simulation's model.

`cocotbext-axi` is a second memory and a second manager for the registers, where it is installed.
"""

import random
import shutil
import subprocess
import sys
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

import pytest

from halpipe.deploy.riscv.board.bus import Bus
from halpipe.deploy.riscv.board.devices import CONFIG, DONE, ERROR, Channel, Transfer
from halpipe.exporters import regulator
from one_fault import with_fault

TABLE = Path(regulator.__file__).parent / "table"
SOURCES = ("halpipe_dma.v", "halpipe_dma_channel.v")
BENCH = Path(__file__).parent / "dma_bench.v"
SPACE, WHOLE, BEAT = 1 << 14, 0x66000000, 8
LATENCY, SETUP = 20, 33
"""Cycles of the memory before its first beat; from RUN to the last answer, beside the beats: 13 more."""

pytestmark = pytest.mark.skipif(not shutil.which("iverilog"), reason="apt-get install iverilog")


def build(folder, texts=None, **parameters):
    texts = texts or {name: (TABLE / "dma" / name).read_text() for name in SOURCES}
    for name, text in texts.items():
        (folder / name).write_text(text)
    chosen = [f"-Pdma_bench.{name}={value}" for name, value in parameters.items()]
    gate = str(TABLE / "rtl/halpipe_regulator_gate.v")
    command = ["iverilog", "-g2005-sv", "-s", "dma_bench", *chosen, "-o", "bench", str(BENCH), *SOURCES, gate]
    subprocess.run(command, cwd=folder, check=True)
    return folder


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    return build(tmp_path_factory.mktemp("dma"))


def play(folder, jobs, before, **settings):
    """Do register accesses; return the memory after it, and the trace."""
    (folder / "before.memh").write_text("\n".join(f"{byte:02x}" for byte in before))
    (folder / "jobs.txt").write_text("".join(f"{kind} {when} {at:x} {value:x}\n" for kind, when, at, value in jobs))
    chosen = [f"+{name}={value}" for name, value in settings.items()]
    subprocess.run(["vvp", "-n", "bench", *chosen], cwd=folder, check=True, stdout=subprocess.DEVNULL, timeout=300)
    lines = (folder / "after.memh").read_text().splitlines()
    after = bytes(int(word, 16) for line in lines if not line.startswith("//") for word in line.split())
    return after, [line.split() for line in (folder / "trace.txt").read_text().splitlines()]


def transfer(channel, source, target, size, config=WHOLE):
    """What the runtime writes: the claim, the description, and last the order to run."""
    base = channel << 12
    words = (
        (0x00, 1),
        (0x00, config << 32 | 1),
        (0x08, size),
        (0x10, target),
        (0x18, source),
        (0x00, config << 32 | 3),
    )
    return [("w", 0, base | offset, value) for offset, value in words]


def drawn(rng, *, config=None):
    """Transfers of four channels, anywhere in quarters of the memory."""
    found = []
    for channel in range(4):
        size = rng.choice([0, 1, 7, 8, 9, 63, 64, 65, rng.randrange(700)])
        source = channel * 0x1000 + rng.randrange(0x400)
        target = channel * 0x1000 + 0x800 + rng.randrange(0x400)
        limits = rng.choice([WHOLE, 0x33000000, 0x45000000, 0, 0xFF000000]) if config is None else config
        found.append((channel, source, target, size, limits))
    return found


def copied(before, transfers):
    after = bytearray(before)
    for _, source, target, size, _ in transfers:
        after[target : target + size] = before[source : source + size]
    return bytes(after)


def faults(folder, seeds):
    """What goes wrong in random transfers on random memories."""
    for seed in seeds:
        rng = random.Random(seed)
        before, transfers = rng.randbytes(SPACE), drawn(rng)
        jobs = [job for one in transfers for job in transfer(*one)]
        settings = {"latency": rng.choice([1, 3, 20, 60]), "stall": rng.choice([0, 4, 12]), "seed": seed + 1}
        after, trace = play(folder, jobs, before, **settings)
        if after != copied(before, transfers):
            yield "bytes"
        if sorted(line for line in trace if line[0] in "DX") and {tuple(t[2:3]) for t in trace if t[0] in "DX"} != {
            (str(1 | DONE),)
        }:
            yield "ends"
        if sum(line[0] == "D" for line in trace) != 4:
            yield "never ends"


def test_every_byte_of_any_transfer_arrives_and_no_other_changes(bench):
    assert list(faults(bench, range(5))) == []


@pytest.mark.slow  # the test above, on more transfers
def test_every_byte_of_many_transfers_arrives(bench):
    assert list(faults(bench, range(100, 140))) == []


@pytest.mark.parametrize("parameters", [{"SIZE": 1, "BURST": 3, "DEPTH": 3}, {"SIZE": 4, "CHANNELS": 7}])
def test_other_widths_and_numbers_of_channels(tmp_path, parameters):
    assert list(faults(build(tmp_path, **parameters), range(2))) == []


# ------------------------------------------------------------------------------------------------ the model


def run_of(trace, channel):
    """The cycle in which a channel is started, and that of its last answer."""
    runs = [int(t[3]) for t in trace if t[0] == "L" and t[1] == str(channel << 12) and int(t[2]) & 3 == 3]
    return runs[-1], max(int(t[3]) for t in trace if t[0] == "B" and t[1] == str(channel))


def modelled(runs, sizes, setup=SETUP, source=0, target=0):
    """When transfers end in the co-simulation that has the bus and the set-up of this engine and memory."""
    bus = Bus(rate=1, capacity=BEAT)
    moved = [Transfer(n, source, target, size, run, run) for n, (run, size) in enumerate(zip(runs, sizes, strict=True))]
    for one in moved:
        bus.take(one, one.begin + setup, BEAT, None)
    return [one.end for one in moved]


@pytest.mark.parametrize("size", [64, 128, 512, 4096])
def test_whole_bursts_end_in_the_cycle_of_the_model(bench, size):
    _, trace = play(bench, transfer(0, 0, 0x2000, size), bytes(SPACE), latency=LATENCY)
    run, end = run_of(trace, 0)
    assert [end] == modelled([run], [size])


def longest_burst(target, size):
    """The beats of the longest burst that is written; the last one is written when all of it was read."""
    edges = [target, *range(target // 64 * 64 + 64, target + size, 64), target + size]
    return max(-(-end // BEAT) - begin // BEAT for begin, end in pairwise(edges))


def test_any_transfer_ends_in_the_cycle_of_the_model(bench):
    """The set-up has the eight beats of a whole burst; one without such a burst has as many less."""
    rng = random.Random(4)
    for number in range(10):
        size, source, target = (
            rng.randrange(1, 90 if number % 2 else 900),
            rng.randrange(64),
            0x2000 + rng.randrange(64),
        )
        _, trace = play(bench, transfer(0, source, target, size), bytes(SPACE), latency=LATENCY)
        run, end = run_of(trace, 0)
        (modelled_end,) = modelled([run], [size], source=source, target=target)
        assert end == modelled_end - (8 - longest_burst(target, size)), (source, target, size)


def together(bench, sizes):
    """Transfers of all channels at once: when each began, and when it ended."""
    jobs = [transfer(n, n * 0x1000, n * 0x1000 + 0x800, size) for n, size in enumerate(sizes)]
    orders = [job for several in jobs for job in several[:-1]] + [several[-1] for several in jobs]
    _, trace = play(bench, orders, bytes(SPACE), latency=LATENCY)
    return zip(*(run_of(trace, n) for n in range(len(sizes))), strict=True)


@pytest.mark.parametrize("channels", [2, 4])
def test_the_last_of_several_channels_ends_in_the_cycle_of_the_model(bench, channels):
    runs, ends = together(bench, [1024] * channels)
    assert max(ends) == max(modelled(runs, [1024] * channels))


@pytest.mark.parametrize("sizes", [(2048, 64, 64, 64), (2048, 1024, 64, 512), (64, 2048, 1536, 2048)])
def test_a_channel_waits_for_no_more_than_the_buffers_of_others(bench, sizes):
    """Reads that others have under way come first, 64 beats of each; then channels take turns."""
    runs, ends = together(bench, sizes)
    expected = modelled(runs, sizes, setup=SETUP + 64 * (len(sizes) - 1))
    assert all(end <= most for end, most in zip(ends, expected, strict=True))


def test_registers_are_those_of_the_model(bench):
    """Any accesses of a channel that does not move: the answers are those of the model."""
    rng = random.Random(7)
    channel, jobs, expected = Channel(2), [], []
    for _ in range(300):
        offset = rng.choice([0x00, 0x00, 0x08, 0x10, 0x18, 0x20])
        if rng.random() < 0.5:
            value = rng.choice([0, 1, 1, 2]) if offset == 0 else rng.getrandbits(64)
            value |= rng.getrandbits(32) << 32 if offset == 0 else 0
            jobs.append(("w", 0, 0x2000 | offset, value))
            claims = offset == 0 and value & 1 and not channel.control & 1
            assert not channel.write(offset, 8 if offset else 4, value if offset else value & 0xFFFFFFFF)
            if offset == 0 and not claims:
                channel.write(CONFIG, 4, value >> 32)
        else:
            jobs.append(("r", 0, 0x2000 | offset, 0))
            config = channel.read(CONFIG, 4) << 32 if offset == 0 else 0
            expected.append(channel.read(offset, 8) | config)
    _, trace = play(bench, jobs, bytes(SPACE), poll=0)
    assert [int(t[2]) for t in trace if t[0] == "V"] == expected


def test_control_cannot_be_written_while_a_transfer_moves(bench):
    """As in the model: the claim is not given up, and nothing starts anew."""
    during = [("w", 0, 0, 0), ("r", 0, 0, 0), ("w", 0, 0, 3), ("r", 0, 0, 0)]
    jobs = [*transfer(0, 0, 0x2000, 2048), *during, ("r", 900, 0, 0), ("w", 0, 0, 0), ("r", 0, 0, 0)]
    _, trace = play(bench, jobs, bytes(SPACE), poll=0)
    assert [int(t[2]) & 0xFFFFFFFF for t in trace if t[0] == "V"] == [3, 3, 1 | DONE, 0]
    assert sum(line[0] == "B" for line in trace) == 2048 // 64


# ------------------------------------------------------------------------------------------------ errors


@pytest.mark.parametrize("broken", [0x100, 0x2100])  # where it reads, and where it writes
def test_an_error_of_the_memory_ends_a_transfer_as_failed(bench, broken):
    before = random.Random(1).randbytes(SPACE)
    jobs = [*transfer(0, 0, 0x2000, 1024), *transfer(1, 0x1000, 0x1800, 1024)]
    after, trace = play(bench, jobs, before, latency=LATENCY, broken=broken)
    assert {(t[1], int(t[2])) for t in trace if t[0] == "D"} == {("0", 1 | ERROR), ("1", 1 | DONE)}
    assert after[0x1800:0x1C00] == before[0x1000:0x1400]  # the other channel is not disturbed
    assert after[0x2000:0x2100] == before[0:0x100]
    assert (
        after[:0x1800] + after[0x1C00:0x2000] + after[0x2200:]
        == before[:0x1800] + before[0x1C00:0x2000] + before[0x2200:]
    )
    assert sum(t[0] == "R" and t[1] == "0" for t in trace) < 16  # nothing more is requested


@pytest.mark.parametrize(("source", "target", "size"), [(1 << 16, 0, 8), (0, 1 << 63, 8), (0, 0x100, 1 << 40)])
def test_addresses_that_the_bus_does_not_have_are_an_error(bench, source, target, size):
    _, trace = play(bench, transfer(3, source, target, size), bytes(SPACE))
    assert [(t[1], int(t[2])) for t in trace if t[0] in "DRW"] == [("3", 1 | ERROR)]


# ------------------------------------------------------------------------------------------------ a regulator before it


@pytest.mark.parametrize("budget", [1, 2, 3])
def test_a_regulator_holds_the_engine_to_its_budget(tmp_path, budget):
    """Windows of 64 cycles with some bursts each: the reads that pass are as many, and the bytes arrive."""
    before = random.Random(2).randbytes(SPACE)
    folder = build(tmp_path, REGULATED=1)
    after, trace = play(folder, transfer(0, 0, 0x2000, 1024), before, latency=LATENCY, budget=64 * budget, window=64)
    assert after == copied(before, [(0, 0, 0x2000, 1024, 0)])
    passed = sorted(int(t[4]) // 64 for t in trace if t[0] == "R")
    counts = [passed.count(window) for window in range(passed[0], passed[-1] + 1)]
    assert sum(counts) == 16
    assert max(counts) <= budget + 1  # windows of the test are not aligned with those of the gate
    assert counts[1:-1] == [budget] * (len(counts) - 2)


# ------------------------------------------------------------------------------------------------ faults


FAULTS = {
    "halpipe_dma_channel.v": (
        ("room >= read_cost", "room != 0"),
        ("filled >= write_cost", "filled != 0"),
        ("(p >= shift) & r_beat", "(p > shift) & r_beat"),
        ("skips <= target[SIZE-1:0] < source", "skips <= target[SIZE-1:0] > source"),
        ("(due != 0);   // what", "1'b0;   // what"),
        ("& (unanswered == 0);", ";"),
        ("failed <= failed | (r_beat & r_error)", "failed <= failed"),
        ("if (w_beat) head <= head + 1'b1;", ""),
    ),
    "halpipe_dma.v": (
        ("& l_wstrb[0] & ~run;", "& l_wstrb[0];"),
        ("(now_end == 0) | (i < now_end)", "1'b1"),
        ("if (failed | ~begun) error", "if (~begun) error"),
        ("(i >= now_first) &", "1'b1 &"),
        ("& ~next_valid;", ";"),
        ("claim <= 1'b1; config_ <= 32'd0;", "claim <= 1'b1;"),
    ),
}


@pytest.mark.slow  # the tests above, on engines that are wrong
@pytest.mark.parametrize(
    ("name", "old", "new"), [(name, *fault) for name, several in FAULTS.items() for fault in several]
)
def test_faults_of_the_engine_are_found(tmp_path, name, old, new):
    texts = {source: (TABLE / "dma" / source).read_text() for source in SOURCES}
    texts[name] = with_fault(texts[name], old, new)
    folder = build(tmp_path, texts)
    checks = (
        lambda: list(faults(folder, range(4))) == [],
        lambda: test_registers_are_those_of_the_model(folder),
        lambda: test_control_cannot_be_written_while_a_transfer_moves(folder),
        lambda: test_an_error_of_the_memory_ends_a_transfer_as_failed(folder, 0x100),
        lambda: test_an_error_of_the_memory_ends_a_transfer_as_failed(folder, 0x2100),
        lambda: test_a_channel_waits_for_no_more_than_the_buffers_of_others(folder, (2048, 64, 64, 64)),
    )
    for check in checks:
        try:
            if check() is False:
                return
        except (AssertionError, ValueError, subprocess.SubprocessError):
            return
    pytest.fail("no test finds it")


# ------------------------------------------------------------------------------------------------ cocotbext-axi


@pytest.mark.slow  # builds a bench of its own
@pytest.mark.skipif(not (find_spec("cocotb") and find_spec("cocotbext")), reason="pip install cocotb cocotbext-axi")
def test_cocotbext_axi_sees_every_byte_arrive(tmp_path):
    """The AXI4 memory and the AXI4-Lite manager of cocotbext-axi, with pauses: `dma_cocotb.py`."""
    runner = (
        "from cocotb_tools.runner import get_runner; r = get_runner('icarus'); "
        f"r.build(sources={[str(TABLE / 'dma' / name) for name in SOURCES]!r}, hdl_toplevel='halpipe_dma', "
        "parameters={'ADDR': 16}, build_dir='built'); "
        "r.test(hdl_toplevel='halpipe_dma', test_module='dma_cocotb', build_dir='built', results_xml='results.xml')"
    )
    paths = {"PYTHONPATH": str(Path(__file__).parent), "PATH": f"{Path(sys.executable).parent}:/usr/bin:/bin"}
    subprocess.run([sys.executable, "-c", runner], cwd=tmp_path, env=paths, check=True, timeout=300)
    (results,) = tmp_path.rglob("results.xml")
    assert "<failure" not in results.read_text()
