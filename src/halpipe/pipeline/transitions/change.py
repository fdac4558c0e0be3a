"""Common facts of all tables of one switch: the modes around it, and its least length."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from functools import cached_property
from graphlib import TopologicalSorter
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.pipeline.solve.groups import linked_tasks
from halpipe.pipeline.transitions.line import GridMode, Layer, Line, LineJob, Window

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.models import Anchor, Task


MOST_CYCLES = 1000
"""Cycles of one mode that are looked at for one window, however wide it is or far back it reaches."""


@record
class Pace:
    """Pace at which a task of both modes must start, in ticks.

    `last` and `last_end` are of its last job before the switch; `first` is the start of its first job in the mode
    after, `most` the longest distance of two starts, `shortest` the least length of a job.
    """

    task: str
    last: int
    last_end: int
    first: int
    most: int
    shortest: int

    def can_be_kept(self, length: int) -> bool:
        """Return whether some number of starts divides the gap into parts that are neither too long nor too short.

        A condition that is quick to check and rules out most lengths of strictly periodic tasks.
        """
        gap = self.first + length - self.last
        return -(-gap // self.most) <= gap // self.shortest


class Change:
    """The switch from `before` to `after`: jobs before it have negative starts; the mode after begins at any time."""

    def __init__(self, before: GridMode, after: GridMode) -> None:
        self.before = before
        self.after = after
        self._past = _Instants(before, last=-1)
        self._future = _Instants(after, first=0)
        cycle = before.hyperperiod
        self.tail = [job.moved(-n * cycle) for job in before.jobs for n in range(1, -(-job.end // cycle))]
        """The jobs of the mode before that still run after the switch, with all their parts."""
        self.tail_layer = Layer(self.tail)
        self._over = max((job.end for job in self.tail), default=0)
        lengths = (shape.length for shapes in after.shapes.values() for shape in shapes)
        self._early = list(_jobs_before(max([self._over, *lengths]), after))
        self.future_layer = Layer(self._early)
        self._has_gaps = any(job.shape.parts for job in (*self.tail, *self._early))
        self.most_wanted = 4 * len(after.expansion.tasks) + 16

    # ---- how long the table must be

    @cached_property
    def least(self) -> tuple[int, str]:
        """The least length for which no unit is still in use when the mode after needs it; a task that needs that.

        Where jobs have gaps, those of the mode after may lie inside, so nothing is known without a look at all.
        """
        last = max(self.tail, key=lambda job: job.end, default=None)
        if last is not None and self.after.is_closed:
            return last.end, last.task
        if self._has_gaps:
            return 0, ""
        ends: dict[str, int] = {}
        for job in self.tail:
            for unit in job.units:
                ends[unit] = max(job.end, ends.get(unit, 0))
        least, task = 0, ""
        for job in self._early:
            for unit in job.units:
                needed = ends.get(unit, 0) - job.start
                if needed > least:
                    least, task = needed, job.task
        return least, task

    def clash(self, length: int) -> str | None:
        """Return a task of the mode after that cannot start in time, as something is in use by the mode before."""
        least, task = self.least
        if length < least:
            return task
        line = Line(self.after.quanta, (self.tail_layer, 0))
        for job in self._early:
            moved = job.moved(length)
            if moved.start >= self._over:
                break
            if line.overloads(moved) or (self._has_gaps and line.clashes(moved)):
                return job.task
            line.enter(moved)
        return None

    @cached_property
    def paces(self) -> tuple[Pace, ...]:
        """The pace of every periodic task of both modes."""
        last: dict[str, LineJob] = {job.task: job for job in self.before.jobs}  # jobs are in order of their starts
        first: dict[str, LineJob] = {job.task: job for job in reversed(self.after.jobs)}
        cycle = self.before.hyperperiod
        return tuple(
            Pace(
                active.name,
                last[active.name].start - cycle,
                last[active.name].end - cycle,
                first[active.name].start,
                self._longest_distance(active.task),
                min(shape.length for shape in self.after.shapes[active.name]),
            )
            for active in self.after.expansion.tasks
            if active.name in self.before.expansion.by_name and active.task.period is not None
        )

    def _longest_distance(self, task: Task) -> int:
        """Return how far starts may be apart: by the slack, and for arrivals so that the longest job ends in time."""
        period = task.period or ZERO
        most = (period * (1 + task.slack) if task.slack else period) // self.after.tick
        if task.distance is not None:
            lengths = [shape.length for shape in self.after.shapes[task.name]]
            lengths += [job.shape.length for job in self._future.of_task(task.name)]
            deadline = (task.deadline or task.distance) // self.after.tick
            most = min(most, task.distance // self.after.tick, deadline - max(lengths))
        return max(1, most)

    @cached_property
    def most(self) -> dict[str, int]:
        """The longest distance of two starts of each periodic task of both modes."""
        return {pace.task: pace.most for pace in self.paces}

    @cached_property
    def group(self) -> dict[str, list[str]]:
        """Return for every task those, itself included, whose jobs can be in the way of its own."""
        groups = ([active.name for active in tasks] for tasks in linked_tasks(self.after.expansion).values())
        return {name: names for names in groups for name in names}

    # ---- who precedes whom

    @cached_property
    def open_windows(self) -> list[tuple[LineJob, Window]]:
        """The windows of jobs of the mode after, relative to its beginning, that no job of that mode meets.

        They lie in its first cycles: those in which the nearest predecessor of the steady state would come before it.
        """
        return [
            (job.moved(number * self.after.hyperperiod), window)
            for job in self.after.jobs
            for window in (stated.of(job.shape) for stated in self.after.windows[job.task, job.shape.version])
            for number in range(self._cycles_before_steady(window, job))
            if not self._is_met_later(job.start + number * self.after.hyperperiod, window)
        ]

    def _is_met_later(self, start: int, window: Window) -> bool:
        return self.has_future(window, start - window.high, start - window.low)

    def _cycles_before_steady(self, window: Window, job: LineJob) -> int:
        """Return in how many cycles a job may need a predecessor from before the mode after.

        Once the last one of the first cycle is far enough back, the nearest is that of the steady state.
        """
        last = self._future.of(window)[-1]
        return min(MOST_CYCLES, -((job.start - window.low - last) // self.after.hyperperiod))

    def has_past(self, window: Window, low: int, high: int) -> bool:
        """Return whether a predecessor of the mode before lies in [low, high]."""
        return bool(self._past.within(window, low, high))

    def has_future(self, window: Window, low: int, high: int) -> bool:
        """Return whether a predecessor of the mode after does, from whose beginning the times count."""
        return bool(self._future.within(window, low, high))

    def newest_before(self, window: Window) -> int | None:
        """Return the last instant of a window's predecessor in the mode before."""
        instants = self._past.of(window)
        return instants[-1] - self.before.hyperperiod if instants else None

    def instants(self, window: Window, low: int, high: int, length: int) -> list[int]:
        """Return all instants in [low, high] of a window's predecessor in both modes, for a table of some length."""
        past = self._past.within(window, low, high)
        return [*past, *(at + length for at in self._future.within(window, low - length, high - length))]

    @cached_property
    def depth(self) -> dict[str, int]:
        """Return the length of the longest chain of predecessors of every task."""
        before: dict[str, set[str]] = {name: set() for name in self.after.shapes}
        for (task, _), windows in self.after.windows.items():
            before[task].update(window.task for window in windows if window.task in before)
        depth: dict[str, int] = {}
        for name in TopologicalSorter(before).static_order():
            depth[name] = max((depth[task] + 1 for task in before[name]), default=0)
        return depth


def _jobs_before(reach: int, mode: GridMode) -> Iterator[LineJob]:
    """Yield the jobs of a mode, from its first cycle on, that start before `reach`, by start."""
    for begin in range(0, reach, mode.hyperperiod or 1):
        for job in mode.jobs:
            if job.start + begin < reach:
                yield job.moved(begin)


class _Instants:
    """Starts and ends of the jobs of every task in a mode's cycles from `first` to `last`, both included."""

    def __init__(self, mode: GridMode, first: int | None = None, last: int | None = None) -> None:
        self._by_task: dict[str, list[LineJob]] = {}
        for job in mode.jobs:
            self._by_task.setdefault(job.task, []).append(job)
        self._cycle = mode.hyperperiod
        self._first, self._last = first, last
        self._made: dict[tuple[str, Anchor, int], list[int]] = {}

    def of_task(self, name: str) -> Sequence[LineJob]:
        """Return the jobs of a task in cycle 0."""
        return self._by_task.get(name, ())

    def within(self, window: Window, low: int, high: int) -> list[int]:
        """Return those of the window's task, starts or ends as the window says, that lie in [low, high]."""
        instants = self.of(window)
        return [
            instant + cycle * self._cycle
            for cycle in self._cycles(instants, low, high)
            for instant in instants[
                bisect_left(instants, low - cycle * self._cycle) : bisect_right(instants, high - cycle * self._cycle)
            ]
        ]

    def _cycles(self, instants: list[int], low: int, high: int) -> range:
        """Return the cycles, no more than the last `MOST_CYCLES`, that have instants in [low, high]."""
        if not instants:
            return range(0)
        first, last = -((instants[-1] - low) // self._cycle), (high - instants[0]) // self._cycle
        first = first if self._first is None else max(first, self._first)
        last = last if self._last is None else min(last, self._last)
        return range(max(first, last - MOST_CYCLES + 1), last + 1)

    def of(self, window: Window) -> list[int]:
        """Return those of the window's task in cycle 0, sorted."""
        key = (window.task, window.origin, window.point)
        if key not in self._made:
            self._made[key] = sorted(window.instant(job) for job in self.of_task(window.task))
        return self._made[key]
