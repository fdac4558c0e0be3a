"""Drawn line of time: occurrences of jobs, load of resources, precedence links.

Everything is exact. The report and the trace both draw from here, so they cannot disagree.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.models import Anchor
from halpipe.pipeline.parts import latest_phase, parts_of, phase_instants, service_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from halpipe.models import (
        Access,
        Job,
        ModeSchedule,
        Precedence,
        Schedule,
        Task,
        TaskModel,
        TransitionTable,
        Version,
    )

# A switch is drawn with a full cycle of both modes around it; more jobs than this in all such cycles of one export
# would make the output large and say nothing new.
CONTEXT_JOBS = 2000

Steps = list[tuple[Duration, Fraction]]


@record
class Placement:
    """One occurrence of `job` on the line, from `start`, which is negative for what began before the line.

    `cycle` counts the hyperperiods from the one that starts at 0; `part` names the mode, or is empty for a job of a
    transition table.
    """

    job: Job
    start: Duration
    cycle: int = 0
    part: str = ""

    @property
    def end(self) -> Duration:
        """The instant at which the occurrence ends."""
        return self.start + (self.job.end - self.job.start)

    def stretches(self) -> list[tuple[Duration, Duration]]:
        """Return when the occurrence occupies its units: all the time, but for its gaps."""
        by = self.start - self.job.start
        return [(start + by, end + by) for start, end in self.job.occupations()]


@record
class Window:
    """The half-open stretch [start, end) of the line that is drawn."""

    start: Duration
    end: Duration

    @property
    def length(self) -> Duration:
        """Length of the stretch."""
        return self.end - self.start

    def shows(self, placement: Placement) -> bool:
        """Whether any of an occurrence lies inside."""
        return self.meets(placement.start, placement.end)

    def meets(self, start: Duration, end: Duration) -> bool:
        """Whether any of [start, end) lies inside."""
        return start < self.end and (end > self.start or start >= self.start)


@record
class Link:
    """The predecessor job that satisfies a constraint of `job`: of those in the window, the newest.

    The predecessor's occurrence lies `cycles` hyperperiods before the job's; `distance` is what the constraint
    limits, from the anchor of the predecessor to the job's start.
    """

    job: Job
    precedence: Precedence
    predecessor: Job
    cycles: int
    distance: Duration


def versions_of(model: TaskModel) -> dict[tuple[str, str], Version]:
    """Return every version by the names of its task and itself."""
    return {(task.name, version.name): version for task in model.tasks for version in task.versions}


def delays_of(task: Task, period: Duration, jobs: Sequence[Job], hyperperiod: Duration) -> list[Duration]:
    """Return the delay of each job after its release, s + j * D modulo t_P (MODEL 3).

    The phase s is the offset of the task, or the one that delays jobs least.
    """
    latest = [(job.start - period * job.index) % hyperperiod for job in jobs]
    phase = _phase(task, period, latest, hyperperiod)
    return [(place - phase) % hyperperiod for place in latest]


def releases_of(mode: ModeSchedule, tasks: Mapping[str, Task]) -> Iterator[tuple[Job, Duration]]:
    """Yield the jobs of tasks with a LET in a mode, and their releases, at which a target copies what they read.

    That is the offset, or the phase that the schedule chose (MODEL 10.1, 10.6).
    """
    for name, jobs in mode.by_task().items():
        if name in tasks:
            period = tasks[name].period
            assert period is not None, "verify refuses a LET without a period"
            latest = [(job.start - period * job.index) % mode.hyperperiod for job in jobs]
            phase = _phase(tasks[name], period, latest, mode.hyperperiod)
            yield from ((job, phase + period * job.index) for job in jobs)


def _phase(task: Task, period: Duration, latest: Sequence[Duration], hyperperiod: Duration) -> Duration:
    return latest_phase(sorted(latest), hyperperiod) if task.offset is None else task.offset % period


class PhaseTimes:
    """Spans in which access phases of jobs are in force, from their starts; computed once for alike jobs."""

    def __init__(self, model: TaskModel) -> None:
        self.versions = versions_of(model)
        self._units = {unit.name: unit for unit in model.units}
        self._interrupted = {unit.name for unit in model.units if unit.interrupts}
        self._known: dict[object, tuple[tuple[Access, Duration, Duration], ...]] = {}

    def of(self, job: Job) -> tuple[tuple[Access, Duration, Duration], ...]:
        """Return the access phases of a job, each with begin and end."""
        if job.parts:
            return self._work_out(job)
        key = (job.task, job.version, job.units if not self._interrupted.isdisjoint(job.units) else ())
        if key not in self._known:
            self._known[key] = self._work_out(job)
        return self._known[key]

    def _work_out(self, job: Job) -> tuple[tuple[Access, Duration, Duration], ...]:
        version = self.versions[job.task, job.version]
        parts, service = parts_of(job, version), service_of(self._units, job.units)
        times = ((a, *phase_instants(a, parts, version.split.resume, service)) for a in version.accesses)
        return tuple((access, begin - job.start, end - job.start) for access, begin, end in times)


def unroll(table: ModeSchedule, cycles: int = 1) -> list[Placement]:
    """Return every occurrence in force on [0, cycles * t_P) of the repeated schedule, by start, then table order.

    A job that wraps round the hyperperiod's end occurs once more for each time it does, from before 0.
    """
    period = table.hyperperiod
    found = []
    for job in table.jobs:
        first = min(0, 1 - -(-job.end // period))
        found += [Placement(job, job.start + period * cycle, cycle, table.name) for cycle in range(first, cycles)]
    return sorted(found, key=lambda placement: placement.start.ns)


def shows_context(schedule: Schedule) -> bool:
    """Whether the switches of `schedule` are few and small enough to be drawn within the modes around them."""
    modes = {mode.name: mode for mode in schedule.modes}
    drawn = 0
    for table in schedule.transitions:
        source, target = modes[table.source], modes[table.target]
        drawn += len(source.jobs) + len(target.jobs) * cycles_after(table, source, target)
    return drawn <= CONTEXT_JOBS


def cycles_after(table: TransitionTable, source: ModeSchedule, target: ModeSchedule) -> int:
    """Return how many cycles of `target` are drawn after a switch: until jobs with gaps in progress are over."""
    ends = [job.end - source.hyperperiod for job in source.jobs if job.parts]
    ends += [job.end for job in table.jobs if job.parts]
    last = max(ends, default=ZERO)
    return max(1, -(-(last - table.length) // target.hyperperiod))


def unroll_switch(
    table: TransitionTable, source: ModeSchedule, target: ModeSchedule, *, context: bool
) -> tuple[Window, list[Placement]]:
    """Return the line around a switch (MODEL 5): the last cycle of `source`, the table, the first of `target`.

    Time 0 is the end of the source's hyperperiod. Parts of the target's jobs that wrap in from a cycle before its
    first are idle, so they do not occur. Jobs with gaps in progress are shown to their ends, so that more cycles of
    the target may follow. Without `context` only the table and what runs into it are returned.
    """
    before = [
        Placement(p.job, p.start - source.hyperperiod, p.cycle - 1, p.part)
        for p in unroll(source)
        if context or p.end > source.hyperperiod
    ]
    inside = [Placement(job, job.start) for job in table.jobs]
    cycles = cycles_after(table, source, target)
    after = [
        Placement(job, table.length + target.hyperperiod * cycle + job.start, cycle, target.name)
        for cycle in range(cycles if context else 0)
        for job in target.jobs
    ]
    start = -source.hyperperiod if context else ZERO
    ends = [p.end for p in (*inside, *(p for p in before if p.job.parts))]
    end = table.length + target.hyperperiod * cycles if context else max([table.length, *ends])
    found = sorted(before + inside + after, key=lambda placement: placement.start.ns)
    return Window(start, end), found


def resource_steps(model: TaskModel, placements: Iterable[Placement], window: Window) -> dict[str, Steps]:
    """Return for every resource the sum of the bounds in force, as (instant, sum from there on) over `window`."""
    times = PhaseTimes(model)
    changes: dict[str, dict[int | Fraction, Fraction]] = {r.name: defaultdict(Fraction) for r in model.resources}
    low, high = window.start.ns, window.end.ns
    for placement in placements:
        for access, first, last in times.of(placement.job):
            begin = max(placement.start.ns + first.ns, low)
            end = placement.start.ns + last.ns
            if begin < end and access.resource in changes:
                changes[access.resource][begin] += access.bound
                changes[access.resource][end] -= access.bound
    return {name: _accumulate(found, low, high) for name, found in changes.items()}


def _accumulate(changes: dict[int | Fraction, Fraction], low: int | Fraction, high: int | Fraction) -> Steps:
    steps = [(Duration(low), Fraction(0))]
    total = Fraction(0)
    for instant in sorted(changes):
        if instant >= high or not changes[instant]:
            continue
        total += changes[instant]
        if instant == low:
            steps.clear()
        steps.append((Duration(instant), total))
    return steps


def links(model: TaskModel, table: ModeSchedule) -> list[Link]:
    """Return, job by job, the predecessor job behind every plain window that the schedule keeps (MODEL 3)."""
    versions = versions_of(model)
    anchors = _Anchors(table)
    found = []
    for job in table.jobs:
        for precedence in versions[job.task, job.version].precedences:
            link = anchors.newest(job, precedence) if precedence.is_plain else None
            if link is not None:
                found.append(link)
    return found


class _Anchors:
    """The anchor instants of every task's jobs on the circle, sorted, so that each look-up is a bisection."""

    def __init__(self, table: ModeSchedule) -> None:
        self.period = table.hyperperiod
        self.jobs: dict[str, list[Job]] = defaultdict(list)
        for job in table.jobs:
            self.jobs[job.task].append(job)
        self.sorted: dict[tuple[str, Anchor], list[tuple[int | Fraction, int]]] = {}

    def newest(self, job: Job, precedence: Precedence) -> Link | None:
        ring = self._ring(precedence.task, precedence.anchor)
        if not ring:
            return None
        latest = (job.start - precedence.min) % self.period
        position = bisect_right(ring, (latest.ns, len(ring))) - 1
        predecessor = self.jobs[precedence.task][ring[position][1]]
        anchor = _anchor(predecessor, precedence.anchor)
        distance = precedence.min + (latest - anchor) % self.period
        if distance > precedence.max:
            return None
        return Link(job, precedence, predecessor, (distance + anchor - job.start) // self.period, distance)

    def _ring(self, task: str, anchor: Anchor) -> list[tuple[int | Fraction, int]]:
        if (task, anchor) not in self.sorted:
            jobs = enumerate(self.jobs.get(task, ()))
            self.sorted[task, anchor] = sorted(((_anchor(j, anchor) % self.period).ns, i) for i, j in jobs)
        return self.sorted[task, anchor]


def _anchor(job: Job, anchor: Anchor) -> Duration:
    return job.start if anchor is Anchor.START else job.end
