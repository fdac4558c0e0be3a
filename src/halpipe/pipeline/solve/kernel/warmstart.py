"""From schedules to states of the kernel and back: warm starts, jobs that stay, and names for the answer."""

from __future__ import annotations

from collections import Counter
from dataclasses import field
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.models import Binding
from halpipe.pipeline.parts import job_of
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
    from collections.abc import Iterable, Iterator, Mapping

    from halpipe.core.durations import Duration
    from halpipe.models import Job
    from halpipe.pipeline.jobs import ActiveTask, Expansion
    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.kernel.assign_units import Units
    from halpipe.pipeline.solve.lanes import Pins
    from halpipe.pipeline.solve.problem import Option, Problem


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
                phase = (job.start - period * job.index) % expansion.hyperperiod % period
                phases[job.task] = min(phase, phases.get(job.task, phase))
        return Earlier(phases, units, pins)


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


def freeze(problem: Problem, state: State, shipped: Mapping[tuple[str, int], Job]) -> tuple[Problem, tuple[str, ...]]:
    """Place the tasks of `shipped` (jobs by task and index) for good; return the problem that
    constructs the rest, and the tasks that cannot stay.

    The problem has one lane per unit. A task stays only if all its jobs are shipped with a version and units that
    it still has. An empty `state` is given and filled.
    """
    arrays = problem.arrays
    put, group_of = bound("put", arrays, state), {names[0]: group for group, names in enumerate(problem.groups)}
    kept, changed = [], []
    for number, active in enumerate(problem.expansion.tasks):
        jobs = [shipped[active.name, index] for index in range(active.jobs) if (active.name, index) in shipped]
        if not jobs:
            continue
        numbers = _numbers(problem, number)
        options = [option for job in jobs if (option := _option(problem, numbers, group_of, job)) is not None]
        if len(options) < active.jobs or not _is_at_releases(problem, active, jobs):
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


def _is_at_releases(problem: Problem, active: ActiveTask, jobs: Iterable[Job]) -> bool:
    """Return whether the jobs of a task start at their releases, where the kernel takes their starts for them."""
    period = active.task.period
    if period is None or not problem.expansion.is_released_at_start(active):
        return True
    return len({(job.start - period * job.index) % problem.expansion.hyperperiod for job in jobs}) == 1


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
        if not _is_at_releases(problem, active, [job for job in mates if job is not None]):
            return None
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
