"""Input of the rules: model and schedule with names resolved, time in exact integer ticks.

The ticks are private to the check: one tick is 1/scale ns, where scale is the least common denominator of every
duration in the model and the schedule. So all sums and comparisons are exact, and fast.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Generic, TypeAlias, TypeVar

from halpipe.core.diagnostics import Diagnostic, Location, Path, Subject, about
from halpipe.core.durations import Duration
from halpipe.core.records import record
from halpipe.models import Anchor, Chain, Job, ModeSchedule, Precedence, Task, TaskModel, TransitionTable, Version
from halpipe.pipeline.verify.ticks import UNDISTURBED, Recurring, Service

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from halpipe.pipeline.verify.ticks import Found, Platform

Checked = TypeVar("Checked", contravariant=True)


@record
class Rule(Generic[Checked]):
    """`check` yields one diagnostic for every violation it finds in its subject."""

    name: str
    sentence: str
    check: Callable[[Checked], Iterable[Diagnostic]]


MAX_BITS = 4096

MAX_LINE = 200_000
"""Jobs of the mode to come that are looked at for jobs in progress at a switch."""

TABLE = " of the table"
"""The part of a switch's line between the two modes."""

Key: TypeAlias = tuple[str, int]
"""An instant of a job (MODEL 10.1): its name, and the execution time of a point."""

READ, WRITE = ("read", 0), ("write", 0)


def common_denominator(denominators: Iterable[int]) -> int | None:
    """Return the least common multiple of `denominators`, or None where it has more than `MAX_BITS` bits."""
    scale = 1
    for denominator in denominators:
        scale = math.lcm(scale, denominator)
        if scale.bit_length() > MAX_BITS:
            return None
    return scale


@record
class Clock:
    """Converts between durations and ticks of 1/scale ns."""

    scale: int

    def ticks(self, duration: Duration) -> int:
        """Return `duration` in ticks; it must be one of those the scale was made from."""
        ns = duration.ns
        return ns * self.scale if isinstance(ns, int) else ns.numerator * (self.scale // ns.denominator)

    def text(self, ticks: int) -> str:
        """Print `ticks` as a duration."""
        return _told(ticks, self.scale)


@lru_cache(maxsize=8192)  # messages of many jobs have the same WCET and the same limits
def _told(ticks: int, scale: int) -> str:
    return str(Duration(Fraction(ticks, scale)))


@dataclass(slots=True)
class ActiveTask:
    """A task in one mode: the versions available there, and its period D.

    `period` is None for a task on demand and where the model gives an unusable one. `wcets` gives C of every version of
    the task in ticks, as far as the model states it. `let` is the logical execution time.
    """

    task: Task
    versions: dict[str, Version]
    wcets: dict[str, int]
    period: int | None
    let: int | None = None
    resumes: dict[str, int] = field(default_factory=dict)


@record
class ActiveMode:
    """A mode of the model: its tasks T_n by name in model order, and its hyperperiod t_P in ticks (0: none).

    `platform` tells the interrupts of the units, `locks` the resources that jobs hold alone, and `in_first` the tasks
    whose phase lies in [0, D): those that a constraint on the same cycle or a logical execution time names (MODEL 10).
    """

    name: str
    tasks: dict[str, ActiveTask]
    period: int
    platform: Platform
    locks: frozenset[str] = frozenset()
    in_first: frozenset[str] = frozenset()
    is_closed: bool = False


Stretch: TypeAlias = "tuple[int, int, int, int]"
"""A part k of a job: s_k and t_k from the job's start s_1, and what it executes, from a_k to b_k (MODEL 8.2)."""


@dataclass(slots=True)
class Placed:
    """A job at its place: start s_1 in ticks, on the circle of its mode or on the line of a switch.

    `version` is None where the model does not tell it, and so is `span`, the time from s_1 to the end t_n. `stretches`
    are the job's parts, and `service` the interrupts of its units. `where` names the part of the line. `delay` is the
    time since its release, where a rule asks for it; `lap` is t_P for a job that belongs to the cycle before.

    (D) A job of a table between modes is released when it starts.
    """

    job: Job
    active: ActiveTask
    version: Version | None
    span: int | None
    start: int
    stretches: tuple[Stretch, ...] = ()
    service: Service = UNDISTURBED
    where: str = ""
    delay: int = 0
    lap: int = 0

    @property
    def end(self) -> int:
        """The end t_n; the start, where it is not known."""
        return self.start + (self.span or 0)

    @property
    def label(self) -> str:
        """The job as messages call it."""
        return f'"{self.job.task}" job {self.job.index}{self.where}'

    @property
    def subject(self) -> Subject:
        """Its task, for a diagnostic that concerns the job."""
        return Subject("task", self.job.task)

    def moved(self, by: int, where: str) -> Placed:
        """Return the same job `by` ticks later, as a part of a line."""
        start = self.start + by
        same = self.job, self.active, self.version, self.span
        return Placed(*same, start, self.stretches, self.service, where, self.delay, self.lap)

    def instant(self, key: Key) -> int | None:
        """Return an instant of the job; None where it has none."""
        name, point = key
        match name:
            case "start":
                return self.start
            case "end":
                return None if self.span is None else self.end
            case "release":
                return self.start - self.delay
            case "read":
                return self.read
            case "write":
                return self.write
        return self._reach(point)

    @property
    def read(self) -> int:
        """The instant at which the job reads its data: its start, or its release (MODEL 10.6)."""
        return self.start if self.active.let is None else self.start - self.delay

    @property
    def write(self) -> int | None:
        """The instant at which the job writes its data: its end, or its release + LET."""
        if self.active.let is None:
            return None if self.span is None else self.end
        return self.start - self.delay + self.active.let

    def _reach(self, point: int) -> int | None:
        """Return when the job has executed for `point` at worst-case pace.

        (D) In the first part that comes so far, at its end rather than at the start of the next one.
        """
        lost = 0
        for begin, _, done_from, done_to in self.stretches:
            if done_from <= point <= done_to:
                work = lost + point - done_from
                return self.start + begin + (self.service.length(work) or work)
            lost = self.resume
        return None

    @property
    def resume(self) -> int:
        """The time lost after a gap, in ticks; 0 where the version is not known."""
        return self.active.resumes.get(self.job.version, 0)


class Instants:
    """Instants of the jobs of every task, found quickly; made on first use."""

    def __init__(self, jobs: dict[str, list[Placed]], period: int) -> None:
        self._jobs = jobs
        self._period = period
        self._made: dict[tuple[str, Key], Recurring] = {}

    def of(self, task: str, key: Key) -> Recurring:
        """Return an instant of every job of `task`.

        (D) Where instants of jobs of one task are equal, the one released earlier counts as the earlier one, without
        releases the lower index; where they end, or write, at the same instant, the one that read later is the newer.
        """
        if (task, key) not in self._made:
            self._made[task, key] = Recurring(points_of(self._jobs.get(task, ()), key), self._period)
        return self._made[task, key]

    def earliest(self, task: str, key: Key, since: int) -> Found:
        """Return the first instant of `task` at or after `since`, with its job."""
        return self.of(task, key).earliest(since)

    def latest(self, task: str, key: Key, until: int) -> Found:
        """Return the last instant of `task` at or before `until`, with its job."""
        return self.of(task, key).latest(until)


def points_of(jobs: Iterable[Placed], key: Key) -> list[tuple[int, Placed]]:
    """Return an instant of each of the jobs that has it, with the job; of equal instants the newer job comes last."""
    ordered = sorted(jobs, key=lambda p: (p.instant((str(Anchor.RELEASE), 0)) or 0, p.job.index))
    points = [(x, p) for p in ordered if (x := p.instant(key)) is not None]
    return sorted(points, key=lambda pair: pair[1].read - pair[0])


def key_of(row: Precedence, clock: Clock) -> Key:
    """Return the instant of the predecessor from which a window counts."""
    return str(row.anchor), clock.ticks(row.point) if row.anchor is Anchor.POINT and row.point is not None else 0


def reached(row: Precedence, placed: Placed) -> int:
    """Return the instant of a job that is to lie in the window."""
    return placed.end if row.to is Anchor.END else placed.start


@dataclass(slots=True)
class ModeTable:
    """The table of one mode as the rules see it.

    `broken` names the rules already found broken in it; `sound` tells whether the model has no fault.
    """

    model: TaskModel
    clock: Clock
    mode: ActiveMode
    schedule: ModeSchedule
    jobs: list[Placed]
    by_task: dict[str, list[Placed]]
    instants: Instants
    broken: set[str] = field(default_factory=set)
    sound: bool = field(init=False)

    @property
    def name(self) -> str:
        """The name of the mode."""
        return self.mode.name

    @property
    def period(self) -> int:
        """The hyperperiod t_P in ticks."""
        return self.mode.period

    @property
    def at(self) -> Location:
        """The place of the table in the schedule file."""
        return self.schedule.at

    def path(self, placed: Placed | None = None) -> Path:
        """Name the table, or a job of it, for a diagnostic."""
        if placed is None:
            return about(mode=self.name)
        return about(mode=self.name, task=placed.job.task, job=placed.job.index)

    def meeting(self) -> list[Placed]:
        """Return the jobs that can meet one another: all."""
        return self.jobs

    def chains(self) -> list[Chain]:
        """Return the chains all of whose tasks run in this mode; the others say nothing about it (D)."""
        return [c for c in self.model.chains if c.tasks and all(t in self.mode.tasks for t in c.tasks)]


@record
class Switch:
    """The line of one switch: mode n up to time 0, the table on [0, length), mode m from `length` on."""

    source: ModeTable
    target: ModeTable
    table: TransitionTable
    length: int
    jobs: list[Placed]
    max_length: Duration | None

    @property
    def clock(self) -> Clock:
        """The clock shared with both modes."""
        return self.source.clock

    @property
    def mode(self) -> ActiveMode:
        """The mode to come, whose tasks and versions the table has."""
        return self.target.mode

    @property
    def model(self) -> TaskModel:
        """The model of both modes."""
        return self.target.model

    @property
    def at(self) -> Location:
        """The place of the table in the schedule file."""
        return self.table.at

    def before(self, turns: int, task: str | None = None) -> list[Placed]:
        """Return the jobs of the last `turns` cycles of mode n, in order of cycle; those of one `task`, if given."""
        period, where = self.source.period, f' of mode "{self.source.name}"'
        jobs = self.source.jobs if task is None else self.source.by_task.get(task, [])
        return [p.moved(q * period, where) for q in range(-turns, 0) for p in jobs]

    def in_progress(self) -> list[Placed]:
        """Return the jobs of the last cycle of mode n that end after the switch.

        Those of cycles before are longer than a cycle, which the rules of the mode report.
        """
        period, where = self.source.period, f' of mode "{self.source.name}"'
        return [p.moved(-period, where) for p in self.source.jobs if p.end > period]

    def after(self, turns: int, task: str | None = None) -> list[Placed]:
        """Return the jobs of the first `turns` cycles of mode m, in order of cycle; those of one `task`, if given."""
        period, where = self.target.period, f' of mode "{self.target.name}"'
        jobs = self.target.jobs if task is None else self.target.by_task.get(task, [])
        return [p.moved(self.length + q * period, where) for q in range(turns) for p in jobs]

    def meeting(self) -> list[Placed]:
        """Return the jobs of the line that can meet jobs of another part of it.

        Only jobs that reach beyond the end of mode n can meet anything of the table or of mode m, and only jobs of mode
        m that start before all those have ended can meet them. Everything else is decided by the rules of the modes.
        """
        meeting = self.in_progress() + self.jobs
        if not meeting:
            return []
        horizon = max(p.end for p in meeting)
        return meeting + [p for p in self.after(self.cycles_of(meeting)) if p.start < horizon]

    def cycles_of(self, jobs: list[Placed]) -> int:
        """Return how many cycles of mode m the line has: two, or as many as `jobs` last that may meet later ones.

        Two also where these would be more than `MAX_LINE` jobs, which the rule of its length reports.
        """
        needed = self.cycles_needed(jobs)
        return needed if needed * max(1, len(self.target.jobs)) <= MAX_LINE else 2

    def cycles_needed(self, jobs: list[Placed]) -> int:
        """Return how many cycles of mode m there would have to be.

        Preemptive jobs leave gaps and take their units again late (MODEL 8.2), and any job may take a resource late. A
        job in one piece without access phases holds its units all along, so it meets a job of the first cycle or none.
        """
        late = (p for p in jobs if len(p.stretches) > 1 or (p.version is not None and p.version.accesses))
        return max([2, *(-(-(p.end - self.length) // self.target.period) for p in late)])

    def path(self, placed: Placed | None = None) -> Path:
        """Name the switch, or a job on its line, for a diagnostic."""
        path = switch_path(self.table)
        return path if placed is None else Path(f"{path} task {placed.label}", (*path.subjects, placed.subject))


def switch_path(table: TransitionTable) -> Path:
    """Name the table of a switch for a diagnostic."""
    return about(transition=(table.source, table.target))
