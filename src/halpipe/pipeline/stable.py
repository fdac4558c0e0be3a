"""A schedule near an earlier one: as many jobs as possible stay at their start, on their units, in their version.

Of jobs that exclude each other where they lie, one must move: the largest number of such sets without a job in common
bounds what must move. Small sets of tasks that leave no conflict are placed anew first. Where none suffices, the tasks
that have changed are, then those as well that have a part in a rule that the best placement breaks; at last everything
is. What is free is tried first where it was. If more have moved than the bound, the exact engine, where it is
installed, looks for a schedule in which fewer have, or proves that there is none; without a proof, tasks are put back
one after the other.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, HalpipeError, about, note
from halpipe.core.grouping import grouped
from halpipe.core.suggest import few
from halpipe.models import Binding, Job, Mode, Schedule, Status, Task, TaskModel, Unit
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.parts import renewed, service_of
from halpipe.pipeline.shipped import overlaps, staying
from halpipe.pipeline.solve.codes import CANNOT_STAY
from halpipe.pipeline.solve.exact_goals import is_same

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping

    from halpipe.core.durations import Duration
    from halpipe.pipeline.solve.schedule import Scheduled, SearchOptions

NEAR = note(
    "HAL0414",
    "Jobs beside those of an earlier schedule",
    "With --near, jobs stay where an earlier schedule has them, as far as the model allows: at the same start, on the "
    "same units, in the same version. The others are listed by task; `halpipe diff` shows each.",
)

LONGER = "has another WCET"
"""Why a job may not be what it was, although it may stay where it was."""

BUDGET = 300
"""Moves per task for the tasks that are free, before more of them are."""

FOR_EACH_FREE = 30
"""So many of them for each that is free: a few soon find all the places that there are."""

COVERS, MANY_JOBS, MOST_CHOICES = 8, 2000, 100
"""Sets of tasks that are free alone, of those that leave no two jobs that exclude each other; of so many jobs one. With
more choices than this, no such set is looked for."""

ROUNDS = 12
"""How often more of them are freed before everything is searched for."""

MOST_PUT_BACK = 24
"""So many tasks that have moved are tried where they were."""

MOST_NAMED = 12
"""Tasks that are named in the note."""


def schedule_near(
    model: TaskModel, options: SearchOptions, earlier: Schedule, solve: Callable[[SearchOptions], Scheduled]
) -> Scheduled:
    """Return the schedule that `solve` finds with as many tasks as possible where `earlier` has them."""
    options = replace(options, optimise=options.optimise or ())  # a margin would move jobs
    changed = _changed(model, earlier, options.tick)
    held = _displaced(earlier, options.shipped)
    conflicts = _conflicts(model, earlier, options)
    fewest = {mode: _packing(sets) for mode, sets in conflicts.items()}

    def attempt(kept: Schedule, budget: int = BUDGET // 4) -> Scheduled | None:
        return _attempt(_near(options, earlier, kept, budget), solve)

    def is_least(found: Scheduled) -> bool:
        moved = moved_jobs(earlier, found.schedule)
        return all(len(jobs) <= fewest[mode] for mode, jobs in moved.items())

    found: Scheduled | None = None
    for free in _covers(earlier, held, conflicts.values()):
        other = attempt(_without(earlier, free), min(BUDGET, FOR_EACH_FREE * max(1, len(free))))
        if other is not None and other.is_complete and (found is None or _is_nearer(earlier, other, found)):
            found = other
            if is_least(found) or _is_exact(model, options, found):  # takes less time than further sets
                break
    if found is None:
        found = _freed(model, options, earlier, held | frozenset(changed), solve)
    if found.is_complete and not is_least(found):
        if _is_exact(model, options, found):
            found, proven = _fewest(model, options, earlier, found, fewest, solve)
            fewest = {mode: max(count, proven.get(mode, 0)) for mode, count in fewest.items()}
        if not is_least(found):
            found = _put_back(earlier, found, attempt)
    shipped = {job.task for mode in (options.shipped.modes if options.shipped else ()) for job in mode.jobs}
    anew = [d for d in found.diagnostics if d.code == CANNOT_STAY.id and _task_of(d) not in shipped]
    notes = [d for d in found.diagnostics if d not in anew]
    changed = dict.fromkeys(map(_task_of, anew), "may not stay there") | changed
    return replace(found, diagnostics=(*notes, *_told(earlier, found.schedule, changed, fewest)))


def settled(before: TaskModel, model: TaskModel, schedule: Schedule, changed: Collection[str]) -> Schedule:
    """Return the tables of a schedule of `before` for which nothing that they depend on differs in `model`.

    Modes named as `changed` differ. A task without migration has one place in all its modes: they differ together.
    """
    known = {mode.name: mode for mode in before.modes}
    reached = {
        mode.name
        for mode in model.modes
        if mode.name in changed or mode.name not in known or _seen(before, known[mode.name]) != _seen(model, mode)
    }
    fixed = {task.name for task in model.tasks if task.binding is Binding.SYSTEM}
    tasks = {mode.name: {run.task for run in mode.runs} & fixed for mode in model.modes}
    while more := {n for n in tasks if n not in reached and any(tasks[n] & tasks[other] for other in reached)}:
        reached |= more
    tables = schedule.transitions if before.transitions == model.transitions else ()
    same = tasks.keys() - reached
    return schedule.alone(
        tuple(mode for mode in schedule.modes if mode.name in same),
        tuple(table for table in tables if {table.source, table.target} <= same),
    )


def _seen(model: TaskModel, mode: Mode) -> TaskModel:
    """Return what a mode depends on: its tasks and chains, and the platform."""
    names = {run.task for run in mode.runs}
    tasks = tuple(task for task in model.tasks if task.name in names)
    chains = tuple(chain for chain in model.chains if names.issuperset(chain.tasks))
    return replace(model.alone(mode.name), tasks=tasks, chains=chains)


def _task_of(finding: Diagnostic) -> str:
    return next((subject.name for subject in finding.subjects if subject.kind == "task"), "")


def _is_exact(model: TaskModel, options: SearchOptions, found: Scheduled) -> bool:
    """Whether the exact engine follows, for one mode at least."""
    from halpipe.pipeline.solve.exact_goals import counts_moves

    modes = (model.mode(mode.name) for mode in found.schedule.modes)
    return options.is_open and any(counts_moves(model, expand(model, mode)) for mode in modes)


def _attempt(options: SearchOptions, solve: Callable[[SearchOptions], Scheduled]) -> Scheduled | None:
    """Return what is found with the jobs that stay; None where they exclude each other."""
    try:
        return solve(options)
    except HalpipeError:
        return None


def _freed(
    model: TaskModel,
    options: SearchOptions,
    earlier: Schedule,
    free: frozenset[str],
    solve: Callable[[SearchOptions], Scheduled],
) -> Scheduled:
    """Free changed tasks, then more and more that are in their way; return what is found."""
    for _ in range(ROUNDS):
        budget = min(BUDGET, FOR_EACH_FREE * max(1, len(free)))
        found = _attempt(_near(options, earlier, _without(earlier, free), budget), solve)
        if found is None:  # what cannot be frozen is searched for as a whole
            break
        if found.is_complete or found.stopped:
            return found
        more = _in_the_way(model, found.schedule, free)
        if not more:
            break
        free |= more
    return solve(replace(options, near=None, like=earlier))


# ------------------------------------------------------------------------------------------------ least moves

_Jobs = frozenset[tuple[str, int]]


def _conflicts(model: TaskModel, earlier: Schedule, options: SearchOptions) -> dict[str, list[_Jobs]]:
    """Return sets of jobs of each mode of which one at least must move, since they exclude each other as they lie."""
    found = {}
    tables, units = {table.name: table for table in earlier.modes}, {unit.name: unit for unit in model.units}
    for mode in model.modes:
        if options.modes and mode.name not in options.modes:
            continue
        expansion = expand(model, mode)
        every = tables[mode.name].jobs if mode.name in tables else ()
        jobs = [job for job in every if job.task in expansion.by_name]
        found_why = ((job, _hinders(units, model.task(job.task), job, options.tick)) for job in jobs)
        known = {(job.task, job.index) for job, why in found_why if why in ("", LONGER)}
        periodic = (active for active in expansion.tasks if active.task.period is not None)
        keys = ((active.name, index) for active in periodic for index in range(active.jobs))
        sets = [frozenset([key]) for key in keys if key not in known]
        pairs = overlaps(expansion, staying(expansion, jobs))
        sets += [frozenset([(one.task, one.index), (two.task, two.index)]) for *_, one, two in pairs]
        found[mode.name] = list(dict.fromkeys(sets))
    return found


def _packing(sets: Iterable[_Jobs]) -> int:
    """Return how many of the sets have no job in common, those with the fewest neighbours first."""
    counts = Counter(job for each in sets for job in each)
    used: set[tuple[str, int]] = set()
    number = 0
    for each in sorted(sets, key=lambda each: (sum(counts[job] for job in each), sorted(each))):
        if used.isdisjoint(each):
            used |= each
            number += 1
    return number


def _covers(earlier: Schedule, free: frozenset[str], conflicts: Iterable[list[_Jobs]]) -> list[frozenset[str]]:
    """Return sets of tasks that leave no conflict when they are free, those with the fewest jobs first."""
    jobs = Counter(job.task for mode in earlier.modes for job in mode.jobs)
    choices = {frozenset(task for task, _ in each) for sets in conflicts for each in sets}
    open_choices = sorted((sorted(each) for each in choices if not each & free), key=lambda each: (len(each), each))
    most = COVERS if jobs.total() <= MANY_JOBS else 1
    if len(open_choices) > MOST_CHOICES:  # most of what has changed moves
        return []
    covers = [free]
    for choice in open_choices:
        wider = {cover if cover & set(choice) else cover | {task} for cover in covers for task in choice}
        covers = sorted(wider, key=lambda cover: (sum(jobs[name] for name in cover), sorted(cover)))[:most]
    return covers


def _fewest(
    model: TaskModel,
    options: SearchOptions,
    earlier: Schedule,
    found: Scheduled,
    fewest: Mapping[str, int],
    solve: Callable[[SearchOptions], Scheduled],
) -> tuple[Scheduled, dict[str, int]]:
    """Ask the exact engine for fewer moves; return the better schedule, and what is proven to be the least of modes."""
    from halpipe.pipeline.solve.exact import Effort
    from halpipe.pipeline.solve.exact_goals import MOVED_WORK, Fewest, fewest_moved

    least: dict[str, int] = {}
    better = []
    for mode, moved in zip(found.schedule.modes, moved_jobs(earlier, found.schedule).values(), strict=True):
        answer = Fewest()
        if moved:
            expansion = expand(model, model.mode(mode.name))
            effort = Effort(work=MOVED_WORK, seed=options.seed)
            before, held = _jobs_of(earlier, mode.name), _jobs_of(options.shipped, mode.name)
            answer = fewest_moved(model, expansion, before, held, mode.jobs, fewest.get(mode.name, 0), effort)
        least[mode.name] = answer.bound
        better.append(replace(mode, jobs=answer.jobs or mode.jobs))
    wanted = found.schedule.alone(tuple(better))
    if wanted.modes != found.schedule.modes:
        other = _attempt(_near(options, wanted, wanted), solve)
        if other is not None and _is_nearer(earlier, other, found):
            found = other
    return found, least


def _jobs_of(schedule: Schedule | None, mode: str) -> dict[tuple[str, int], Job]:
    tables = [each for each in schedule.modes if each.name == mode] if schedule is not None else []
    return {(job.task, job.index): job for each in tables for job in each.jobs}


def moved_jobs(earlier: Schedule, found: Schedule) -> dict[str, list[Job]]:
    """Return the jobs of each mode that are not where they were."""
    moved = {}
    for mode in found.modes:
        before = _jobs_of(earlier, mode.name)
        moved[mode.name] = [job for job in mode.jobs if not is_same(job, before)]
    return moved


def _moved_tasks(earlier: Schedule, found: Schedule) -> Counter[str]:
    """Return how many jobs of each task are not where they were, of tasks of which any is."""
    return Counter(job.task for jobs in moved_jobs(earlier, found).values() for job in jobs)


def _near(options: SearchOptions, earlier: Schedule, kept: Schedule, budget: int = BUDGET) -> SearchOptions:
    """Return the options of a search in which the kept jobs of the earlier schedule stay, and no others have to.

    It is not saved: a checkpoint has one state for each mode, and the next search keeps other jobs.
    """
    shipped = _together(options.shipped, kept)
    return replace(options, shipped=shipped, near=None, like=earlier, budget=budget, keeper=None)


def _put_back(earlier: Schedule, found: Scheduled, attempt: Callable[[Schedule], Scheduled | None]) -> Scheduled:
    """Return a schedule in which fewer jobs have moved, if there is one: some tasks were freed without need.

    One after the other stays where it was, those with the most jobs first, while the others that have moved are free.
    """
    counts = _moved_tasks(earlier, found.schedule)
    for name in sorted(counts, key=lambda name: (-counts[name], name))[:MOST_PUT_BACK]:
        moved = _moved_tasks(earlier, found.schedule).keys()
        if name in moved:
            found = _better(earlier, found, _without(earlier, moved - {name}), attempt)
    return found


def _better(
    earlier: Schedule, found: Scheduled, kept: Schedule, attempt: Callable[[Schedule], Scheduled | None]
) -> Scheduled:
    """Return the schedule found with the kept jobs where fewer have moved in it; otherwise the present one."""
    other = attempt(kept)
    return other if other is not None and _is_nearer(earlier, other, found) else found


def _is_nearer(earlier: Schedule, other: Scheduled, found: Scheduled) -> bool:
    counts = (_moved_tasks(earlier, each.schedule).total() for each in (other, found))
    return other.is_complete and next(counts) < next(counts)


def _in_the_way(model: TaskModel, best: Schedule, free: frozenset[str]) -> frozenset[str]:
    """Return as many tasks again: those in most broken rules of the best placement, else beside the free ones."""
    counts = Counter(s.name for d in broken(model, best) for s in d.subjects if s.kind == "task" and s.name not in free)
    jobs = [job for mode in best.modes for job in mode.jobs]
    units = {unit for job in jobs if job.task in free for unit in job.units}
    beside = Counter(job.task for job in jobs if job.task not in free and not units.isdisjoint(job.units))
    ordered = sorted(counts or beside, key=lambda name: (-counts[name], beside[name], name))
    return frozenset(ordered[: max(1, len(free))])


def broken(model: TaskModel, best: Schedule) -> list[Diagnostic]:
    """Return what verify finds in the best placement of a search, without regard to what its author claims of it."""
    from halpipe.pipeline.verify import verify

    tables = tuple(replace(table, status=Status.VALID, cost=None, chains=()) for table in best.modes)
    alone = model.alone(*(table.name for table in tables))
    return [found for found in verify(alone, best.alone(tables)) if found.is_error]


def _displaced(earlier: Schedule, held: Schedule | None) -> frozenset[str]:
    """Return the tasks of held jobs, and those with a job that one of them would meet on its unit."""
    names: set[str] = set()
    before = {mode.name: mode for mode in earlier.modes}
    for mode in held.modes if held is not None else ():
        own = {job.task for job in mode.jobs}
        others = [job for job in before[mode.name].jobs if job.task not in own] if mode.name in before else []
        names |= own | {job.task for job in others for one in mode.jobs if _meet(one, job, mode.hyperperiod)}
    return frozenset(names)


def _meet(one: Job, other: Job, length: Duration) -> bool:
    """Return whether two jobs use one unit at one time, on the circle of the hyperperiod."""
    if not set(one.units) & set(other.units):
        return False
    ahead = (other.start - one.start) % length
    return ahead < one.end - one.start or length - ahead < other.end - other.start


def _together(held: Schedule | None, kept: Schedule) -> Schedule:
    """Return the kept jobs with those held; of a task that is held there, or on other units elsewhere, no others."""
    if held is None:
        return kept
    stays = {mode.name: mode.jobs for mode in held.modes}
    units = grouped((job.task, {*job.units}) for mode in held.modes for job in mode.jobs)
    modes = []
    for mode in kept.modes:
        own = stays.get(mode.name, ())
        tasks = {job.task for job in own}
        tasks |= {job.task for job in mode.jobs if job.task in units and {*job.units} not in units[job.task]}
        modes.append(replace(mode, jobs=(*own, *(job for job in mode.jobs if job.task not in tasks))))
    return kept.alone(tuple(modes))


def _changed(model: TaskModel, earlier: Schedule, tick: Duration | None) -> dict[str, str]:
    """Return the tasks of which some job cannot be what it was, and why."""
    units = {unit.name: unit for unit in model.units}
    jobs = grouped((job.task, job) for mode in earlier.modes for job in mode.jobs)
    why = {
        task.name: next((why for job in jobs[task.name] if (why := _hinders(units, task, job, tick))), "")
        if task.name in jobs
        else "is new"
        for task in model.tasks
    }
    return {name: reason for name, reason in why.items() if reason}


def _hinders(units: Mapping[str, Unit], task: Task, job: Job, tick: Duration | None) -> str:
    version = next((v for v in task.versions if v.name == job.version), None)
    if version is None or version.wcet is None:
        return f'has no version "{job.version}"'
    if len(job.units) != version.gang or not all(unit in version.units and unit in units for unit in job.units):
        return "has other units"
    if tick is not None and job.start % tick:
        return "starts between the ticks"
    now = renewed(job, version, service_of(units, job.units))
    if now is None:
        return "has no time beside the interrupts of its units"
    return "" if job.parts or now.end == job.end else LONGER


def _without(earlier: Schedule, free: Collection[str]) -> Schedule:
    modes = (replace(mode, jobs=tuple(job for job in mode.jobs if job.task not in free)) for mode in earlier.modes)
    return earlier.alone(tuple(modes))


def _told(
    earlier: Schedule, found: Schedule, changed: Mapping[str, str], fewest: Mapping[str, int]
) -> list[Diagnostic]:
    """List for each mode how many jobs stay, which tasks have others and why, and whether fewer could move."""
    notes = []
    for mode, moved in zip(found.modes, moved_jobs(earlier, found).values(), strict=True):
        names = sorted({job.task for job in moved}, key=lambda name: (name not in changed, name))
        reasons = [f"{name} ({changed.get(name, 'makes room')})" for name in names]
        others = f"; not those of {few(reasons, MOST_NAMED, quote='')}" if names else ""
        text = f"{len(mode.jobs) - len(moved)} of {len(mode.jobs)} jobs stay where they were{others}"
        if moved:
            least = fewest.get(mode.name, 0)
            proven = "proven" if least >= len(moved) else f"at least {least} must" if least else "not proven"
            text += f"; no schedule moves fewer: {proven}"
        notes.append(NEAR(text, path=about(mode=mode.name), help="" if not names else "see `halpipe diff`"))
    return notes
