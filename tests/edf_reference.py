"""Earliest deadline first over parts, written without regard to speed: what `native/edf.c` is held against.

On each unit the job with the earliest deadline runs to its next split point. A piece that would keep a job which is
still to come from its latest start is not begun: idle time is inserted instead. A job that can wait no longer comes
before all others. Jobs that have begun are a stack on each unit, so that spans are nested.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import Counter
from heapq import heappop, heappush
from typing import TYPE_CHECKING, NamedTuple

from edf_reference_jobs import Job, Resources, Table, may_stop, oldest_part, stops_at
from halpipe.pipeline.solve.edf.fixed import Claim
from halpipe.pipeline.solve.edf.plans import releases_of
from halpipe.pipeline.solve.edf.trials import MOST_CYCLES, Simulator

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from edf_reference_jobs import Piece
    from halpipe.pipeline.solve.edf.fixed import FixedJob, Walls
    from halpipe.pipeline.solve.edf.plans import Plan, Span
    from halpipe.pipeline.solve.edf.plans import Table as PlannedTable
    from halpipe.pipeline.solve.edf.works import Mode, Window


class _Place(NamedTuple):
    """Whether a job that stays occupies a unit, when the next one does, and the innermost gap of one around it."""

    is_busy: bool
    next_busy: int | None
    gap: tuple[int, int] | None


class _Wall:
    """The jobs that stay on one unit, repeated for ever."""

    def __init__(self, walls: Walls, cycle: int) -> None:
        self.rows, self.begins, self.cycle = walls.rows(), walls.begins, cycle

    def at(self, time: int) -> _Place:
        turn, rest = divmod(time, self.cycle)
        _, is_busy, has_gap, begin, end = self.rows[bisect_right([row[0] for row in self.rows], rest) - 1]
        shift = turn * self.cycle
        following = min(begin for begin in (*self.begins, self.begins[-1] + self.cycle) if begin >= rest)
        return _Place(is_busy, following + shift, (begin + shift, end + shift) if has_gap else None)


_RELEASE, _STOP, _WAKE, _FIXED = 0, 1, 2, 3

_AT_ONCE = -1
"""The deadline of a job that can wait no longer."""


def simulate(mode: Mode, plan: Plan) -> Table:
    """Return the table that `plan` leads to."""
    return _Simulation(mode, plan).run()


class Compared(Simulator):
    """The product's simulation, each of whose tables has to be that of the reference."""

    tables = 0

    def table(self, plan: Plan) -> PlannedTable:
        """Return the table that a plan leads to."""
        found, wanted = super().table(plan), simulate(self._mode, plan)
        assert (found.closed, found.late) == (wanted.closed, wanted.late)
        tasks = range(len(self._mode.works))
        assert {(task, index): spans for task in tasks for index, spans in found.jobs(task)} == wanted.jobs
        for task in tasks:
            for place in range(found.places[task], found.places[task + 1]):
                if found.counts[place]:
                    key, spans = (task, found.indices[place]), found.spans(place)
                    assert found.releases[place] == wanted.releases[key]
                    assert (found.starts[place], found.ends[place]) == (spans[0][0], spans[-1][1])
        Compared.tables += 1
        return found


class _Simulation:
    def __init__(self, mode: Mode, plan: Plan) -> None:
        self.mode = mode
        self.plan = plan
        self.cycle = mode.hyperperiod
        self.events: list[tuple[int, int, int, Job | None, int]] = []
        self.sequence = 0
        self.now = 0
        claims = (claim for each in mode.fixed.jobs for claim in each.claims)
        self.resources = Resources(tuple(mode.capacity.values()), claims, self.cycle)
        self.walls = {unit: _Wall(walls, self.cycle) for unit, walls in mode.fixed.walls.items()}
        self.pending: list[list[Job]] = [[] for _ in mode.units]
        self.stacks: list[list[Job]] = [[] for _ in mode.units]
        self.running: list[Job | None] = [None] * len(mode.units)
        self.on_unit: list[list[int]] = [[] for _ in mode.units]
        self.starts: list[list[int]] = [[] for _ in mode.works]
        self.ends: list[list[int]] = [[] for _ in mode.works]
        self.unfinished: list[Job | None] = [None] * len(mode.works)
        self.released: list[list[Job]] = [[] for _ in mode.works]
        self.releases = releases_of(mode, plan)
        self.next: list[tuple[int, int]] = []
        self.followers: list[set[int]] = [set() for _ in mode.works]
        self.reach = [0] * len(mode.works)
        self.done: list[Job] = []
        self.hurried = 0
        for task, way in enumerate(plan.ways):
            for unit in way.units if task not in mode.fixed.tasks else ():
                self.on_unit[unit].append(task)
            for window in way.windows:
                self.followers[window.task].update(way.units)
                self.reach[window.task] = max(self.reach[window.task], window.most)
        self.start_up = max(
            (earliest_expected(self.plan, self.releases, window) for way in plan.ways for window in way.windows),
            default=0,
        )
        self.has_windows = any(way.windows for way in plan.ways)

    # ---- time

    def run(self) -> Table:
        for task, times in enumerate(self.releases):
            self.next.append((-1, -1))
            if times:
                self._announce(task, 0)
        for number, each in enumerate(self.mode.fixed.jobs):
            for instant in {t for span in each.spans for t in span}:
                self._at(instant % self.cycle, _FIXED, None, number)
        signature = None
        start_up = -(-self.start_up // self.cycle)
        for cycle in range(1, start_up + MOST_CYCLES + 1):
            self._run_until(cycle * self.cycle)
            before, signature = signature, self._signature(cycle * self.cycle)
            if cycle <= start_up:
                continue
            if signature == before or (cycle == 1 and self._is_quiescent(cycle * self.cycle)):
                return self._table(cycle, closed=True)
        return self._table(start_up + MOST_CYCLES, closed=False)

    def _announce(self, task: int, number: int) -> None:
        """Put the release of a job on the list of events."""
        rounds, place = divmod(number, len(self.releases[task]))
        time = rounds * self.cycle + self.releases[task][place][0]
        self.next[task] = (time, number)
        self._at(time, _RELEASE, None, task)

    def _at(self, time: int, kind: int, job: Job | None, number: int) -> None:
        assert time >= self.now, "an event in the past"
        self.sequence += 1
        heappush(self.events, (time, kind, self.sequence, job, number))

    def _run_until(self, end: int) -> None:
        while self.events and self.events[0][0] < end:
            now = self.now = self.events[0][0]
            touched: set[int] = set()
            while self.events and self.events[0][0] == now:
                _, kind, _, job, number = heappop(self.events)
                if kind == _RELEASE:
                    touched.update(self._release(number))
                elif kind == _STOP and job is not None and job.ticket == number:
                    touched.update(self._stop(job, now))
                elif kind == _WAKE:
                    touched.add(number)
                elif kind == _FIXED:
                    touched.update(self._pass(self.mode.fixed.jobs[number], number, now))
            for unit in sorted(touched):
                self._dispatch(unit, now)

    def _release(self, task: int) -> tuple[int, ...]:
        now, number = self.next[task]
        self._announce(task, number + 1)
        work, way = self.mode.works[task], self.plan.ways[task]
        far = self.cycle * MOST_CYCLES
        time = now - self.plan.holds[task]
        job = Job(
            work=work,
            task=task,
            number=number,
            release=time,
            due=time + self.plan.urgency[task],
            latest=time + (work.latest if work.is_cyclic else far),
            end_by=time + (work.deadline if work.is_cyclic else far),
            way=way,
        )
        if self.unfinished[task] is None:
            self._offer(job, now)
        else:
            self.released[task].append(job)
        return way.units

    def _offer(self, job: Job, now: int) -> None:
        """Let a job wait for its units, from its release on or, if the one before it ends later, from then on."""
        self.unfinished[job.task] = job
        for unit in job.way.units:
            waiting = self.pending[unit]
            waiting.insert(bisect_left([other.order for other in waiting], job.order), job)
        if job.last_start > now:
            self._at(job.last_start, _WAKE, None, job.way.units[0])

    def _hurry(self, job: Job) -> None:
        """Put a job before all that can still wait."""
        job.due = _AT_ONCE
        self.hurried += 1
        for unit in job.way.units:
            self.pending[unit].sort(key=lambda other: other.order)

    def _stop(self, job: Job, now: int) -> set[int]:
        """End a piece; the job goes on, or makes room, when the unit is dispatched."""
        job.executed = job.target
        job.is_running = False
        job.spans[-1][1], job.spans[-1][3] = now, job.executed
        touched = set(job.way.units)
        for unit in job.way.units:
            self.running[unit] = None
        if job.executed < job.way.wcet:
            return touched
        for unit in job.way.units:
            self.stacks[unit].pop()
        self.done.append(job)
        self.ends[job.task].append(now)
        self.unfinished[job.task] = None
        if self.released[job.task]:
            self._offer(self.released[job.task].pop(0), now)
        return touched | self.followers[job.task]

    def _pass(self, fixed: FixedJob, number: int, now: int) -> set[int]:
        """Note what a job that stays does at an instant, and when it comes by again."""
        self._at(now + self.cycle, _FIXED, None, number)
        touched = set(fixed.units)
        for instant, times in ((fixed.start, self.starts), (fixed.end, self.ends)):
            if (now - instant) % self.cycle == 0:
                times[fixed.task].append(now)
                touched |= self.followers[fixed.task]
        return touched

    # ---- decisions

    def _dispatch(self, unit: int, now: int) -> None:
        for job in list(self.pending[unit]):
            if now >= job.last_start and job.due != _AT_ONCE:
                self._hurry(job)
        current = self.running[unit]
        if current is not None:
            self._cut(current, unit, now)
            return
        hurried = -1
        while hurried != self.hurried:  # who was put first meanwhile has not been asked
            hurried = self.hurried
            waiting: list[Job] = []
            for job in self._candidates(unit, now):
                if self._begin(job, waiting, now):
                    return
                waiting.append(job)

    def _candidates(self, unit: int, now: int) -> Iterator[Job]:
        """Yield the jobs that may take a unit, the most urgent first: those above the job that has begun, and it."""
        stack = self.stacks[unit]
        top = stack[-1] if stack else None
        waits = top is not None and self._is_shut_out(top, unit, now)
        for job in list(self.pending[unit]):
            if top is not None and job.order > top.order and not waits:
                break
            yield job
        if top is not None:
            yield top

    def _begin(self, job: Job, waiting: Sequence[Job], now: int) -> bool:
        """Start a job, or go on with it, if nothing forbids it; else see to it that the question is asked again."""
        begun = bool(job.spans)
        if not self._is_free_for(job, now) or (not begun and not self._windows_allow(job, now)):
            return False
        piece = job.piece(now)
        limit = self._limit(job, now)
        target = self._target(job, piece, limit)
        end = piece.end(target)
        if limit is not None and end > limit:
            return False
        claims = _claims(job, piece, target) if job.way.phases else []
        goes_on = piece.gaps == job.gaps
        must = goes_on and job.gaps >= job.way.max_gaps
        if not must:
            free = self.resources.collision(claims)
            if free is not None:
                if free > now:
                    self._at(free, _WAKE, None, job.way.units[0])
                return False
            if self._keeps_others_late(job, piece, end, waiting, now):
                return False
        if claims and self.resources.is_crowded():
            self.resources.forget(oldest_part(self.stacks, now))
        self.resources.take(claims)
        if not begun:
            self._enter(job, now)
        if not goes_on:
            job.spans.append([now, now, job.executed, job.executed])
        job.target, job.claims, job.kept = target, claims, now
        self._run(job, end)
        return True

    def _limit(self, job: Job, now: int) -> int | None:
        """Return until when a job may run from `now` on, before one that stays; None if for ever."""
        if not self.walls:
            return None
        limits = [self.walls[unit].at(now).next_busy for unit in job.way.units if unit in self.walls]
        return min((limit for limit in limits if limit is not None), default=None)

    def _is_shut_out(self, job: Job, unit: int, now: int) -> bool:
        """Return whether a job that stays keeps another from a unit: it runs, or what is begun must end before it."""
        if unit not in self.walls:
            return False
        place = self.walls[unit].at(now)
        if place.is_busy:
            return True
        if place.gap is None:
            return False
        begin, end = place.gap
        if job.spans:
            return job.spans[0][0] < begin
        others = [other.rest() for other in self.stacks[unit] if other.spans[0][0] >= begin]
        return now + job.way.length + sum(others) > end

    def _enter(self, job: Job, now: int) -> None:
        """Begin a job; one that had to begin now, but need not end in one piece, is no more urgent from now on."""
        self.starts[job.task].append(now)
        if job.due == _AT_ONCE and now + job.way.length < job.end_by:
            job.due = job.release + self.plan.urgency[job.task]
        for unit in job.way.units:
            self.pending[unit].remove(job)
            self.stacks[unit].append(job)
        for unit in self.followers[job.task]:
            self._at(now, _WAKE, None, unit)

    def _run(self, job: Job, end: int) -> None:
        job.ticket += 1
        job.is_running = True
        for unit in job.way.units:
            self.running[unit] = job
        self._at(end, _STOP, job, job.ticket)

    def _is_free_for(self, job: Job, now: int) -> bool:
        for unit in job.way.units:
            if self.running[unit] is not None or (self.walls and self._is_shut_out(job, unit, now)):
                return False
            top = self.stacks[unit][-1] if self.stacks[unit] else None
            if top is None or top is job:
                continue
            if job.spans or top.gaps >= top.way.max_gaps or not may_stop(top):
                return False
            if job.order > top.order and not self._is_shut_out(top, unit, now):
                return False
        return True

    def _windows_allow(self, job: Job, now: int) -> bool:
        """Return whether every window of a job is open; if one opens later, ask again then."""
        for window in job.way.windows:
            if self.plan.fresh and now < job.last_start and self._is_to_come(window, job):
                return False
            times = (self.ends if window.from_end else self.starts)[window.task]
            place = bisect_right(times, now - window.least)
            if place and times[place - 1] >= now - window.most:
                continue
            if now < earliest_expected(self.plan, self.releases, window):
                continue  # what it asks for lies before the beginning of time
            if place < len(times):
                self._at(times[place] + window.least, _WAKE, None, job.way.units[0])
            return False
        return True

    def _is_to_come(self, window: Window, job: Job) -> bool:
        """Return whether a predecessor that was released no later than `job` has still to start, or to end."""
        before = self.unfinished[window.task]
        return before is not None and before.release <= job.release and (window.from_end or not before.spans)

    def _target(self, job: Job, piece: Piece, limit: int | None) -> int:
        """Return up to where a job runs before the next decision: a job without gaps left runs to its end."""
        way = job.way
        if piece.gaps >= way.max_gaps:
            return way.wcet
        if not way.anywhere:
            return self._next_end(job, piece, limit)
        edges = sorted({edge for p in way.phases for edge in (p.begin, p.end) if edge > job.executed})
        target = next((edge for edge in edges if stops_at(way, piece.first, edge)), way.wcet)
        if limit is not None and piece.end(target) > limit:
            return piece.last_stop(limit, job.executed) or target
        return target

    def _next_end(self, job: Job, piece: Piece, limit: int | None) -> int:
        """Return the next split point, or a later one where until then no job is released that could be more urgent."""
        way = job.way
        least = bisect_right(way.ends, job.executed)
        if any(self.pending[unit] and self.pending[unit][0].order < job.order for unit in way.units):
            return way.ends[least]
        others = [self.next[task][0] for unit in way.units for task in self.on_unit[unit] if task != job.task]
        others += [other.last_start for unit in way.units for other in self.pending[unit]]
        quiet = min(others, default=piece.start)
        if limit is not None:
            quiet = min(quiet, limit) if others else limit
        most = len(way.ends) - 1
        while least < most:
            middle = (least + most + 1) // 2
            if piece.end(way.ends[middle]) <= quiet:
                least = middle
            else:
                most = middle - 1
        return way.ends[least]

    def _cut(self, job: Job, unit: int, now: int) -> None:
        """Shorten the piece of a job that may be interrupted anywhere, if a more urgent one waits for its unit."""
        way = job.way
        if not way.anywhere or job.gaps >= way.max_gaps or not self.pending[unit]:
            return
        urgent = self.pending[unit][0]
        if urgent.order > job.order or not self._windows_allow(urgent, now):
            return
        piece = job.running()
        where = piece.first_stop(now, job.executed)
        if where == job.executed and job.kept == now:
            return  # nobody could take its place at this instant
        if where < job.target:
            job.target = where
            end = piece.end(where)
            self.resources.give_back(claim for claim in job.claims if claim.begin >= end)
            self._run(job, end)

    def _keeps_others_late(self, job: Job, piece: Piece, end: int, waiting: Sequence[Job], now: int) -> bool:
        """Return whether a piece until `end` would keep some job from its latest start, while this job can wait."""
        for unit in job.way.units:
            if self._keeps_next_late(job, piece, end, unit, now):
                return True
            if self.pending[unit] and self._keeps_pending_late(job, piece, end, unit, now):
                return True
        for other in waiting:
            latest = other.latest if not other.spans else other.end_by
            latest = min(latest, other.end_by - other.rest())
            if end > latest >= now and end + job.rest() <= job.end_by:
                return True
        return False

    def _keeps_next_late(self, job: Job, piece: Piece, end: int, unit: int, now: int) -> bool:
        """Return that of jobs that are released before `end`."""
        for task in self.on_unit[unit]:
            release, _ = self.next[task]
            if task == job.task or release >= end or self.unfinished[task] is not None:
                continue
            work, way = self.mode.works[task], self.plan.ways[task]
            if not work.is_cyclic:
                continue
            latest = release - self.plan.holds[task] + min(work.latest, work.deadline - way.length)
            if _holds_up(job, piece, end, max(release, now), latest) and job.can_wait(release + way.length):
                return True
        return False

    def _keeps_pending_late(self, job: Job, piece: Piece, end: int, unit: int, now: int) -> bool:
        """Return that of jobs that have been released, and put the one found before all others."""
        for other in self.pending[unit]:
            if other is job or other.due == _AT_ONCE or not now <= other.last_start < end:
                continue
            latest = other.last_start
            if _holds_up(job, piece, end, latest, latest) and job.can_wait(now + other.way.length):
                self._hurry(other)
                return True
        return False

    # ---- results

    def _is_quiescent(self, now: int) -> bool:
        """Return whether nothing is under way, so that the next hyperperiod repeats the first."""
        return (
            not self.has_windows
            and all(job is None for job in self.unfinished)
            and not self.resources.in_force(now)
            and all(
                time - self.cycle == first[0][0]
                for (time, _), first in zip(self.next, self.releases, strict=True)
                if first
            )
        )

    def _signature(self, now: int) -> object:
        """Return all that the future depends on, relative to `now`."""
        self.resources.forget(now - self.cycle)
        jobs = tuple(
            (
                job.task,
                job.release - now,
                job.executed,
                job.target,
                job.is_running,
                tuple((s - now, e - now, a, b) for s, e, a, b in job.spans),
            )
            for unit in range(len(self.mode.units))
            for job in (*self.stacks[unit], *self.pending[unit])
        )
        released = tuple(tuple(job.release - now for job in jobs) for jobs in self.released)
        history = tuple(
            tuple(time - now for time in times if time >= now - self.reach[task])
            for kind in (self.starts, self.ends)
            for task, times in enumerate(kind)
        )
        nexts = tuple(time - now for (time, _), times in zip(self.next, self.releases, strict=True) if times)
        return jobs, released, history, nexts, self.resources.in_force(now)

    def _table(self, cycle: int, *, closed: bool) -> Table:
        end = cycle * self.cycle
        begin = end - self.cycle
        self._finish(end)
        jobs: dict[tuple[int, int], tuple[Span, ...]] = {}
        releases: dict[tuple[int, int], int] = {}
        late = [0] * len(self.mode.works)
        for job in self.done:
            if not begin <= job.spans[0][0] < end:
                continue
            index = self.releases[job.task][job.number % len(self.releases[job.task])][1]
            jobs[job.task, index] = tuple((s - begin, e - begin, a, b) for s, e, a, b in job.spans)
            releases[job.task, index] = job.release - begin
            late[job.task] += max(0, job.spans[0][0] - job.latest) + max(0, job.spans[-1][1] - job.end_by)
        placed = Counter(task for task, _ in jobs)
        for task, times in enumerate(self.releases):
            missing = len(times) - placed[task]
            late[task] += missing * self.cycle
            closed = closed and not missing
        return Table(jobs, releases, tuple(late), closed)

    def _finish(self, end: int) -> None:
        """Go on until all that began before `end` has ended."""
        limit = end + self.cycle
        while self.events and self.events[0][0] < limit:
            if not any(job.spans and job.spans[0][0] < end for stack in self.stacks for job in stack):
                return
            self._run_until(self.events[0][0] + 1)


def earliest_expected(plan: Plan, releases: Sequence[Sequence[tuple[int, int]]], window: Window) -> int:
    """Return before when no job may expect a predecessor in a window, since none has run yet."""
    if not window.least or not releases[window.task]:
        return 0
    length = plan.ways[window.task].length if window.from_end else 0
    return releases[window.task][0][0] + length + window.least


def _claims(job: Job, piece: Piece, target: int) -> list[Claim]:
    """Return what a piece up to `target` asks of resources, beyond what the job has taken."""
    return [
        Claim(p.resource, piece.start + piece.lost + p.begin - piece.first, piece.end(p.end), p.height)
        for p in job.way.phases
        if job.executed <= p.begin and p.end <= target
    ]


def _holds_up(job: Job, piece: Piece, end: int, since: int, latest: int) -> bool:
    """Return whether a piece until `end` still runs after `latest`, even if it is asked to pause from `since` on."""
    return end > latest and not (piece.may_pause and piece.end(piece.first_stop(since, job.executed)) <= latest)
