"""The one function that the emulator calls before every basic block: it counts instructions and knows when to stop.

It is compiled by numba, because a callback in Python would cost a hundred times as much as the block itself. All it
knows lies in one page of integers per hart (`Slot`), which stands in the same allocation as the memories of the
machine, so that it can also look at the instructions that it counts.
"""

from __future__ import annotations

import ctypes
from enum import IntEnum
from functools import cache
from typing import Any

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
    FIRST_WATCHED = 16
    FIRST_REGION = 16 + MAX_WATCHED  # base, end and offset from the page, for every memory
    FIRST_KNOWN = 16 + MAX_WATCHED + 3 * MAX_REGIONS  # address, and size << 32 | number of instructions


@cache
def block_hook() -> Any:
    """Return the compiled callback, of the form that ``UC_HOOK_BLOCK`` asks for."""
    import numba
    import numpy as np
    from llvmlite import binding
    from unicorn import unicorn_py3

    binding.add_symbol("uc_emu_stop", ctypes.cast(unicorn_py3.unicorn.uclib.uc_emu_stop, ctypes.c_void_p).value)
    stop = numba.types.ExternalFunction("uc_emu_stop", numba.int32(numba.types.voidptr))
    # The compiler freezes plain integers into the code; it does not know enumerations.
    count, limit, block, extent, once, hit, watched, regions, span, full = (slot.value for slot in list(Slot)[:10])
    first_watched, first_region, first_known = 16, Slot.FIRST_REGION.value, Slot.FIRST_KNOWN.value
    known, words = KNOWN, HEADER // 8

    def before_block(engine, address, size, data):  # type: ignore[no-untyped-def] # noqa: ANN001, ANN202
        page = numba.carray(data, (words,), np.int64)  # type: ignore[attr-defined]
        at = np.int64(address)
        if page[count] >= page[limit]:
            page[full] = 1
            stop(engine)
            return
        if at != page[once]:
            for i in range(page[watched]):
                if page[first_watched + i] == at:
                    page[hit] = at
                    stop(engine)
                    return
        page[once] = -1
        page[block] = at
        page[extent] = size
        place = first_known + 2 * ((at >> 1) & (known - 1))
        if page[place] == at and page[place + 1] >> 32 == size:
            page[count] += page[place + 1] & 0xFFFFFFFF
            return
        memory = numba.carray(data, (page[span],), np.uint8)  # type: ignore[attr-defined]
        for i in range(page[regions]):
            entry = first_region + 3 * i
            if page[entry] <= at < page[entry + 1]:
                position = page[entry + 2] + at - page[entry]
                end = min(position + np.int64(size), page[span])
                number = 0
                while position < end:
                    position += 4 if memory[position] & 3 == 3 else 2
                    number += 1
                page[count] += number
                page[place] = at
                page[place + 1] = np.int64(size) << 32 | number
                break

    form = numba.void(numba.types.voidptr, numba.uint64, numba.uint32, numba.types.voidptr)
    return numba.cfunc(form, cache=True)(before_block)


def install(engine: Any, page: int) -> None:
    """Have the emulator call the compiled callback before every block, with the hart's `page` (a host address)."""
    from unicorn import UC_HOOK_BLOCK, UcError, unicorn_py3

    handle = ctypes.c_size_t()
    status = unicorn_py3.unicorn.uclib.uc_hook_add(
        engine._uch,  # noqa: SLF001 - the binding takes Python callbacks only; its library takes any
        ctypes.byref(handle),
        UC_HOOK_BLOCK,
        ctypes.c_void_p(block_hook().address),
        ctypes.c_void_p(page),
        ctypes.c_uint64(1),
        ctypes.c_uint64(0),
    )
    if status:
        raise UcError(status)
