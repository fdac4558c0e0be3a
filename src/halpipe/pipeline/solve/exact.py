"""The exact engine: one mode as a constraint program for CP-SAT, every rule of MODEL 3 and 10, for small systems.

It starts from the expanded model and shares nothing with the annealer's arrays, so that each can be compared with the
other. Its schedules are checked by verify before anyone sees them; "infeasible" is its own word alone, which `explain`
turns into a set of tasks and constraints that can be looked at.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Exit, HalpipeError, about
from halpipe.core.records import record
from halpipe.models import Anchor, Binding, ModeSchedule, Schedule, Status
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.codes import EXACT_MISSING, EXACT_TOO_LARGE, EXACT_WRONG
from halpipe.pipeline.solve.exactlengths import inflated, kinds_of, services_of
from halpipe.pipeline.solve.lanes import is_bound
from halpipe.pipeline.solve.limits import DEFAULT_WORK
from halpipe.pipeline.solve.solver import solver_library
from halpipe.pipeline.solve.workers import Workers, watched

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from halpipe.core.diagnostics import Diagnostic, Location
    from halpipe.models import Chain, Job, Mode, TaskModel
    from halpipe.pipeline.jobs import Expansion
    from halpipe.pipeline.solve.exactmodel import Program

FIRST_TURN, GROWTH = 0.02, 2
"""Deterministic seconds of a program in the first turn, and how many times as many it gets in the next."""

MAX_JOBS = 20_000
"""Jobs up to which a mode is taken; larger ones are for the annealer.

What bounds them is memory: 2400 tasks with 4800 jobs took 0.4 GB, 10 000 with 20 000 took 0.8 GB.
"""

MAX_TICKS = 2**36
"""Ticks of a hyperperiod: products with job counts and bounds must stay within 64 bits."""


class Answer(StrEnum):
    """Answer of the exact engine; `UNKNOWN` when its effort is spent."""

    FEASIBLE = "feasible"
    INFEASIBLE = "infeasible"
    UNKNOWN = "unknown"


@record
class ExactResult:
    """The answer for one mode, with the jobs of a valid schedule where there is one.

    `stopped` tells that the answer is unknown because the caller wanted no more.
    """

    status: Answer
    jobs: tuple[Job, ...] = ()
    stopped: bool = False

    @property
    def is_last(self) -> bool:
        """Whether the caller has stopped the search."""
        return self.stopped or self.status is not Answer.UNKNOWN


@record(kw_only=True)
class Effort:
    """Effort of CP-SAT.

    - `work` is its deterministic time, about a second each; None for no bound.
    - `workers` are the threads on which several programs run at a time, each on one; the answer is the same.
    - `go_on` is asked several times a second; once it says no, CP-SAT stops.
    """

    work: float | None = DEFAULT_WORK
    workers: int = 1
    seed: int = 1
    go_on: Callable[[], bool] = lambda: True


PLAIN = Effort()


def solve_exact(model: TaskModel, mode: Mode, effort: Effort = PLAIN) -> ExactResult:
    """Decide whether `mode` of a validated model has a valid schedule.

    Preemptive jobs are placed in one piece; that there is none without preemption proves nothing.
    Raise `HalpipeError` where OR-Tools is not installed, where the mode is too large, or where verify refuses the
    schedule found (a bug).
    """
    expansion = expand(model, mode)
    result = solve_expansion(model, inflated(model, expansion), effort)
    if result.status is Answer.INFEASIBLE and is_preemptive(expansion):
        return ExactResult(Answer.UNKNOWN)
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

    The first program runs alone; then programs of several forms take turns, each time with more work and another seed,
    since a single run may have bad luck: many sets that take one of them seconds take another an instant. The answer is
    that of the first, by turn and number, that has one, however many of them run at a time.

    Nothing is verified here: a part of a mode keeps the hyperperiod of the whole, which verify would not accept.
    """
    if not expansion.tasks:  # what is left of a mode whose one task is left out: there is no grid to stand on
        return ExactResult(Answer.FEASIBLE)
    _refuse_unsuited(expansion)
    from halpipe.pipeline.solve.exactmodel import MAX_PARTS, build
    from halpipe.pipeline.solve.exactunits import forms_of

    counted = model.chains if chains is None else chains
    forms = forms_of(expansion, model.units)
    programs = (build(expansion, model, counted, form) for form in forms)
    racing = [next(programs)]
    workers, left, turn = Workers(effort.workers), math.inf if effort.work is None else effort.work, 0
    while left > 0:
        entrants = [program for program in racing if program is not None]
        if not entrants and turn:
            raise _too_large(expansion, f"needs more than {MAX_PARTS} variables and intervals")
        share = min(FIRST_TURN * GROWTH**turn, left / max(1, len(entrants)))
        run = _Turn(replace(effort, work=share, seed=effort.seed + turn))
        answers = workers.each(run.solve, list(enumerate(entrants)), lambda found: found.is_last)
        if answers and answers[-1].is_last:
            return answers[-1]
        left -= share * len(entrants)
        turn += 1
        racing += programs
    return ExactResult(Answer.UNKNOWN)


@dataclass(slots=True)
class _Turn:
    """One run of CP-SAT on each program; those behind one that has an answer are stopped."""

    effort: Effort
    answered: float = math.inf

    def solve(self, numbered: tuple[int, Program]) -> ExactResult:
        """Let CP-SAT run on a program; starts that cannot be assigned to units are no answer."""
        number, program = numbered
        go_on = lambda: number < self.answered and self.effort.go_on()  # noqa: E731
        solver, status, is_stopped = run(program, replace(self.effort, go_on=go_on))
        found = ExactResult(Answer.UNKNOWN, stopped=is_stopped)
        if status in FOUND:
            jobs = program.jobs(solver)
            if jobs is not None:
                found = ExactResult(Answer.FEASIBLE, tuple(jobs))
        if status == IMPOSSIBLE and program.form.is_circle:
            found = ExactResult(Answer.INFEASIBLE)
        if found.is_last:
            self.answered = min(self.answered, number)
        return found


FOUND, IMPOSSIBLE, UNDECIDED = ("OPTIMAL", "FEASIBLE"), "INFEASIBLE", "UNKNOWN"
"""Answers of CP-SAT by their names."""


def run(program: Program, effort: Effort) -> tuple[Any, str, bool]:
    """Let CP-SAT run on one thread, so that its answer depends on the program and the effort alone.

    Return the solver, the name of its answer, and whether it was stopped.
    """
    solver = solver_library().CpSolver()
    parameters = solver.parameters
    parameters.num_workers = 1
    parameters.random_seed = effort.seed % 2**31
    parameters.max_deterministic_time = effort.work
    parameters.catch_sigint_signal = False  # Ctrl-C belongs to the caller of `go_on`
    parameters.symmetry_level = 0  # programs have their own, and the detection of OR-Tools 9.15 fails on some of them
    status, is_stopped = watched(lambda: solver.solve(program.cp), effort.go_on, solver.stop_search)
    return solver, solver.status_name(status), is_stopped


def is_preemptive(expansion: Expansion) -> bool:
    """Return whether some jobs of a mode may be preempted."""
    return any(version.split.is_allowed for active in expansion.tasks for version in active.versions)


def unknown_to_exact(model: TaskModel, expansion: Expansion) -> Iterator[tuple[str, Location]]:
    """Yield what the model states of a mode, and where, that the exact engine cannot place jobs by."""
    units = {unit.name: unit for unit in model.units}
    for active in expansion.tasks:
        if any(version.gang > 1 and len(kinds_of(version, units)) > 1 for version in active.versions):
            yield f'gang of task "{active.name}" over units with different interrupts', active.task.at
        for row in (row for version in active.versions for row in version.precedences):
            before = expansion.by_name.get(row.task)
            if row.anchor is Anchor.POINT and before is not None and len(services_of(before, units)) > 1:
                yield f'point of task "{row.task}", which lies elsewhere with the interrupts of each unit', row.at
        modes = sum(run.task == active.name for mode in model.modes for run in mode.runs)
        if modes > 1 and active.task.binding is Binding.SYSTEM and is_bound(active):
            yield f'binding of task "{active.name}" to the units of another mode', active.task.at


def is_small(expansion: Expansion) -> bool:
    """Tell whether a mode is of a size for this engine."""
    from halpipe.pipeline.solve.exactmodel import exact_tick

    return expansion.job_count <= MAX_JOBS and expansion.hyperperiod // exact_tick(expansion) <= MAX_TICKS


def is_installed() -> bool:
    """Tell whether OR-Tools is there."""
    from importlib.util import find_spec

    return find_spec("ortools") is not None


def _refuse_unsuited(expansion: Expansion) -> None:
    """Say how to get CP-SAT where it is missing, and refuse what is too large for it."""
    if not is_installed():
        raise HalpipeError(
            EXACT_MISSING("OR-Tools is not installed", help="install it: pip install ortools"),
        )
    if not is_small(expansion):
        raise _too_large(
            expansion, f"has {expansion.job_count} jobs in {expansion.hyperperiod}; {MAX_JOBS} jobs are taken"
        )


def _too_large(expansion: Expansion, text: str) -> HalpipeError:
    path = about(mode=expansion.mode.name)
    return HalpipeError(EXACT_TOO_LARGE(text, at=expansion.mode.at, path=path, help="use --engine anneal"))


def _check(model: TaskModel, expansion: Expansion, jobs: Iterable[Job]) -> None:
    """Refuse a schedule that the independent checker refuses."""
    wrong = violations(model, expansion, jobs)
    if wrong:
        text = f"verify finds {len(wrong)} violations in the schedule of the exact engine"
        raise HalpipeError(EXACT_WRONG(text, path=about(mode=expansion.mode.name)), *wrong, exit=Exit.INTERNAL)


def violations(model: TaskModel, expansion: Expansion, jobs: Iterable[Job]) -> list[Diagnostic]:
    """Return what the independent checker finds in the jobs of a mode."""
    from halpipe.pipeline.verify import verify

    table = ModeSchedule(
        name=expansion.mode.name, hyperperiod=expansion.hyperperiod, status=Status.VALID, jobs=tuple(jobs)
    )
    alone = model.alone(expansion.mode.name)
    schedule = Schedule(model=model.name, model_sha256=model.digest, modes=(table,))
    return [d for d in verify(alone, schedule) if d.is_error]
