"""Programs: segments and symbols are read, and nothing that is spoilt gets through or raises anything else."""

import struct
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.deploy.riscv.board.elf import Segment, read_program
from halpipe.deploy.riscv.codes import BROKEN_PROGRAM

AT = Location("images/0.elf")


def elf(code=b"\x13\0\0\0" * 4, data=b"abcdefgh", machine=243):
    """A program with code at 0x1821000 and data at 0x1042000, and one symbol of eight bytes."""
    body = 64 + 2 * 56
    names = b"\0scan\0"
    symbols = struct.pack("<IBBHQQ", 0, 0, 0, 0, 0, 0) + struct.pack("<IBBHQQ", 1, 0x11, 0, 1, 0x1042000, 8)
    at_data, at_names = body + len(code), body + len(code) + len(data)
    at_symbols = at_names + len(names)
    at_sections = at_symbols + len(symbols)
    header = struct.pack(
        "<16sHHIQQQIHHHHHH", b"\x7fELF\x02\x01\x01", 2, machine, 1, 0x1821000, 64, at_sections, 0, 64, 56, 2, 64, 3, 0
    )
    segments = struct.pack("<IIQQQQQQ", 1, 5, body, 0x1821000, 0x80050000, len(code), len(code), 4)
    segments += struct.pack("<IIQQQQQQ", 1, 6, at_data, 0x1042000, 0x80050010, len(data), 64, 8)
    sections = struct.pack("<IIQQQQIIQQ", *[0] * 10)
    sections += struct.pack("<IIQQQQIIQQ", 0, 2, 0, 0, at_symbols, len(symbols), 2, 1, 8, 24)
    sections += struct.pack("<IIQQQQIIQQ", 0, 3, 0, 0, at_names, len(names), 0, 0, 1, 0)
    return header + segments + code + data + names + symbols + sections


def test_segments_and_symbols_are_read():
    program = read_program(elf(), AT)
    assert program.entry == 0x1821000
    assert program.segments == (
        Segment(0x80050000, 0x1821000, b"\x13\0\0\0" * 4, 16, True),
        Segment(0x80050010, 0x1042000, b"abcdefgh", 64, False),
    )
    assert program.symbols == {"scan": (0x1042000, 8)}


def test_a_program_for_another_machine_is_refused():
    with pytest.raises(HalpipeError) as failure:
        read_program(elf(machine=62), AT)
    (found,) = failure.value.diagnostics
    assert found.code == BROKEN_PROGRAM.id
    assert found.at == AT
    assert "no little-endian ELF of 64 bits for RISC-V" in found.message


@given(st.integers(0, len(elf()) - 1))
def test_a_program_that_ends_too_early_is_refused(size):
    with pytest.raises(HalpipeError) as failure:
        read_program(elf()[:size], AT)
    assert failure.value.diagnostics[0].code == BROKEN_PROGRAM.id


@given(st.integers(0, len(elf()) - 1), st.integers(0, 255))
def test_a_program_with_any_byte_changed_is_read_or_refused(position, value):
    data = bytearray(elf())
    data[position] = value
    with suppress(HalpipeError):
        read_program(bytes(data), AT)
