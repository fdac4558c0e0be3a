"""Rocket tiles in RTL as a judge: a bundle plays on the Verilog of `pythondata-cpu-rocket` as in the co-simulation.

Four harts with eight PMP entries, caches of 4 KiB and coherent memory; no scratchpads and no DMA engine. So scratchpads
are parts of main memory, the management core copies, and instants are others than on a platform with phases. What is
the same: which operations the runtime does in which order, with which flags, and causes, pc and values of faults.
"""

import json
import struct
import subprocess
import sys
from collections import defaultdict
from random import Random

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.deploy.riscv import CoSimulation, Plant
from halpipe.deploy.riscv.run.recording import Flag, Kind, parse_recording
from halpipe.flow import formats

pytestmark = [pytest.mark.slow, pytest.mark.timeout(7200)]
PROFILE = """halpipe-profile: 1
summary: Rocket tiles in RTL, scratchpads in main memory, the management core copies
cores: 3
clock: 100000000
timebase: 1000000
main: {base: 0x80000000, size: 16MiB}
ispm: {base: 0x82200000, stride: 0x1e000, size: 120KiB}
dspm: {base: 0x82000000, stride: 0x40000, size: 256KiB}
stack: 8KiB
service: 60us
cpi: {jobs: 3, management: 8, multiply: 40}
clint: 0x02000000
uart: {kind: sifive, base: 0x20000000}
dma: {kind: copy, channels: 4, bandwidth: 5MB/s, setup: 100us}
finisher: 0x30000000
"""
MEMORY, CYCLES = 64 << 20, 6_000_000
CONTROL = (0x48414C5049504531, 1, 0, 0, 1, 2, 1000, 0)  # magic, one table, real, its mode, report, finisher, offset
FAULTS = {
    "illegal": '__asm__ volatile(".word 0xc0001073");',
    "wild": "*(volatile uint64_t *)0x80000000UL = 1;",
    "misaligned": '__asm__ volatile("ld t0, 1(%0)" ::"r"(x));',
    "amo": '__asm__ volatile("amoadd.d t0, t0, (%0)" ::"r"(0x80000000UL));',
    "jump": "((void (*)(void))0x80000000UL)();",
    "csr": '__asm__ volatile("csrw mtvec, zero");',
    "spin": 'for (;;) { __asm__ volatile(""); }',
}
GOOD = {
    "good": "for (int i = 0; i < 8; i++) out[i] = in[i] * 3 + 1;",
    "next": "for (int i = 0; i < 8; i++) out[i] = in[i] / 3 + in[7 - i] + (uint64_t)i;",
}


def _phase(kind, at, buffer, symbol, size=64):
    moved = f'<transfer buffer="{buffer}" symbol="{symbol}" size="{size}B"/>'
    return f'<access resource="m" start="{at}us" end="{at + 10}us" kind="{kind}">{moved}</access>'


def _task(name, unit, phases="", wcet=500):
    return (
        f'<task name="{name}" period="20ms"><version name="v" wcet="{wcet}us"><units names="{unit}"/>{phases}'
        f'<source files="{name}.c" entry="{name}"/></version></task>'
    )


def _model():
    tasks = [
        _task(name, unit, _phase("read", 0, source, "in") + _phase("write", 400, target, "out"), 410)
        for name, unit, source, target in (("good", "u1", "a", "b"), ("next", "u2", "b", "a"))
    ]
    tasks += [_task(name, f"u{1 + i % 3}") for i, name in enumerate(FAULTS)]
    return _system(tasks, (*GOOD, *FAULTS), 3)


def _system(tasks, names, units):
    runs = "".join(f'<run task="{name}" versions="v"/>' for name in names)
    platform = "".join(f'<unit name="u{i + 1}"/>' for i in range(units))
    return (
        f'<task-model xmlns="urn:halpipe:task-model:1" name="rtl"><platform>{platform}<resource name="m"/></platform>'
        f'<tasks>{"".join(tasks)}</tasks><modes><mode name="on">{runs}</mode></modes></task-model>'
    )


def _bundle(folder, model, sources):
    """Export a model with its sources, each a function of the file's name."""
    folder.joinpath("rocket.yaml").write_text(PROFILE)
    folder.joinpath("m.xml").write_text(model)
    for name, (declared, body) in sources.items():
        text = f"#include <stdint.h>\n{declared}\nvoid {name}(void) {{ {body} }}\n"
        folder.joinpath(f"{name}.c").write_text(text)
    own = ["--sources", str(folder), "--profile", str(folder / "rocket.yaml")]
    model, prepared, schedule = (str(folder / name) for name in ("m.xml", "p.xml", "s.xml"))
    for command in (
        ["deploy", "prepare", model, "-o", prepared, *own],
        ["schedule", prepared, "-o", schedule, "--tick", "1us"],
        ["export", "riscv", prepared, schedule, "-o", str(folder / "b"), *own],
    ):
        subprocess.run([sys.executable, "-m", "halpipe", *command], check=True, capture_output=True)
    return formats.open_target(str(folder / "b"))


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    sources = {name: ("uint64_t in[8], out[8];", body) for name, body in GOOD.items()}
    sources |= {name: ("uint64_t x[2];", body) for name, body in FAULTS.items()}
    return _bundle(tmp_path_factory.mktemp("rtl"), _model(), sources)


def _play(bundle, rocket, image):
    """Return what the runtime records in a run on the tiles, its state, and the status of the run."""
    target = json.loads(bundle.bundle.files["target.json"])
    memory = bytearray(MEMORY)
    program = bundle.bundle.files["bundle.bin"]
    memory[: len(program)] = program
    struct.pack_into("<8Q", memory, int(target["control"], 16) - int(target["main"]["base"], 16), *CONTROL)
    image.write_bytes(memory)
    run = subprocess.run(
        [str(rocket), str(image), str(MEMORY), str(CYCLES)], capture_output=True, text=True, check=False
    )
    return *parse_recording(run.stdout, HalpipeError()), run.returncode


@pytest.fixture(scope="module")
def played(bundle, rocket, tmp_path_factory):
    *recorded, status = _play(bundle, rocket, tmp_path_factory.mktemp("image") / "memory.bin")
    assert status == 1  # some jobs were abandoned
    return recorded


@pytest.fixture(scope="module")
def simulated(bundle):
    return CoSimulation(bundle, plant=Plant(), cycles=1).run().recording


def _by_slot(recording):
    """Return what the runtime did, in order, for each job."""
    found = defaultdict(list)
    for r in recording.records:
        if r.kind is not Kind.TABLE:
            found[r.cycle, r.table, r.release].append((r.program, r.operation, r.kind, int(r.flags), r.hart))
    return found


def test_the_same_operations_in_the_same_order_with_the_same_flags(played, simulated):
    recording, state = played
    assert state == 2
    assert _by_slot(recording) == _by_slot(simulated)
    assert len(recording.records) == len(simulated.records) > 40


def _faults(recording):
    faults = [a for a in recording.abandoned if a.flags == Flag.FAULT]
    return {(a.cycle, a.release): (int(a.flags), a.cause, a.epc, a.tval) for a in faults}


def test_the_same_causes_pc_and_values(played, simulated):
    assert _faults(played[0]) == _faults(simulated)
    assert len(_faults(simulated)) == len(FAULTS) - 1  # and one that its timer ends, wherever it is


def test_jobs_begin_at_their_ticks_and_end_within_their_time(played, simulated):
    """An operation is as late as the management core is; its caches make that more than the co-simulation's."""
    for real, planned in zip(played[0].records, simulated.records, strict=True):
        assert -60 <= real.time - planned.time <= 60


MIX = "uint64_t s = 1; for (int i = 0; i < N; i++) s = s * 6364136223846793005UL + in[i % W];"
TURN = "for (int i = 0; i < W; i++) out[i] = in[W - 1 - i];"
SWAP = "if (out[i] < out[i - 1]) { uint64_t t = out[i]; out[i] = out[i - 1]; out[i - 1] = t; }"
BODIES = (
    "for (int i = 0; i < N; i++) out[i % W] = in[i % W] * 3 + (uint64_t)i;",
    "for (int i = 0; i < N; i++) out[i % W] += in[i % W] / (uint64_t)(i + 1);",
    f"{MIX} for (int i = 0; i < W; i++) out[i] = s ^ (uint64_t)i;",
    f"{TURN} for (int k = 0; k < 2; k++) for (int i = 1; i < W; i++) {SWAP}",
)


def _small(number):
    """Return a model of two to four tasks on one to three units, and their sources; from 15 on one of them fails."""
    random = Random(number)
    units, tasks, words = random.randint(1, 3), random.randint(2, 4), random.choice([1, 2, 8, 16, 32])
    texts, sources = [], {}
    for k in range(tasks):
        source, target = random.sample(["a", "b", "c"], 2)
        phases = _phase("read", 0, source, "in", 8 * words) + _phase("write", 400, target, "out", 8 * words)
        body, rounds = random.choice(BODIES), random.randint(4, 200)
        if number >= 15 and k == 0:
            body = f"uint64_t x[2]; {list(FAULTS.values())[number - 15]} (void)x;"
        texts.append(_task(f"t{k}", f"u{1 + k % units}", phases, 410))
        sources[f"t{k}"] = (f"enum {{ N = {rounds}, W = {words} }};\nuint64_t in[W], out[W];", body)
    return _system(texts, sources, units), sources


@pytest.mark.parametrize("number", range(20))
def test_small_models_are_played_as_in_the_cosimulation(rocket, tmp_path, number):
    model, sources = _small(number)
    small = _bundle(tmp_path, model, sources)
    recording, state, _ = _play(small, rocket, tmp_path / "memory.bin")
    expected = CoSimulation(small, plant=Plant(), cycles=1).run().recording
    assert state == 2
    assert _by_slot(recording) == _by_slot(expected)
    assert _faults(recording) == _faults(expected)
    assert any(r.flags for r in recording.records) == (number >= 15)
