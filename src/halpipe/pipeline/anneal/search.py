"""The driver of the kernel: runs it in slices, assigns units, and gives the answer its names back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from halpipe.models import Job
from halpipe.pipeline.anneal.kernel import anneal, load, total_cost
from halpipe.pipeline.anneal.noise import gumbel_table
from halpipe.pipeline.anneal.profile import NEVER
from halpipe.pipeline.anneal.state import BEST, INSERTED, MOVES, State, new_state
from halpipe.pipeline.anneal.units import Arc, assign_units
from halpipe.pipeline.anneal.warmstart import Earlier, hints, known_first, rename_units
from halpipe.pipeline.problem import Option

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from halpipe.durations import Duration
    from halpipe.pipeline.problem import Problem

    Ints = NDArray[np.int64]

SLICE_WORK = 20_000
"""Placements of single jobs per slice, roughly: small enough to answer Ctrl-C at once."""

OnSlice = Callable[[int, int], bool]
"""Called between slices with moves made and best cost so far (-1: still constructing); False stops the search."""


NOTHING = Earlier()


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a search came to: all jobs of the mode, valid if `cost` is zero."""

    jobs: tuple[Job, ...]
    cost: int
    moves: int
    stopped: bool


def search(
    problem: Problem,
    separate: Callable[[], Problem],
    seed: int,
    budget: int,
    on_slice: OnSlice,
    earlier: Earlier = NOTHING,
) -> Outcome:
    """Look for a valid schedule in at most `budget` moves, trying first where `earlier` modes put the tasks.

    `separate` builds the same problem with one lane per unit; it is needed only where the load of a group of
    units fits, but the jobs cannot be dealt out to its units as they lie.
    """
    state = new_state(problem.arrays, seed, problem.mean_wcet)
    state.hint[:] = hints(problem, earlier)
    order = known_first(problem.arrays.construction, state.hint)
    problem = replace(problem, arrays=problem.arrays._replace(construction=order))
    stopped = _run(problem, state, budget, on_slice)
    moves = int(state.register[MOVES])
    if state.register[BEST] == NEVER:
        state = _completed(problem, state, seed)
    units = _deal(problem, state.best_start, state.best_option)
    if units is None and state.register[BEST] == 0:
        problem, state = _continue(problem, state, separate(), seed)
        stopped = stopped or _run(problem, state, budget - moves, lambda made, best: on_slice(moves + made, best))
        moves += int(state.register[MOVES])
        units = _deal(problem, state.best_start, state.best_option)
    start, option = state.best_start, state.best_option
    units = rename_units(problem, units or _deal_anyhow(problem, start, option), earlier)
    jobs = tuple(_jobs(problem, start, option, units))
    return Outcome(jobs, int(state.register[BEST]), moves, stopped)


def _completed(problem: Problem, state: State, seed: int) -> State:
    """Return a state in which a construction that was cut short is complete: the jobs left start at their offsets."""
    arrays = problem.arrays
    task = arrays.job_task
    number = np.where(arrays.task_cyclic[task] == 1, np.arange(len(task)) - arrays.task_job[task], 0)
    phase = np.maximum(arrays.entry_offset[arrays.job_entry], 0)
    placed = state.start >= 0
    fresh = new_state(arrays, seed, problem.mean_wcet)
    fresh.start[:] = np.where(placed, state.start, (phase + number * arrays.task_period[task]) % arrays.hyperperiod)
    fresh.option[:] = np.where(placed, state.option, arrays.task_option[task])
    fresh.phase[:] = np.where(placed, state.phase, phase)
    load(arrays, fresh)
    return fresh


def _run(problem: Problem, state: State, budget: int, on_slice: OnSlice) -> bool:
    """Run the kernel in slices until it is done, out of moves, or told to stop (then True)."""
    noise = gumbel_table()
    entries = len(problem.arrays.entry_offset)
    size = max(1, SLICE_WORK * entries // (20 * max(1, len(problem.arrays.job_task))))
    register = state.register
    if entries == 0:
        register[BEST] = total_cost(problem.arrays, state)
        return False
    while register[MOVES] < budget:
        cost = anneal(problem.arrays, state, noise, min(size, budget - int(register[MOVES])))
        constructed = register[INSERTED] == entries
        if constructed and cost == 0:
            return False
        if not on_slice(int(register[MOVES]), int(register[BEST]) if constructed else -1):
            return True
    return False


# ------------------------------------------------------------------------------------------------ units

Units = dict[int, tuple[str, ...]]


def _deal(problem: Problem, start: Ints, option: Ints) -> Units | None:
    """Deal the units of every group out to its jobs; None where that fails for some group."""
    arrays = problem.arrays
    arcs: list[list[Arc]] = [[] for _ in problem.groups]
    for job, chosen in enumerate(option.tolist()):
        for group, count in problem.options[chosen].groups:
            arcs[group].append(Arc(job, int(start[job]), int(arrays.option_wcet[chosen]), count))
    units: Units = {}
    for names, members in zip(problem.groups, arcs, strict=True):
        if not members:
            continue
        dealt = assign_units(members, len(names), int(arrays.hyperperiod))
        if dealt is None:
            return None
        for job, places in dealt.items():
            units[job] = units.get(job, ()) + tuple(names[place] for place in places)
    return units


def _deal_anyhow(problem: Problem, start: Ints, option: Ints) -> Units:
    """Deal units out in turn, overlaps or not: for reporting the best placement of a search that failed."""
    units: Units = {}
    turn = [0] * len(problem.groups)
    for job in np.argsort(start, kind="stable").tolist():
        taken: tuple[str, ...] = ()
        for group, count in problem.options[int(option[job])].groups:
            names = problem.groups[group]
            taken += tuple(names[(turn[group] + place) % len(names)] for place in range(count))
            turn[group] += count
        units[job] = taken
    return units


def _continue(problem: Problem, state: State, alone: Problem, seed: int) -> tuple[Problem, State]:
    """Carry a schedule over to the problem with one lane per unit; overlaps are left to the kernel."""
    units = _deal_anyhow(problem, state.start, state.option)
    fresh = new_state(alone.arrays, seed + 1, alone.mean_wcet)
    group_of = {names[0]: group for group, names in enumerate(alone.groups)}
    task_option, job_task = alone.arrays.task_option.tolist(), alone.arrays.job_task.tolist()
    for job, chosen in enumerate(state.option.tolist()):
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


# ------------------------------------------------------------------------------------------------ names


def _jobs(problem: Problem, start: Ints, option: Ints, units: Units) -> Iterator[Job]:
    """Yield the present jobs with names and exact times."""
    arrays = problem.arrays
    for number, active in enumerate(problem.expansion.tasks):
        first, last = int(arrays.task_job[number]), int(arrays.task_job[number + 1])
        shift = _rotation(problem, number, start[first:last].tolist())
        for job in range(first, last):
            version = problem.options[int(option[job])].version
            if version is None or version.wcet is None:
                continue
            begin: Duration = problem.tick * int(start[job])
            yield Job(
                task=active.name,
                index=(job - first + shift) % (last - first),
                start=begin,
                end=begin + version.wcet,
                version=version.name,
                units=units[job],
            )


def _rotation(problem: Problem, task: int, start: list[int]) -> int:
    """Return by how much job numbers must turn for the phase s of a periodic task to lie in [0, D) (MODEL 3).

    The kernel's moves may carry the phase past the period's edges, which only renames the jobs. The jobs of a task
    that demands others keep their numbers, by which its demands are known.
    """
    arrays = problem.arrays
    first, last = int(arrays.task_job[task]), int(arrays.task_job[task + 1])
    demanding = arrays.dependent_first[last] > arrays.dependent_first[first]
    if not arrays.task_cyclic[task] or demanding or arrays.entry_offset[arrays.job_entry[first]] >= 0:
        return 0
    period, hyperperiod = int(arrays.task_period[task]), int(arrays.hyperperiod)
    offsets = [(time - number * period) % hyperperiod for number, time in enumerate(start)]
    ordered = sorted(set(offsets))
    gaps = [(b - a, b) for a, b in pairwise(ordered)]
    gaps.append((ordered[0] + hyperperiod - ordered[-1], ordered[0]))
    return max(gaps)[1] // period
