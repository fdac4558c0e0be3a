"""What a simulation of earliest deadline first is told, its jobs, its outcome; and where a job may be interrupted."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from halpipe.records import record

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.pipeline.parts import Service
    from halpipe.pipeline.solve.edf.resources import Claim
    from halpipe.pipeline.solve.edf.works import Way, Work

Span = tuple[int, int, int, int]
"""A part: start, end, and what it executes, from and to."""


@record
class Plan:
    """What the simulation is told: for each task its way, the phase of its releases, and how urgent its jobs are.

    `urgency` is the deadline by which jobs are ordered, from their release; they are held back for `holds` after it.
    With `fresh` a job waits, as long as it can, for the job of its predecessor that was released before it or with it.
    """

    ways: tuple[Way, ...]
    phases: tuple[int, ...]
    urgency: tuple[int, ...]
    holds: tuple[int, ...]
    fresh: bool = True


class Piece(NamedTuple):
    """A part of a job that it runs, or might: from `start` on it executes what comes after `first`.

    Before that `lost` goes by, and so many `gaps` lie before it.
    """

    way: Way
    start: int
    first: int
    lost: int
    gaps: int

    @property
    def may_pause(self) -> bool:
        """Whether it may end at other instants than split points."""
        return self.way.anywhere and self.gaps < self.way.max_gaps

    def end(self, done: int) -> int:
        """Return when it ends if it executes up to `done`."""
        work = self.lost + done - self.first
        return self.start + (reserved(work, self.way.service) if self.way.service else work)

    def first_stop(self, now: int, executed: int) -> int:
        """Return the least execution time at which it may end, at or after the instant `now`."""
        way = self.way
        least, most = max(executed, self.first + 1), way.wcet
        while least < most:  # the least execution time that the part has reached at `now`
            middle = (least + most) // 2
            if self.end(middle) >= now:
                most = middle
            else:
                least = middle + 1
        where = max(least, self.first + way.min_part)
        if way.wcet - where < way.min_part:
            return way.wcet
        for phase in sorted(way.phases, key=lambda p: p.begin):
            if phase.begin < where < phase.end:
                where = phase.end
        return where if stops_at(way, self.first, where) else way.wcet

    def last_stop(self, limit: int, executed: int) -> int:
        """Return the last execution time beyond `executed` at which it may end before `limit`; 0 if there is none."""
        way = self.way
        least, most = executed, way.wcet
        while least < most:
            middle = (least + most + 1) // 2
            if self.end(middle) <= limit:
                least = middle
            else:
                most = middle - 1
        where = min(least, way.wcet - way.min_part)
        for phase in sorted(way.phases, key=lambda p: -p.end):
            if phase.begin < where < phase.end:
                where = phase.begin
        return where if where > executed and stops_at(way, self.first, where) else 0


@dataclass(slots=True)
class Job:
    """A job on its way. `number` counts the jobs of its task from the beginning of time.

    `last_start` is when it must start at the latest to run in one piece.
    """

    work: Work
    task: int
    number: int
    release: int
    due: int
    latest: int
    end_by: int
    way: Way
    spans: list[list[int]] = field(default_factory=list)
    executed: int = 0
    target: int = 0
    claims: list[Claim] = field(default_factory=list)
    kept: int = -1
    ticket: int = 0
    is_running: bool = False
    last_start: int = field(init=False)

    def __post_init__(self) -> None:
        self.last_start = min(self.latest, self.end_by - self.way.length)

    @property
    def order(self) -> tuple[int, int, int]:
        """Earlier ones run first."""
        return self.due, self.task, self.number

    @property
    def gaps(self) -> int:
        """Return how many gaps the job has so far."""
        return len(self.spans) - 1

    def running(self) -> Piece:
        """Return the part that was begun last."""
        start, _, first, _ = self.spans[-1]
        return Piece(self.way, start, first, self.way.resume if self.gaps else 0, self.gaps)

    def piece(self, now: int) -> Piece:
        """Return the part that goes on at `now` without a gap, or else begins then."""
        if self.spans and self.spans[-1][1] == now:
            return self.running()
        return Piece(self.way, now, self.executed, self.way.resume if self.spans else 0, self.gaps + 1)

    def can_wait(self, until: int) -> bool:
        """Return whether it may start, or go on, at an instant and end in time as one part."""
        return until + self.rest() <= self.end_by and (bool(self.spans) or until <= self.latest)

    def rest(self) -> int:
        """Return what is left, as one part."""
        lost = self.way.resume if self.spans else 0
        return reserved(self.way.wcet - self.executed + lost, self.way.service)


@record
class Table:
    """One hyperperiod: the spans of every job by task and index, their starts in [0, hyperperiod).

    `releases` are the instants of release that belong to those starts. `late` sums for each task by how much its jobs
    start or end too late. A table that is not `closed` does not repeat.
    """

    jobs: dict[tuple[int, int], tuple[Span, ...]]
    releases: dict[tuple[int, int], int]
    late: tuple[int, ...]
    closed: bool


def reserved(work: int, service: Service[int]) -> int:
    """Return what `parts.reserved_length` does, of interrupts that are known to leave some of the time."""
    length, longer = 0, work
    while service and longer != length:
        length, longer = longer, work
        for distance, time in service:
            longer += -(-length // distance) * time
    return longer


def stops_at(way: Way, first: int, where: int) -> bool:
    """Return whether a part that began at `first` may end at `where`, in execution time."""
    if where >= way.wcet:
        return True
    if not way.anywhere:
        return where in way.ends
    is_long = where - first >= way.min_part and way.wcet - where >= way.min_part
    return is_long and not any(p.begin < where < p.end for p in way.phases)


def may_stop(job: Job) -> bool:
    """Return whether the running part may end with what it has executed."""
    return stops_at(job.way, job.spans[-1][2], job.executed)


def oldest_part(stacks: Iterable[Iterable[Job]], now: int) -> int:
    """Return the first instant at which a part began that is running, or may go on at once."""
    going = [job for stack in stacks for job in stack if job.is_running or job.spans[-1][1] == now]
    return min([now, *(job.spans[-1][0] for job in going)])
