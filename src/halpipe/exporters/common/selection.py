"""The part of a schedule that an export shows, proven to fit the model before anything is drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, Location, about, version_of
from halpipe.core.durations import ZERO, Duration
from halpipe.core.suggest import did_you_mean
from halpipe.exporters.common.codes import FOREIGN_SCHEDULE, KEEPS_NO_LET, NEEDS_HOLD, NEEDS_SCHEDULE, UNDRAWABLE_TIME
from halpipe.exporters.common.timeline import versions_of
from halpipe.models.modes import require_mode

if TYPE_CHECKING:
    from collections.abc import Collection

    from halpipe.models import Job, ModeSchedule, Schedule, TaskModel, TransitionTable

REMAKE = "make the schedule again from this model"


def select(model: TaskModel, schedule: Schedule | None, mode: str, format_name: str) -> Schedule:
    """Return `schedule`, cut to one `mode` if it is not empty, in which every name and time can be relied on.

    Raise `HalpipeError` with everything that does not fit: exporters never guess.
    """
    if schedule is None:
        help = "run `halpipe schedule` and give its output with the model"
        raise HalpipeError(NEEDS_SCHEDULE(f'format "{format_name}" needs a schedule', help=help))
    if mode:
        require_mode(mode, schedule.modes)
        kept = tuple(m for m in schedule.modes if m.name == mode)
        schedule = schedule.alone(kept)
    check = _Check(model, schedule)
    for table in schedule.modes:
        check.mode(table)
    for transition in schedule.transitions:
        check.transition(transition)
    check.findings.stop_on_errors()
    return schedule


def refuse_gaps(model: TaskModel, schedule: Schedule, target: str, anywhere: str, points: str) -> None:
    """Raise `HalpipeError` with every task of which a job has gaps, for a `target` that cannot hold jobs.

    What helps depends on whether jobs are interrupted `anywhere` or at `points`.
    """
    versions = versions_of(model)
    findings = Findings()
    first: dict[str, Job] = {}
    for job in schedule.all_jobs():
        if job.parts:
            first.setdefault(job.task, job)
    for task, job in first.items():
        message = f"job {job.index} has {len(job.parts)} parts; {target}"
        help = points if versions[task, job.version].split.points else anywhere
        findings.add(NEEDS_HOLD(message, at=job.at, path=about(task=task), help=help))
    findings.stop_on_errors()


def refuse_let(model: TaskModel, schedule: Schedule, target: str) -> None:
    """Raise `HalpipeError` with every scheduled task that has a LET, for a `target` that does not copy data."""
    running = {job.task for mode in schedule.modes for job in mode.jobs}
    help = "export the linux or the riscv format, which make these copies; or remove the LET"
    findings = Findings()
    for task in (task for task in model.tasks if task.let is not None and task.name in running):
        message = f"has the LET {task.let}; {target} copies no data at the release and at release + LET"
        findings.add(KEEPS_NO_LET(message, at=task.at, path=about(task=task.name), help=help))
    findings.stop_on_errors()


def refuse_early_phases(model: TaskModel, schedule: Schedule, target: str, help: str) -> None:
    """Raise `HalpipeError` with every version whose access phases a `target` would begin early (MODEL 8.2, run time).

    Models that split no job and serve no interrupts say nothing of jobs that are early.
    """
    versions = versions_of(model)
    if not (any(v.split.is_allowed for v in versions.values()) or any(unit.interrupts for unit in model.units)):
        return
    findings = Findings()
    jobs = schedule.all_jobs()
    for task, name in sorted({(job.task, job.version) for job in jobs}):
        version = versions[task, name]
        if any(access.start > ZERO for access in version.accesses):
            message = f"an access phase begins within its jobs, and jobs may be early; {target}"
            findings.add(NEEDS_HOLD(message, at=version.at, path=version_of(task, name), help=help))
    findings.stop_on_errors()


class _Check:
    """Compares a schedule with its model, collecting all that does not fit."""

    def __init__(self, model: TaskModel, schedule: Schedule) -> None:
        self.findings = Findings()
        self.versions = {task.name: {version.name for version in task.versions} for task in model.tasks}
        self.units = {unit.name for unit in model.units}
        self.resources = {resource.name for resource in model.resources}
        self.chains = {chain.name for chain in model.chains}
        self.modes = {mode.name for mode in model.modes}
        self.scheduled = {mode.name for mode in schedule.modes}

    def mode(self, table: ModeSchedule) -> None:
        path = about(mode=table.name)
        self._known("mode", table.name, self.modes, table.at, path)
        if table.hyperperiod <= ZERO:
            self._time("the hyperperiod must be positive", table.at, path)
            return
        for job in table.jobs:
            self._job(job, path, table.hyperperiod)
            if not ZERO <= job.start < table.hyperperiod:
                self._time(
                    f"start {job.start} is outside the hyperperiod {table.hyperperiod}", job.at, f"{path}, {_name(job)}"
                )
        for unit_load in table.unit_loads:
            self._known("unit", unit_load.unit, self.units, table.at, path)
        for resource_load in table.resource_loads:
            self._known("resource", resource_load.resource, self.resources, table.at, path)
        for chain in table.chains:
            self._known("chain", chain.name, self.chains, table.at, path)

    def transition(self, table: TransitionTable) -> None:
        path = about(transition_from=(table.source, table.target))
        for name in (table.source, table.target):
            self._known("mode", name, self.scheduled, table.at, path, "schedule")
        for job in table.jobs:
            self._job(job, path, None)

    def _job(self, job: Job, path: str, longest: Duration | None) -> None:
        where = f"{path}, {_name(job)}"
        if self._known("task", job.task, self.versions, job.at, where):
            self._known("version", job.version, self.versions[job.task], job.at, where)
        for unit in job.units:
            self._known("unit", unit, self.units, job.at, where)
        if not job.units:
            self.findings.add(FOREIGN_SCHEDULE("the job has no unit", at=job.at, path=where, help=REMAKE))
        if job.end < job.start:
            self._time(f"end {job.end} is before start {job.start}", job.at, where)
        busy = sum((end - start for start, end in job.occupations()), ZERO)
        if longest is not None and busy > longest:
            self._time(f"lasts {busy}, longer than the hyperperiod {longest}", job.at, where)
        instants = [instant for start, end in job.occupations() for instant in (start, end)]
        if job.parts and (instants != sorted(instants) or (instants[0], instants[-1]) != (job.start, job.end)):
            self._time("its parts do not follow each other from its start to its end", job.at, where)

    def _known(
        self, kind: str, name: str, known: Collection[str], at: Location, path: str, owner: str = "model"
    ) -> bool:
        if name in known:
            return True
        help = did_you_mean(name, sorted(known), REMAKE)
        self.findings.add(FOREIGN_SCHEDULE(f'the {owner} has no {kind} "{name}"', at=at, path=path, help=help))
        return False

    def _time(self, message: str, at: Location, path: str) -> None:
        self.findings.add(UNDRAWABLE_TIME(message, at=at, path=path, help=REMAKE))


def _name(job: Job) -> str:
    return f'job {job.index} of task "{job.task}"'
