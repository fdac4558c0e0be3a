"""The kernel in slices, so that progress shows and Ctrl-C is answered; the outcome does not depend on their size."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from halpipe.pipeline.anneal.kernel import anneal, total_cost
from halpipe.pipeline.anneal.noise import gumbel_table
from halpipe.pipeline.anneal.state import BEST, FROZEN, INSERTED, MOVES, State

if TYPE_CHECKING:
    from halpipe.pipeline.problem import Problem

SLICE_WORK = 20_000
"""Placements of single jobs per slice, roughly: small enough to answer Ctrl-C at once."""

OnSlice = Callable[[int, int], bool]
"""Called between slices with moves made and best cost so far (-1: still constructing); False stops the search."""


def run(problem: Problem, state: State, budget: int, on_slice: OnSlice) -> bool:
    """Run the kernel until the cost is zero, out of moves, or told to stop (then True)."""
    noise = gumbel_table()
    entries = len(problem.arrays.entry_offset)
    size = max(1, SLICE_WORK * entries // (20 * max(1, len(problem.arrays.job_task))))
    register = state.register
    if entries == register[FROZEN]:
        register[BEST] = total_cost(problem.arrays, state)
        return False
    while register[MOVES] < budget:
        cost = anneal(problem.arrays, state, noise, min(size, budget - int(register[MOVES])))
        constructed = register[INSERTED] == entries
        if constructed and cost == 0:
            return False
        if not on_slice(int(register[MOVES]), int(register[BEST]) if constructed else -1):
            return True
    return False
