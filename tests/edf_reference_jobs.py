"""Jobs, pieces and access phases of the reference simulation (`edf_reference`)."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from halpipe.core.records import record
from halpipe.pipeline.solve.edf.fixed import Claim

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from halpipe.pipeline.parts import Service
    from halpipe.pipeline.solve.edf.plans import Span
    from halpipe.pipeline.solve.edf.works import Way, Work

FEW = 64
"""Claims of a resource that are remembered before any are forgotten."""


class Resources:
    """The claims that may still matter, by resource; those that ended before all running parts are forgotten."""

    def __init__(self, capacity: Sequence[int], standing: Iterable[Claim] = (), cycle: int = 1) -> None:
        """Begin with `standing` claims, which come again with every `cycle`."""
        self._capacity = capacity
        self._claims: list[list[Claim]] = [[] for _ in capacity]
        self._most = [FEW] * len(capacity)
        self._standing: list[list[Claim]] = [[] for _ in capacity]
        self._cycle = cycle
        for claim in standing:
            turn = claim.begin // cycle * cycle
            self._standing[claim.resource].append(claim.moved(-turn))
        for claims in self._standing:
            claims.sort(key=lambda claim: claim.begin)
        self._longest = [max((c.end - c.begin for c in claims), default=0) for claims in self._standing]

    def collision(self, claims: Iterable[Claim]) -> int | None:
        """Return None if all `claims` fit, also beside each other, else an instant up to which one of them does not.

        Those of one piece may lie over each other where interrupts stretch its phases.
        """
        before: list[Claim] = []
        for claim in claims:
            until = self._first_free(claim, before)
            if until is not None:
                return until
            before.append(claim)
        return None

    def _first_free(self, claim: Claim, others: Iterable[Claim]) -> int | None:
        room = self._capacity[claim.resource] - claim.height
        taken = (*self._claims[claim.resource], *(c for c in others if c.resource == claim.resource))
        near = [c for c in taken if c.begin < claim.end and claim.begin < c.end]
        near += self._standing_near(claim)
        for instant in sorted({max(claim.begin, other.begin) for other in near}):
            if sum(c.height for c in near if c.begin <= instant < c.end) > room:
                return min(c.end for c in near if c.begin <= instant < c.end)
        return None

    def _standing_near(self, claim: Claim) -> Iterator[Claim]:
        """Yield those that stay as they lie around `claim`."""
        standing = self._standing[claim.resource]
        earliest = claim.begin - self._longest[claim.resource]
        for turn in range(earliest // self._cycle, claim.end // self._cycle + 1) if standing else ():
            shift = turn * self._cycle
            for place in range(bisect_left(standing, earliest - shift, key=lambda c: c.begin), len(standing)):
                other = standing[place].moved(shift)
                if other.begin >= claim.end:
                    break
                if claim.begin < other.end:
                    yield other

    def take(self, claims: Iterable[Claim]) -> None:
        """Take what `claims` ask for."""
        for claim in claims:
            self._claims[claim.resource].append(claim)

    def give_back(self, claims: Iterable[Claim]) -> None:
        """Give back what was taken and is not needed now."""
        for claim in list(claims):
            self._claims[claim.resource].remove(claim)

    def is_crowded(self) -> bool:
        """Return whether so many claims are remembered that it is time to forget some."""
        return any(len(claims) > most for claims, most in zip(self._claims, self._most, strict=True))

    def forget(self, before: int) -> None:
        """Forget what ended at or before an instant."""
        for number, claims in enumerate(self._claims):
            claims[:] = [claim for claim in claims if claim.end > before]
            self._most[number] = max(FEW, 2 * len(claims))

    def in_force(self, since: int) -> tuple[Claim, ...]:
        """Return the claims that end after an instant, relative to it."""
        return tuple(
            sorted(
                Claim(c.resource, c.begin - since, c.end - since, c.height)
                for claims in self._claims
                for c in claims
                if c.end > since
            )
        )


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
