"""The annealing kernel, as Python calls it. What it does is written in C: see `native/kernel.c`.

The kernel sees `Arrays` and `State` as structs of addresses and integers, field by field; a test compares both sides.
It allocates nothing, and is called without the interpreter's lock.
"""

from __future__ import annotations

import struct
from array import array
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe.core import libraries
from halpipe.core.libraries import INTEGER, POINTER, address, words

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.kernel.state import State
    from halpipe.pipeline.solve.problem import Arrays


def anneal(arrays: Arrays, state: State, noise: Ints, moves: int) -> int:
    """Make up to `moves` moves; stop early when the schedule is complete and its cost is zero. Return the cost."""
    return ask("anneal", arrays, state, moves, noise=noise)


def next_temperature(arrays: Arrays, state: State) -> None:
    """Cool linearly to a third within a cycle, then begin another."""
    tell("next_temperature", arrays, state)


def move(arrays: Arrays, state: State, noise: Ints) -> None:
    """Make one heat-bath move and account for its cost: of an entry, or of it and what is tightly linked to it."""
    tell("move", arrays, state, noise=noise)


def load(arrays: Arrays, state: State) -> int:
    """Take the complete placement in `start`, `option` and `phase` as the current one; return its cost.

    What is built up anew after that tries the same times first.
    """
    return ask("load", arrays, state)


def restart(arrays: Arrays, state: State) -> None:
    """Take everything out that is not frozen, to construct it anew; after some cycles, without the hints."""
    tell("restart", arrays, state)


def total_cost(arrays: Arrays, state: State) -> int:
    """Return the cost of a complete placement, from its profiles and windows."""
    return ask("total_cost", arrays, state)


def putting(arrays: Arrays, state: State) -> Callable[[int], object]:
    """Return what enters a job's rectangles into the profiles."""
    return bound("put", arrays, state)


def fitting(arrays: Arrays, state: State) -> Callable[..., int]:
    """Return what places an entry at the first phase in [earliest, last] that costs nothing: the phase, or NEVER."""
    return bound("fit", arrays, state)


def removing(arrays: Arrays, state: State) -> Callable[..., object]:
    """Return what takes an entry out of the profiles."""
    return bound("remove", arrays, state)


def worst_reaction(arrays: Arrays, state: State, chain: int) -> int:
    """Return the worst reaction time, in the best placement, of a chain by number, or NEVER."""
    return ask("worst_reaction", arrays, state, chain)


def worst_age(arrays: Arrays, state: State, chain: int) -> int:
    """Return the worst data age, in the best placement, of a chain by number, or NEVER."""
    return ask("worst_age", arrays, state, chain)


def gather_cluster(arrays: Arrays, state: State, task: int) -> int:
    """List `task` and all that is tightly linked to it in `cluster`; return how many, 0 if they cannot be moved."""
    return ask("gather_cluster", arrays, state, task)


def move_cluster(arrays: Arrays, state: State, noise: Ints, size: int) -> None:
    """Make one heat-bath move of the cluster and account for its cost."""
    tell("move_cluster", arrays, state, size, noise=noise)


def move_swap(arrays: Arrays, state: State, noise: Ints, entry: int) -> bool:
    """Swap an entry with another one, and account for the cost; False if there is none to swap with."""
    return ask("move_swap", arrays, state, entry, noise=noise) != 0


def luby(number: int) -> int:
    """Return the number-th term, from 1 on, of Luby's sequence 1, 1, 2, 1, 1, 2, 4, ..."""
    return int(function("luby")(INTEGER(number)))


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


SIZE = 4096


@cache
def gumbel_table() -> Ints:
    """Return round(1024 * -ln(-ln((i + 1/2) / 4096))) for i in 0..4095.

    The table is a file and not computed here, because logarithms differ in the last digit between maths
    libraries; a test recomputes it with decimal arithmetic.
    """
    data = Path(__file__).with_name("gumbel.i16").read_bytes()
    return array("q", struct.unpack(f"<{SIZE}h", data))
