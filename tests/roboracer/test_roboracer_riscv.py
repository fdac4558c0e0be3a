"""The tasks as RISC-V programs: the same results as on this computer, in the time and the stack that they have."""

import struct
from fractions import Fraction

import drive as module
import host
import pytest
from roboracer_case import EXAMPLE

from halpipe.models import AccessKind

pytest.importorskip("ziglang", reason="pip install ziglang pyelftools unicorn")
pytest.importorskip("unicorn", reason="pip install ziglang pyelftools unicorn")
pytest.importorskip("elftools", reason="pip install ziglang pyelftools unicorn")

from rv_program import RiscvProgram

HERTZ = 10**8  # 100 MHz, one instruction in each cycle
CODE, DATA = 116 * 1024, 255 * 1024 - 8 * 1024  # of the scratchpads, without monitor, mailbox and stack
LEAST, EVERY = 10, 40  # samples of each version are taken from this run on, so often

pytestmark = pytest.mark.slow


class Both:
    """A program of the host that is run on the emulated core as well, now and then."""

    def __init__(self, program, emulated):
        self.program, self.emulated = program, emulated
        self.runs, self.compared, self.most = 0, 0, 0

    def run(self, inputs, outputs):
        here = self.program.run(inputs, outputs)
        self.runs += 1
        if self.runs <= 2 or (self.runs >= LEAST and self.runs % EVERY == 0):
            assert self.emulated.run(inputs, outputs) == here
            self.compared += 1
            self.most = max(self.most, self.emulated.instructions)
        return here


@pytest.fixture(scope="module")
def emulated(model, tmp_path_factory):
    folder = tmp_path_factory.mktemp("riscv")
    return {
        (task.name, version.name): RiscvProgram(version.source, EXAMPLE, folder / f"{task.name[1:]}-{version.name}.elf")
        for task in model.tasks
        for version in task.versions
    }


@pytest.fixture(scope="module")
def compared(model, schedule, programs, emulated):
    """A lap with the opponent, a third of a lap alone, a stop, and on the way samples of every version."""
    both = {key: Both(program, emulated[key]) for key, program in programs.items()}
    drive = module.a_drive(1, 1, 0)
    host.Host(model, schedule, both).run(drive, 4000)
    assert drive.succeeded
    return both


def test_the_emulated_core_computes_what_this_computer_computes(compared):
    for both in compared.values():
        assert both.compared >= 3


def test_every_version_needs_less_than_half_of_its_time(model, compared):
    """Counted on samples of a drive, at one instruction a cycle; the time between the last read and the first write."""
    for task in model.tasks:
        for version in task.versions:
            reads = [a.end for a in version.accesses if a.kind is AccessKind.READ]
            writes = [a.start for a in version.accesses if a.kind is AccessKind.WRITE]
            execution = (min(writes) - max(reads)).in_unit("s")
            assert Fraction(compared[task.name, version.name].most, HERTZ) < execution / 2


def test_the_programs_fit_the_scratchpads(emulated):
    for program in emulated.values():
        sizes = program.sizes
        assert sizes[".text"] < CODE
        assert sum(sizes.get(name, 0) for name in (".rodata", ".data", ".bss", ".sdata", ".sbss")) < DATA


def test_the_stack_suffices(compared):
    for both in compared.values():
        assert both.emulated.deepest < 1024


def test_no_program_has_a_floating_point_instruction(emulated):
    """Opcodes of loads, stores and arithmetic on floating-point numbers (RISC-V unprivileged specification, 24.1)."""
    for program in emulated.values():
        text = program.code
        at = 0
        while at < len(text):
            (word,) = struct.unpack_from("<H", text, at)
            if word & 3 == 3:
                (word,) = struct.unpack_from("<I", text, at)
                assert word & 0x7F not in (0x07, 0x27, 0x43, 0x47, 0x4B, 0x4F, 0x53)
                at += 4
            else:
                assert (word & 3, word >> 13) not in [(0, 1), (0, 5), (2, 1), (2, 5)]
                at += 2
