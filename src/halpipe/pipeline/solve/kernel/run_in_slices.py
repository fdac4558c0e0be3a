"""The kernel in slices, so that progress shows and Ctrl-C is answered; the outcome does not depend on their size."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Protocol

from halpipe.core.records import record
from halpipe.pipeline.solve.kernel.kernel import anneal, gumbel_table, total_cost
from halpipe.pipeline.solve.kernel.state import BEST, FROZEN, INSERTED, MOVES, State

if TYPE_CHECKING:
    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.problem import Arrays, Problem

SLICE_WORK = 20_000
"""Placements of single jobs per slice, roughly: small enough to answer Ctrl-C at once."""

OnSlice = Callable[[int, int], bool]
"""Called between slices with moves made and best cost so far (-1: still constructing); False stops the search."""

Advance = Callable[["State", int, OnSlice, "Kept | None"], bool]
"""Lets one search of a problem go on until it has made so many moves in all, as `advance` does."""


class Keeper(Protocol):
    """Saves states, and restores those of a run that is continued."""

    def restore(self, key: str, state: State) -> None:
        """Fill a fresh state with what was saved for it, if anything was."""
        ...

    def keep(self, key: str, state: State, *, now: bool) -> None:
        """Save a state: at once, or when it is time."""
        ...

    def note(self, key: str, facts: Mapping[str, Ints]) -> None:
        """Save the outcome of what was kept under `key`, in place of its state."""
        ...

    def noted(self, key: str) -> Mapping[str, Ints] | None:
        """Return such an outcome; None where there is none."""
        ...


@record
class Kept:
    """A keeper and the name under which one search is kept."""

    keeper: Keeper
    key: str

    def stage(self, name: str) -> Kept:
        """Return the same for one stage of the search."""
        return Kept(self.keeper, f"{self.key}/{name}")

    def restore(self, state: State) -> None:
        """Fill a fresh state with what was saved for it, if anything was."""
        self.keeper.restore(self.key, state)

    def keep(self, state: State, *, now: bool) -> None:
        """Save a state: at once, or when it is time."""
        self.keeper.keep(self.key, state, now=now)

    def note(self, facts: Mapping[str, Ints]) -> None:
        """Save the outcome of a finished stage in place of its state."""
        self.keeper.note(self.key, facts)

    def noted(self) -> Mapping[str, Ints] | None:
        """Return the outcome of this stage if it was finished before."""
        return self.keeper.noted(self.key)


def run(problem: Problem, state: State, budget: int, on_slice: OnSlice, kept: Kept | None = None) -> bool:
    """Run the kernel until the cost is zero, out of moves, or told to stop (then True)."""
    if kept is not None:
        kept.restore(state)
    stopped = advance(problem.arrays, state, budget, on_slice, kept)
    if kept is not None:
        kept.keep(state, now=True)
    return stopped


def here(problem: Problem) -> Advance:
    """Return what advances the searches of a problem on the thread that asks for it."""
    return partial(advance, problem.arrays)


def advance(arrays: Arrays, state: State, budget: int, on_slice: OnSlice, kept: Kept | None = None) -> bool:
    """Do the same from the state as it is, without a word to the keeper at the end."""
    noise = gumbel_table()
    size = slice_of(arrays)
    register = state.register
    if register[FROZEN] == len(arrays.entry_offset):
        register[BEST] = total_cost(arrays, state)
        return False
    while register[MOVES] < budget:
        cost = anneal(arrays, state, noise, min(size, budget - register[MOVES]))
        best = best_of(arrays, state)
        if best >= 0 and cost == 0:
            return False
        if not on_slice(register[MOVES], best):
            return True
        if kept is not None:
            kept.keep(state, now=False)
    return False


def slice_of(arrays: Arrays) -> int:
    """Return the moves of one slice."""
    return max(1, SLICE_WORK * len(arrays.entry_offset) // (20 * max(1, len(arrays.job_task))))


def best_of(arrays: Arrays, state: State) -> int:
    """Return the best cost so far, or -1 while there is no whole placement."""
    return state.register[BEST] if state.register[INSERTED] == len(arrays.entry_offset) else -1
