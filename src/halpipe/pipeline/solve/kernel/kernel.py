"""The annealing kernel, as Python calls it, and the state of a search. What it does is in C: see `native/kernel.c`.

The kernel sees `Arrays` and `State` as structs of addresses and integers, field by field; a test compares both sides.
It allocates nothing, and is called without the interpreter's lock. All that changes is in arrays, so that a search can
stop and continue with the same outcome.
"""

from __future__ import annotations

import struct
from array import array
from dataclasses import fields
from enum import IntFlag
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe.core import libraries
from halpipe.core.libraries import INTEGER, POINTER, address, words
from halpipe.core.records import record
from halpipe.pipeline.solve.integers import filled

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.problem import Arrays


NEVER = 1 << 60
"""A cost that nothing reaches."""

# Registers of the search (State.register).
COST = 0
BEST = 1
INSERTED = 2
MOVES = 3
CYCLE = 4
CYCLE_LENGTH = 5
CYCLE_LEFT = 6
HEAT = 7
TEMPERATURE = 8
HOT = 9
FROZEN = 10
REGISTERS = 11

START_HEAT, START_HEAT_WITH_WINDOWS = 24, 40
"""T at the start of a full cycle, in thousandths of the cost of a mean WCET's distance from a window."""

CLUSTER = 8
"""Tasks that may move together, unless they are one body, which moves as a whole."""

FROZEN_HINT = -2
"""Mark of an entry that never moves."""


class Part(IntFlag):
    """Part of the search that can be switched off, to measure its worth; schedules are found with all parts."""

    # Moves other than that of a whole entry.
    MOVE_JOB = 1 << 4
    MOVE_CLUSTER = 1 << 5
    # Places to try other than anywhere.
    AIM_AT_WINDOW = 1 << 6
    AIM_AT_GAP = 1 << 7
    AIM_AT_STEP = 1 << 8
    AIM_NEARBY = 1 << 9
    TRY_HINT = 1 << 10  # where an earlier mode, or an earlier construction, put the task
    SLIDE = 1 << 11  # from a place that is taken to the next that is free
    # Choice of what to move, and how the temperature goes.
    PICK_CONFLICTS = 1 << 12
    HOT_CYCLES = 1 << 13
    RESTARTS = 1 << 14
    # One more of the moves other than that of a whole entry.
    MOVE_SWAP = 1 << 15


ALL_PARTS = Part(-1)


@record
class State:
    """Everything that changes: the placement, the profiles, the conflict list, the generator."""

    start: Ints  # per job, -1 before its insertion
    option: Ints
    phase: Ints  # start less number times period, not wrapped
    step: Ints  # of the profile of each lane: begin, level
    edges: Ints  # breakpoints in use on each lane
    guide: Ints  # per stretch of a lane: the breakpoint, of those of the lane, at its begin or the last before it
    owner: Ints  # rectangles on each lane: begin, length, and job * max_rects + rectangle
    owners: Ints
    owner_at: Ints  # per job and rectangle: its place in `owner`
    hot: Ints  # entries that may be in conflict
    hot_at: Ints  # per entry: its place in `hot`, or -1
    hint: Ints  # per entry: phase to try first at construction, -1 for none, or FROZEN_HINT
    best_start: Ints
    best_option: Ints
    old: Ints  # per job: start, option, phase before the move
    kept: Ints  # per job: start, option, phase of the candidate to keep
    cluster: Ints  # tasks of the move at hand, if it moves several
    register: Ints
    random: array[int]  # not negative
    max_rects: int
    heat: int  # T at the start of a full cycle, 10 fraction bits
    enabled: int  # parts of the search that are on


def new_state(arrays: Arrays, seed: int, mean_wcet: int, enabled: Part = ALL_PARTS) -> State:
    """Return the empty schedule, ready to construct with the parts of the search that are enabled."""
    jobs, entries = len(arrays.job_task), len(arrays.entry_offset)
    lanes = len(arrays.lane_capacity)
    max_rects = max((end - begin for begin, end in pairwise(arrays.rect_first)), default=0) or 1
    step = filled(2 * max(1, arrays.lane_first[-1]))
    for first in arrays.lane_first[:-1]:
        step[2 * (first + 1)] = arrays.hyperperiod
    register = filled(REGISTERS)
    register[BEST] = NEVER
    share = START_HEAT_WITH_WINDOWS if len(arrays.row) else START_HEAT
    heat = max(1, share * 1024 * mean_wcet * arrays.unit_weight // 1000)
    return State(
        start=filled(jobs, -1),
        option=filled(jobs),
        phase=filled(jobs),
        step=step,
        edges=filled(lanes, 1),
        guide=filled(arrays.guide_first[-1]),
        owner=filled(3 * max(1, arrays.owner_first[-1])),
        owners=filled(lanes),
        owner_at=filled(jobs * max_rects),
        hot=filled(entries),
        hot_at=filled(entries, -1),
        hint=filled(entries, -1),
        best_start=filled(jobs, -1),
        best_option=filled(jobs),
        old=filled(3 * jobs),
        kept=filled(3 * jobs),
        cluster=filled(max(CLUSTER, len(arrays.task_period))),
        register=register,
        random=seeded(seed),
        max_rects=max_rects,
        heat=heat,
        enabled=enabled,
    )


def seeded(seed: int) -> array[int]:
    """Return a xorshift64 state for a seed, never zero."""
    mixed = (seed + 1) * 0x9E3779B97F4A7C15 & (2**64 - 1)
    return array("Q", [mixed or 1])


def anneal(arrays: Arrays, state: State, noise: Ints, moves: int) -> int:
    """Make up to `moves` moves; stop early when the schedule is complete and its cost is zero. Return the cost."""
    return ask("anneal", arrays, state, moves, noise=noise)


def load(arrays: Arrays, state: State) -> int:
    """Take the complete placement in `start`, `option` and `phase` as the current one; return its cost.

    What is built up anew after that tries the same times first.
    """
    return ask("load", arrays, state)


def total_cost(arrays: Arrays, state: State) -> int:
    """Return the cost of a complete placement, from its profiles and windows."""
    return ask("total_cost", arrays, state)


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
