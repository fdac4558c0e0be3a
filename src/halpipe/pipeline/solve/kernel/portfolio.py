"""Several searches of one problem that take turns: the time of a single one has a heavy tail.

The first search runs alone for a while, which is enough for most problems. Then each makes some moves in its turn, the
first as many as all others together. The first to succeed, by turn and number, has won. Who wins does not depend on how
many of them run at the same time; with as many threads as searches, the time is that of the quickest. The kernel runs
in slices, so that progress shows and Ctrl-C is answered; the outcome does not depend on their size.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from halpipe.core.records import record
from halpipe.pipeline.solve.kernel.kernel import BEST, FROZEN, INSERTED, MOVES, State, anneal, gumbel_table, total_cost

if TYPE_CHECKING:
    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.problem import Arrays, Problem
    from halpipe.pipeline.solve.workers import Workers


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
    stopped = advance(problem.arrays, state, budget, on_slice, kept)
    if kept is not None:
        kept.keep(state, now=True)
    return stopped


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


LEAD = 256
"""Moves per task that the first search makes before the others begin."""

TURN = 64
"""Moves per task in one turn of all searches but the first, which makes as many as they do together."""


@record
class Race:
    """Result of the searches: the state of the best one, the moves of all, and whether they were stopped."""

    state: State
    moves: int
    stopped: bool


@dataclass(slots=True)
class _Member:
    """One search; `passed` and `bound` are its moves before and after the turn at hand."""

    number: int
    state: State
    kept: Kept | None
    passed: int = 0
    bound: int = 0
    stopped: bool = False

    @property
    def has_won(self) -> bool:
        """Whether it has succeeded, in this turn or before; a state kept from a later turn does not count yet."""
        return self.state.register[BEST] == 0 and self.moves <= self.bound

    @property
    def moves(self) -> int:
        return self.state.register[MOVES]

    @property
    def is_over(self) -> bool:
        return self.has_won or self.stopped


def race(
    problem: Problem,
    begin: Callable[[int], State],
    budget: int,
    members: int,
    workers: Workers,
    on_slice: OnSlice,
    kept: Kept | None,
) -> Race:
    """Search in at most `budget` moves of all searches together; `begin` returns the fresh state of one of them."""
    tasks = max(1, len(problem.expansion.tasks))
    entries = len(problem.arrays.entry_offset)
    found = _Searches(begin, problem.arrays, on_slice, kept)
    first = found.add()
    if members == 1 or first.state.register[FROZEN] == entries:
        found.turn(workers, [budget])
        return found.outcome()
    lead = min(budget, LEAD * tasks)
    found.turn(workers, [lead])
    left = budget - lead
    shares = [members - 1, *[1] * (members - 1)]
    while left > 0 and not found.over:
        step = min(TURN * tasks, left // sum(shares))
        while len(found.all) < members:
            found.add()
        turn = [share * step for share in shares] if step else [left, *[0] * (members - 1)]
        found.turn(workers, [member.bound + moves for member, moves in zip(found.all, turn, strict=True)])
        left -= sum(turn)
    return found.outcome()


class _Searches:
    """The searches of a race, and how far they are."""

    def __init__(self, begin: Callable[[int], State], arrays: Arrays, on_slice: OnSlice, kept: Kept | None) -> None:
        self._begin = begin
        self._arrays = arrays
        self._on_slice = on_slice
        self._kept = kept
        self._shown: dict[int, tuple[int, int]] = {}
        self.all: list[_Member] = []
        self.over: _Member | None = None

    def add(self) -> _Member:
        """Begin, or go on with, one more search."""
        number = len(self.all)
        kept = self._kept and self._kept.stage(f"groups{number or ''}")
        member = _Member(number, self._begin(number), kept)
        if kept is not None:
            kept.restore(member.state)
        self.all.append(member)
        return member

    def turn(self, workers: Workers, bounds: list[int]) -> None:
        """Let every search run until it has made as many moves as its bound says."""
        for member, bound in zip(self.all, bounds, strict=True):
            member.passed, member.bound = member.bound, bound
        taken = workers.each(self._advance, self.all, lambda member: member.is_over)
        if taken[-1].is_over:
            self.over = taken[-1]

    def _advance(self, member: _Member) -> _Member:
        def on_slice(moves: int, best: int) -> bool:
            self._shown[member.number] = moves, best
            shown = list(self._shown.values())
            constructed = [found for _, found in shown if found >= 0]
            return self._on_slice(sum(made for made, _ in shown), min(constructed, default=-1))

        member.stopped = advance(self._arrays, member.state, member.bound, on_slice, member.kept)
        return member

    def outcome(self) -> Race:
        """Return the winner or the best, and the moves that the searches had made one after the other by then."""
        for member in self.all:
            if member.kept is not None:
                member.kept.keep(member.state, now=True)
        won = self.over is not None and self.over.has_won
        best = self.over if self.over and won else min(self.all, key=lambda m: (m.state.register[BEST], m.number))
        moves = sum(self._counted(member) for member in self.all)
        return Race(best.state, moves, self.over is not None and not won)

    def _counted(self, member: _Member) -> int:
        if self.over is None or member.number == self.over.number:
            return member.moves
        return min(member.moves, member.bound if member.number < self.over.number else member.passed)
