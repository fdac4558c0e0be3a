"""The exact engine: one mode as a constraint program for CP-SAT, every rule of MODEL 3, for small systems.

It starts from the expanded model and shares nothing with the annealer's arrays, so that each can be held against the
other. Its schedules are checked by verify before anyone sees them; "infeasible" is its own word alone, which `explain`
turns into a set of tasks and constraints that can be looked at.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from halpipe.diagnostics import Exit, HalpipeError
from halpipe.models import ModeSchedule, Schedule, Status
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.codes import EXACT_MISSING, EXACT_TOO_LARGE, EXACT_WRONG
from halpipe.pipeline.solve.limits import DEFAULT_WORK
from halpipe.pipeline.solve.workers import watched

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from halpipe.models import Chain, Job, Mode, TaskModel
    from halpipe.pipeline.jobs import Expansion

MAX_JOBS = 2_000
MAX_PARTS = 200_000
"""Jobs, and pieces of the program they become, up to which a mode is taken; larger ones are for the annealer."""

MAX_TICKS = 2**36
"""Ticks of a hyperperiod: products with job counts and bounds must stay within 64 bits."""


class Answer(StrEnum):
    """What the exact engine says; `UNKNOWN` when its effort is spent."""

    FEASIBLE = "feasible"
    INFEASIBLE = "infeasible"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class ExactResult:
    """The answer for one mode, with the jobs of a valid schedule where there is one.

    `stopped` tells that the answer is unknown because the caller wanted no more.
    """

    status: Answer
    jobs: tuple[Job, ...] = ()
    stopped: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """How hard CP-SAT tries.

    - `work` is its deterministic time, about a second each; None for no bound.
    - `clock` is a limit in seconds of the clock (0: none), for which the answer depends on the machine.
    - `workers` are its threads: one gives the same answer on every machine, several do not.
    - `go_on` is asked several times a second; once it says no, CP-SAT stops.
    """

    work: float | None = DEFAULT_WORK
    clock: float = 0
    workers: int = 1
    seed: int = 1
    go_on: Callable[[], bool] = lambda: True


PLAIN = Effort()


def solve_exact(model: TaskModel, mode: Mode, effort: Effort = PLAIN) -> ExactResult:
    """Decide whether `mode` of a validated model has a valid schedule.

    Raise `HalpipeError` where OR-Tools is not installed, where the mode is too large, or where verify refuses the
    schedule found (a bug).
    """
    expansion = expand(model, mode)
    result = solve_expansion(model, expansion, effort)
    if result.status is Answer.FEASIBLE:
        _check(model, expansion, result.jobs)
    return result


def solve_expansion(
    model: TaskModel,
    expansion: Expansion,
    effort: Effort = PLAIN,
    *,
    chains: Sequence[Chain] | None = None,
) -> ExactResult:
    """Solve an expanded mode, or a part of one; of `chains` (the model's) those count whose tasks are all in it.

    Nothing is verified here: a part of a mode keeps the hyperperiod of the whole, which verify would not accept.
    """
    if not expansion.tasks:  # what is left of a mode whose one task is left out: there is no grid to stand on
        return ExactResult(Answer.FEASIBLE)
    cp_model = _solver_library(expansion)
    from halpipe.pipeline.solve.exactmodel import build

    program = build(cp_model, expansion, model, model.chains if chains is None else chains, MAX_PARTS)
    if program is None:
        raise _too_large(expansion, f"needs more than {MAX_PARTS} variables and intervals")
    solver = cp_model.CpSolver()
    _set(solver.parameters, effort)
    status, is_stopped = watched(lambda: solver.solve(program.cp), effort.go_on, solver.stop_search)
    if status in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return ExactResult(Answer.FEASIBLE, tuple(program.jobs(solver)))
    if status == cp_model.INFEASIBLE:
        return ExactResult(Answer.INFEASIBLE)
    return ExactResult(Answer.UNKNOWN, stopped=is_stopped)


def _set(parameters: Any, effort: Effort) -> None:
    parameters.num_workers = effort.workers
    parameters.random_seed = effort.seed
    if effort.work is not None:
        parameters.max_deterministic_time = effort.work
    if effort.clock:
        parameters.max_time_in_seconds = effort.clock
    parameters.catch_sigint_signal = False  # Ctrl-C is for whoever is behind `go_on`
    parameters.symmetry_level = 0  # the program has its own, and the detection of OR-Tools 9.15 fails on some models


def is_small(expansion: Expansion) -> bool:
    """Tell whether a mode is of a size for this engine."""
    from halpipe.pipeline.solve.exactmodel import exact_tick

    return expansion.job_count <= MAX_JOBS and expansion.hyperperiod // exact_tick(expansion) <= MAX_TICKS


def is_installed() -> bool:
    """Tell whether OR-Tools is there."""
    from importlib.util import find_spec

    return find_spec("ortools") is not None


def _solver_library(expansion: Expansion) -> Any:
    """Import CP-SAT, or say how to get it, and refuse what is too large for it."""
    if not is_installed():
        raise HalpipeError(
            EXACT_MISSING("OR-Tools is not installed", help="install it: pip install 'halpipe[exact]'"),
        )
    if not is_small(expansion):
        raise _too_large(
            expansion, f"has {expansion.job_count} jobs in {expansion.hyperperiod}; {MAX_JOBS} jobs are taken"
        )
    from ortools.sat.python import cp_model

    return cp_model


def _too_large(expansion: Expansion, text: str) -> HalpipeError:
    path = f'mode "{expansion.mode.name}"'
    return HalpipeError(EXACT_TOO_LARGE(text, at=expansion.mode.at, path=path, help="use --engine anneal"))


def _check(model: TaskModel, expansion: Expansion, jobs: Iterable[Job]) -> None:
    """Refuse a schedule that the independent checker refuses."""

    from halpipe.pipeline.verify import verify

    table = ModeSchedule(
        name=expansion.mode.name, hyperperiod=expansion.hyperperiod, status=Status.VALID, jobs=tuple(jobs)
    )
    alone = model.alone(expansion.mode.name)
    schedule = Schedule(model=model.name, model_sha256=model.digest, modes=(table,))
    wrong = [d for d in verify(alone, schedule) if d.is_error]
    if wrong:
        text = f"verify finds {len(wrong)} violations in the schedule of the exact engine"
        raise HalpipeError(EXACT_WRONG(text, path=f'mode "{expansion.mode.name}"'), *wrong, exit=Exit.INTERNAL)
