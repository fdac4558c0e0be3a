"""The exact engine asked for the fewest jobs that are not where an earlier schedule has them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from halpipe.core.durations import ZERO, greatest_common_divisor
from halpipe.core.records import record
from halpipe.pipeline.parts import is_exact_model
from halpipe.pipeline.solve.exact import MAX_PARTS, Effort, is_installed, is_small, solver_for
from halpipe.pipeline.solve.workers import watched

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from halpipe.models import Job, TaskModel
    from halpipe.pipeline.jobs import Expansion
    from halpipe.pipeline.solve.exactmodel import JobVars, Program

    Jobs = Mapping[tuple[str, int], Job]

WORK = 10
"""Deterministic seconds for one mode."""

MAX_JOBS = 2000
"""Jobs of a mode up to which it is asked."""


@record
class Fewest:
    """The jobs of a schedule in which fewer have moved, if there are any; at least `bound` must, and `stopped`."""

    bound: int = 0
    jobs: tuple[Job, ...] = ()
    stopped: bool = False


def fewest_moved(
    model: TaskModel, expansion: Expansion, earlier: Jobs, held: Jobs, known: tuple[Job, ...], effort: Effort
) -> Fewest:
    """Look for a schedule in which fewer jobs have moved than in the `known` one, where the `held` jobs stay."""
    if not (is_installed() and is_exact_model(model) and is_small(expansion) and expansion.job_count <= MAX_JOBS):
        return Fewest()
    if not all(_is_numbered(expansion, job) for job in (*earlier.values(), *held.values(), *known)):
        return Fewest()
    from ortools.sat.python import cp_model

    from halpipe.pipeline.solve.exactmodel import build, exact_tick
    from halpipe.pipeline.solve.exactunits import NamedUnits

    starts = (job.start for jobs in (earlier.values(), held.values(), known) for job in jobs)
    tick = greatest_common_divisor([exact_tick(expansion), *starts])
    program = build(cp_model, expansion, model, model.chains, MAX_PARTS, NamedUnits, tick)
    if program is None:
        return Fewest()
    stay = list(_stay(program, earlier))
    for literal in _stay(program, held):
        program.cp.add(literal == 1)
    moved = expansion.job_count - sum(stay)
    most = sum(not is_same(job, earlier) for job in known) - 1
    program.cp.add(moved <= most)
    program.cp.minimize(moved)
    program.suggest(known)
    solver = solver_for(cp_model, effort)
    status, stopped = watched(lambda: solver.solve(program.cp), effort.go_on, solver.stop_search)
    if status == cp_model.INFEASIBLE:
        return Fewest(most + 1)
    if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return Fewest(stopped=stopped)
    # A count of jobs, far below 2**53: the float is whole but for its rounding.
    return Fewest(int(solver.best_objective_bound + 0.5), tuple(program.jobs(solver) or ()), stopped)


def is_same(job: Job, earlier: Jobs) -> bool:
    """Return whether a job is where the earlier schedule has it: start, units and version."""
    other = earlier.get((job.task, job.index))
    return other is not None and place(other) == place(job)


def place(job: Job) -> tuple[object, ...]:
    """Return what of a job must be the same for it to stay."""
    return job.start, job.version, frozenset(job.units), job.parts


def _is_numbered(expansion: Expansion, job: Job) -> bool:
    """Return whether a job of a periodic task lies in the periods that its number says, as those of the program do."""
    active = expansion.by_name.get(job.task)
    if active is None or active.task.period is None:
        return True
    period = active.task.period
    late = (job.start - period * job.index) % expansion.hyperperiod
    return ZERO <= late < period + period * active.task.slack


def _stay(program: Program, jobs: Jobs) -> Iterator[Any]:
    """Yield a literal for each job that a schedule has: that the program has it in the same place."""
    units: dict[tuple[str, int], dict[str, list[Any]]] = {}
    form: Any = program.placement
    for job, name, literal in form.units:
        units.setdefault((job.active.name, job.index), {}).setdefault(name, []).append(literal)
    for own in program.tasks.values():
        for job in own:
            before = jobs.get((job.active.name, job.index))
            if before is not None:
                yield _stays(program, job, before, units.get((job.active.name, job.index), {}))


def _stays(program: Program, job: JobVars, before: Job, units: Mapping[str, list[Any]]) -> Any:
    stays = program.literal()
    chosen = [chosen for version, chosen in job.versions if version.name == before.version]
    if not chosen or not all(name in units for name in before.units):
        program.cp.add(stays == 0)
        return stays
    program.cp.add(job.theta == before.start // program.tick).only_enforce_if(stays)
    program.cp.add(chosen[0] == 1).only_enforce_if(stays)
    for name in before.units:
        program.cp.add(sum(units[name]) == 1).only_enforce_if(stays)
    return stays
