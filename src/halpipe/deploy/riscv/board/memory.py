"""The memories of the machine, in one allocation of the host: every hart and the DMA engine see the same bytes."""

from __future__ import annotations

import ctypes
import mmap
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.deploy.riscv.board.block_hook import HEADER

if TYPE_CHECKING:
    from collections.abc import Sequence

PAGE = 4096


@record
class Region:
    """A memory at `base`: main, near (the scratchpad of hart 0), or the ispm or dspm of another `hart`."""

    kind: str
    base: int
    size: int
    hart: int = 0

    @property
    def end(self) -> int:
        """The first address behind it."""
        return self.base + self.size

    @property
    def extent(self) -> int:
        """Its size in whole pages."""
        return -(-self.size // PAGE) * PAGE


class Memory:
    """All memories, by address; a page of integers for each of `harts` stands before them (see `block_hook`)."""

    def __init__(self, regions: Sequence[Region], harts: int) -> None:
        self.regions = tuple(regions)
        self._offsets: list[int] = []
        total = harts * HEADER
        for region in self.regions:
            self._offsets.append(total)
            total += region.extent
        self._map = mmap.mmap(-1, total)
        self._bytes = memoryview(self._map)
        self._anchor = ctypes.c_char.from_buffer(self._map)
        self.size = total

    @property
    def host(self) -> int:
        """Address of the allocation in the host."""
        return ctypes.addressof(self._anchor)

    def placed(self) -> list[tuple[Region, int]]:
        """Return every memory with its offset in the allocation."""
        return list(zip(self.regions, self._offsets, strict=True))

    def region(self, address: int, size: int = 1) -> Region | None:
        """Return the memory that holds all of `size` bytes at `address`."""
        return next((r for r in self.regions if r.base <= address and address + size <= r.end), None)

    def view(self, address: int, size: int) -> memoryview | None:
        """Return `size` bytes at `address` to read and write, None if they are not all in one memory."""
        for region, offset in zip(self.regions, self._offsets, strict=True):
            if region.base <= address and address + size <= region.end:
                start = offset + address - region.base
                return self._bytes[start : start + size]
        return None

    def read(self, address: int, size: int) -> bytes:
        """Return `size` bytes at `address`; addresses come from a target that was checked."""
        found = self.view(address, size)
        if found is None:
            raise IndexError(f"no memory of {size} bytes at {address:#x}")
        return bytes(found)

    def write(self, address: int, data: bytes) -> None:
        """Store `data` at `address`, behind the back of the harts."""
        found = self.view(address, len(data))
        if found is None:
            raise IndexError(f"no memory of {len(data)} bytes at {address:#x}")
        found[:] = data

    def word(self, address: int) -> int:
        """Return the 64-bit word at `address`."""
        return int.from_bytes(self.read(address, 8), "little")

    def put_word(self, address: int, value: int) -> None:
        """Store a 64-bit word at `address`."""
        self.write(address, value.to_bytes(8, "little"))
