"""The kernel in slices, so that progress shows and Ctrl-C is answered; the outcome does not depend on their size."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Protocol

from halpipe.pipeline.solve.kernel.kernel import anneal, total_cost
from halpipe.pipeline.solve.kernel.noise import gumbel_table
from halpipe.pipeline.solve.kernel.state import BEST, FROZEN, INSERTED, MOVES, State
from halpipe.records import record

if TYPE_CHECKING:
    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.problem import Problem

SLICE_WORK = 20_000
"""Placements of single jobs per slice, roughly: small enough to answer Ctrl-C at once."""

OnSlice = Callable[[int, int], bool]
"""Called between slices with moves made and best cost so far (-1: still constructing); False stops the search."""


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
    stopped = advance(problem, state, budget, on_slice, kept)
    if kept is not None:
        kept.keep(state, now=True)
    return stopped


def advance(problem: Problem, state: State, budget: int, on_slice: OnSlice, kept: Kept | None = None) -> bool:
    """Do the same from the state as it is, without a word to the keeper at the end."""
    noise = gumbel_table()
    entries = len(problem.arrays.entry_offset)
    size = max(1, SLICE_WORK * entries // (20 * max(1, len(problem.arrays.job_task))))
    register = state.register
    if entries == register[FROZEN]:
        register[BEST] = total_cost(problem.arrays, state)
        return False
    while register[MOVES] < budget:
        cost = anneal(problem.arrays, state, noise, min(size, budget - register[MOVES]))
        constructed = register[INSERTED] == entries
        if constructed and cost == 0:
            return False
        if not on_slice(register[MOVES], register[BEST] if constructed else -1):
            return True
        if kept is not None:
            kept.keep(state, now=False)
    return False
