"""Transfers on a target without DMA engine, where the management core copies: seen from its loads and stores.

A copy is a row of loads from and stores to adjacent addresses. It may be interrupted by other work of the management
core and go on later, so it is over only when that core has nothing to do, or starts the core whose scratchpads were
filled.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.deploy.riscv.board.dma import Transfer

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.deploy.riscv.board.memory import Memory

UNKNOWN = -1
"""The channel of copies: whatever resource they are for, one core does them all."""


class CopyWatcher:
    """Puts loads and stores together to transfers; `begins` and `ends` hear of each."""

    def __init__(self, memory: Memory, begins: Callable[[Transfer], None], ends: Callable[[Transfer], None]) -> None:
        self._memory = memory
        self._begins, self._ends = begins, ends
        self._open: list[Transfer] = []
        self._loaded: tuple[Transfer, int] | None = None  # of which transfer something was loaded last, and how much

    def loads(self, address: int, size: int, now: int) -> None:
        """The management core is about to load: the beginning of a copy, or more of one."""
        known = next((t for t in self._open if t.source + t.size == address), None)
        if known is None:
            known = Transfer(UNKNOWN, address, 0, 0, now, now)
            self._begins(known)
        self._loaded = (known, size)

    def stores(self, address: int, size: int, now: int) -> None:
        """The management core is about to store what it has loaded; other stores are none of ours."""
        if self._loaded is None or self._loaded[1] != size:
            return
        transfer, _ = self._loaded
        self._loaded = None
        if not transfer.size:
            transfer.target = address
            self._open.append(transfer)
        elif transfer.target + transfer.size != address:
            return
        transfer.size += size
        transfer.end = now

    def finish(self, now: int, hart: int | None = None) -> None:
        """All copies are over, or those into the scratchpads of one `hart`."""
        for transfer in list(self._open):
            region = self._memory.region(transfer.target)
            if hart is None or (region is not None and region.hart == hart):
                self._open.remove(transfer)
                transfer.end = now
                transfer.data = self._memory.read(transfer.target, transfer.size)
                self._ends(transfer)
