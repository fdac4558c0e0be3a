"""The answer with its names: from job numbers, ticks and options back to tasks, times, versions and units."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.pipeline.parts import job_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.durations import Duration
    from halpipe.models import Job
    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.kernel.assign_units import Units
    from halpipe.pipeline.solve.problem import Problem


def named_jobs(problem: Problem, start: Ints, option: Ints, units: Units) -> Iterator[Job]:
    """Yield the present jobs with names and exact times."""
    arrays = problem.arrays
    for number, active in enumerate(problem.expansion.tasks):
        first, last = arrays.task_job[number], arrays.task_job[number + 1]
        shift = _rotation(problem, number, start[first:last].tolist())
        for job in range(first, last):
            version = problem.options[option[job]].version
            if version is None or version.wcet is None:
                continue
            begin: Duration = problem.tick * start[job]
            index = (job - first + shift) % (last - first)
            service = tuple(interrupt for unit in units[job] for interrupt in problem.services[unit])
            yield job_of(active.name, index, version, units[job], [(begin, ZERO, version.wcet)], service)


def _rotation(problem: Problem, task: int, start: list[int]) -> int:
    """Return by how much job numbers must turn for the phase s of a periodic task to lie in [0, D) (MODEL 3).

    The kernel's moves may carry the phase past the period's edges, which only renames the jobs. The jobs of a task
    that demands others keep their numbers, by which its demands are known, and so do those of a task that a cycle or
    a LET names: its phase is in [0, D) already, while all its starts may lie a period later.
    """
    arrays = problem.arrays
    first, last = arrays.task_job[task], arrays.task_job[task + 1]
    is_numbered = arrays.task_first[task] or arrays.dependent_first[last] > arrays.dependent_first[first]
    if not arrays.task_cyclic[task] or is_numbered or arrays.entry_offset[arrays.job_entry[first]] >= 0:
        return 0
    period, hyperperiod = arrays.task_period[task], arrays.hyperperiod
    offsets = [(time - number * period) % hyperperiod for number, time in enumerate(start)]
    ordered = sorted(set(offsets))
    gaps = [(b - a, b) for a, b in pairwise(ordered)]
    gaps.append((ordered[0] + hyperperiod - ordered[-1], ordered[0]))
    return max(gaps)[1] // period
