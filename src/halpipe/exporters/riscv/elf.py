"""Minimal ELF reader: bytes to load with their addresses, and symbols."""

from __future__ import annotations

import io
from collections import Counter
from typing import TYPE_CHECKING, Any

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Iterator


@record
class Segment:
    """Bytes to load: at `offset` in the file, stored at `source` in main memory, executed or used at `target`."""

    offset: int
    source: int
    target: int
    size: int


@record
class Symbol:
    """A symbol's address and size in bytes; `is_unique` is False where several have its name."""

    address: int
    size: int
    is_unique: bool = True


@record
class Elf:
    """Loadable segments that are not empty, as they lie in main memory, and the symbols by name."""

    segments: tuple[Segment, ...]
    symbols: dict[str, Symbol]
    reserving: tuple[int, ...] = ()
    """Addresses of lr and sc in the code."""

    def address(self, name: str) -> int:
        """Return the address of a symbol that the linker script defines."""
        return self.symbols[name].address

    @property
    def stored(self) -> int:
        """How many bytes of main memory the image takes, from its first to its last."""
        if not self.segments:
            return 0
        return max(s.source + s.size for s in self.segments) - min(s.source for s in self.segments)


def read_elf(data: bytes) -> Elf:
    """Read a file that our own linker wrote."""
    from elftools.elf.elffile import ELFFile

    file = ELFFile(io.BytesIO(data))
    found = (
        Segment(header["p_offset"], header["p_paddr"], header["p_vaddr"], header["p_filesz"])
        for header in file.iter_segments("PT_LOAD")
        if header["p_filesz"]
    )
    segments = tuple(sorted(found, key=lambda segment: segment.source))
    symbols: dict[str, Symbol] = {}
    table: Any = file.get_section_by_name(".symtab")
    named = [s for s in table.iter_symbols() if s.name and s["st_shndx"] != "SHN_UNDEF"] if table else []
    counts = Counter(s.name for s in named)
    for symbol in named:
        symbols[symbol.name] = Symbol(symbol["st_value"], symbol["st_size"], counts[symbol.name] == 1)
    text = file.get_section_by_name(".text")
    return Elf(segments, symbols, tuple(_reserving(text.data(), text["sh_addr"])) if text else ())


_ATOMIC, _FUNCTIONS = 0x2F, (2, 3)  # lr and sc among the atomic operations


def _reserving(code: bytes, base: int) -> Iterator[int]:
    at = 0
    while at + 2 <= len(code):
        word = int.from_bytes(code[at : at + 4], "little")
        if word & 0x7F == _ATOMIC and word >> 27 in _FUNCTIONS:
            yield base + at
        at += 4 if word & 3 == 3 else 2
