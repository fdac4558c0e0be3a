"""The search built for another processor does the same, to the last bit: its aarch64 library, run by an emulator."""

import sys
from dataclasses import fields
from pathlib import Path

import build_native
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scheduler_systems import random_problem

from halpipe.pipeline.solve.integers import Table
from halpipe.pipeline.solve.kernel.kernel import COUNTED, anneal, gumbel_table, new_state, values
from profiles import examples

unicorn = pytest.importorskip("unicorn", reason="halpipe[riscv] is not installed")
pytest.importorskip("elftools", reason="halpipe[riscv] is not installed")
pytest.importorskip("ziglang", reason="halpipe[riscv] is not installed")

CODE, DATA, STACK, RETURN, MEMMOVE = 0x100000, 0x10000000, 0x8000000, 0x7000000, 0x7001000
CODE_SIZE, DATA_SIZE, STACK_SIZE = 0x200000, 0x2000000, 0x100000

RELATIVE, SYMBOLIC = {1027}, {257, 1025, 1026}
"""Kinds of relocations: R_AARCH64_RELATIVE; ABS64, GLOB_DAT, JUMP_SLOT."""


class Machine:
    """Emulates a processor with the library in its memory."""

    def __init__(self, library: Path) -> None:
        from unicorn import arm64_const

        self._registers = arm64_const
        self._engine = unicorn.Uc(unicorn.UC_ARCH_ARM64, unicorn.UC_MODE_ARM)
        for begin, size in ((CODE, CODE_SIZE), (DATA, DATA_SIZE), (STACK, STACK_SIZE), (RETURN, 0x2000)):
            self._engine.mem_map(begin, size)
        self._engine.mem_write(MEMMOVE, bytes.fromhex("c0035fd6"))  # ret
        self._engine.hook_add(unicorn.UC_HOOK_CODE, self._memmove, begin=MEMMOVE, end=MEMMOVE)
        self._load(library)
        self._top = DATA

    def _load(self, library: Path) -> None:
        from elftools.elf.elffile import ELFFile

        with library.open("rb") as stream:
            elf = ELFFile(stream)
            for segment in elf.iter_segments("PT_LOAD"):
                self._engine.mem_write(CODE + segment["p_vaddr"], segment.data())
            symbols = elf.get_section_by_name(".dynsym")
            self.addresses = {symbol.name: CODE + symbol["st_value"] for symbol in symbols.iter_symbols()}
            self.addresses["memmove"] = MEMMOVE
            sections = filter(None, map(elf.get_section_by_name, (".rela.dyn", ".rela.plt")))
            for entry in (entry for section in sections for entry in section.iter_relocations()):
                assert entry["r_info_type"] in RELATIVE | SYMBOLIC
                if entry["r_info_type"] in RELATIVE:
                    value = CODE + entry["r_addend"]
                else:
                    value = self.addresses[symbols.get_symbol(entry["r_info_sym"]).name] + entry["r_addend"]
                self._engine.mem_write(CODE + entry["r_offset"], value.to_bytes(8, "little"))

    def _memmove(self, engine, address, size, data) -> None:
        target, source, length = (engine.reg_read(r) for r in self._arguments()[:3])
        engine.mem_write(target, bytes(engine.mem_read(source, length)))

    def _arguments(self):
        return [getattr(self._registers, f"UC_ARM64_REG_X{number}") for number in range(8)]

    def put(self, data: bytes) -> int:
        """Copy bytes into the memory; return where they are."""
        place = self._top
        self._engine.mem_write(place, data)
        self._top += (len(data) + 79) // 64 * 64
        return place

    def read(self, place: int, length: int) -> bytes:
        return bytes(self._engine.mem_read(place, length))

    def call(self, name: str, *arguments: int) -> None:
        for register, value in zip(self._arguments(), arguments, strict=False):
            self._engine.reg_write(register, value)
        self._engine.reg_write(self._registers.UC_ARM64_REG_SP, STACK + STACK_SIZE - 0x1000)
        self._engine.reg_write(self._registers.UC_ARM64_REG_LR, RETURN)
        self._engine.emu_start(self.addresses[name], RETURN)


def content(field):
    """Return the bytes of an array or a table; None for an integer."""
    if isinstance(field, int):
        return None
    return (field.flat if isinstance(field, Table) else field).tobytes()


def struct(machine, members):
    """Copy members into the machine; return where their struct is, and where each of them."""
    places = [field if isinstance(field, int) else machine.put(content(field)) for field in members]
    words = b"".join((place % 2**64).to_bytes(8, "little") for place in places)
    return machine.put(words), places


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    made = build_native.build(tmp_path_factory.mktemp("aarch64"), "linux-aarch64")
    return next(path for path in made.values() if path.stem == "kernel")


@pytest.mark.slow  # an emulator makes some ten thousand moves a second
@pytest.mark.skipif(sys.byteorder == "big", reason="bytes are compared with those of a little-endian processor")
def test_another_processor_makes_the_same_moves(library):
    noise = gumbel_table()

    @examples(40)
    @given(st.integers(0, 2**32), st.booleans())
    def check(seed, grouped):
        _, problem = random_problem(seed, grouped=grouped)
        arrays = problem.arrays
        if not len(arrays.entry_offset):
            return
        machine = Machine(library)
        lengths = [len(getattr(arrays, name)) for name in COUNTED.values()]
        fixed, _ = struct(machine, [*values(arrays), *lengths])
        before = new_state(arrays, seed, problem.mean_wcet)
        changing, places = struct(machine, values(before))
        machine.call("halpipe_anneal", fixed, changing, machine.put(noise.tobytes()), 400)
        native = new_state(arrays, seed, problem.mean_wcet)
        anneal(arrays, native, noise, 400)
        assert native.register != before.register
        for name, field, place in zip((field.name for field in fields(native)), values(native), places, strict=True):
            if content(field) is not None:
                assert machine.read(place, len(content(field))) == content(field), name

    check()
