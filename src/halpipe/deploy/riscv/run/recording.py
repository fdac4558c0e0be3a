"""The runtime's own record of a run, as it lies in main memory: what a board can tell of it."""

from __future__ import annotations

import struct
from enum import IntEnum, IntFlag
from typing import TYPE_CHECKING

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.core.diagnostics import HalpipeError
    from halpipe.deploy.riscv.target import Ring

_RECORD = struct.Struct("<QQQIIIIIBBBx")
_FAULT = struct.Struct("<QQQQIIIIIBBH8x")
_WORDS, _STATE, _TRACED, _FAULTS = 16, 9, 13, 14  # of the control block


class Kind(IntEnum):
    """What a record is about."""

    TABLE = 0
    COPY = 1
    DONE = 2
    RUN = 3
    STOP = 4
    HEALTH = 5
    INPUT = 6
    OUTPUT = 7


class Flag(IntFlag):
    """What was wrong with an operation."""

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
    hart: int
    flags: Flag


@record
class Recording:
    """What the rings hold; `lost` records were overwritten by later ones."""

    records: tuple[Record, ...]
    abandoned: tuple[Abandoned, ...]
    lost: int


def read_recording(
    read: Callable[[int, int], bytes], trace: Ring, traced: int, faults: Ring, abandoned: int
) -> Recording:
    """Read both rings; `read` gives bytes at an address, `traced` and `abandoned` are the counts ever written."""
    records = tuple(_record(raw) for raw in _ring(read, trace, traced))
    found = tuple(_abandoned(raw) for raw in _ring(read, faults, abandoned))
    lost = max(traced - trace.capacity, 0) + max(abandoned - faults.capacity, 0)
    return Recording(records, found, lost)


def _record(raw: bytes) -> Record:
    time, begin, end, cycle, table, release, program, operation, kind, flags, unit = _RECORD.unpack(raw)
    return Record(time, begin, end, cycle, table, release, operation, kind, Flag(flags), program, unit + 1)


def _abandoned(raw: bytes) -> Abandoned:
    time, cause, epc, tval, cycle, table, release, program, _, _, flags, hart = _FAULT.unpack(raw)
    return Abandoned(time, cause, epc, tval, cycle, table, release, program, hart, Flag(flags))


def _ring(read: Callable[[int, int], bytes], ring: Ring, count: int) -> list[bytes]:
    first = max(count - ring.capacity, 0)
    return [read(ring.base + i % ring.capacity * ring.record, ring.record) for i in range(first, count)]


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
    if "end" not in lines or len(words["control"]) != 1 or len(words["control"][0]) < _WORDS * 8 or sizes:
        raise broken
    control = struct.unpack_from(f"<{_WORDS}Q", words["control"][0])
    state, traced, abandoned = control[_STATE], control[_TRACED], control[_FAULTS]
    records = tuple(_record(raw) for raw in words["trace"])
    found = tuple(_abandoned(raw) for raw in words["fault"])
    return Recording(records, found, traced - len(records) + abandoned - len(found)), state
