"""Several searches of one problem that take turns: the time of a single one has a heavy tail.

The first search runs alone for a while, which is enough for most problems. Then each makes some moves in its turn, the
first as many as all others together. Later those of many entries without windows go on as replicas at fixed
temperatures (`tempering.py`), for which the hardest problems ask. Of few entries, the first two then make more than the
others. With windows, a long search is worth no more than a new one. The first to succeed, by turn and
number, has won. Who wins does not depend on how many of them run at the same time; with as many threads as searches,
the time is that of the quickest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.pipeline.solve.kernel.run_in_slices import here
from halpipe.pipeline.solve.kernel.state import BEST, FROZEN, MOVES

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.pipeline.solve.kernel.run_in_slices import Advance, Kept, OnSlice
    from halpipe.pipeline.solve.kernel.state import State
    from halpipe.pipeline.solve.problem import Problem
    from halpipe.pipeline.solve.workers import Workers

LEAD = 256
"""Moves per task that the first search makes before the others begin."""

TURN = 64
"""Moves per task in one turn of all searches but the first, which makes as many as they do together."""

LONG, LONGER, LONG_ONES = 2048, 6, 2
"""Without windows: after so many moves per task of the first, the first two of few entries make six times as many as
others do, and those of many are replicas from then on."""

MANY = 32
"""Entries from which on they are: fewer have cycles that begin hot, which no replica does."""


@record
class Race:
    """What became of the searches: the state of the best one, the moves of all, and whether they were told to stop."""

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
    advancing: Callable[[Problem], Advance] = here,
) -> Race:
    """Search in at most `budget` moves of all searches together; `begin` returns the fresh state of one of them.

    What `advancing` returns for the problem makes the moves, on the threads of `workers`.
    """
    tasks = max(1, len(problem.expansion.tasks))
    entries = len(problem.arrays.entry_offset)
    found = _Searches(begin, advancing(problem), on_slice, kept)
    first = found.add()
    if members == 1 or first.state.register[FROZEN] == entries:
        found.turn(workers, [budget])
        return found.outcome()
    lead = min(budget, LEAD * tasks)
    found.turn(workers, [lead])
    left = budget - lead
    is_linked = len(problem.arrays.row) > 0
    while left > 0 and not found.over:
        is_long = not is_linked and first.bound >= LONG * tasks
        if is_long and entries >= MANY:
            found.temper(workers, tasks, budget)
            break
        shares = [LONGER] * min(LONG_ONES, members) if is_long else [members - 1]
        shares += [1] * (members - len(shares))
        step = min(TURN * tasks, left // sum(shares))
        while len(found.all) < members:
            found.add()
        turn = [share * step for share in shares] if step else [left, *[0] * (members - 1)]
        found.turn(workers, [member.bound + moves for member, moves in zip(found.all, turn, strict=True)])
        left -= sum(turn)
    return found.outcome()


class _Searches:
    """The searches of a race, and how far they are."""

    def __init__(self, begin: Callable[[int], State], advance: Advance, on_slice: OnSlice, kept: Kept | None) -> None:
        self._begin = begin
        self._make_moves = advance
        self._on_slice = on_slice
        self._kept = kept
        self._shown: dict[int, tuple[int, int]] = {}
        self._abandoned = 0
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

    def temper(self, workers: Workers, tasks: int, budget: int) -> None:
        """Go on as replicas, as long as the budget has a whole turn for all.

        All of them are kept together from now on, and each on its own no more.
        """
        from halpipe.pipeline.solve.kernel import tempering

        step = tempering.TURN * tasks
        for member in self.all:
            if member.kept is not None:
                member.kept.keep(member.state, now=True)
                member.kept = None
        while len(self.all) < len(tempering.LADDER):
            number = len(self.all)
            self.all.append(_Member(number, self._begin(number), None))
        budget -= self._abandon(len(tempering.LADDER))
        kept = self._kept and self._kept.stage("replicas")
        replicas = tempering.Replicas([member.state for member in self.all], kept)
        for member in self.all:
            member.bound = member.moves  # those of a run that is gone on with, if one is
        while not self.over and sum(replicas.moves) + step * len(self.all) <= budget:
            self.turn(workers, [moves + step for moves in replicas.moves])
            if not self.over:
                replicas.change_places()
                replicas.keep(now=False)
        if not self.over:
            replicas.keep(now=True)

    def _abandon(self, first: int) -> int:
        """Leave out the searches from the `first` on; return how many moves they have made."""
        moves = sum(member.bound for member in self.all[first:])
        del self.all[first:]
        self._abandoned += moves
        return moves

    def _advance(self, member: _Member) -> _Member:
        def on_slice(moves: int, best: int) -> bool:
            self._shown[member.number] = moves, best
            shown = list(self._shown.values())
            constructed = [found for _, found in shown if found >= 0]
            return self._on_slice(sum(made for made, _ in shown), min(constructed, default=-1))

        member.stopped = self._make_moves(member.state, member.bound, on_slice, member.kept)
        return member

    def outcome(self) -> Race:
        """Return the winner or the best, and the moves that the searches had made one after the other by then."""
        for member in self.all:
            if member.kept is not None:
                member.kept.keep(member.state, now=True)
        won = self.over is not None and self.over.has_won
        best = self.over if self.over and won else min(self.all, key=lambda m: (m.state.register[BEST], m.number))
        moves = self._abandoned + sum(self._counted(member) for member in self.all)
        return Race(best.state, moves, self.over is not None and not won)

    def _counted(self, member: _Member) -> int:
        if self.over is None or member.number == self.over.number:
            return member.moves
        return min(member.moves, member.bound if member.number < self.over.number else member.passed)
