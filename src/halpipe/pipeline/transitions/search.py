"""The search for the jobs of one transition table of a given length.

What is fixed: two cycles of the mode before, two of the mode after. What is asked: the fewest jobs that keep tasks
of both modes from starving and that give jobs of the mode after the predecessors they need. Jobs are placed by
latest start first; one that does not fit is tried earlier in the next round.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from graphlib import TopologicalSorter
from typing import TYPE_CHECKING

from halpipe.pipeline.transitions.line import Line, LineJob

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.pipeline.transitions.line import Shape
    from halpipe.pipeline.transitions.modes import GridMode, Window

ROUNDS = 12
"""Orders of placement that are tried for one length."""


@dataclass(frozen=True, slots=True)
class Blocked:
    """Why no table of a length was found: the task and the rule, for people; `progress` says how far it came."""

    task: str
    rule: str
    progress: int = 0


@dataclass(slots=True)
class _Wanted:
    """A job that the table must have: a start of `task` in [earliest, latest]; `instants` narrow start or end."""

    task: str
    earliest: int
    latest: int
    rule: str
    order: int
    instants: list[tuple[int, int, bool]] = field(default_factory=list)


class Table:
    """One attempt: the switch from `before` to `after` with a table of `length` ticks."""

    def __init__(self, before: GridMode, after: GridMode, length: int) -> None:
        self.after = after
        self.length = length
        self.past = [job.moved(-cycle * before.hyperperiod) for cycle in (2, 1) for job in before.jobs]
        self.future = [job.moved(length + cycle * after.hyperperiod) for cycle in (0, 1) for job in after.jobs]
        self.common = {a.name: a for a in after.expansion.tasks if a.name in before.expansion.by_name}
        self._most_wanted = 4 * len(after.expansion.tasks) + 16
        self.fixed_by_task: dict[str, list[LineJob]] = {}
        for job in (*self.past, *self.future):
            self.fixed_by_task.setdefault(job.task, []).append(job)

    def fill(self) -> tuple[LineJob, ...] | Blocked:
        """Return the jobs of the table, or what blocks it."""
        line = self._line()
        if isinstance(line, Blocked):
            return line
        wanted = self._wanted()
        if isinstance(wanted, Blocked):
            return wanted
        blocked = Blocked("", "")
        for _ in range(ROUNDS):
            placed = self._place(wanted)
            if not isinstance(placed, _Wanted):
                return placed
            blocked = Blocked(placed.task, placed.rule, progress=1)
            placed.order -= 1
            self._want_predecessors_of(placed, wanted)
        return blocked

    def _line(self) -> Line | Blocked:
        """Enter what is fixed near the switch; two modes that clash there leave no table of this length."""
        line = Line(self.after.quanta)
        for job in self.past:
            if job.end > 0:
                line.enter(job)
        reach = self.length + max((s.wcet for shapes in self.after.shapes.values() for s in shapes), default=0)
        for job in self.future:
            if job.start < reach or job.start < max((p.end for p in self.past), default=0):
                if line.clashes(job):
                    return Blocked(job.task, "unit or resource is still in use by the mode before")
                line.enter(job)
        return line

    # ---- what is wanted

    def _wanted(self) -> list[_Wanted] | Blocked:
        wanted: list[_Wanted] = []
        for name, active in self.common.items():
            if active.task.period is None:
                continue
            found = self._against_starving(name)
            if isinstance(found, Blocked):
                return found
            wanted += found
        for job in self.future:
            for window in self.after.windows[job.task, job.shape.version]:
                if window.met_by(job.start, self.fixed_by_task.get(window.task, [])):
                    continue
                blocked = self._want_predecessor(job, window, wanted)
                if blocked is not None:
                    return blocked
        return wanted

    def _against_starving(self, name: str) -> list[_Wanted] | Blocked:
        """Return the starts that fill a gap between the last job before and the first job after the switch."""
        task = self.common[name].task
        assert task.period is not None, "only periodic tasks starve"
        most = (task.period * (1 + task.slack)) // self.after.tick
        last = max((job for job in self.past if job.task == name), key=lambda j: j.start)
        first = min((job for job in self.future if job.task == name), key=lambda j: j.start)
        gap = first.start - last.start
        count = max(0, -(-gap // most) - 1)
        if not count:
            return Blocked(name, "would run against itself") if gap < last.shape.wcet else []
        shortest = min(shape.wcet for shape in self.after.shapes[name])
        wanted = []
        for number in range(1, count + 1):
            left = count + 1 - number
            earliest = max(0, first.start - left * most, last.end + (number - 1) * shortest)
            latest = min(self.length - 1, last.start + number * most, first.start - left * shortest)
            if earliest > latest:
                return Blocked(name, "would not start often enough")
            wanted.append(_Wanted(name, earliest, latest, "would not start often enough", 0))
        return wanted

    def _want_predecessor(self, job: LineJob, window: Window, wanted: list[_Wanted]) -> Blocked | None:
        """Narrow a start that is wanted anyway to one that meets the window, or want one more."""
        low, high = job.start - window.high, job.start - window.low
        rule = f'job of "{job.task}" lacks its predecessor "{window.task}"'
        shapes = self.after.shapes.get(window.task)
        if not shapes:
            return Blocked(job.task, rule)
        for known in wanted:
            if known.task == window.task and (low, high, window.from_end) in known.instants:
                return None
        shift = max(shape.wcet for shape in shapes) if window.from_end else 0
        earliest, latest = max(0, low - shift), min(self.length - 1, high - (shift and min(s.wcet for s in shapes)))
        if earliest > latest:
            return Blocked(job.task, rule)
        for known in wanted:
            if (
                known.task == window.task
                and not known.instants
                and known.earliest <= latest
                and earliest <= known.latest
            ):
                known.earliest, known.latest = max(known.earliest, earliest), min(known.latest, latest)
                known.instants.append((low, high, window.from_end))
                return None
        wanted.append(_Wanted(window.task, earliest, latest, rule, 0, [(low, high, window.from_end)]))
        return None

    def _want_predecessors_of(self, want: _Wanted, wanted: list[_Wanted]) -> None:
        """Want the jobs without which no version of a job of the table finds its predecessors."""
        shape = self.after.shapes[want.task][0]
        for window in self.after.windows[want.task, shape.version]:
            fixed = (window.instant(job) for job in self.fixed_by_task.get(window.task, ()))
            met = any(want.earliest - window.high <= instant <= want.latest - window.low for instant in fixed)
            if met or not self.after.shapes.get(window.task) or len(wanted) > self._most_wanted:
                continue
            shift = self.after.shapes[window.task][0].wcet if window.from_end else 0
            earliest = max(0, want.earliest - window.high - shift)
            latest = min(self.length - 1, want.latest - window.low - shift)
            if earliest <= latest and not any(w.task == window.task and w.latest == latest for w in wanted):
                wanted.append(_Wanted(window.task, earliest, latest, want.rule, want.order))

    # ---- placing

    def _place(self, wanted: list[_Wanted]) -> tuple[LineJob, ...] | _Wanted:
        """Place every wanted job, predecessors first; return them numbered, or the first wish that does not fit."""
        line = self._line()
        assert isinstance(line, Line), "checked before"
        jobs = {name: list(found) for name, found in self.fixed_by_task.items()}
        placed: list[LineJob] = []
        for want in sorted(wanted, key=lambda w: (w.order, self._depth[w.task], w.latest, w.task)):
            job = self._place_one(want, line, jobs)
            if job is None:
                return want
            line.enter(job)
            jobs.setdefault(job.task, []).append(job)
            placed.append(job)
        return tuple(_numbered(placed))

    def _place_one(self, want: _Wanted, line: Line, jobs: dict[str, list[LineJob]]) -> LineJob | None:
        for shape in self.after.shapes[want.task]:
            for earliest, latest in self._allowed(want, shape, jobs):
                fit = line.first_fit(shape, earliest, latest)
                if fit is not None:
                    return LineJob(fit[0], want.task, 0, shape, fit[1])
        return None

    def _allowed(self, want: _Wanted, shape: Shape, jobs: dict[str, list[LineJob]]) -> list[tuple[int, int]]:
        """Return the intervals of starts that the wish and the version's own constraints leave."""
        spans = [(want.earliest, want.latest)]
        for low, high, from_end in want.instants:
            shift = shape.wcet if from_end else 0
            spans = _meet(spans, [(low - shift, high - shift)])
        for window in self.after.windows[shape.task, shape.version]:
            instants = (window.instant(job) for job in jobs.get(window.task, ()))
            spans = _meet(spans, [(instant + window.low, instant + window.high) for instant in instants])
        return spans

    @cached_property
    def _depth(self) -> dict[str, int]:
        """The place of every task in an order with predecessors first."""
        before: dict[str, set[str]] = {name: set() for name in self.after.shapes}
        for (task, _), windows in self.after.windows.items():
            before[task].update(window.task for window in windows if window.task in before)
        return {name: place for place, name in enumerate(TopologicalSorter(before).static_order())}


def _meet(spans: list[tuple[int, int]], others: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return the intersection of two unions of closed intervals, in order."""
    met = {(max(a, c), min(b, d)) for a, b in spans for c, d in others}
    return sorted((low, high) for low, high in met if low <= high)


def _numbered(jobs: list[LineJob]) -> Iterator[LineJob]:
    """Number the jobs of every task by start."""
    count: dict[str, int] = {}
    for job in sorted(jobs, key=lambda j: (j.start, j.task)):
        number = count.get(job.task, 0)
        count[job.task] = number + 1
        yield replace(job, index=number)
