"""Instructions on control and status registers that the emulator cannot be left alone with.

Some registers it does not let us set (hart number, pending interrupts), some it counts in a way of its own (cycles),
and its protection is our own (`pmp`). Such instructions are found in the code, and carried out by us when reached.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.deploy.riscv.board.pmp import ADDRESS, CONFIG, ENTRIES

if TYPE_CHECKING:
    from collections.abc import Iterator

MSTATUS, MIE, MIP, MHARTID = 0x300, 0x304, 0x344, 0xF14
MCYCLE, MINSTRET, CYCLE, TIME, INSTRET = 0xB00, 0xB02, 0xC00, 0xC01, 0xC02
COUNTERS = frozenset({MCYCLE, MINSTRET, CYCLE, INSTRET})
PROTECTION = frozenset((*range(CONFIG, CONFIG + ENTRIES // 4), *range(ADDRESS, ADDRESS + ENTRIES)))
OURS = frozenset({MIP, MHARTID, TIME}) | COUNTERS | PROTECTION
"""Registers that we keep; the emulator never sees the instruction."""
INTERRUPTS = frozenset({MSTATUS, MIE})
"""Registers that the emulator keeps, but after which interrupts may be due."""

_SYSTEM = 0x73
MRET = 0x30200073
WFI = 0x10500073
EBREAK = 0x00100073
FENCE_I = 0x0000100F
C_EBREAK = 0x9002
ATOMIC, LOAD_RESERVED = 0x2F, 2  # the opcode of atomic operations, and the function of lr


@record
class Access:
    """One instruction on a register: what it reads into `target`, and by which `operation` it writes `source`."""

    csr: int
    operation: int  # 1 write, 2 set, 3 clear
    target: int  # number of a general register
    source: int  # number of a general register, or a value where `immediate`
    immediate: bool

    @property
    def writes(self) -> bool:
        """Whether the register is written at all; setting or clearing nothing is only reading."""
        return self.operation == 1 or self.source != 0

    def result(self, old: int, operand: int) -> int:
        """Return the new value of the register."""
        if self.operation == 1:
            return operand
        return old | operand if self.operation == 2 else old & ~operand


def decode(word: int) -> Access | None:
    """Return what the instruction `word` does with a register, None if it is none of these."""
    kind = word >> 12 & 7
    if word & 0x7F != _SYSTEM or kind in (0, 4):
        return None
    return Access(word >> 20, kind & 3, word >> 7 & 31, word >> 15 & 31, kind >= 4)


_CANDIDATE = re.compile(rb"(?s)[\x0f\x73\xf3]")
"""The low byte of such an instruction, by the parity of its target register."""


def of_interest(code: bytes, base: int) -> Iterator[int]:
    """Yield the addresses where `code` may have an instruction for us; whether it has, is decided when reached."""
    for match in _CANDIDATE.finditer(code):
        at = match.start()
        if at % 2 or at + 4 > len(code):
            continue
        word = int.from_bytes(code[at : at + 4], "little")
        access = decode(word)
        if word in (MRET, FENCE_I) or (access is not None and access.csr in OURS | INTERRUPTS):
            yield base + at
