"""Recordings of a board: a memory dump or serial output, converted to a trace for `compare`."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.quantities import format_rational
from halpipe.deploy.riscv.codes import NO_RECORDING
from halpipe.deploy.riscv.run.cosimulation import Word
from halpipe.deploy.riscv.run.recording import Flag, Kind, meaning, parse_recording, read_recording
from halpipe.deploy.riscv.target import read_site

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.bundles import Bundle
    from halpipe.deploy.riscv.run.recording import Record, Recording
    from halpipe.deploy.riscv.target import Site

_LINE = re.compile(r"\s*(?:0x)?([0-9a-fA-F]{4,16}):((?:\s+[0-9a-fA-F]{2,16})+)\s*")
_STATES = range(1, 6)  # after the boot; see docs/reference/riscv-bundle.md
_HEADER = "cycle,mode,task,job,units,start,end"


def read_board(bundle: Bundle, data: bytes, file: str, base: int | None = None) -> Recording:
    """Return what the runtime recorded, from a dump of memory or from what it printed.

    A dump is binary, from `base` on (by default main memory's), or the text that OpenOCD's ``mdb`` to ``mdd`` write.
    Raise `HalpipeError` if the control block and the rings are not in it.
    """
    site = read_site(bundle)
    text = data.decode("ascii", "replace") if data[:4096].isascii() else ""
    if re.search(r"^control ", text, re.MULTILINE):
        return parse_recording(text, _broken(file, "what the runtime printed is cut off"))[0]
    memory = _Sparse(file, text) if _LINE.match(text) else _Flat(file, data, site.main.base if base is None else base)
    state, traced, faults = (memory.word(site.control + 8 * w) for w in (Word.STATE, Word.TRACED, Word.FAULTS))
    if state not in _STATES:
        raise _broken(file, f"the control block at {site.control:#x} says state {state}: no run of this bundle")
    return read_recording(memory.read, site.trace, traced, site.faults, faults)


def board_csv(bundle: Bundle, recording: Recording, file: str) -> bytes:
    """Return the jobs of a recording in the form that `compare` reads: exact nanoseconds from the run's beginning."""
    site, lines = read_site(bundle), [_HEADER]
    try:
        operations = json.loads(bundle.files["operations.json"])
        for start, end, record in sorted(_jobs(recording), key=lambda job: (job[0], job[1], job[2].program)):
            release = operations["tables"][record.table]["releases"][record.release]
            units = " ".join(operations["programs"][record.program]["units"])
            cells = (record.cycle, site.tables[record.table].name, release["task"], release["index"], units)
            lines.append(",".join(map(str, (*cells, _ns(site, start), _ns(site, end)))))
    except (LookupError, TypeError, ValueError):
        raise _broken(file, "a record names a table, a job or a program that the bundle does not have") from None
    return ("\n".join(lines) + "\n").encode()


def told(bundle: Bundle, recording: Recording) -> Iterator[str]:
    """Yield the summary of a recording: how much there is, which jobs failed, which health rules fired."""
    site = read_site(bundle)
    operations: Any = json.loads(bundle.files["operations.json"])
    cycles = {record.cycle for record in recording.records}
    yield f"{len(recording.records)} records of {len(cycles)} tables; {recording.lost} older ones were overwritten"
    for abandoned in recording.abandoned:
        task = operations["programs"][abandoned.program]["task"]
        where = f"cycle {abandoned.cycle}: a job of {task} on hart {abandoned.hart} was abandoned at "
        yield where + f"{site.tick * abandoned.time}: {meaning(abandoned.flags)}"
    for record in recording.records:
        if record.kind == Kind.HEALTH:
            task = operations["programs"][record.program]["task"]
            yield f"cycle {record.cycle}: health rule {record.begin} fired for {task} at {site.tick * record.time}"


def _jobs(recording: Recording) -> Iterator[tuple[int, int, Record]]:
    """Yield when each job began and ended: with its transfers, as far as these took place."""
    found: dict[tuple[int, int, int], list[Record]] = defaultdict(list)
    for record in recording.records:
        if record.kind in (Kind.COPY, Kind.DONE, Kind.RUN, Kind.STOP) and not record.flags & Flag.SKIPPED:
            found[record.cycle, record.table, record.release].append(record)
    for records in found.values():
        last = records[-1]
        end = last.end if last.kind == Kind.STOP and last.end else last.time
        yield min(record.time for record in records), end, records[0]


def _ns(site: Site, tick: int) -> str:
    return format_rational((site.tick * tick).fraction)


def _broken(file: str, message: str) -> HalpipeError:
    help = "dump main memory after the run, with OpenOCD: halt; dump_image memory.bin BASE SIZE (main in target.json)"
    return HalpipeError(NO_RECORDING(message, at=Location(file), help=help))


class _Flat:
    """A binary dump that begins at an address."""

    def __init__(self, file: str, data: bytes, base: int) -> None:
        self._file, self._data, self._base = file, data, base

    def read(self, address: int, size: int) -> bytes:
        at = address - self._base
        if at < 0 or at + size > len(self._data):
            raise _broken(self._file, f"{size} bytes at {address:#x} are not in the dump")
        return self._data[at : at + size]

    def word(self, address: int) -> int:
        return int.from_bytes(self.read(address, 8), "little")


class _Sparse(_Flat):
    """Lines of an address and words, as a debugger prints them; words are little-endian numbers."""

    def __init__(self, file: str, text: str) -> None:
        super().__init__(file, b"", 0)
        self._bytes: dict[int, int] = {}
        for line in text.splitlines():
            found = _LINE.fullmatch(line)
            if found is None:
                continue  # prompts and echoes
            at = int(found[1], 16)
            for word in found[2].split():
                if len(word) % 2:
                    raise _broken(file, f"{word} has an odd number of digits")
                for byte in reversed(bytes.fromhex(word)):
                    self._bytes[at] = byte
                    at += 1

    def read(self, address: int, size: int) -> bytes:
        try:
            return bytes(self._bytes[at] for at in range(address, address + size))
        except KeyError as missing:
            raise _broken(self._file, f"the byte at {missing.args[0]:#x} is not in the dump") from None
