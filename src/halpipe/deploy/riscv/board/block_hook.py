"""The function that the emulator calls before every basic block: it counts cycles and knows when to stop.

It is written in C (`native/block.c`), because a callback in Python would cost a hundred times as much as the block
itself. All it knows lies in one struct per hart (`Page`), which stands in the same allocation as the memories
of the machine, so that it can also look at the instructions that it counts.
"""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

from halpipe.core.libraries import library
from halpipe.deploy.riscv.target import CLASSES

HEADER = 32768
"""Bytes of the page of each hart."""

MAX_WATCHED = 64
MAX_REGIONS = 136
KNOWN = 512
"""Blocks of which the cycles are remembered, by address; a power of two."""


INTEGER = ctypes.c_int64


class Region(ctypes.Structure):
    """A memory: its addresses, and its offset from the page."""

    _fields_: ClassVar = [("base", INTEGER), ("end", INTEGER), ("offset", INTEGER)]


class Known(ctypes.Structure):
    """A block that was counted before; -1 for none."""

    _fields_: ClassVar = [
        *(("address", INTEGER), ("count", ctypes.c_uint32)),
        *(("size", ctypes.c_uint16), ("returns", ctypes.c_uint16)),
    ]


class Branch(ctypes.Structure):
    """The address of the block that followed another one, by the end of that."""

    _fields_: ClassVar = [("end", INTEGER), ("next", INTEGER)]


class Page(ctypes.Structure):
    """State that a hart and the callbacks share: `count` cycles, run up to `limit`; -1 stands for no address.

    `block` and `size` are those of the block begun last, `skip` is a watched address to pass once, `hit` the one of the
    stop. The other side is in `native/block.c`, with the meaning of each field; a test compares the two.
    """

    _fields_: ClassVar = [
        *(
            (name, INTEGER)
            for name in ("count", "limit", "block", "size", "skip", "hit", "watching", "memories", "span")
        ),
        ("full", INTEGER),
        ("stop", ctypes.c_void_p),
        *((name, INTEGER) for name in ("misaligned", "stores", "weight", "near", "end")),
        ("cycles", INTEGER * (len(CLASSES) + 1)),
        ("watched", INTEGER * MAX_WATCHED),
        ("region", Region * MAX_REGIONS),
        ("known", Known * KNOWN),
        ("branch", Branch * KNOWN),
    ]

    def forget(self) -> None:
        """Forget all blocks that were counted."""
        ctypes.memset(ctypes.addressof(self.known), 0xFF, ctypes.sizeof(self.known))

    def take_back(self, pc: int) -> None:
        """Take back the instructions from `pc` on of the block that was begun last, since they were not executed."""
        _native().halpipe_take_back(ctypes.byref(self), INTEGER(pc))


@cache
def _native() -> ctypes.CDLL:
    return library(Path(__file__).parent / "native", "block")


def _function(name: str) -> int:
    return ctypes.cast(_native()[name], ctypes.c_void_p).value or 0


def install(engine: Any, page: Page) -> None:
    """Have the emulator call the compiled callbacks with the hart's `page`.

    Before every block, and before every load and store.
    """
    from unicorn import UC_HOOK_BLOCK, UC_HOOK_MEM_READ, UC_HOOK_MEM_WRITE, unicorn_py3

    page.stop = ctypes.cast(unicorn_py3.unicorn.uclib.uc_emu_stop, ctypes.c_void_p).value or 0
    _hook(engine, UC_HOOK_BLOCK, _function("halpipe_before_block"), ctypes.addressof(page))
    _hook(engine, UC_HOOK_MEM_READ | UC_HOOK_MEM_WRITE, _function("halpipe_before_access"), ctypes.addressof(page))


def _hook(engine: Any, kind: int, function: int, page: int) -> None:
    from unicorn import UcError, unicorn_py3

    handle = ctypes.c_size_t()
    status = unicorn_py3.unicorn.uclib.uc_hook_add(
        engine._uch,  # noqa: SLF001 - the binding takes Python callbacks only; its library takes any
        ctypes.byref(handle),
        kind,
        ctypes.c_void_p(function),
        ctypes.c_void_p(page),
        ctypes.c_uint64(1),
        ctypes.c_uint64(0),
    )
    if status:
        raise UcError(status)
