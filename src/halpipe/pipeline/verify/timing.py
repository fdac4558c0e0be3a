"""Rules periodic, deadline and edge: each job in time after its release, at one phase for each task (MODEL 3)."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from itertools import accumulate, pairwise
from math import floor
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, about
from halpipe.models import Anchor, Task
from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.tables import ActiveTask, Clock, ModeTable, Placed, Rule

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from fractions import Fraction


def check_periodic(table: ModeTable) -> Iterator[Diagnostic]:
    """Report the jobs that are outside their slack at the phase that suits most jobs of their task."""
    for name, active in table.mode.tasks.items():
        releases = _Releases(table, name, active)
        if name in table.mode.in_first and not releases.is_in_first():
            text = f"has its first release at {table.clock.text(releases.phase)}, not in the first of its periods"
            help = "number its jobs from the first release on"
            yield codes.NOT_PERIODIC(text, at=table.at, path=about(table.path(), task=name), help=help)
        for placed, delay in releases.delays():
            if delay > releases.slack:
                text = releases.blame(placed, delay, "its slack allows", releases.slack)
                help = f"start it within the slack, or change the slack or offset of the task ({releases.phase_text()})"
                yield codes.NOT_PERIODIC(text, at=placed.job.at, path=table.path(placed), help=help)


def check_deadline(table: ModeTable) -> Iterator[Diagnostic]:
    """Report the jobs that end after their deadline at the phase that suits most jobs of their task.

    (D) The phase is the same for both rules: s must satisfy them together. A job outside its slack has no release, so
    of its deadline only C <= deadline can be said. Jobs on demand have no release; their deadline is not checked. Of a
    task that serves arrivals, each job is compared with the one before instead (MODEL 8.2).
    """
    for name, active in table.mode.tasks.items():
        if active.task.distance is None or active.let is not None:
            yield from _released(table, name, active)
        if active.task.distance is not None:
            yield from _polled(table, name, active)


def _released(table: ModeTable, name: str, active: ActiveTask) -> Iterator[Diagnostic]:
    clock = table.clock
    releases = _Releases(table, name, active)
    for placed, delay in releases.delays():
        if placed.span is None:
            continue
        delay = delay if delay <= releases.slack else 0
        excess = delay + placed.span - releases.deadline
        if excess > 0:
            text = f"ends {clock.text(delay + placed.span)} after its release, its deadline is "
            text = text.replace("deadline", "LET") if releases.deadline == active.let else text
            text += f"{clock.text(releases.deadline)}: {clock.text(excess)} late, at {placed.job.end}"
            help = f"start it earlier, or change the deadline of the task ({releases.phase_text()})"
            yield codes.LATE(text, at=placed.job.at, path=table.path(placed), help=help)


def _polled(table: ModeTable, name: str, active: ActiveTask) -> Iterator[Diagnostic]:
    jobs = sorted(table.by_task.get(name, ()), key=lambda p: (p.start, p.job.index))
    if jobs:
        first = jobs[-1].moved(-table.period, " of the cycle before")
        for before, placed in pairwise((first, *jobs)):
            for text in late_for_arrivals(active.task, before, placed, table.clock):
                help = "start it earlier, start the job before it later, or poll more often"
                yield codes.ARRIVAL_LATE(text, at=placed.job.at, path=table.path(placed), help=help)


def late_for_arrivals(task: Task, before: Placed, placed: Placed, clock: Clock) -> Iterator[str]:
    """Say in how far a job is too late for an arrival just after the start of the job `before` it.

    It must start within the distance after that start, so that no second arrival comes, and end within the deadline.
    """
    if task.distance is None:
        return
    distance = clock.ticks(task.distance)
    deadline = distance if task.deadline is None else clock.ticks(task.deadline)
    for what, instant, limit in (("starts", placed.start, distance), ("ends", placed.end, deadline)):
        if instant - before.start > limit:
            text = f"{what} {clock.text(instant - before.start)} after the start of {before.label}; an arrival just "
            text += (
                f"after that start allows {clock.text(limit)}: {clock.text(instant - before.start - limit)} too late"
            )
            yield text


class _Releases:
    """The phase s of a task and the delay delta of each of its jobs.

    (D) Where no phase suits all jobs, the one that suits most is taken: first by slack, then by slack and deadline
    together, then the smallest. Jobs whose index is out of range have no release and are left to rule complete.
    Some end of a window lies in every common intersection of windows, so only those need to be tried as s; delays are
    whole ticks, so slack * D may be rounded down to a tick without loss.
    """

    def __init__(self, table: ModeTable, name: str, active: ActiveTask) -> None:
        self._table = table
        self._active = active
        self.jobs: list[Placed] = []
        if active.period is None:
            return
        count = table.period // active.period
        self.jobs = [p for p in table.by_task.get(name, ()) if 0 <= p.job.index < count]
        deadline = active.task.distance if active.task.deadline is None else active.task.deadline
        self.deadline = active.period if deadline is None else table.clock.ticks(deadline)
        if active.let is not None:
            self.deadline = active.let
        self._exact = active.task.slack * active.period
        self.slack = floor(self._exact)
        if self.jobs:
            self.phase = self._phase(active.period)

    def _latest_releases(self, period: int) -> list[int]:
        """Return for every job the latest s that still releases it in time: theta - j * D."""
        return [(p.start - p.job.index * period) % self._table.period for p in self.jobs]

    def _phase(self, period: int) -> int:
        offset = self._active.task.offset
        if offset is not None:
            return self._table.clock.ticks(offset) % period
        latest = self._latest_releases(period)
        rooms = [min(self.slack, floor(self._room(p.span))) for p in self.jobs]
        if latest.count(latest[0]) == len(latest):
            return latest[0]
        tried = sorted(set(latest))
        by_slack = self._suits(tried, latest, [self.slack] * len(latest))
        by_both = self._suits(tried, latest, rooms)
        scores = zip(by_slack, by_both, (-s for s in tried), strict=True)
        return -max(scores)[2]

    def _room(self, span: int | None) -> int | Fraction:
        """Return how late a job may start for its deadline: of a task that serves arrivals, not less than its slack."""
        return self._exact if span is None else self.deadline - span

    def is_in_first(self) -> bool:
        """Tell whether some phase in [0, D) suits all jobs; of a task with a LET, the latest that suits them is taken.

        Phases that suit are those from the greatest of `latest - room` on up to the one that was found.
        """
        period = self._active.period
        if not self.jobs or period is None or self.phase < period:
            return True
        if self._active.let is not None:
            return False
        rooms = ((delay, self._room(placed.span)) for placed, delay in self.delays())
        return all(self.phase - period + delay < min(self._exact, room) for delay, room in rooms)

    def _suits(self, tried: Sequence[int], latest: Sequence[int], rooms: Sequence[int]) -> list[int]:
        """Count, for every phase tried, the jobs whose arc [latest - room, latest] contains it.

        The counts are right up to a number common to all phases, which is all that their comparison needs: an arc that
        passes 0 counts 0 inside and -1 outside, one that covers the circle or nothing is left out.
        """
        circle = self._table.period
        steps = [0] * (len(tried) + 1)
        for last, room in zip(latest, rooms, strict=True):
            if 0 <= room < circle:
                steps[bisect_left(tried, (last - room) % circle)] += 1
                steps[bisect_right(tried, last)] -= 1
        return list(accumulate(steps[:-1]))

    def delays(self) -> Iterator[tuple[Placed, int]]:
        """Yield every job with its delay after its release, in [0, t_P)."""
        if self._active.period is not None:
            for placed, last in zip(self.jobs, self._latest_releases(self._active.period), strict=True):
                yield placed, (last - self.phase) % self._table.period

    def blame(self, placed: Placed, delay: int, rule: str, limit: int) -> str:
        """Say how far a job is from its window, on the nearer side."""
        clock = self._table.clock
        early = self._table.period - delay
        if early < delay - limit:
            return f"starts at {placed.job.start}, {clock.text(early)} before its release"
        text = f"starts at {placed.job.start}, {clock.text(delay)} after its release; "
        return text + f"{rule} {clock.text(limit)}: {clock.text(delay - limit)} too late"

    def phase_text(self) -> str:
        """Say which phase the delays were counted from."""
        phase = self._table.clock.text(self.phase)
        fixed = self._active.task.offset is not None
        return f"its offset puts the first release at {phase}" if fixed else f"most jobs fit a first release at {phase}"


def release(table: ModeTable) -> None:
    """Note the releases of jobs that windows, chains or logical execution times refer to, and their cycles."""
    named = {c.tasks[0] for c in table.chains() if c.anchor is Anchor.RELEASE} | table.mode.in_first
    for active in table.mode.tasks.values():
        rows = (row for version in active.versions.values() for row in version.precedences)
        named |= {row.task for row in rows if row.anchor is Anchor.RELEASE}
    for name in sorted(named & table.mode.tasks.keys()):
        active = table.mode.tasks[name]
        period = active.period
        for placed, delay in _Releases(table, name, active).delays():
            placed.delay = delay
            first = placed.job.index * period if period else 0
            if active.task.offset is not None and period:
                first += table.clock.ticks(active.task.offset) % period
            placed.lap = table.period if placed.start < first else 0


PERIODIC = Rule(
    "periodic",
    "For every periodic task there is a phase s (its offset, where one is given) such that job j starts at "
    "s + j * period, delayed by at most slack * period; within the first period where a constraint on the same "
    "cycle or a logical execution time names the task.",
    check_periodic,
)
DEADLINE = Rule(
    "deadline",
    "Every periodic job ends within its deadline and its logical execution time after its release, at the same phase. "
    "Of a task that serves arrivals, "
    "every job starts within the distance and ends within the deadline after the start of the job before it.",
    check_deadline,
)


def check_edge(table: ModeTable) -> Iterator[Diagnostic]:
    """Compare the ends of all jobs with the hyperperiod; access phases lie within their jobs."""
    for placed in table.jobs if table.mode.is_closed else ():
        if placed.end > table.period:
            text = f"ends at {table.clock.text(placed.end)}, after the end of the table at "
            text += table.clock.text(table.period)
            help = "start it earlier, or open the edge of the mode"
            yield codes.OVER_THE_EDGE(text, at=placed.job.at, path=table.path(placed), help=help)


EDGE = Rule("edge", "In a mode with a closed edge every job ends within the table.", check_edge)
