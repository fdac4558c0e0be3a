"""Cycles by class of instruction: on the RTL of a Rocket tile, and on the co-simulation's hart, within 10 %.

The tile (LitexLinux4) predicts no branch, and multiplies and divides a bit in each cycle. Loops fit its caches, as jobs
fit scratchpads, and their second turn is counted.
"""

import subprocess
import sys

import pytest

from halpipe.core.diagnostics import Location
from halpipe.deploy.riscv.board.devices import Clint, Uart
from halpipe.deploy.riscv.board.elf import read_program
from halpipe.deploy.riscv.board.hart import Hart
from halpipe.deploy.riscv.board.memory import Memory, Region

pytestmark = [pytest.mark.slow, pytest.mark.timeout(7200)]

MAIN, UART, SIZE, CYCLES = 0x80000000, 0x20000000, 1 << 20, 2_000_000
TILE = {"load": 2, "load-byte": 3, "multiply": 66, "multiply-word": 34, "divide": 68, "taken": 4}
"""As `hardware.py` states them for LiteX."""

KERNELS = {
    "additions": "addi t2, t2, 1\n xor t3, t3, t2",
    "loads": "ld t2, (s2)\n ld t3, 8(s2)",
    "load, use": "ld t2, (s2)\n add t3, t2, t2",
    "load, other, use": "ld t2, (s2)\n addi t4, t4, 1\n add t3, t2, t2",
    "word, use": "lw t2, (s2)\n c.add t3, t2",
    "byte, use": "lb t2, (s2)\n add t3, t2, t2",
    "byte, other, use": "lbu t2, (s2)\n addi t4, t4, 1\n add t3, t2, t2",
    "half, use": "lhu t2, (s2)\n add t3, t2, t2",
    "list": "ld t5, (t5)",
    "stores": "sd t2, (s2)\n sb t3, 8(s2)",
    "load, store": "c.ld a0, (a5)\n c.sd a0, 8(a5)",
    "products": "mul t2, s3, s4",
    "product, use": "mul t2, s3, s4\n add t3, t2, t2",
    "product, others": "mul t2, s3, s4\n addi t4, t4, 1\n addi t4, t4, 1",
    "product of words": "mulw t2, s3, s4\n add t3, t2, t2",
    "quotients": "divu t2, s3, s4",
    "remainder of words": "remw t2, s3, s4\n add t3, t2, t2",
    "branches not taken": "beqz s3, 1f\n1: addi t2, t2, 1",
    "branches taken": "bnez s3, 1f\n addi t2, t2, 1\n1: addi t2, t2, 1",
    "branches of both kinds": "andi t3, t0, 1\n bnez t3, 1f\n addi t2, t2, 1\n1:",
    "short loops": "li t3, 4\n1: addi t3, t3, -1\n bnez t3, 1b",
    "jumps": "j 1f\n nop\n1:",
    "calls": "call leaf",
    "fences": "fence",
}
PROGRAM = """
    .section .start, "ax"
    csrr t0, mhartid
1:  bnez t0, 1b
    la s2, data
    mv a5, s2
    mv t5, s2
    sd s2, (s2)
    li s3, 1000
    li s4, 77
    la s10, table
next:
    ld s1, (s10)
    beqz s1, over
    jalr s11, s1
    jalr s11, s1
    li s5, 0x20000000
    li t2, 28
2:  srl a1, s0, t2
    andi a1, a1, 15
    addi a2, a1, 65
    sb a2, (s5)
    addi t2, t2, -4
    bgez t2, 2b
    li a2, 10
    sb a2, (s5)
    addi s10, s10, 8
    j next
over: li t0, 0x30000000
    sw zero, (t0)
3:  j 3b
leaf: ret
    {kernels}
    .balign 8
table: {table}
    .dword 0
    .balign 64
data: .zero 64
"""
KERNEL = """
    .balign 64
kernel_{number}:
    li t0, 16
    fence
    csrr s0, mcycle
9:  .rept 8
    {body}
    .endr
    addi t0, t0, -1
    bnez t0, 9b
    csrr t1, mcycle
    sub s0, t1, s0
    jr s11
"""


def _counted(text):
    """Return the cycles that a program prints, a letter for each four bits."""
    return [int("".join(f"{ord(letter) - 65:x}" for letter in line), 16) for line in text.split()]


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    folder = tmp_path_factory.mktemp("timing")
    kernels = "".join(KERNEL.format(number=i, body=body) for i, body in enumerate(KERNELS.values()))
    table = "\n".join(f".dword kernel_{i}" for i in range(len(KERNELS)))
    folder.joinpath("t.S").write_text(PROGRAM.format(kernels=kernels, table=table))
    folder.joinpath("t.ld").write_text(f"SECTIONS {{ . = {MAIN:#x}; .start : {{ *(.start) }} }} ENTRY({MAIN:#x})")
    target = ["--target=riscv64-freestanding", "-mcpu=generic_rv64+m+a+c+zicsr+zifencei", "-nostdlib", "-static"]
    command = [sys.executable, "-m", "ziglang", "cc", *target, "-Wl,-T,t.ld", "-o", "t.elf", "t.S"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return read_program((folder / "t.elf").read_bytes(), Location("t.elf")).segments


class World:
    """A machine without a trap that ends with the first store to the finisher."""

    def fenced(self, hart):
        pass

    def trapped(self, hart, cause, pc, value):
        return True

    def called(self):
        return True


class Line(Uart):
    """A serial line that is never busy, as that of the tiles here: the program does not wait for it."""

    def store(self, hart, offset, size, value):
        self.text.append(value & 0xFF)


def on_our_hart(segments):
    memory = Memory((Region("main", MAIN, SIZE),), 1)
    clint, uart = Clint(0x2000000, 1000, lambda *_: None), Line(UART)
    hart = Hart(0, memory, [clint, uart], 1, 1000)
    clint.harts, hart.world, hart.pc = [hart], World(), MAIN
    for segment in segments:
        memory.write(segment.source, segment.data)
        hart.hook_registers(segment.data, segment.source)
    hart.weigh(**TILE)
    hart.run(CYCLES)
    return _counted(bytes(uart.text).decode())


def test_every_class_takes_what_it_takes_on_the_tile(rocket, program, tmp_path):
    image = bytearray(SIZE)
    for segment in program:
        at = segment.source - MAIN
        image[at : at + len(segment.data)] = segment.data
    (tmp_path / "memory.bin").write_bytes(image)
    command = [str(rocket), str(tmp_path / "memory.bin"), str(SIZE), str(CYCLES)]
    played = subprocess.run(command, capture_output=True, text=True, check=False)
    assert played.returncode == 0
    tile, ours = _counted(played.stdout), on_our_hart(program)
    assert len(tile) == len(ours) == len(KERNELS)
    apart = {
        name: (real, own)
        for name, real, own in zip(KERNELS, tile, ours, strict=True)
        if not real * 9 <= own * 10 <= real * 11
    }
    assert apart == {}
