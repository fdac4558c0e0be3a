"""The runtime's own record of a run, as memory, dumps or serial output of a board hold it."""

from __future__ import annotations

import re
import struct
from enum import IntEnum, IntFlag
from typing import TYPE_CHECKING, Protocol

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.records import record
from halpipe.deploy.riscv.codes import NO_RECORDING
from halpipe.deploy.riscv.target import Ring, Site, read_site

if TYPE_CHECKING:
    from halpipe.core.bundles import Bundle

_RECORD = struct.Struct("<QQQIIIIIBBBx")
_FAULT = struct.Struct("<QQQQIIIIIBBH8x")


class Word:
    """Words of the control block."""

    REQUEST, STATE, BASE, PLAYED, TABLE, TRACED, FAULTS, REFUSED = range(8, 16)
    CAUSE, EPC = 16, 17  # of a trap of the management core
    WORDS = 18


class Kind(IntEnum):
    """Subject of a record."""

    TABLE = 0
    COPY = 1
    DONE = 2
    RUN = 3
    STOP = 4
    HEALTH = 5
    INPUT = 6
    OUTPUT = 7


class Flag(IntFlag):
    """Fault of an operation."""

    LATE = 1
    OVERRUN = 2
    FAULT = 4
    SKIPPED = 8
    STUCK = 16
    REFUSED = 32
    ERROR = 64


MEANING = {
    Flag.LATE: "transfer not complete in time",
    Flag.OVERRUN: "execution not over in time",
    Flag.FAULT: "the job trapped",
    Flag.STUCK: "the core did not answer",
    Flag.ERROR: "the DMA engine reported an error",
}


@record
class Record:
    """One operation of the runtime; instants in ticks from the beginning of the run."""

    time: int
    begin: int
    end: int
    cycle: int
    table: int
    release: int
    operation: int
    kind: int
    flags: Flag
    program: int
    hart: int = 0


@record
class Abandoned:
    """A job that the runtime gave up."""

    time: int
    cause: int
    epc: int
    tval: int
    cycle: int
    table: int
    release: int
    program: int
    operation: int
    kind: int
    hart: int
    flags: Flag


@record
class Recording:
    """Contents of the rings; `lost` records were overwritten by later ones."""

    records: tuple[Record, ...]
    abandoned: tuple[Abandoned, ...]
    lost: int


class Memory(Protocol):
    """Main memory of a board, simulated or dumped."""

    def read(self, address: int, size: int) -> bytes:
        """Return `size` bytes at `address`."""
        ...

    def word(self, address: int) -> int:
        """Return the 64-bit word at `address`."""
        return int.from_bytes(self.read(address, 8), "little")


def read_recording(memory: Memory, site: Site) -> Recording:
    """Read both rings from memory, with as many records as the control block counts."""
    # The counts are of a program that may be wrong.
    traced, abandoned = (min(memory.word(site.control + 8 * w), 1 << 32) for w in (Word.TRACED, Word.FAULTS))
    records = tuple(_record(raw) for raw in _ring(memory, site.trace, traced))
    found = tuple(_abandoned(raw) for raw in _ring(memory, site.faults, abandoned))
    lost = max(traced - site.trace.capacity, 0) + max(abandoned - site.faults.capacity, 0)
    return Recording(records, found, lost)


def _record(raw: bytes) -> Record:
    time, begin, end, cycle, table, release, program, operation, kind, flags, unit = _RECORD.unpack(raw)
    return Record(time, begin, end, cycle, table, release, operation, kind, Flag(flags), program, unit + 1)


def _abandoned(raw: bytes) -> Abandoned:
    time, cause, epc, tval, cycle, table, release, program, operation, kind, flags, hart = _FAULT.unpack(raw)
    return Abandoned(time, cause, epc, tval, cycle, table, release, program, operation, kind, hart, Flag(flags))


def _ring(memory: Memory, ring: Ring, count: int) -> list[bytes]:
    first = max(count - ring.capacity, 0)
    return [memory.read(ring.base + i % ring.capacity * ring.record, ring.record) for i in range(first, count)]


def meaning(flags: Flag) -> str:
    """Return what flags say, for people."""
    return ", ".join(text for flag, text in MEANING.items() if flag & flags)


def parse_recording(printed: str, broken: HalpipeError) -> tuple[Recording, int]:
    """Read what the runtime prints at its end, and return it with the state it was in; raise `broken` if it is cut."""
    words: dict[str, list[bytes]] = {"control": [], "trace": [], "fault": []}
    lines = printed.replace("\r", "").splitlines()
    for line in lines:
        name, _, rest = line.partition(" ")
        if name in words:
            try:
                words[name].append(b"".join(int(word, 16).to_bytes(8, "little") for word in rest.split()))
            except (ValueError, OverflowError):
                raise broken from None
    sizes = {len(raw) for raw in words["trace"]} - {_RECORD.size} | {len(raw) for raw in words["fault"]} - {_FAULT.size}
    if "end" not in lines or len(words["control"]) != 1 or len(words["control"][0]) < 8 * Word.CAUSE or sizes:
        raise broken
    control = struct.unpack_from(f"<{Word.CAUSE}Q", words["control"][0])
    state, traced, abandoned = control[Word.STATE], control[Word.TRACED], control[Word.FAULTS]
    records = tuple(_record(raw) for raw in words["trace"])
    found = tuple(_abandoned(raw) for raw in words["fault"])
    return Recording(records, found, traced - len(records) + abandoned - len(found)), state


_STATES = range(1, 6)  # after the boot; see docs/reference/riscv-bundle.md


def read_board(bundle: Bundle, data: bytes, file: str, base: int | None = None) -> Recording:
    """Return what the runtime recorded, from a dump of memory or from what it printed.

    A dump begins at `base`, by default that of main memory. Raise `HalpipeError` if the control block and the rings are
    not in it.
    """
    site = read_site(bundle)
    text = _printed(data)
    if text:
        return parse_recording(text, no_recording(file, "what the runtime printed is cut off"))[0]
    memory = Dump(file, data, site.main.base if base is None else base)
    state = memory.word(site.control + 8 * Word.STATE)
    if state not in _STATES:
        raise no_recording(file, f"the control block at {site.control:#x} says state {state}: no run of this bundle")
    return read_recording(memory, site)


def _printed(data: bytes) -> str:
    """Return what the runtime printed; empty if it is none of that."""
    text = data.decode("ascii", "replace") if data[:4096].isascii() else ""
    return text if re.search(r"^control ", text, re.MULTILINE) else ""


CALIBRATION, MOST_MEASURED = 1024, 100
"""Where the measurements lie behind the control block, their number first, and how many there may be."""

Measured = list[tuple[int, int, int]]
"""Measurements of a runtime before its run: kind, amount and ticks."""


def measurements(memory: Memory, site: Site) -> Measured:
    """Read what the runtime measured from memory; empty where something else stands there."""
    at = site.control + CALIBRATION
    count = memory.word(at)
    rows = range(count if count <= MOST_MEASURED else 0)
    return [struct.unpack("<3Q", memory.read(at + 8 + 24 * i, 24)) for i in rows]


def read_calibration(bundle: Bundle, data: bytes, file: str, base: int | None = None) -> tuple[Recording, Measured]:
    """Return what the runtime recorded, and what it measured before."""
    recording, text, site = read_board(bundle, data, file, base), _printed(data), read_site(bundle)
    if not text:
        return recording, measurements(Dump(file, data, site.main.base if base is None else base), site)
    rows = [line.split()[1:] for line in text.splitlines() if line.startswith("calibration ")]
    if any(len(row) != 3 or not all(re.fullmatch("[0-9a-f]{1,16}", word) for word in row) for row in rows):
        raise no_recording(file, "what the runtime printed of its measurements is cut off")
    return recording, [(int(kind, 16), int(amount, 16), int(ticks, 16)) for kind, amount, ticks in rows]


def no_recording(file: str, message: str) -> HalpipeError:
    """Make the error for what is no record of a run."""
    help = "dump main memory after the run, with OpenOCD: halt; dump_image memory.bin BASE SIZE (main in target.json)"
    return HalpipeError(NO_RECORDING(message, at=Location(file), help=help))


class Dump(Memory):
    """A binary dump of memory that begins at an address."""

    def __init__(self, file: str, data: bytes, base: int) -> None:
        self._file, self._data, self._base = file, data, base

    def read(self, address: int, size: int) -> bytes:
        """Return `size` bytes at `address`; raise `HalpipeError` unless the dump has all of them."""
        at = address - self._base
        if at < 0 or at + size > len(self._data):
            raise no_recording(self._file, f"{size} bytes at {address:#x} are not in the dump")
        return self._data[at : at + size]
