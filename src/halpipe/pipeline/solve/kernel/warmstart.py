"""From schedules to states of the kernel and back: warm starts, jobs that stay, and names for the answer."""

from __future__ import annotations

from collections import Counter
from dataclasses import field
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.models import Binding
from halpipe.pipeline.jobs import start_in_time
from halpipe.pipeline.parts import job_of, renewed
from halpipe.pipeline.solve.integers import filled, ints
from halpipe.pipeline.solve.kernel.kernel import (
    BEST,
    COST,
    FROZEN,
    FROZEN_HINT,
    INSERTED,
    State,
    bound,
    load,
    new_state,
    total_cost,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from halpipe.core.durations import Duration
    from halpipe.models import Job, Version
    from halpipe.pipeline.jobs import ActiveTask, Expansion
    from halpipe.pipeline.parts import Service
    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.kernel.assign_units import Units
    from halpipe.pipeline.solve.lanes import Choice, Pins
    from halpipe.pipeline.solve.problem import Problem


@record
class Earlier:
    """Placement in earlier modes: the phase of every periodic task, and the units of every job.

    `pins`: the units of tasks bound in the whole system, or before the first mode those that serve in every mode.
    """

    phases: dict[str, Duration] = field(default_factory=dict)
    units: dict[tuple[str, int], tuple[str, ...]] = field(default_factory=dict)
    pins: dict[str, Pins] = field(default_factory=dict)

    def and_then(self, expansion: Expansion, jobs: Iterable[Job]) -> Earlier:
        """Return what is known after one more mode; the first mode that runs a task decides for it."""
        phases, units, pins = dict(self.phases), dict(self.units), dict(self.pins)
        for job in jobs:
            period = expansion.by_name[job.task].task.period
            if expansion.by_name[job.task].task.binding is Binding.SYSTEM:
                pins[job.task] = {len(job.units): frozenset(job.units)}
            units.setdefault((job.task, job.index), job.units)
            if period is not None and job.task not in self.phases:
                phase = job.start % period
                phases[job.task] = min(phase, phases.get(job.task, phase))
        return Earlier(phases, units, pins)


def hints(problem: Problem, earlier: Earlier) -> Ints:
    """Return for every entry the phase in ticks to try first, -1 where none is known."""
    arrays = problem.arrays
    hint = filled(len(arrays.entry_offset), -1)
    for number, active in enumerate(problem.expansion.tasks):
        phase = earlier.phases.get(active.name)
        if phase is not None:
            hint[arrays.job_entry[arrays.task_job[number]]] = phase // problem.tick
    return hint


def known_first(construction: Ints, hint: Ints) -> Ints:
    """Return the order of construction with the entries whose phase is known before the others."""
    return ints(sorted(construction, key=lambda entry: hint[entry] < 0))


def rename_units(problem: Problem, units: dict[int, tuple[str, ...]], earlier: Earlier) -> dict[int, tuple[str, ...]]:
    """Exchange the names of units within every group so that as many jobs as possible are where they were."""
    votes = Counter[tuple[str, str]]()
    for job, names in units.items():
        number = problem.arrays.job_task[job]
        key = (problem.expansion.tasks[number].name, job - problem.arrays.task_job[number])
        votes.update(zip(names, earlier.units.get(key, ()), strict=False))
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


def freeze(problem: Problem, state: State, shipped: Mapping[tuple[str, int], Job]) -> tuple[Problem, tuple[str, ...]]:
    """Place the tasks of `shipped` (jobs by task and index) for good; return the problem that
    constructs the rest, and the tasks that cannot stay.

    The problem has one lane per unit. A task stays only if all its jobs are shipped with a version and units that
    it still has. An empty `state` is given and filled.
    """
    arrays, put, groups = problem.arrays, bound("put", problem.arrays, state), _group_of(problem)
    kept: list[int] = []
    changed = []
    for number, active in enumerate(problem.expansion.tasks):
        jobs = [shipped[active.name, index] for index in range(active.jobs) if (active.name, index) in shipped]
        if not jobs:
            continue
        if len(jobs) < active.jobs or not _take_over(problem, state, number, jobs, groups):
            changed.append(active.name)
            continue
        places = range(arrays.task_job[number], arrays.task_job[number + 1])
        for place in places:
            put(place)
        kept += sorted({arrays.job_entry[place] for place in places})
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


def _is_at_releases(problem: Problem, active: ActiveTask, jobs: Iterable[Job]) -> bool:
    """Return whether the jobs of a task start at their releases, where the kernel takes their starts for them."""
    period = active.task.period
    if period is None or not problem.expansion.is_released_at_start(active):
        return True
    return len({(job.start - period * job.index) % problem.expansion.hyperperiod for job in jobs}) == 1


def taken_over(problem: Problem, jobs: Iterable[Job], seed: int) -> tuple[State, Units] | None:
    """Return the placement of all jobs of a mode, whose starts are whole ticks of the problem, and their units.

    None where the kernel has no option for one of them (of large gangs, not every set of groups is tried), or does not
    find that the placement is valid.
    """
    state, groups = new_state(problem.arrays, seed, problem.mean_wcet), _group_of(problem)
    known = {(job.task, job.index): job for job in jobs}
    units: Units = {}
    for number, active in enumerate(problem.expansion.tasks):
        mates = [known.get((active.name, index)) for index in range(active.jobs)]
        if not _take_over(problem, state, number, mates, groups):
            return None
        places = enumerate(mates, problem.arrays.task_job[number])
        units |= {place: job.units for place, job in places if job is not None}
    return (state, units) if load(problem.arrays, state) == 0 else None


def _group_of(problem: Problem) -> dict[str, int]:
    """Return the number of the group of every unit."""
    return {name: group for group, names in enumerate(problem.groups) for name in names}


def _take_over(
    problem: Problem, state: State, task: int, jobs: Sequence[Job | None], groups: Mapping[str, int]
) -> bool:
    """Set option, start and phase of all jobs of a task, of which None do not run; False where that is not possible.

    It is not where the task has no such option, where slack or deadline do not allow the starts, and for a job in parts
    or one that starts outside of the hyperperiod, as in a schedule that was not verified.
    """
    arrays, active = problem.arrays, problem.expansion.tasks[task]
    numbers = range(arrays.task_option[task], arrays.task_option[task + 1])
    known = {_choice(problem.options[number].version, problem.options[number].groups): number for number in numbers}
    starts = [0 if job is None else job.start // problem.tick for job in jobs]
    options = []
    for job in jobs:
        taken = Counter(groups.get(name, -1) for name in job.units) if job is not None else {}
        options.append(known.get((None if job is None else job.version, tuple(sorted(taken.items())))))
    found = [option for option in options if option is not None]
    is_inside = all(0 <= start < arrays.hyperperiod for start in starts) and not any(job and job.parts for job in jobs)
    if len(found) < len(options) or not is_inside or not _is_at_releases(problem, active, filter(None, jobs)):
        return False
    versions = [(job, problem.options[option].version) for job, option in zip(jobs, found, strict=True)]
    present = [(job, version) for job, version in versions if job is not None and version is not None]
    own = [renewed(job, version, _service(problem, job.units)) for job, version in present]
    if not start_in_time(problem.expansion, active, [job for job in own if job is not None]):
        return False
    places = slice(arrays.task_job[task], arrays.task_job[task + 1])
    state.option[places], state.start[places] = ints(found), ints(starts)
    _set_phases(problem, state, task, active.jobs)
    return True


def _service(problem: Problem, units: tuple[str, ...]) -> Service[Duration]:
    return tuple(interrupt for unit in units for interrupt in problem.services[unit])


def _choice(version: Version | None, groups: Choice) -> tuple[str | None, Choice]:
    return (None if version is None else version.name, groups)


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
            span = (begin, ZERO, version.wcet)
            yield job_of(active.name, index, version, units[job], [span], _service(problem, units[job]))


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
