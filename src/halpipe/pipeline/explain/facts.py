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
    from collections.abc import Iterator

    from halpipe.models import Task, Version
    from halpipe.pipeline.validate.context import ActiveMode, ActiveTask


@dataclass(frozen=True, slots=True)
class Usable:
    """A version that a job may take: its WCET, and how far after its release the job may start (delta, MODEL 3)."""

    version: Version
    wcet: int
    late: int
    units: frozenset[str]

    @property
    def gang(self) -> int:
        """How many units the job takes."""
        return self.version.gang

    @property
    def core(self) -> int:
        """The time for which the job runs whatever its delay is: C - delta_max, from delta_max after the release."""
        return self.wcet - self.late


@dataclass(frozen=True, slots=True)
class TaskFacts:
    """A task that certainly has jobs in the mode; `period` is 0 for one on demand."""

    task: Task
    period: int
    jobs: int
    versions: tuple[Usable, ...]

    @property
    def name(self) -> str:
        """The task's name."""
        return self.task.name

    @property
    def units(self) -> frozenset[str]:
        """All units that any job may use."""
        return frozenset().union(*(version.units for version in self.versions))

    @property
    def late(self) -> int:
        """The largest delay of any version."""
        return max(version.late for version in self.versions)

    @property
    def least(self) -> int:
        """The smallest WCET."""
        return min(version.wcet for version in self.versions)

    @property
    def most(self) -> int:
        """The largest WCET."""
        return max(version.wcet for version in self.versions)

    @property
    def core(self) -> int:
        """The length of what every job runs from `late` after its release on; 0 or less where nothing is certain."""
        return min(version.wcet for version in self.versions) - self.late

    def sure_units(self) -> frozenset[str]:
        """Return the units that every job occupies."""
        return frozenset.intersection(*(v.units if len(v.units) == v.gang else frozenset() for v in self.versions))


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
    counts = mode.job_counts(min)
    tasks = {
        name: TaskFacts(
            active.task,
            _scaled(active.task.period or ZERO, scale),
            counts[name],
            tuple(_usable(active, mode, scale)),
        )
        for name, active in mode.tasks.items()
        if counts[name] > 0
    }
    return ModeFacts(mode, scale, {name: facts for name, facts in tasks.items() if facts.versions})


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


def _usable(active: ActiveTask, mode: ActiveMode, scale: int) -> Iterator[Usable]:
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
            yield Usable(version, wcet, late, frozenset(version.units))
