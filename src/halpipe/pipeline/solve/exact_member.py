"""The exact engine as a part of scheduling: alone where it is asked for, else after a search that has found nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Exit, HalpipeError, about
from halpipe.pipeline.parts import is_exact_model
from halpipe.pipeline.solve.codes import (
    EXACT_INFEASIBLE,
    EXACT_TICK,
    EXACT_TOO_LARGE,
    EXACT_WHOLE,
    INTERRUPTED,
    NOT_FOUND,
)
from halpipe.pipeline.solve.exact import Answer, Effort, is_small, solve_exact

if TYPE_CHECKING:
    from halpipe.core.durations import Duration
    from halpipe.models import Job, TaskModel
    from halpipe.pipeline.jobs import Expansion


def solve_alone(model: TaskModel, expansion: Expansion, tick: Duration | None, effort: Effort) -> tuple[Job, ...]:
    """Let the exact engine decide; without a schedule there is no placement to go on from, so that this stops all."""
    mode = expansion.mode
    path = about(mode=mode.name)
    if not is_exact_model(model):
        raise HalpipeError(EXACT_WHOLE("cannot schedule this model", at=mode.at, path=path, help="use --engine anneal"))
    if tick is not None:
        raise HalpipeError(EXACT_TICK("cannot compute with a tick of its own", path=path, help="omit --tick"))
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
