"""As much of ELF as is needed to load programs for RISC-V, and to write one: segments and symbols.

Read here and not by a library, because programs are input: every offset is checked, and what is wrong has a message.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.records import record
from halpipe.deploy.riscv.codes import BROKEN_PROGRAM

if TYPE_CHECKING:
    from collections.abc import Mapping


_LOADED = 1
_EXECUTABLE = 1
_SYMBOLS, _NAMES = 2, 3
_RISCV = 243
_HEADER = struct.Struct("<16sHHIQQQIHHHHHH")
_SEGMENT = struct.Struct("<IIQQQQQQ")
_SECTION = struct.Struct("<IIQQQQIIQQ")
_SYMBOL = struct.Struct("<IBBHQQ")


@record
class Segment:
    """A part that is loaded: `data` lies at `source` (physical) and runs at `target` (virtual)."""

    source: int
    target: int
    data: bytes
    size: int
    is_executable: bool


@record
class Program:
    """An ELF file: where it begins, what of it is loaded, and its symbols with address and size."""

    entry: int
    segments: tuple[Segment, ...]
    symbols: Mapping[str, tuple[int, int]]

    def source(self, address: int) -> int:
        """Return where in main memory lies what runs at an address."""
        parts = (s for s in self.segments if s.target <= address < s.target + len(s.data))
        return next((address - part.target + part.source for part in parts), address)


def read_program(data: bytes, at: Location) -> Program:
    """Read an ELF for RISC-V with 64 bits; raise `HalpipeError` if it is none or ends too early."""
    try:
        return _read(data)
    except (struct.error, ValueError) as failure:
        help = "export the bundle again; edit the model or its sources, not the bundle"
        raise HalpipeError(BROKEN_PROGRAM(f"cannot be read: {failure}", at=at, help=help)) from None


def _read(data: bytes) -> Program:
    header = _HEADER.unpack_from(data)
    magic, machine, entry, segments, sections = header[0], header[2], header[4], header[5], header[6]
    segment_size, segment_count, section_size, section_count = header[9], header[10], header[11], header[12]
    if magic[:6] != b"\x7fELF\x02\x01" or machine != _RISCV:
        raise ValueError("it is no little-endian ELF of 64 bits for RISC-V")
    if segment_size not in (0, _SEGMENT.size) or section_size not in (0, _SECTION.size):
        raise ValueError("its tables have entries of another size")
    loaded = []
    for i in range(segment_count):
        kind, flags, offset, target, source, stored, size, _ = _SEGMENT.unpack(
            _part(data, segments + i * segment_size, _SEGMENT.size)
        )
        if kind == _LOADED and size:
            loaded.append(Segment(source, target, _part(data, offset, stored), size, bool(flags & _EXECUTABLE)))
    return Program(entry, tuple(loaded), _symbols(data, sections, section_count))


def offset_of(data: bytes, target: int, size: int) -> int | None:
    """Return where in a readable ELF file stand the `size` bytes that are used at the virtual address `target`."""
    header = _HEADER.unpack_from(data)
    for i in range(header[10]):
        kind, _, offset, at, _, stored, _, _ = _SEGMENT.unpack_from(data, header[5] + i * _SEGMENT.size)
        if kind == _LOADED and at <= target and target + size <= at + stored:
            return int(offset + target - at)
    return None


def write_program(parts: Mapping[int, bytes], entry: int, symbols: Mapping[str, int]) -> bytes:
    """Return an ELF file that loads each part to its address, with global symbols at addresses."""
    names = b"\0.strtab\0.symtab\0" + b"".join(name.encode() + b"\0" for name in symbols)
    table = bytes(_SYMBOL.size) + b"".join(
        _SYMBOL.pack(names.index(b"\0%s\0" % name.encode()) + 1, 0x10, 0, 0xFFF1, at, 0) for name, at in symbols.items()
    )
    front = _HEADER.size + _SEGMENT.size * len(parts)
    segments, body = b"", b""
    for at, data in parts.items():
        segments += _SEGMENT.pack(_LOADED, 7, front + len(body), at, at, len(data), len(data), 1)
        body += data
    place = front + len(body)
    sections = bytes(_SECTION.size) + _SECTION.pack(1, _NAMES, 0, 0, place, len(names), 0, 0, 1, 0)
    sections += _SECTION.pack(9, _SYMBOLS, 0, 0, place + len(names), len(table), 1, 1, 1, _SYMBOL.size)
    places = entry, _HEADER.size, place + len(names) + len(table)
    sizes = 0, _HEADER.size, _SEGMENT.size, len(parts), _SECTION.size, 3, 1
    head = _HEADER.pack(b"\x7fELF\2\1\1", 2, _RISCV, 1, *places, *sizes)
    return head + segments + body + names + table + sections


def _symbols(data: bytes, sections: int, count: int) -> dict[str, tuple[int, int]]:
    found: dict[str, tuple[int, int]] = {}
    tables = [_SECTION.unpack(_part(data, sections + i * _SECTION.size, _SECTION.size)) for i in range(count)]
    for table in tables:
        if table[1] != _SYMBOLS:
            continue
        if table[6] >= count:
            raise ValueError("its symbols have no names")
        entries = _part(data, table[4], table[5] - table[5] % _SYMBOL.size)
        names = _part(data, tables[table[6]][4], tables[table[6]][5])
        for name, info, _, section, value, size in _SYMBOL.iter_unpack(entries):
            if section and info & 0xF < 3:
                end = names.find(b"\0", name)
                found[names[name:end].decode("ascii", "replace")] = (value, size)
    return found


def _part(data: bytes, offset: int, size: int) -> bytes:
    if offset + size > len(data):
        raise ValueError(f"it ends before byte {offset + size}")
    return data[offset : offset + size]
