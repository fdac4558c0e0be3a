"""Annealer, packing and exact engine take turns on one mode, each with more work every time.

Each has sets that cost it an instant and the others for ever: the annealer large ones with room, packing those in which
tasks share room and no more, the exact engine small ones that leave nothing idle. Turns are counted in moves, fillings
and CP-SAT's own count of work, so that who answers depends on the model and the options alone, however many processors
there are.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.pipeline.solve.checkpoint import SAVED

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from halpipe.models import Job
    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.kernel.run_in_slices import Keeper
    from halpipe.pipeline.solve.kernel.search import Outcome
    from halpipe.pipeline.solve.kernel.state import State

FIRST_SHARE = 64
"""The annealer's first turn is this part of its least budget."""

FIRST_WORK = 1
"""Deterministic seconds of the exact engine in its first turn, which is the second of the others."""

FIRST_FILLINGS = 50
"""Fillings that packing tries in its first turn."""

FASTER = 4
"""How many times as much a turn is as the one before."""


@record
class Turn:
    """One turn of all: the moves that the annealer has made after it, fillings, and work of the exact engine."""

    number: int
    moves: int
    fillings: int
    work: int


def turns(least: int, budget: int) -> Iterator[Turn]:
    """Yield the turns; with a budget above `least`, which is that of a time limit, they go on and on."""
    moves, number, scale = max(1, least // FIRST_SHARE), 0, 1
    while True:
        work = FIRST_WORK * scale // FASTER if number else 0
        yield Turn(number, min(moves * scale, budget), FIRST_FILLINGS * scale, work)
        if moves * scale >= budget:
            return
        number, scale = number + 1, scale * FASTER


def relay(
    look: Callable[[int], Outcome],
    others: Mapping[str, Callable[[Outcome, Turn], tuple[Job, ...] | None]],
    least: int,
    budget: int,
) -> tuple[Outcome, str, tuple[Job, ...]]:
    """Let all take turns; return what the annealer came to, and the name and the jobs of another one that succeeded.

    `look` goes on to so many moves in all; the others are asked in their order.
    """
    outcome: Outcome | None = None
    for turn in turns(least, budget):
        outcome = look(turn.moves)
        if outcome.cost == 0 or outcome.stopped:
            break
        for name, ask in others.items():
            jobs = ask(outcome, turn)
            if jobs is not None:
                return outcome, name, jobs
    assert outcome is not None, "there is at least one turn"
    return outcome, "", ()


@dataclass(slots=True)
class Memory:
    """A keeper that remembers every search at the end of its turn, for the next; saving is left to another one."""

    saver: Keeper | None = None
    _states: dict[str, dict[str, Ints]] = field(default_factory=dict)

    def restore(self, key: str, state: State) -> None:
        """Fill a fresh state with what is remembered of it, or was saved."""
        if key in self._states:
            for name, values in self._states[key].items():
                getattr(state, name)[:] = values
        elif self.saver is not None:
            self.saver.restore(key, state)

    def keep(self, key: str, state: State, *, now: bool) -> None:
        """Remember a state at the end of its turn."""
        if now:
            self._states[key] = {name: getattr(state, name)[:] for name in SAVED}
        if self.saver is not None:
            self.saver.keep(key, state, now=now)

    def note(self, key: str, facts: Mapping[str, Ints]) -> None:
        """Save the outcome of a stage that is over, which no later turn comes to again."""
        if self.saver is not None:
            self.saver.note(key, facts)

    def noted(self, key: str) -> Mapping[str, Ints] | None:
        """Return such an outcome."""
        return None if self.saver is None else self.saver.noted(key)
