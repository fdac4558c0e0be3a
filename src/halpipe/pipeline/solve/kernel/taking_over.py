"""Kernel state from an existing schedule (warm start)."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from halpipe.pipeline.solve.kernel.kernel import load
from halpipe.pipeline.solve.kernel.state import new_state

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.models import Job
    from halpipe.pipeline.solve.kernel.assign_units import Units
    from halpipe.pipeline.solve.kernel.state import State
    from halpipe.pipeline.solve.problem import Option, Problem


def taken_over(problem: Problem, jobs: Iterable[Job], seed: int) -> tuple[State, Units] | None:
    """Return the placement of all jobs of a mode, whose starts are whole ticks of the problem, and their units.

    None where the kernel has no option for one of them (of large gangs, not every set of groups is tried), or does not
    find that the placement is valid.
    """
    arrays, state, units = (
        problem.arrays,
        new_state(problem.arrays, seed, problem.mean_wcet),
        dict[int, tuple[str, ...]](),
    )
    known = {(job.task, job.index): job for job in jobs}
    group_of = {name: group for group, names in enumerate(problem.groups) for name in names}
    for number, active in enumerate(problem.expansion.tasks):
        options = range(arrays.task_option[number], arrays.task_option[number + 1])
        of_option = {_name(problem.options[option]): option for option in options}
        first = arrays.task_job[number]
        mates = [known.get((active.name, index)) for index in range(active.jobs)]
        for place, job in enumerate(mates, first):
            used = () if job is None else tuple(sorted(Counter(group_of[name] for name in job.units).items()))
            option = of_option.get((None if job is None else job.version, used))
            if option is None:
                return None
            state.option[place] = option
            state.start[place] = 0 if job is None else job.start // problem.tick
            if job is not None:
                units[place] = job.units
        _set_phases(problem, state, number, active.jobs)
    return (state, units) if load(arrays, state) == 0 else None


def _name(option: Option) -> tuple[str | None, tuple[tuple[int, int], ...]]:
    return (None if option.version is None else option.version.name, option.groups)


def _set_phases(problem: Problem, state: State, task: int, count: int) -> None:
    """Set the starts less number times period: of a task with an offset from there on, else round its first job."""
    arrays, first = problem.arrays, problem.arrays.task_job[task]
    if not arrays.task_cyclic[task]:
        state.phase[first : first + count] = state.start[first : first + count]
        return
    period, offset = arrays.task_period[task], arrays.entry_offset[arrays.job_entry[first]]
    base = offset if offset >= 0 else state.start[first]
    back = 0 if offset >= 0 else arrays.hyperperiod // 2
    for number, job in enumerate(range(first, first + count)):
        drift = (state.start[job] - number * period - base + back) % arrays.hyperperiod - back
        state.phase[job] = base + drift
