"""Registers of a hart that the emulator cannot be left alone with: counters, interrupts, physical memory protection."""

from __future__ import annotations

import re
from enum import IntEnum, IntFlag
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Iterator

ENTRIES = 16
CONFIG, ADDRESS = 0x3A0, 0x3B0
_OFF, _TOR, _NA4, _NAPOT = 0, 1, 2, 3
_LOCK = 0x80
TOP = 1 << 56


class Right(IntFlag):
    """Right to read, write or execute an address."""

    NONE = 0
    READ = 1
    WRITE = 2
    EXECUTE = 4
    ALL = 7


class Level(IntEnum):
    """The privilege with which a hart executes."""

    USER = 0
    MACHINE = 3


class Protection:
    """The registers ``pmpcfg`` and ``pmpaddr`` of one hart.

    Only locked entries bind machine mode; user mode has nothing that no entry gives it.
    """

    def __init__(self) -> None:
        self._config = [0] * ENTRIES
        self._address = [0] * ENTRIES

    @property
    def is_locked(self) -> bool:
        """Whether any entry binds machine mode."""
        return any(config & _LOCK for config in self._config)

    def read(self, csr: int) -> int:
        """Return the value of a register; of the 64-bit architecture only even ``pmpcfg`` are there, the others 0."""
        if csr >= ADDRESS:
            return self._address[csr - ADDRESS]
        if csr % 2:
            return 0
        first = (csr - CONFIG) * 4
        return sum(config << 8 * i for i, config in enumerate(self._config[first : first + 8]))

    def write(self, csr: int, value: int) -> None:
        """Set a register, as far as it is not locked."""
        if csr >= ADDRESS:
            entry = csr - ADDRESS
            follower = self._config[entry + 1] if entry + 1 < ENTRIES else 0
            bound_by_next = follower & _LOCK and follower >> 3 & 3 == _TOR
            if not (self._config[entry] & _LOCK or bound_by_next):
                self._address[entry] = value & (1 << 54) - 1
            return
        if csr % 2:
            return
        for i in range(8):
            entry = (csr - CONFIG) * 4 + i
            if entry < ENTRIES and not self._config[entry] & _LOCK:
                self._config[entry] = value >> 8 * i & 0x9F

    def areas(self, level: Level = Level.MACHINE) -> list[tuple[int, int, Right]]:
        """Return the areas of the entries, [low, high) and what they allow; the first that matches rules."""
        found = []
        for entry, config in enumerate(self._config):
            kind = config >> 3 & 3
            if kind == _OFF:
                continue
            binds = config & _LOCK or level is Level.USER
            address = self._address[entry]
            if kind == _TOR:
                low, high = (self._address[entry - 1] << 2 if entry else 0), address << 2
            elif kind == _NA4:
                low, high = address << 2, (address << 2) + 4
            else:
                ones = (address ^ (address + 1)).bit_length() - 1
                size = 8 << ones
                low = (address >> ones << ones) << 2
                high = low + size
            found.append((low, high, Right(config & 7) if binds else Right.ALL))
        return found

    def rights(self, address: int, size: int = 1, level: Level = Level.MACHINE) -> Right:
        """Return what a level may do with all of `size` bytes at `address`."""
        for low, high, right in self.areas(level):
            if low < address + size and address < high:
                return right if low <= address and address + size <= high else Right.NONE
        return Right.ALL if level is Level.MACHINE else Right.NONE

    def pieces(self, low: int, high: int, level: Level = Level.MACHINE) -> list[tuple[int, int, Right]]:
        """Cut [low, high) where rights change, and return the pieces with their rights."""
        cuts = {low, high}
        for start, end, _ in self.areas(level):
            cuts |= {cut for cut in (start, end) if low < cut < high}
        edges = sorted(cuts)
        merged: list[tuple[int, int, Right]] = []
        for start, end in pairwise(edges):
            right = self.rights(start, level=level)
            if merged and merged[-1][2] == right:
                merged[-1] = (merged[-1][0], end, right)
            else:
                merged.append((start, end, right))
        return merged


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
EBREAK = 0x00100073
FENCE_I, FENCE = 0x0000100F, 0x0FF0000F
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
        if word in (MRET, FENCE_I, FENCE) or (access is not None and access.csr in OURS | INTERRUPTS):
            yield base + at
