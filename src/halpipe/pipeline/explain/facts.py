"""What every valid schedule of a mode has in common: usable versions, and the time a task takes wherever it starts.

All times are integers: nanoseconds times the common denominator of the mode.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.durations import ZERO, Duration

if TYPE_CHECKING:
    from collections.abc import Container, Iterator

    from halpipe.models import Task, Version
    from halpipe.pipeline.validate.context import ActiveMode, ActiveTask


@dataclass(frozen=True, slots=True)
class Usable:
    """A version that a job may take: its WCET, and how far after its release the job may start (delta, MODEL 3)."""

    version: Version
    wcet: int
    late: int
    units: frozenset[str]


@dataclass(frozen=True, slots=True)
class TaskFacts:
    """A task that certainly has jobs in the mode; `period` is 0 for one on demand.

    `units` are all that a job may use, `late` is the largest delay, `least` and `most` are WCETs. `core` is the length
    of what every job runs, from `late` after its release on; 0 or less where nothing is certain.
    """

    task: Task
    period: int
    jobs: int
    versions: tuple[Usable, ...]
    units: frozenset[str]
    late: int
    least: int
    most: int
    core: int

    @classmethod
    def of(cls, task: Task, period: int, jobs: int, versions: tuple[Usable, ...]) -> TaskFacts:
        """Collect what the usable versions of a task, at least one, have in common."""
        units = versions[0].units
        for version in versions[1:]:
            if version.units is not units:
                units |= version.units
        late, wcets = max(version.late for version in versions), [version.wcet for version in versions]
        return cls(task, period, jobs, versions, units, late, min(wcets), max(wcets), min(wcets) - late)

    @property
    def name(self) -> str:
        """The task's name."""
        return self.task.name

    def without(self, versions: Container[str]) -> TaskFacts | None:
        """Return the facts without some versions; None where none is left."""
        left = tuple(v for v in self.versions if v.version.name not in versions)
        return TaskFacts.of(self.task, self.period, self.jobs, left) if left else None

    def sure_units(self) -> frozenset[str]:
        """Return the units that every job occupies."""
        if any(len(v.units) != v.version.gang for v in self.versions):
            return frozenset()
        return frozenset.intersection(*(v.units for v in self.versions))


@dataclass(frozen=True, slots=True)
class ModeFacts:
    """The tasks of a mode by name, and the scale of their times."""

    mode: ActiveMode
    scale: int
    tasks: dict[str, TaskFacts]

    def ticks(self, time: Duration) -> int:
        """Return a time of the mode as an integer."""
        return _scaled(time, self.scale)

    def text(self, time: int) -> str:
        """Print a time with its unit."""
        return str(Duration(Fraction(time, self.scale)))


def mode_facts(mode: ActiveMode) -> ModeFacts:
    """Collect the facts of a mode of a validated model."""
    scale = math.lcm(1, *(getattr(value, "denominator", 1) for value in _values(mode)))
    counts = _job_counts(mode)
    units: dict[tuple[str, ...], frozenset[str]] = {}
    tasks = {}
    for name, active in mode.tasks.items():
        versions = tuple(_usable(active, mode, scale, units))
        if counts[name] > 0 and versions:
            period = _scaled(active.task.period or ZERO, scale)
            tasks[name] = TaskFacts.of(active.task, period, counts[name], versions)
    return ModeFacts(mode, scale, tasks)


def _job_counts(mode: ActiveMode) -> dict[str, int]:
    """Return how many jobs each task has at least."""
    hyperperiod = mode.hyperperiod
    periods = {name: active.task.period for name, active in mode.tasks.items() if active.is_periodic}
    if len(periods) < len(mode.tasks) or hyperperiod is None:
        return mode.job_counts(min)
    return {name: hyperperiod // period for name, period in periods.items() if period is not None}


def _values(mode: ActiveMode) -> Iterator[int | Fraction]:
    for active in mode.tasks.values():
        task = active.task
        for time in (task.period, task.offset, task.deadline):
            if time is not None:
                yield time.ns
        if task.period is not None and task.slack:
            yield (task.period * task.slack).ns
        for version in active.versions:
            if version.wcet is not None:
                yield version.wcet.ns
            for access in version.accesses:
                yield from (access.start.ns, access.end.ns)
            for row in version.precedences:
                yield from (row.min.ns, row.max.ns)


def _scaled(time: Duration, scale: int) -> int:
    return int(time.ns * scale)


def _usable(
    active: ActiveTask, mode: ActiveMode, scale: int, units: dict[tuple[str, ...], frozenset[str]]
) -> Iterator[Usable]:
    """Yield the versions that have their predecessors and end in time; `units` shares equal sets of units."""
    task = active.task
    for version in active.versions:
        if version.wcet is None or any(row.task not in mode.tasks for row in version.precedences):
            continue
        late, wcet = 0, _scaled(version.wcet, scale)
        if task.period is not None:
            deadline = _scaled(task.period if task.deadline is None else task.deadline, scale)
            slack = _scaled(task.period * task.slack, scale) if task.slack else 0
            late = min(slack, deadline - wcet)
        if late >= 0:
            if version.units not in units:
                units[version.units] = frozenset(version.units)
            yield Usable(version, wcet, late, units[version.units])
