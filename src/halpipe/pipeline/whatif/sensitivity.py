"""Growth of a WCET until the schedule breaks, and until no schedule is found."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.pipeline.parts import parts_of, reserved_length, service_of
from halpipe.pipeline.validate.context import Context
from halpipe.pipeline.verify import verify
from halpipe.pipeline.whatif.changed import Changed, time_limit, with_version_factor
from halpipe.pipeline.whatif.growth import FixedStarts, Limit, common_tick
from halpipe.pipeline.whatif.trial import WINDOWS, Search, bracket, proofs

if TYPE_CHECKING:
    from collections.abc import Iterator
    from fractions import Fraction

    from halpipe.models import Job, ModeSchedule, Schedule, Task, TaskModel, TransitionTable, Version


@record(kw_only=True)
class Searched:
    """The largest WCET with a schedule that was found, and the largest not proven impossible.

    Both are on a grid of shares of the WCET. None: without any limit, because the task can do without the version.
    """

    found: Duration | None
    bound: Duration | None
    failed: tuple[Duration, ...]


@record(kw_only=True)
class Sensitivity:
    """How much the WCET of a version may grow; `growth` is None where the schedule does not use the version."""

    task: str
    version: str
    wcet: Duration
    growth: Duration | None
    reason: str
    searched: Searched | None = None


def sensitivities(model: TaskModel, schedule: Schedule, tasks: frozenset[str]) -> Iterator[Sensitivity]:
    """Yield one row for each version of the named tasks (or all), for a schedule that verifies.

    By `growth` more the schedule still verifies, with every start where it is; by anything more it does not. Where jobs
    are split or interrupted, serve arrivals, or keep requirements of MODEL 10, verify itself says so: by a tick more it
    does not. There the last segment of a preemptive job grows.
    """
    tick = common_tick(model, schedule)
    whole = _has_undisturbed_jobs(model) and not any(True for _ in model.refinements())
    modes = {mode.name: FixedStarts.of(model, mode, tick) for mode in schedule.modes} if whole else {}
    for task in model.tasks:
        for version in task.versions:
            if version.wcet is None or (tasks and task.name not in tasks):
                continue
            limit = _in_modes(modes, task.name, version.name)
            if not whole:
                limit = _by_verify(model, schedule, task.name, version.name, tick)
            limit = _across_switches(model, schedule, task.name, version.name, tick, limit)
            yield Sensitivity(
                task=task.name,
                version=version.name,
                wcet=version.wcet,
                growth=None if limit is None else tick * limit.growth,
                reason="" if limit is None else limit.reason,
            )


def _in_modes(modes: dict[str, FixedStarts], task: str, version: str) -> Limit | None:
    limits = []
    for name, starts in modes.items():
        limit = starts.limit(task, version)
        if limit is not None:
            limits.append(Limit(limit.growth, f'mode "{name}": {limit.reason}' if len(modes) > 1 else limit.reason))
    return min(limits, key=lambda limit: limit.growth, default=None)


def _by_verify(model: TaskModel, schedule: Schedule, task: str, version: str, tick: Duration) -> Limit | None:
    """Return the limit that the modes give which use the version, each looked at alone."""
    limit: Limit | None = None
    for mode in schedule.modes:
        if any((job.task, job.version) == (task, version) for job in mode.jobs):
            alone = model.alone(mode.name)
            most = limit or Limit(mode.hyperperiod // tick, "length of the hyperperiod")
            limit = _across(
                alone, schedule.alone((mode,)), task, version, tick, most, _room(mode, task, version) // tick
            )
    return limit


def _room(mode: ModeSchedule, task: str, version: str) -> Duration:
    """Return after what growth the jobs of a version certainly run into who comes next on one of their units."""
    starts: dict[str, list[Duration]] = {}
    for job in mode.jobs:
        for unit in job.units:
            starts.setdefault(unit, []).extend(start % mode.hyperperiod for start, _ in job.occupations())
    for each in starts.values():
        each.sort()
    rooms = []
    for job in mode.jobs:
        end = job.end % mode.hyperperiod
        for unit in job.units if (job.task, job.version) == (task, version) else ():
            following = bisect_left(starts[unit], end)
            turn = ZERO if following < len(starts[unit]) else mode.hyperperiod
            rooms.append(starts[unit][following % len(starts[unit])] + turn - end)
    return min(rooms)


def _has_undisturbed_jobs(model: TaskModel) -> bool:
    """Return whether jobs are neither split nor interrupted, and none serves arrivals."""
    splits = (version.split.is_allowed for task in model.tasks for version in task.versions)
    served = any(unit.interrupts for unit in model.units)
    return not (served or any(splits) or any(task.distance is not None for task in model.tasks))


def grown(
    model: TaskModel, schedule: Schedule, task: str, version: str, growth: Duration
) -> tuple[TaskModel, Schedule]:
    """Return model and schedule with a longer WCET of a version, every start where it was, and no figures reported.

    Of a job with gaps the last part grows.
    """
    units = {unit.name: unit for unit in model.units}

    def longer(v: Version) -> Version:
        return replace(v, wcet=v.wcet + growth) if v.name == version and v.wcet is not None else v

    def later(job: Job) -> Job:
        if (job.task, job.version) != (task, version):
            return job
        *before, last = parts_of(job, model.task(task).version(version))
        done = last.executed_to + growth
        resume = model.task(task).version(version).split.resume if before else ZERO
        end = last.start + reserved_length(resume + done - last.executed_from, service_of(units, job.units))
        parts = (*before, replace(last, executed_to=done, end=end)) if before else ()
        return replace(job, end=end, parts=parts)

    tasks = tuple(replace(t, versions=tuple(map(longer, t.versions))) if t.name == task else t for t in model.tasks)
    modes = tuple(
        replace(mode, jobs=tuple(map(later, mode.jobs)), cost=None, unit_loads=(), resource_loads=(), chains=())
        for mode in schedule.modes
    )
    tables = tuple(replace(table, jobs=tuple(map(later, table.jobs))) for table in schedule.transitions)
    return replace(model, tasks=tasks), replace(schedule, modes=modes, transitions=tables)


# ------------------------------------------------------------------------------------------------ switches


def _across_switches(
    model: TaskModel, schedule: Schedule, task: str, version: str, tick: Duration, limit: Limit | None
) -> Limit | None:
    """Tighten a limit by what verify says of the switches, each with its two modes."""
    for table in schedule.transitions:
        alone = _switch_alone(model, schedule, table)
        jobs = [*table.jobs, *(job for mode in alone[1].modes for job in mode.jobs)]
        if not any((job.task, job.version) == (task, version) for job in jobs):
            continue
        if limit is None:  # used by a table only
            limit = Limit(max(mode.hyperperiod for mode in schedule.modes) // tick, "length of the hyperperiod")
        limit = _across(*alone, task, version, tick, limit)
    return limit


def _switch_alone(model: TaskModel, schedule: Schedule, table: TransitionTable) -> tuple[TaskModel, Schedule]:
    pair = (table.source, table.target)
    listed = tuple(t for t in model.allowed_transitions() if (t.source, t.target) == pair)
    alone = model.alone(*pair, transitions=listed)
    modes = tuple(mode for mode in schedule.modes if mode.name in pair)
    return alone, schedule.alone(modes, (table,))


def _across(
    model: TaskModel, schedule: Schedule, task: str, version: str, tick: Duration, limit: Limit, room: int | None = None
) -> Limit:
    """Bisect with verify, which is the only one to know all rules; growth beyond `room` is known to break one."""

    def fault(growth: int) -> str:
        longer = grown(model, schedule, task, version, tick * growth)
        return next((f"{d.path}: {d.message}" for d in verify(*longer) if d.is_error), "")

    good, bad = 0, limit.growth
    if room is not None and room < limit.growth:
        bad = room + 1
    elif not fault(limit.growth):
        return limit
    while bad - good > 1:
        middle = (good + bad) // 2
        good, bad = (good, middle) if fault(middle) else (middle, bad)
    return Limit(good, fault(bad))


# ------------------------------------------------------------------------------------------------ search


def searched(model: TaskModel, row: Sensitivity, search: Search, step: Fraction) -> Searched:
    """Look how far the WCET can grow if everything may move, in steps of a share of the WCET."""
    task = model.task(row.task)
    without = _longest(model, task, row.wcet, step) + 1  # so long that the version cannot be chosen any more
    least = without - (row.growth or ZERO) // (row.wcet * step)

    def factor(number: int) -> Fraction:
        return 1 + step * (without - number)

    def changed(number: int) -> Changed:
        return with_version_factor(model, row.task, row.version, factor(number))

    result = bracket(
        least,
        lambda number: proofs(changed(number), WINDOWS),
        lambda number: search.finds(changed(number)),
        known=least,
    )

    def wcet(number: int | None) -> Duration | None:
        return row.wcet * factor(number) if number else None

    failed = tuple(w for w in map(wcet, result.failed) if w is not None)
    return Searched(found=wcet(result.found), bound=wcet(result.possible), failed=failed)


def _longest(model: TaskModel, task: Task, wcet: Duration, step: Fraction) -> int:
    """Return how many steps longer than now a WCET may be that deadline and hyperperiods allow."""
    hyperperiods = [mode.hyperperiod or ZERO for mode in Context(model).active if task.name in mode.tasks]
    limit = time_limit(task)
    most = max(hyperperiods, default=ZERO)
    return ((most if limit is None else limit) - wcet) // (wcet * step)
