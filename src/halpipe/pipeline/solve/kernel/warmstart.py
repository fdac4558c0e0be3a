"""The start from an earlier mode's placement: common tasks are tried first where they were (MODEL 5).

It makes short transitions likely and changes nothing else: phases are only tried first, and units of one group
only change names.
"""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.pipeline.solve.integers import filled, ints

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.core.durations import Duration
    from halpipe.models import Job
    from halpipe.pipeline.jobs import Expansion
    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.problem import Problem


@record
class Earlier:
    """Where earlier modes put the jobs: the phase of every periodic task, and the units of every job."""

    phases: dict[str, Duration] = field(default_factory=dict)
    units: dict[tuple[str, int], tuple[str, ...]] = field(default_factory=dict)

    def and_then(self, expansion: Expansion, jobs: Iterable[Job]) -> Earlier:
        """Return what is known after one more mode; the first mode that runs a task decides for it."""
        phases, units = dict(self.phases), dict(self.units)
        for job in jobs:
            period = expansion.by_name[job.task].task.period
            units.setdefault((job.task, job.index), job.units)
            if period is not None and job.task not in self.phases:
                phase = (job.start - period * job.index) % expansion.hyperperiod % period
                phases[job.task] = min(phase, phases.get(job.task, phase))
        return Earlier(phases, units)


def hints(problem: Problem, earlier: Earlier) -> Ints:
    """Return for every entry the phase in ticks to try first, -1 where none is known."""
    arrays = problem.arrays
    hint = filled(len(arrays.entry_offset), -1)
    for number, active in enumerate(problem.expansion.tasks):
        phase = earlier.phases.get(active.name)
        if phase is not None and active.task.period is not None and phase < active.task.period:
            hint[arrays.job_entry[arrays.task_job[number]]] = phase // problem.tick
    return hint


def known_first(construction: Ints, hint: Ints) -> Ints:
    """Return the order of construction with the entries whose phase is known before the others."""
    return ints(sorted(construction, key=lambda entry: hint[entry] < 0))


def rename_units(problem: Problem, units: dict[int, tuple[str, ...]], earlier: Earlier) -> dict[int, tuple[str, ...]]:
    """Exchange the names of units within every group so that as many jobs as possible are where they were."""
    votes: dict[tuple[str, str], int] = {}
    for job, names in units.items():
        number = problem.arrays.job_task[job]
        key = (problem.expansion.tasks[number].name, job - problem.arrays.task_job[number])
        for now, before in zip(names, earlier.units.get(key, ()), strict=False):
            votes[now, before] = votes.get((now, before), 0) + 1
    group_of = {name: group for group, names in enumerate(problem.groups) for name in names}
    name_for: dict[str, str] = {}
    taken: set[str] = set()
    for now, before in sorted(votes, key=lambda pair: (-votes[pair], pair)):
        if now not in name_for and before not in taken and group_of.get(before) == group_of[now]:
            name_for[now] = before
            taken.add(before)
    for group in problem.groups:
        free = iter([name for name in group if name not in taken])
        for name in group:
            if name not in name_for:
                name_for[name] = next(free)
    return {job: tuple(name_for[name] for name in names) for job, names in units.items()}
