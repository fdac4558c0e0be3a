"""The one function that the emulator calls before every basic block: it counts instructions and knows when to stop.

It is written in C (`native/block.c`), because a callback in Python would cost a hundred times as much as the block
itself. All it knows lies in one page of integers per hart (`Slot`), which stands in the same allocation as the memories
of the machine, so that it can also look at the instructions that it counts.
"""

from __future__ import annotations

import ctypes
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any

from halpipe.core.libraries import library

HEADER = 16384
"""Bytes of the page of integers that each hart has."""

MAX_WATCHED = 64
MAX_REGIONS = 136
KNOWN = 512
"""Blocks of which the number of instructions is remembered, by address; a power of two."""


class Slot(IntEnum):
    """Where in its page a hart keeps what; the lists of watched addresses and of memories follow."""

    COUNT = 0  # instructions that were begun
    LIMIT = 1  # stop before the first block at or beyond this count
    BLOCK = 2  # address of the block that was begun last, -1 for none
    SIZE = 3  # its size in bytes
    PASS = 4  # a watched address at which not to stop once, -1 for none
    HIT = 5  # the watched address at which it stopped, -1 for none
    WATCHED = 6  # number of watched addresses
    REGIONS = 7  # number of memories
    SPAN = 8  # bytes from the page to the end of the last memory
    FULL = 9  # 1 if it stopped at the limit
    STOP = 10  # address of the emulator's function that stops it
    MISALIGNED = 11  # the address of an access that is not aligned, -1 for none
    STORES = 12  # 1 if that is a store
    WEIGHT = 13  # what a load or store counts beyond one
    FIRST_WATCHED = 16
    FIRST_REGION = 16 + MAX_WATCHED  # base, end and offset from the page, for every memory
    FIRST_KNOWN = 16 + MAX_WATCHED + 3 * MAX_REGIONS  # address, and size << 32 | number of instructions


def is_access(half: int) -> bool:
    """Whether an instruction loads or stores, by its first two bytes."""
    if half & 3 == 3:
        return half & 0x7F in (0x03, 0x07, 0x23, 0x27, 0x2F)
    return half & 3 != 1 and half >> 13 & 7 not in (0, 4)


@cache
def _function(name: str) -> int:
    """Return the address of a callback in the library."""
    native = library(Path(__file__).parent / "native", "block")
    return ctypes.cast(native[name], ctypes.c_void_p).value or 0


def install(engine: Any, page: int, *, is_strict: bool) -> None:
    """Have the emulator call the compiled callbacks with the hart's `page` (a host address).

    Before every block; and where it `is_strict`, before every load and store, to find those that are not aligned.
    """
    from unicorn import UC_HOOK_BLOCK, UC_HOOK_MEM_READ, UC_HOOK_MEM_WRITE, unicorn_py3

    stop = ctypes.cast(unicorn_py3.unicorn.uclib.uc_emu_stop, ctypes.c_void_p).value or 0
    ctypes.c_int64.from_address(page + 8 * Slot.STOP).value = stop
    _hook(engine, UC_HOOK_BLOCK, _function("halpipe_before_block"), page)
    if is_strict:
        _hook(engine, UC_HOOK_MEM_READ | UC_HOOK_MEM_WRITE, _function("halpipe_before_access"), page)


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
