"""The border between Python and the kernel, which is C: how its functions are called, and what they are given.

The kernel sees `Arrays` and `State` as structs of addresses and integers, field by field; a test holds both sides
together. It allocates nothing, and is called without the interpreter's lock.
"""

from __future__ import annotations

import ctypes
from array import array
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe.core.libraries import library
from halpipe.pipeline.solve.integers import Table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.kernel.state import State
    from halpipe.pipeline.solve.problem import Arrays

SOURCES = Path(__file__).parent / "native"

COUNTED = {
    "lanes": "lane_capacity", "jobs": "job_task", "entries": "entry_offset", "rows": "row", "chains": "chain_limit",
}  # fmt: skip
"""Lengths that follow the fields of `Arrays`, and the arrays whose they are."""

INTEGER, POINTER = ctypes.c_int64, ctypes.c_void_p


def bound(name: str, arrays: Arrays, state: State) -> Callable[..., int]:
    """Return a function that takes a problem, a state and integers, for many calls that differ by the integers."""
    native, pointers = function(name), _structs(arrays, state)
    return lambda *numbers: int(native(*pointers, *map(INTEGER, numbers)))


def _structs(arrays: Arrays, state: State) -> list[Any]:
    lengths = [len(getattr(arrays, array)) for array in COUNTED.values()]
    return [words([*values(arrays), *lengths]), words(values(state))]


def values(record: Arrays | State) -> list[Any]:
    """Return the values of a record in the order of its fields."""
    return [getattr(record, field.name) for field in fields(record)]


def ask(name: str, arrays: Arrays, state: State, *numbers: int, noise: Ints | None = None) -> int:
    """Call a function that takes a problem, a state, the table of noise if it is given, and integers."""
    pointers = _structs(arrays, state)
    if noise is not None:
        pointers.append(POINTER(address(noise)))
    return int(function(name)(*pointers, *map(INTEGER, numbers)))


def tell(name: str, arrays: Arrays, state: State, *numbers: int, noise: Ints | None = None) -> None:
    """Do the same with a function that returns nothing."""
    ask(name, arrays, state, *numbers, noise=noise)


def function(name: str) -> Any:
    """Return a function of the library; its answer, where there is one, is an integer."""
    native = library(SOURCES, "kernel")[f"halpipe_{name}"]
    native.restype = INTEGER
    return native


def words(members: Iterable[Any]) -> ctypes.Array[ctypes.c_int64]:
    """Return a struct: the addresses of arrays, and integers. It is good as long as the arrays live."""
    values = [member if isinstance(member, int) else address(member) for member in members]
    return (INTEGER * len(values))(*values)


def address(values: Ints | Table) -> int:
    """Return where an array begins; the kernel takes for granted that it is one of 64 bit integers."""
    held = values.flat if isinstance(values, Table) else values
    if not isinstance(held, array) or held.typecode not in "qQ":
        raise TypeError("the kernel takes arrays of 64 bit integers")
    return held.buffer_info()[0]
