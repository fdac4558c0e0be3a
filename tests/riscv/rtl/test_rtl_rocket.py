"""Rocket tiles in RTL as a judge: a bundle plays on the Verilog of `pythondata-cpu-rocket` as in the co-simulation.

Four harts with eight PMP entries, caches of 4 KiB and coherent memory; no scratchpads and no DMA engine. So scratchpads
are parts of main memory, the management core copies, and instants are others than on a platform with phases. What is
the same: which operations the runtime does in which order, with which flags, and causes, pc and values of faults.
"""

import subprocess
from random import Random

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.deploy.riscv import CoSimulation, Plant
from halpipe.deploy.riscv.run.recording import parse_recording
from riscv_judged import FAULTS, by_slot, exported, exported_failing, faults_of, memory_of, phase, system, task

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


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    return exported_failing(tmp_path_factory.mktemp("rtl"), PROFILE)


def _play(bundle, rocket, image):
    """Return what the runtime records in a run on the tiles, its state, and the status of the run."""
    image.write_bytes(memory_of(bundle, MEMORY, leaves=2))
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


def test_the_same_operations_in_the_same_order_with_the_same_flags(played, simulated):
    recording, state = played
    assert state == 2
    assert by_slot(recording) == by_slot(simulated)
    assert len(recording.records) == len(simulated.records) > 40


def test_the_same_causes_pc_and_values(played, simulated):
    assert faults_of(played[0]) == faults_of(simulated)
    assert len(faults_of(simulated)) == len(FAULTS) - 1  # and one that its timer ends, wherever it is


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
        phases = phase("read", 0, source, "in", 8 * words) + phase("write", 400, target, "out", 8 * words)
        body, rounds = random.choice(BODIES), random.randint(4, 200)
        if number >= 15 and k == 0:
            body = f"uint64_t x[2]; {list(FAULTS.values())[number - 15]} (void)x;"
        texts.append(task(f"t{k}", f"u{1 + k % units}", phases, 410))
        sources[f"t{k}"] = (f"enum {{ N = {rounds}, W = {words} }};\nuint64_t in[W], out[W];", body)
    return system(texts, sources, units), sources


@pytest.mark.parametrize("number", range(20))
def test_small_models_are_played_as_in_the_cosimulation(rocket, tmp_path, number):
    model, sources = _small(number)
    small = exported(tmp_path, model, sources, PROFILE)
    recording, state, _ = _play(small, rocket, tmp_path / "memory.bin")
    expected = CoSimulation(small, plant=Plant(), cycles=1).run().recording
    assert state == 2
    assert by_slot(recording) == by_slot(expected)
    assert faults_of(recording) == faults_of(expected)
    assert any(r.flags for r in recording.records) == (number >= 15)
