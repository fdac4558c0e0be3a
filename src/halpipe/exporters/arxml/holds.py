"""Hold points of OsTasks: the preemption points in use, and the begin of each access phase (MODEL 8.2, run time).

An OsTask waits there for an event, which the schedule table sets: where the job has a gap, when its next part begins;
at an access phase, when the phase begins; otherwise when the job starts, so that it does not wait at all. Where an
access phase begins after a gap, and to go on may take time, it waits twice: to go on it may need less than that time. A
model that splits no job and serves no interrupts holds none.
"""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.exporters.common.timeline import PhaseTimes

if TYPE_CHECKING:
    from halpipe.core.durations import Duration
    from halpipe.models import Job, Schedule, TaskModel


@record
class Hold:
    """A position in the execution of a version, at which the OsTask waits.

    With `is_second` it has gone on after a gap, and waits for its access phase.
    """

    version: str
    position: Duration
    is_second: bool = False


class Holds:
    """All positions at which the jobs of a schedule are held, and until when."""

    def __init__(self, model: TaskModel, schedule: Schedule) -> None:
        self._times = PhaseTimes(model)
        jobs = [job for mode in schedule.modes for job in mode.jobs]
        jobs += [job for table in schedule.transitions for job in table.jobs]
        self._by_task: dict[str, dict[Hold, None]] = defaultdict(dict)
        splits = any(version.split.is_allowed for version in self._times.versions.values())
        if splits or any(unit.interrupts for unit in model.units):
            for job in jobs:
                for hold in self._positions(job):
                    self._by_task[job.task].setdefault(hold)
        self._has_gap = {(job.task, job.version) for job in jobs if job.parts}

    def of(self, task: str, versions: tuple[str, ...]) -> list[Hold]:
        """Return where the jobs of a task in some versions are held, in order."""
        found = [hold for hold in self._by_task.get(task, ()) if hold.version in versions]
        return sorted(found, key=lambda h: (versions.index(h.version), h.position.ns, h.is_second))

    def is_preempted(self, task: str, versions: tuple[str, ...]) -> bool:
        """Return whether jobs of a task are interrupted anywhere, so that only priorities can do it."""
        kept = ((task, version) for version in versions if self._times.versions[task, version].split.anywhere)
        return any(key in self._has_gap for key in kept)

    def instants(self, job: Job) -> list[tuple[Hold, Duration]]:
        """Return until when a job is held at each position of its version, on the time of its table."""
        if not self._by_task.get(job.task):
            return []
        version = self._times.versions[job.task, job.version]
        gaps = {} if version.split.anywhere else {part.executed_from: part.start for part in job.parts[1:]}
        phases = {access.start: job.start + begin for access, begin, _ in self._times.of(job)}
        first, second = phases | gaps, phases
        return [
            (hold, (second if hold.is_second else first).get(hold.position, job.start))
            for hold in self.of(job.task, (job.version,))
        ]

    def _positions(self, job: Job) -> list[Hold]:
        version = self._times.versions[job.task, job.version]
        found = [access.start for access in version.accesses if access.start > ZERO]
        gaps = [] if version.split.anywhere else [part.executed_from for part in job.parts[1:]]
        twice = set(found) & set(gaps) if version.split.resume > ZERO else set()
        holds = [Hold(job.version, position) for position in (*found, *gaps)]
        return holds + [Hold(job.version, position, is_second=True) for position in sorted(twice)]
