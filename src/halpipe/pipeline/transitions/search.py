"""The search for the jobs of one transition table of a given length.

What is fixed is in `Change`: the cycles of the mode before and of the mode after. What is asked: the fewest jobs that
keep tasks of both modes from starving and that give jobs of the mode after the predecessors they need. Jobs are placed
by latest start first; those that do not fit are tried earlier in the next round, with those in their way alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.pipeline.transitions.line import Line, LineJob, Shape, Window

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.pipeline.transitions.change import Change, Pace

PATIENCE = 4
MORE_PATIENCE = 300
"""Orders of placement that may fit no more jobs than the best one before a length is given up; one more for so many
tasks, since large modes settle slowly."""


@record
class Blocked:
    """Obstacle to a table of a length: the task and the rule, for people; `progress` is how far the search came."""

    task: str
    rule: str
    progress: int = 0


@dataclass(slots=True)
class _Wanted:
    """A job that the table must have: a start of `task` in [earliest, latest]; `instants` narrow start or end.

    `number` counts the jobs, from 1, that keep the pace of the task; 0 is any other job.
    """

    task: str
    earliest: int
    latest: int
    rule: str
    order: int = 0
    number: int = 0
    instants: list[tuple[int, int, Window]] = field(default_factory=list)


class Table:
    """One attempt: the switch `change` with a table of `length` ticks; `work` counts the jobs it tried to place."""

    def __init__(self, change: Change, length: int) -> None:
        self.change = change
        self.length = length
        self.work = 0
        self._wanted: dict[str, list[_Wanted]] = {}
        self._count = 0
        self._placed: dict[str, list[LineJob]] = {}
        self._paced: dict[tuple[str, int], LineJob] = {}

    def fill(self) -> tuple[LineJob, ...] | Blocked:
        """Return the jobs of the table, or what blocks it."""
        clash = self.change.clash(self.length)
        if clash is not None:
            return Blocked(clash, "unit or resource is still in use by the mode before")
        hopeless = self._want_all() or self._crowded()
        if hopeless is not None:
            return hopeless
        patience = PATIENCE + len(self.change.paces) // MORE_PATIENCE
        unfit = self._place(self._wanted)
        fewest, stale = len(unfit), 0
        while unfit:
            blocked = Blocked(unfit[0].task, unfit[0].rule, progress=1)
            for want in unfit:
                want.order -= 1
                self._want_predecessors_of(want)
            if stale >= patience:
                return blocked
            unfit = self._place(want.task for want in unfit)
            fewest, stale = (len(unfit), 0) if len(unfit) < fewest else (fewest, stale + 1)
        return tuple(_numbered([job for jobs in self._placed.values() for job in jobs]))

    # ---- what is wanted

    def _want(self, *wanted: _Wanted) -> None:
        for want in wanted:
            self._wanted.setdefault(want.task, []).append(want)
        self._count += len(wanted)

    def _want_all(self) -> Blocked | None:
        for pace in self.change.paces:
            found = self._against_starving(pace)
            if isinstance(found, Blocked):
                return found
            self._want(*found)
        for job, window in self.change.open_windows:
            low, high = job.start - window.high + self.length, job.start - window.low + self.length
            if self.change.has_past(window, low, high):
                continue
            blocked = self._want_predecessor(job, window, low, high)
            if blocked is not None:
                return blocked
        return None

    def _against_starving(self, pace: Pace) -> list[_Wanted] | Blocked:
        """Return the starts that fill a gap between the last job before and the first job after the switch."""
        first = pace.first + self.length
        count = max(0, -(-(first - pace.last) // pace.most) - 1)
        if not count:
            is_early = first < pace.last_end
            return Blocked(pace.task, "would run against itself") if is_early else []
        wanted = []
        for number in range(1, count + 1):
            left = count + 1 - number
            earliest = max(0, first - left * pace.most, pace.last_end + (number - 1) * pace.shortest)
            latest = min(self.length - 1, pace.last + number * pace.most, first - left * pace.shortest)
            if earliest > latest:
                return Blocked(pace.task, "would not start often enough")
            wanted.append(_Wanted(pace.task, earliest, latest, "would not start often enough", number=number))
        return wanted

    def _want_predecessor(self, job: LineJob, window: Window, low: int, high: int) -> Blocked | None:
        """Narrow a start that is wanted anyway to one that meets the window, or want one more."""
        rule = f'job of "{job.task}" lacks its predecessor "{window.task}"'
        shapes = self.change.after.shapes.get(window.task)
        if not shapes:
            return Blocked(job.task, rule)
        instants = (low, high, window)
        wanted = self._wanted.get(window.task, ())
        if any(instants in known.instants for known in wanted):
            return None
        lags = [window.lag(shape) for shape in shapes]
        earliest, latest = max(0, low - max(lags)), min(self.length - 1, high - min(lags))
        if earliest > latest:
            return Blocked(job.task, rule)
        for known in wanted:
            if not known.instants and known.earliest <= latest and earliest <= known.latest:
                known.earliest, known.latest = max(known.earliest, earliest), min(known.latest, latest)
                known.instants.append(instants)
                return None
        self._want(_Wanted(window.task, earliest, latest, rule, instants=[instants]))
        return None

    def _want_predecessors_of(self, want: _Wanted) -> None:
        """Want the jobs without which no version of a job of the table finds its predecessors."""
        change = self.change
        shape = change.after.shapes[want.task][0]
        for window in (stated.of(shape) for stated in change.after.windows[want.task, shape.version]):
            low, high = want.earliest - window.high, want.latest - window.low
            met = change.has_past(window, low, high) or change.has_future(window, low - self.length, high - self.length)
            if met or not change.after.shapes.get(window.task) or self._count > change.most_wanted:
                continue
            shift = window.lag(change.after.shapes[window.task][0])
            earliest, latest = max(0, low - shift), min(self.length - 1, high - shift)
            if earliest <= latest and all(w.latest != latest for w in self._wanted.get(window.task, ())):
                self._want(_Wanted(window.task, earliest, latest, want.rule, want.order))

    # ---- placing

    def _crowded(self) -> Blocked | None:
        """Return a job that finds no room: of those that can run on one unit alone, all but the last end before it."""
        crowds: dict[str, list[_Wanted]] = {}
        shapes = self.change.after.shapes
        for want in (want for wanted in self._wanted.values() for want in wanted):
            units = {unit for shape in shapes[want.task] for unit in shape.units}
            if len(units) == 1 and not any(shape.parts for shape in shapes[want.task]):
                crowds.setdefault(units.pop(), []).append(want)
        for crowd in crowds.values():
            lengths = [min(shape.length for shape in shapes[want.task]) for want in crowd]
            span = max(want.latest for want in crowd) - min(want.earliest for want in crowd)
            if sum(lengths) - max(lengths) > span:
                return Blocked(crowd[-1].task, crowd[-1].rule, progress=1)
        return None

    def _place(self, tasks: Iterable[str]) -> list[_Wanted]:
        """Place anew the wanted jobs of the groups of some tasks, predecessors first; return those that do not fit.

        Jobs of one group never stand in the way of another, so what is placed of the others stays.
        """
        change = self.change
        unfit: list[_Wanted] = []
        for group in {change.group[task][0]: change.group[task] for task in tasks}.values():
            line = Line(change.after.quanta, (change.tail_layer, 0), (change.future_layer, self.length))
            wanted = [want for task in group for want in self._wanted.get(task, ())]
            for want in wanted:
                self._placed[want.task] = []
                self._paced.pop((want.task, want.number), None)
            for want in sorted(wanted, key=self._turn):
                job = self._place_one(want, line)
                if job is None:
                    unfit.append(want)
                    continue
                line.enter(job)
                self._placed[job.task].append(job)
                if want.number:
                    self._paced[want.task, want.number] = job
        return sorted(unfit, key=self._turn)

    def _turn(self, want: _Wanted) -> tuple[int, int, int, str]:
        return want.order, self.change.depth[want.task], want.latest, want.task

    def _place_one(self, want: _Wanted, line: Line) -> LineJob | None:
        self.work += 1
        for shape in self.change.after.shapes[want.task]:
            for earliest, latest in self._allowed(want, shape):
                fit = line.first_fit(shape, earliest, latest)
                if fit is not None:
                    return LineJob(fit[0], want.task, 0, shape, fit[1])
        return None

    def _allowed(self, want: _Wanted, shape: Shape) -> list[tuple[int, int]]:
        """Return the intervals of starts that the wish, its neighbours and the version's own constraints leave."""
        spans = [self._in_pace(want, shape)]
        for low, high, reached in want.instants:
            shift = reached.lag(shape)
            spans = _meet(spans, [(low - shift, high - shift)])
        for window in (stated.of(shape) for stated in self.change.after.windows[shape.task, shape.version]):
            if not spans:
                break
            low, high = spans[0][0] - window.high, spans[-1][1] - window.low
            instants = self.change.instants(window, low, high, self.length)
            instants += [window.instant(job) for job in self._placed.get(window.task, ())]
            spans = _meet(spans, [(instant + window.low, instant + window.high) for instant in instants])
        return [(low, high) for low, high in spans if low <= high]

    def _in_pace(self, want: _Wanted, shape: Shape) -> tuple[int, int]:
        """Return the starts that are neither too far from the jobs before and after it, nor run into them."""
        earliest, latest = want.earliest, want.latest
        if self.change.after.is_closed:
            latest = min(latest, self.length - shape.length)
        before = self._paced.get((want.task, want.number - 1))
        if before is not None:
            earliest = max(earliest, before.end)
            latest = min(latest, before.start + self.change.most[want.task])
        after = self._paced.get((want.task, want.number + 1)) if want.number else None
        if after is not None:
            earliest = max(earliest, after.start - self.change.most[want.task])
            latest = min(latest, after.start - shape.length)
        return earliest, latest


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
