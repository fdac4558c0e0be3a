"""Turns of annealer and exact engine on one mode, each with more work every time; and the exact engine alone.

The annealer is quick on large sets with room, the exact engine on small ones that leave nothing idle. Turns are counted
in moves and CP-SAT's own count of work, so the engine that answers depends on the model and the options alone, however
many processors there are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Exit, HalpipeError, about
from halpipe.core.records import record
from halpipe.pipeline.solve.codes import (
    EXACT_ELEMENT,
    EXACT_INFEASIBLE,
    EXACT_TICK,
    EXACT_TOO_LARGE,
    INTERRUPTED,
    NOT_FOUND,
)
from halpipe.pipeline.solve.exact import Answer, Effort, is_preemptive, is_small, solve_exact, unknown_to_exact

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from halpipe.core.durations import Duration
    from halpipe.models import Job, TaskModel
    from halpipe.pipeline.jobs import Expansion
    from halpipe.pipeline.solve.kernel.search import Outcome


FIRST_SHARE = 64
"""The annealer's first turn is this part of its least budget."""

FIRST_WORK = 1
"""Deterministic seconds of the exact engine in its first turn, which is the second of the annealer."""

FEW_JOBS, FEWER = 50, 5
"""Jobs up to which this is so. Of n times as many, the exact engine gets less by this power of n: a deterministic
second takes longer, and the annealer waits for it, which finds larger modes far more often."""

FASTER = 4
"""How many times as much a turn is as the one before."""


@record
class Turn:
    """One turn of all: the moves that the annealer has made after it, and work of the exact engine."""

    number: int
    moves: int
    work: float


def turns(least: int, budget: int, jobs: int) -> Iterator[Turn]:
    """Yield the turns; with a budget above `least`, which is that of a time limit, they continue until it is spent."""
    moves, number, scale = max(1, least // FIRST_SHARE), 0, 1
    while True:
        work = FIRST_WORK * scale * FEW_JOBS**FEWER / (FASTER * max(FEW_JOBS, jobs) ** FEWER) if number else 0
        yield Turn(number, min(moves * scale, budget), work)
        if moves * scale >= budget:
            return
        number, scale = number + 1, scale * FASTER


def relay(
    look: Callable[[int], Outcome],
    solve: Callable[[Outcome, Turn], tuple[Job, ...] | None],
    least: int,
    budget: int,
    jobs: int,
) -> tuple[Outcome, tuple[Job, ...] | None]:
    """Alternate annealer and exact engine; return the outcome of the one, and the jobs of the other if it succeeded.

    `look` continues to so many moves in all; `jobs` are those of the mode.
    """
    outcome: Outcome | None = None
    for turn in turns(least, budget, jobs):
        outcome = look(turn.moves)
        if outcome.cost == 0 or outcome.stopped:
            break
        answer = solve(outcome, turn)
        if answer is not None:
            return outcome, answer
    assert outcome is not None, "there is at least one turn"
    return outcome, None


def solve_alone(model: TaskModel, expansion: Expansion, tick: Duration | None, effort: Effort) -> tuple[Job, ...]:
    """Let the exact engine decide; without a schedule there is no placement to go on from, so that this stops all."""
    mode = expansion.mode
    path = about(mode=mode.name)
    unknown = list(unknown_to_exact(model, expansion))
    if unknown:
        help = "use --engine anneal"
        raise HalpipeError(*(EXACT_ELEMENT(f"does not know: {t}", at=at, path=path, help=help) for t, at in unknown))
    if tick is not None:
        raise HalpipeError(
            EXACT_TICK("cannot compute with a tick of its own", path=path, help="omit --tick, or use --engine anneal")
        )
    result = solve_exact(model, mode, effort)
    if result.status is Answer.FEASIBLE:
        return result.jobs
    if result.status is Answer.INFEASIBLE:
        text, help = "the exact engine finds that it has no schedule", "ask `halpipe explain` for the conflict"
        raise HalpipeError(EXACT_INFEASIBLE(text, at=mode.at, path=path, help=help), exit=Exit.NOT_FOUND)
    if result.stopped:
        text, help = "the exact engine was stopped; it has no placement to save", "run it again, or use --engine anneal"
        raise HalpipeError(INTERRUPTED(text, at=mode.at, path=path, help=help), exit=Exit.INTERRUPTED)
    text = "the exact engine found no schedule within its effort, and no proof that there is none"
    if is_preemptive(expansion):
        text = "the exact engine found no schedule without preemption"
    raise HalpipeError(NOT_FOUND(text, at=mode.at, path=path, help="use --engine anneal"), exit=Exit.NOT_FOUND)


def solve_after(model: TaskModel, expansion: Expansion, effort: Effort) -> tuple[Job, ...] | None:
    """Return the jobs of a valid schedule of a small mode, for which a search has found none; None if this does not."""
    if not (effort.work and is_small(expansion)):
        return None
    try:
        result = solve_exact(model, expansion.mode, effort)
    except HalpipeError as failure:
        if [found.code for found in failure.diagnostics] == [EXACT_TOO_LARGE.id]:
            return None
        raise
    return result.jobs if result.status is Answer.FEASIBLE else None
