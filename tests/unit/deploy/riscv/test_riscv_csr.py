"""Instructions on control and status registers: what they do, and where code has those that are ours to carry out."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from halpipe.deploy.riscv.board.registers import MHARTID, MIE, MRET, Access, decode, of_interest

NOP, C_NOP = 0x00000013, 0x0001


def code(*words):
    return b"".join(word.to_bytes(4 if word & 3 == 3 else 2, "little") for word in words)


@pytest.mark.parametrize(
    ("word", "access"),
    [
        (0xF1402573, Access(MHARTID, 2, 10, 0, False)),  # csrr a0, mhartid
        (0x30451073, Access(MIE, 1, 0, 10, False)),  # csrw mie, a0
        (0x304465F3, Access(MIE, 2, 11, 8, True)),  # csrrsi a1, mie, 8
        (0x30407073, Access(MIE, 3, 0, 0, True)),  # csrci mie, 0
        (0x00000073, None),  # ecall
        (NOP, None),
    ],
)
def test_instructions_are_decoded(word, access):
    assert decode(word) == access


def test_reading_writes_nothing():
    assert not Access(MIE, 2, 10, 0, False).writes
    assert Access(MIE, 1, 10, 0, False).writes


@given(st.integers(0, 2**64 - 1), st.integers(0, 2**64 - 1))
def test_write_set_and_clear(old, operand):
    assert [Access(MIE, kind, 0, 1, False).result(old, operand) for kind in (1, 2, 3)] == [
        operand,
        old | operand,
        old & ~operand,
    ]


def test_code_is_searched_at_every_even_address():
    text = code(NOP, C_NOP, 0xF1402573, 0x304465F3, 0x34202573, MRET)
    assert list(of_interest(text, 0x1000)) == [0x1006, 0x100A, 0x1012]


@given(st.binary(max_size=64))
def test_any_bytes_are_searched_as_one_would_by_hand(data):
    ours = [at for at in range(0, len(data) - 3, 2) if list(of_interest(data[at : at + 4], 0))]
    assert list(of_interest(data, 0)) == ours
