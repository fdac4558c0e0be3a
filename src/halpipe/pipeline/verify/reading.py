"""Brings the model and the untrusted schedule file together: resolves names, converts time, reports what does not fit.

A part that cannot be understood is reported and left out; the rules then look at everything else.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Findings, about
from halpipe.core.durations import ZERO, Duration
from halpipe.models import Edge, Match, ResourceKind, Status
from halpipe.pipeline.verify import codes, modelfaults
from halpipe.pipeline.verify.tables import (
    MAX_BITS,
    TABLE,
    ActiveMode,
    ActiveTask,
    Clock,
    Instants,
    ModeTable,
    Placed,
    Switch,
    common_denominator,
    switch_path,
)
from halpipe.pipeline.verify.ticks import Platform, Service
from halpipe.pipeline.verify.timing import release

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.models import Job, Mode, ModeSchedule, Schedule, Task, TaskModel, TransitionTable
    from halpipe.pipeline.verify.tables import Stretch


def make_clock(model: TaskModel, schedule: Schedule) -> Clock | None:
    """Find the scale that makes every duration whole; None where it is out of reach."""
    durations = {d.ns for d in (*_model_durations(model), *_schedule_durations(schedule))}
    scale = common_denominator(ns.denominator for ns in durations if not isinstance(ns, int))
    return Clock(scale) if scale else None


def _model_durations(model: TaskModel) -> Iterator[Duration]:
    for unit in model.units:
        for interrupt in unit.interrupts:
            yield from (interrupt.distance, interrupt.wcet)
    for task in model.tasks:
        stated = (task.period, task.offset, task.deadline, task.distance, task.let)
        yield from (d for d in stated if d is not None)
        for version in task.versions:
            yield from version.split.points
            yield from (d for d in (version.split.resume, version.split.min_part) if d is not None)
            if version.wcet is not None:
                yield version.wcet
            for access in version.accesses:
                yield from (access.start, access.end)
            for precedence in version.precedences:
                yield from (d for d in (precedence.min, precedence.max, precedence.point) if d is not None)
    for chain in model.chains:
        yield from (d for d in (chain.max_latency, chain.max_reaction, chain.max_age) if d is not None)


def _schedule_durations(schedule: Schedule) -> Iterator[Duration]:
    for mode in schedule.modes:
        yield from _job_durations(mode.jobs)
    for table in schedule.transitions:
        yield table.length
        yield from _job_durations(table.jobs)


def _job_durations(jobs: tuple[Job, ...]) -> Iterator[Duration]:
    for job in jobs:
        yield from (job.start, job.end)
        for part in job.parts:
            yield from (part.start, part.end, part.executed_from, part.executed_to)


# ------------------------------------------------------------------------------------------------ the model


def active_modes(model: TaskModel, clock: Clock, found: Findings) -> dict[str, ActiveMode]:
    """Return every mode of the model by name, with what its tasks need."""
    found.extend(modelfaults.repeated_names(model))
    found.extend(modelfaults.unknown_names(model))
    found.extend(modelfaults.interrupts(model))
    found.extend(modelfaults.events(model))
    platform = _platform(model, clock)
    modes: dict[str, ActiveMode] = {}
    for mode in model.modes:
        if mode.name not in modes:
            modes[mode.name] = _active_mode(model, mode, platform, clock, found)
    return modes


def _platform(model: TaskModel, clock: Clock) -> Platform:
    served = {unit.name: unit.interrupts for unit in reversed(model.units) if unit.interrupts}
    usable = {name: tuple(i for i in rows if modelfaults.is_interrupt(i)) for name, rows in served.items()}
    return Platform(
        {name: tuple((clock.ticks(i.distance), clock.ticks(i.wcet)) for i in r) for name, r in usable.items()}
    )


def _active_mode(model: TaskModel, mode: Mode, platform: Platform, clock: Clock, found: Findings) -> ActiveMode:
    runs = {run.task: run.versions for run in reversed(mode.runs)}
    locks = frozenset(r.name for r in model.resources if r.kind is ResourceKind.LOCK)
    tasks: dict[str, ActiveTask] = {}
    for task in model.tasks:
        if runs.get(task.name) and task.name not in tasks:
            tasks[task.name] = _active_task(task, runs[task.name], locks, clock, found)
    found.extend(modelfaults.cycle(mode.name, tasks, mode.at))
    found.extend(modelfaults.instants(tasks))
    period = 1  # t_P, the least common multiple of the periods (paper, section III)
    for active in tasks.values():
        period = math.lcm(period, active.period or 1) if period.bit_length() <= MAX_BITS else period
    fault = ""
    if period.bit_length() > MAX_BITS:
        fault = f"its hyperperiod has more than {MAX_BITS} bits"
    elif all(active.period is None for active in tasks.values()):
        fault = "no periodic task runs in it, so it has no hyperperiod"
    if fault:
        help = "correct the periods, or remove the mode"
        found.add(codes.MODEL_FAULT(fault, at=mode.at, path=about(mode=mode.name), help=help))
        return ActiveMode(mode.name, tasks, 0, platform)
    return ActiveMode(mode.name, tasks, period, platform, locks, _in_first(tasks), mode.edge is Edge.CLOSED)


def _in_first(tasks: dict[str, ActiveTask]) -> frozenset[str]:
    """Return the tasks that a constraint on the same cycle or a logical execution time names."""
    named = {name for name, active in tasks.items() if active.let is not None}
    for name, active in tasks.items():
        rows = (row for version in active.versions.values() for row in version.precedences)
        before = [row.task for row in rows if row.match is Match.CYCLE]
        named.update((name, *before) if before else ())
    return frozenset(named)


def _active_task(
    task: Task, available: tuple[str, ...], locks: frozenset[str], clock: Clock, found: Findings
) -> ActiveTask:
    found.extend(modelfaults.timing(task))
    versions = {v.name: v for v in reversed(task.versions)}
    for name in dict.fromkeys(available):
        if name in versions:
            found.extend(modelfaults.version(task, versions[name], locks))
    wcets = {v.name: clock.ticks(v.wcet) for v in versions.values() if v.wcet is not None and v.wcet >= ZERO}
    period = clock.ticks(task.period) if task.period is not None and task.period > ZERO else None
    chosen = {name: versions[name] for name in available if name in versions}
    let = clock.ticks(task.let) if task.let is not None and period is not None else None
    resumes = {v.name: clock.ticks(v.split.resume) for v in versions.values() if v.split.resume}
    return ActiveTask(task, chosen, wcets, period, let, resumes)


# ------------------------------------------------------------------------------------------------ the schedule


def header(model: TaskModel, schedule: Schedule) -> Iterator[Diagnostic]:
    """The schedule belongs to this model: same name, and same hash where both are known."""
    if schedule.model != model.name:
        text = f'was made for model "{schedule.model}", not for "{model.name}"'
        yield codes.WRONG_MODEL(text, at=schedule.at, path="schedule", help="check it against its own model")
    if model.digest and schedule.model_sha256 and model.digest != schedule.model_sha256:
        text = f"was made from a model file with SHA-256 {schedule.model_sha256}, this one has {model.digest}"
        yield codes.MODEL_CHANGED(text, at=schedule.at, path="schedule", help="schedule the model again")


def mode_tables(
    model: TaskModel, schedule: Schedule, modes: dict[str, ActiveMode], clock: Clock, found: Findings
) -> dict[str, ModeTable]:
    """Return the table of every mode that can be checked: known, given once, with a hyperperiod."""
    tables: dict[str, ModeTable] = {}
    seen: set[str] = set()
    for given in schedule.modes:
        path = about(mode=given.name)
        if given.name not in modes:
            known = ", ".join(f'"{name}"' for name in modes) or "none"
            text = "does not exist in the model"
            found.add(codes.UNKNOWN_MODE(text, at=given.at, path=path, help=f"the model's modes: {known}"))
        elif given.name in seen:
            found.add(codes.REPEATED_TABLE("has two tables", at=given.at, path=path, help="keep one of them"))
        else:
            mode = modes[given.name]
            found.extend(_claims(given, mode, clock))
            if mode.period and (given.jobs or given.status is Status.VALID):
                tables[given.name] = _mode_table(model, given, mode, clock, found)
        seen.add(given.name)
    for name in modes:
        if name not in seen:
            text = "has no table in the schedule"
            path = about(mode=name)
            found.add(codes.MISSING_MODE(text, at=schedule.at, path=path, help="schedule this mode as well"))
    return tables


def _claims(given: ModeSchedule, mode: ActiveMode, clock: Clock) -> Iterator[Diagnostic]:
    """The table says that it was found, and names the right hyperperiod."""
    path = about(mode=given.name)
    if given.status is not Status.VALID:
        text = "no valid table was found for it"
        help = "give the search more time, or relax the model; `halpipe explain` names the conflict"
        yield codes.MODE_NOT_FOUND(text, at=given.at, path=path, help=help)
    if mode.period and given.hyperperiod * clock.scale != Duration(mode.period):
        text = f"has the hyperperiod {given.hyperperiod}, but its periods make {clock.text(mode.period)}"
        yield codes.WRONG_HYPERPERIOD(text, at=given.at, path=path, help="schedule the mode again")


def _mode_table(model: TaskModel, given: ModeSchedule, mode: ActiveMode, clock: Clock, found: Findings) -> ModeTable:
    path = about(mode=mode.name)
    jobs: list[Placed] = []
    by_task: dict[str, list[Placed]] = {}
    for placed in _placed_jobs(model, mode, given.jobs, path, clock, found):
        if not 0 <= placed.start < mode.period:
            found.add(_bad_start(placed, path, f"[0, {clock.text(mode.period)})"))
            placed.start %= mode.period  # (D) so that the other rules can still be checked
        jobs.append(placed)
        by_task.setdefault(placed.job.task, []).append(placed)
    table = ModeTable(model, clock, mode, given, jobs, by_task, Instants(by_task, mode.period))
    release(table)
    return table


def _placed_jobs(
    model: TaskModel, mode: ActiveMode, jobs: tuple[Job, ...], path: str, clock: Clock, found: Findings
) -> Iterator[Placed]:
    """Yield the jobs whose task runs in `mode`, and check what each says of itself."""
    names = {task.name for task in model.tasks}
    for job in jobs:
        active = mode.tasks.get(job.task)
        if active is None:
            found.add(_no_task(job, job.task in names, path, mode.name))
            continue
        wcet = active.wcets.get(job.version)
        service = mode.platform.service(job.units)
        start = clock.ticks(job.start)
        stretches = _stretches(job, start, wcet, service, clock)
        if wcet is not None and not job.parts and clock.ticks(job.end) != start + stretches[0][1]:
            found.add(_wrong_end(job, wcet, stretches[0][1], clock, path))
        span = stretches[-1][1] if stretches else None
        yield Placed(job, active, active.versions.get(job.version), span, start, stretches, service)


def _stretches(job: Job, start: int, wcet: int | None, service: Service, clock: Clock) -> tuple[Stretch, ...]:
    """Return the parts of a job, which count from its start.

    (D) Of a job in one piece what the model says counts, of parts what the schedule says: rule parts judges them. Parts
    without length are left out, and the order is that of time, so that the other rules can still be checked.
    """
    if wcet is None:
        return ()
    if job.parts:
        ticks, parts = clock.ticks, job.parts
        given = [
            (ticks(p.start) - start, ticks(p.end) - start, ticks(p.executed_from), ticks(p.executed_to)) for p in parts
        ]
        ordered = tuple(sorted(part for part in given if 0 <= part[0] < part[1]))
        if ordered:
            return ordered
    length = service.length(wcet)
    return ((0, max(0, clock.ticks(job.end) - start) if length is None else length, 0, wcet),)


def _wrong_end(job: Job, wcet: int, length: int, clock: Clock, path: str) -> Diagnostic:
    text = f"ends at {job.end}, but its start {job.start} and WCET {clock.text(wcet)} make"
    help = "end = start + WCET, not reduced"
    if length != wcet:
        text = f"ends at {job.end}, but its start {job.start}, its WCET {clock.text(wcet)} and the interrupts make"
        help = "end = start + reserved length of the WCET, not reduced"
    text += f" {clock.text(clock.ticks(job.start) + length)}"
    return codes.WRONG_END(text, at=job.at, path=_job(path, job), help=help)


def _job(path: str, job: Job) -> str:
    return about(path, task=job.task, job=job.index)


def _no_task(job: Job, known: bool, path: str, mode: str) -> Diagnostic:
    where = _job(path, job)
    if known:
        text = f'the task does not run in mode "{mode}"'
        return codes.NOT_IN_MODE(text, at=job.at, path=where, help="remove the job, or let the task run in the mode")
    return codes.UNKNOWN_TASK("the model has no such task", at=job.at, path=where, help="remove the job")


def _bad_start(placed: Placed, path: str, span: str) -> Diagnostic:
    job = placed.job
    where = _job(path, job)
    return codes.BAD_START(f"starts at {job.start}, outside {span}", at=job.at, path=where, help="move the job inside")


# ------------------------------------------------------------------------------------------------ switches


def switches(
    model: TaskModel, schedule: Schedule, tables: dict[str, ModeTable], clock: Clock, found: Findings
) -> Iterator[Switch]:
    """Yield every switch that can be checked: allowed, given once, between modes with tables."""
    allowed = {(t.source, t.target): t.max_length for t in reversed(list(model.allowed_transitions()))}
    seen: set[tuple[str, str]] = set()
    for given in schedule.transitions:
        pair = (given.source, given.target)
        path = switch_path(given)
        if pair not in allowed:
            help = "remove the table, or list the transition in the model"
            found.add(codes.NOT_ALLOWED("the model does not allow this switch", at=given.at, path=path, help=help))
        elif pair in seen:
            found.add(codes.REPEATED_TABLE("has two tables", at=given.at, path=path, help="keep one of them"))
        else:
            if given.status is not Status.VALID:
                text = "no table was found for it, so it must not be performed"
                help = "allow a longer transition, or relax the model"
                found.add(codes.SWITCH_NOT_FOUND(text, at=given.at, path=switch_path(given), help=help))
            if pair[0] in tables and pair[1] in tables and (given.jobs or given.status is Status.VALID):
                source, target = tables[pair[0]], tables[pair[1]]
                yield _switch(model, given, source, target, allowed[pair], clock, found)
        seen.add(pair)
    found.extend(_no_table(schedule, source, target) for source, target in allowed if (source, target) not in seen)


def _no_table(schedule: Schedule, source: str, target: str) -> Diagnostic:
    text = "is allowed by the model but has no table, so it must not be performed"
    path = about(transition=(source, target))
    return codes.NO_TABLE(text, at=schedule.at, path=path, help="schedule the transition, or list only those needed")


def _switch(
    model: TaskModel,
    given: TransitionTable,
    source: ModeTable,
    target: ModeTable,
    max_length: Duration | None,
    clock: Clock,
    found: Findings,
) -> Switch:
    path = switch_path(given)
    length = clock.ticks(given.length)
    jobs: list[Placed] = []
    leaving = {name for name in source.mode.tasks if name not in target.mode.tasks}
    stays = tuple(job for job in given.jobs if job.task not in leaving)
    found.extend(_left(job, target.name, path) for job in given.jobs if job.task in leaving)
    for placed in _placed_jobs(model, target.mode, stays, path, clock, found):
        if not 0 <= placed.start < length:
            found.add(_bad_start(placed, path, f"[0, {given.length})"))
        jobs.append(placed.moved(0, TABLE))
    return Switch(source, target, given, length, jobs, max_length)


def _left(job: Job, mode: str, path: str) -> Diagnostic:
    """(D) Rule 4: a task that leaves is not started any more."""
    text = f'starts at {job.start}, but the task does not run in mode "{mode}" any more'
    return codes.STARTED_AFTER_LEAVING(text, at=job.at, path=_job(path, job), help="remove the job")
