"""The driver of the kernel: runs it in slices, assigns units, and gives the answer its names back."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.pipeline.solve.kernel.assign_units import Units, deal, deal_anyhow
from halpipe.pipeline.solve.kernel.first_fit import construct
from halpipe.pipeline.solve.kernel.kernel import BEST, MOVES, NEVER, State, load, new_state
from halpipe.pipeline.solve.kernel.portfolio import Kept, OnSlice, race, run
from halpipe.pipeline.solve.kernel.warmstart import Earlier, freeze, hints, known_first, named_jobs, rename_units
from halpipe.pipeline.solve.problem import Option
from halpipe.pipeline.solve.workers import Workers

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from halpipe.models import Job
    from halpipe.pipeline.solve.optimise import Polish
    from halpipe.pipeline.solve.problem import Problem

NOTHING = Earlier()

MEMBER_SEED = 0x2127599BF4325C37
"""Between the seeds of searches that take turns."""


@record
class Effort:
    """Number of searches that take turns, and the threads that they share."""

    members: int = 1
    workers: Workers = field(default_factory=Workers)


ALONE = Effort()


@record
class Outcome:
    """Result of a search: all jobs of the mode, valid if `cost` is zero; `changed` shipped tasks could not stay.

    `unimproved` tells that it was stopped while it improved a valid schedule.
    """

    jobs: tuple[Job, ...]
    cost: int
    moves: int
    stopped: bool
    changed: tuple[str, ...] = ()
    unimproved: bool = False


def search(
    problem: Problem,
    separate: Callable[[], Problem],
    seed: int,
    budget: int,
    on_slice: OnSlice,
    earlier: Earlier = NOTHING,
    polish: tuple[Polish, Callable[[], Problem]] | None = None,
    shipped: Mapping[tuple[str, int], Job] | None = None,
    kept: Kept | None = None,
    effort: Effort = ALONE,
) -> Outcome:
    """Look for a valid schedule in at most `budget` moves, trying first where `earlier` modes put the tasks.

    `separate` builds the same problem with one lane per unit; it is needed only where the load of a group of
    units fits, but the jobs cannot be assigned to its units as they lie. `polish` improves a valid one further, and
    comes with what builds the problem with the chains that count for that.
    `shipped` jobs stay where they are. What is `kept` is gone on from.
    """
    if shipped:
        problem = separate()
    hint = hints(problem, earlier)
    problem = problem.with_construction(known_first(problem.arrays.construction, hint))
    changed: tuple[str, ...] = ()
    first = new_state(problem.arrays, seed, problem.mean_wcet)
    first.hint[:] = hint
    if shipped:
        problem, changed = freeze(problem, first, shipped)

    def begin(member: int) -> State:
        if member == 0:
            return first
        state = new_state(problem.arrays, seed + member * MEMBER_SEED, problem.mean_wcet)
        state.hint[:] = hint
        if shipped:
            freeze(problem, state, shipped)
        return state

    if len(problem.arrays.chain_limit):
        construct(problem, first, budget, lambda made: on_slice(made, -1))
    found = race(problem, begin, budget, effort.members, effort.workers, on_slice, kept)
    state, moves, stopped = found.state, found.moves, found.stopped
    if state.register[BEST] == NEVER:
        state = _completed(problem, state, seed)
    units = deal(problem, state.best_start, state.best_option)
    if units is None and state.register[BEST] == 0:
        problem, state = _continue(problem, state, separate(), seed)
        rest = kept and kept.stage("units")
        before = moves
        stopped = stopped or run(
            problem, state, budget - before, lambda made, best: on_slice(before + made, best), rest
        )
        moves += state.register[MOVES]
        units = deal(problem, state.best_start, state.best_option)

    def named(problem: Problem, state: State, units: Units) -> tuple[Job, ...]:
        renamed = units if shipped else rename_units(problem, units, earlier)
        return tuple(named_jobs(problem, state.best_start, state.best_option, renamed))

    unimproved = False
    if units is not None and state.register[BEST] == 0 and polish is not None and not stopped:
        from halpipe.pipeline.solve.kernel.quality import improve

        wish, chained = polish
        better = improve(problem.with_chains(chained()), state, units, wish, on_slice, named, kept)
        problem, state, units, unimproved = better.problem, better.state, better.units, better.stopped
        moves += better.moves
    units = units or deal_anyhow(problem, state.best_start, state.best_option)
    return Outcome(named(problem, state, units), state.register[BEST], moves, stopped, changed, unimproved)


def improved(
    problem: Problem,
    jobs: Iterable[Job],
    polish: Polish,
    on_slice: OnSlice,
    earlier: Earlier = NOTHING,
    kept: Kept | None = None,
) -> Outcome | None:
    """Improve a valid schedule that another engine has found; None where the kernel cannot take it over.

    The problem counts the chains that the wishes are about, and its tick divides all starts.
    """
    from halpipe.pipeline.solve.kernel.quality import improve
    from halpipe.pipeline.solve.kernel.warmstart import taken_over

    taken = taken_over(problem, jobs, polish.seed)
    if taken is None:
        return None

    def named(problem: Problem, state: State, units: Units) -> tuple[Job, ...]:
        renamed = rename_units(problem, units, earlier)
        return tuple(named_jobs(problem, state.best_start, state.best_option, renamed))

    better = improve(problem, *taken, polish, on_slice, named, kept)
    found = named(better.problem, better.state, better.units)
    return Outcome(found, 0, better.moves, stopped=False, unimproved=better.stopped)


def _completed(problem: Problem, state: State, seed: int) -> State:
    """Return a state in which a construction that was cut short is complete: the jobs left start at their offsets."""
    arrays = problem.arrays
    fresh = new_state(arrays, seed, problem.mean_wcet)
    fresh.start[:], fresh.option[:], fresh.phase[:] = state.start, state.option, state.phase
    for job, task in enumerate(arrays.job_task):
        if state.start[job] < 0:
            number = job - arrays.task_job[task] if arrays.task_cyclic[task] else 0
            phase = max(0, arrays.entry_offset[arrays.job_entry[job]])
            fresh.start[job] = (phase + number * arrays.task_period[task]) % arrays.hyperperiod
            fresh.option[job], fresh.phase[job] = arrays.task_option[task], phase
    load(arrays, fresh)
    return fresh


def _continue(problem: Problem, state: State, alone: Problem, seed: int) -> tuple[Problem, State]:
    """Carry a schedule over to the problem with one lane per unit; overlaps are left to the kernel."""
    units = deal_anyhow(problem, state.start, state.option)
    fresh = new_state(alone.arrays, seed + 1, alone.mean_wcet)
    group_of = {names[0]: group for group, names in enumerate(alone.groups)}
    task_option, job_task = alone.arrays.task_option, alone.arrays.job_task
    for job, chosen in enumerate(state.option):
        version = problem.options[chosen].version
        wanted = Option(version, tuple(sorted((group_of[name], 1) for name in units[job])))
        task = job_task[job]
        offered = range(task_option[task], task_option[task + 1])
        same = [n for n in offered if alone.options[n].version == version]  # of large gangs, not every set is offered
        fresh.option[job] = next((n for n in same if alone.options[n] == wanted), same[0])
    fresh.start[:] = state.start
    fresh.phase[:] = state.phase
    load(alone.arrays, fresh)
    return alone, fresh
