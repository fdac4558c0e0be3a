"""Jobs that stay where an earlier schedule put them, because that schedule has shipped."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.pipeline.solve.integers import ints
from halpipe.pipeline.solve.kernel.kernel import putting, total_cost
from halpipe.pipeline.solve.kernel.state import BEST, COST, FROZEN, FROZEN_HINT, INSERTED, State

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.models import Job
    from halpipe.pipeline.solve.problem import Option, Problem


def freeze(problem: Problem, state: State, shipped: Mapping[tuple[str, int], Job]) -> tuple[Problem, tuple[str, ...]]:
    """Place the tasks of `shipped` (jobs by task and index) for good; return the problem that
    constructs the rest, and the tasks that cannot stay.

    The problem has one lane per unit. A task stays only if all its jobs are shipped with a version and units that
    it still has. An empty `state` is given and filled.
    """
    arrays = problem.arrays
    put, group_of = putting(arrays, state), {names[0]: group for group, names in enumerate(problem.groups)}
    kept, changed = [], []
    for number, active in enumerate(problem.expansion.tasks):
        jobs = [shipped[active.name, index] for index in range(active.jobs) if (active.name, index) in shipped]
        if not jobs:
            continue
        numbers = _numbers(problem, number)
        options = [option for job in jobs if (option := _option(problem, numbers, group_of, job)) is not None]
        if len(options) < active.jobs:
            changed.append(active.name)
            continue
        first = arrays.task_job[number]
        cycle = arrays.task_period[number] if arrays.task_cyclic[number] else 0
        base = jobs[0].start // problem.tick
        half = arrays.hyperperiod // 2
        for place, (job, option) in enumerate(zip(jobs, options, strict=True)):
            start = job.start // problem.tick
            drift = (start - place * cycle - base + half) % arrays.hyperperiod - half
            state.start[first + place], state.option[first + place] = start, option
            state.phase[first + place] = base + drift
            put(first + place)
        kept += sorted({arrays.job_entry[first + place] for place in range(active.jobs)})
    for entry in kept:
        state.hint[entry] = FROZEN_HINT
    frozen = set(kept)
    problem = problem.with_construction(ints([*kept, *(e for e in arrays.construction if e not in frozen)]))
    state.register[INSERTED] = state.register[FROZEN] = len(kept)
    state.register[COST] = total_cost(problem.arrays, state)
    if len(kept) == len(arrays.entry_offset):
        state.register[BEST] = state.register[COST]
        state.best_start[:], state.best_option[:] = state.start, state.option
    return problem, tuple(changed)


_Choice = tuple[str, tuple[tuple[int, int], ...]]


def _numbers(problem: Problem, task: int) -> dict[_Choice, int]:
    """Return the options of a task by their version and groups of units; the first of several."""
    found: dict[_Choice, int] = {}
    arrays = problem.arrays
    for number in range(arrays.task_option[task], arrays.task_option[task + 1]):
        option: Option = problem.options[number]
        if option.version is not None:
            found.setdefault((option.version.name, option.groups), number)
    return found


def _option(problem: Problem, numbers: Mapping[_Choice, int], group_of: Mapping[str, int], job: Job) -> int | None:
    """Return the option that puts a job's version on its units; None if the task no longer has it.

    Nor does a job have one that starts outside of the hyperperiod, as in a schedule that was not verified.
    """
    if not 0 <= job.start // problem.tick < int(problem.arrays.hyperperiod):
        return None
    if not all(name in group_of for name in job.units):
        return None
    return numbers.get((job.version, tuple(sorted((group_of[name], 1) for name in job.units))))
