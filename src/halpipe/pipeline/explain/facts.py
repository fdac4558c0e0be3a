"""Facts common to every valid schedule of a mode: usable versions, and least time of a task.

All times are integers: nanoseconds times the common denominator of the mode.
"""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.pipeline.parts import reserved_length

if TYPE_CHECKING:
    from collections.abc import Container, Iterator, Mapping

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Split, Task, Unit, Version
    from halpipe.pipeline.parts import Service
    from halpipe.pipeline.validate.context import ActiveMode, ActiveTask


@record
class Witness:
    """Proof that a mode has no schedule: the finding, and its tasks."""

    diagnostic: Diagnostic
    tasks: tuple[str, ...]


@record
class Usable:
    """A version that a job may take: for how long, and how far after its release the job may start (delta, MODEL 3).

    `wcet` is what the job takes of its units at least, with interrupts: their least reserved length. `piece` is the
    part of it that certainly runs in one go, all of it where the version is not split. `span` is the longest that the
    job may last, gaps included.
    """

    version: Version
    wcet: int
    late: int
    units: frozenset[str]
    piece: int
    span: int

    @property
    def pauses(self) -> bool:
        """Whether a job may have gaps, so that nothing is certain of where it runs between its start and its end."""
        return can_pause(self.version.split)


@record
class TaskFacts:
    """A task that certainly has jobs in the mode; `period` is 0 for one on demand.

    `units` are all that a job may use, `late` is the largest delay, `least` the least time on its units and `most` the
    longest time from start to end. `core` is the length of what every job runs, from `late` after its release on; 0 or
    less where nothing is certain, as where a job may pause.
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
        late, least = max(version.late for version in versions), min(version.wcet for version in versions)
        most = max(version.span for version in versions)
        core = 0 if any(version.pauses for version in versions) else least - late
        return cls(task, period, jobs, versions, units, late, least, most, core)

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


@record
class ModeFacts:
    """The tasks of a mode by name, the scale of their times, and the interrupts of units that serve any."""

    mode: ActiveMode
    scale: int
    tasks: dict[str, TaskFacts]
    services: dict[str, Service[int]]

    def ticks(self, time: Duration) -> int:
        """Return a time of the mode as an integer."""
        return _scaled(time, self.scale)

    def text(self, time: int) -> str:
        """Print a time with its unit."""
        return str(Duration(Fraction(time, self.scale)))


def mode_facts(mode: ActiveMode, units: Mapping[str, Unit] | None = None) -> ModeFacts:
    """Collect the facts of a mode of a validated model, whose `units` may serve interrupts."""
    interrupts = {name: unit.interrupts for name, unit in (units or {}).items() if unit.interrupts}
    times = [time.ns for served in interrupts.values() for i in served for time in (i.distance, i.wcet)]
    scale = math.lcm(*(getattr(value, "denominator", 1) for value in (*_values(mode), *times)))
    services: dict[str, Service[int]] = {
        name: tuple((_scaled(i.distance, scale), _scaled(i.wcet, scale)) for i in served)
        for name, served in interrupts.items()
    }
    counts = mode.least_jobs
    sets: dict[tuple[str, ...], frozenset[str]] = {}
    tasks = {}
    for name, active in mode.tasks.items():
        versions = tuple(_usable(active, mode, scale, sets, services))
        if counts[name] > 0 and versions:
            period = _scaled(active.task.period or ZERO, scale)
            tasks[name] = TaskFacts.of(active.task, period, counts[name], versions)
    return ModeFacts(mode, scale, tasks, services)


def _values(mode: ActiveMode) -> Iterator[int | Fraction]:
    for active in mode.tasks.values():
        task = active.task
        for time in (task.period, task.offset, task.deadline, task.distance):
            if time is not None:
                yield time.ns
        if task.period is not None and task.slack:
            yield (task.period * task.slack).ns
        for version in active.versions:
            if version.wcet is not None:
                yield version.wcet.ns
            yield from (point.ns for point in version.split.points)
            for access in version.accesses:
                yield from (access.start.ns, access.end.ns)
            for row in version.precedences:
                yield from (row.min.ns, row.max.ns)


def _scaled(time: Duration, scale: int) -> int:
    return int(time.ns * scale)


def can_pause(split: Split) -> bool:
    """Return whether jobs with this split may have gaps."""
    return split.is_allowed and split.max_gaps != 0


def longest_piece(version: Version, wcet: int, scale: int) -> int:
    """Return how much of `wcet` every job executes in one go at least, at some time."""
    split = version.split
    if not can_pause(split):
        return wcet
    phases = [_scaled(access.end - access.start, scale) for access in version.accesses]
    points = [0, *(_scaled(point, scale) for point in split.points), wcet]
    pieces = [] if split.anywhere else [end - start for start, end in pairwise(points)]
    shares = [] if split.max_gaps is None else [wcet // (split.max_gaps + 1)]
    return max([*phases, *pieces, *shares, 0])


def _usable(
    active: ActiveTask,
    mode: ActiveMode,
    scale: int,
    sets: dict[tuple[str, ...], frozenset[str]],
    services: Mapping[str, Service[int]],
) -> Iterator[Usable]:
    """Yield the versions that have their predecessors and end in time; `sets` shares equal sets of units."""
    task = active.task
    for version in active.versions:
        if version.wcet is None or any(row.task not in mode.tasks for row in version.precedences):
            continue
        wcet = _scaled(version.wcet, scale)
        served = [services.get(unit, ()) for unit in version.units] if services else [()]
        lengths = [_length(wcet, service) for service in served]
        least, piece = min(lengths), longest_piece(version, wcet, scale)
        late, span = 0, max(lengths)
        if task.period is not None:
            deadline = _scaled(_deadline(task) or task.period, scale)
            slack = _scaled(task.period * task.slack, scale) if task.slack else 0
            late = min(slack, deadline - least) if task.distance is None else slack
            if can_pause(version.split) or (version.gang > 1 and any(served)):  # its members wait for each other
                span = max(span, deadline)
        if late >= 0:
            if version.units not in sets:
                sets[version.units] = frozenset(version.units)
            piece = min(_length(piece, service) for service in served)
            yield Usable(version, least, late, sets[version.units], piece, span)


def _length(work: int, service: Service[int]) -> int:
    """Return the time reserved for some work; where it is not found, the work itself, which is less."""
    try:
        return reserved_length(work, service)
    except ValueError:
        return work


def _deadline(task: Task) -> Duration | None:
    """Return the stated deadline, or the default of a task that serves arrivals; those count from the arrival."""
    return task.distance if task.deadline is None else task.deadline
