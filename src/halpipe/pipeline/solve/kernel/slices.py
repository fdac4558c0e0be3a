"""The kernel in slices, so that progress shows and Ctrl-C is answered; the outcome does not depend on their size."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from halpipe.pipeline.solve.kernel.kernel import BEST, FROZEN, INSERTED, MOVES, State, anneal, gumbel_table, total_cost

if TYPE_CHECKING:
    from halpipe.pipeline.solve.checkpoint import Kept
    from halpipe.pipeline.solve.problem import Arrays


SLICE_WORK = 20_000
"""Placements of single jobs per slice, roughly: small enough to answer Ctrl-C at once."""

FIRST_STAGE = "groups"
"""Name of the stage of a search in which the units of a group are one lane."""

OnSlice = Callable[[int, int], bool]
"""Called between slices with moves made and best cost so far (-1: still constructing); False stops the search."""


def run(arrays: Arrays, state: State, budget: int, on_slice: OnSlice, kept: Kept | None = None) -> bool:
    """Continue from a state until the cost is zero, out of moves, or told to stop (then True)."""
    register = state.register
    if register[FROZEN] == len(arrays.entry_offset):
        register[BEST] = total_cost(arrays, state)
        return False
    noise, is_stopped = gumbel_table(), False
    size = max(1, SLICE_WORK * len(arrays.entry_offset) // (20 * len(arrays.job_task)))
    while register[MOVES] < budget and not is_stopped:
        cost = anneal(arrays, state, noise, min(size, budget - register[MOVES]))
        is_whole = register[INSERTED] == len(arrays.entry_offset)
        if is_whole and cost == 0:
            break
        is_stopped = not on_slice(register[MOVES], register[BEST] if is_whole else -1)
        if kept is not None:
            kept.keep(state, now=False)
    if kept is not None:
        kept.keep(state, now=True)
    return is_stopped
