"""The border between Python and the kernel, which is C: how its functions are called, and what they are given.

The kernel sees `Arrays` and `State` as structs of addresses and integers, field by field; a test holds both sides
together. It allocates nothing, and is called without the interpreter's lock.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe.core import libraries
from halpipe.core.libraries import INTEGER, POINTER, address, words

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.kernel.state import State
    from halpipe.pipeline.solve.problem import Arrays

SOURCES = Path(__file__).parent / "native"

COUNTED = {
    "lanes": "lane_capacity", "jobs": "job_task", "entries": "entry_offset", "rows": "row", "chains": "chain_limit",
}  # fmt: skip
"""Lengths that follow the fields of `Arrays`, and the arrays whose they are."""


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
    """Return a function of the library."""
    return libraries.function(SOURCES, "kernel", f"halpipe_{name}")
