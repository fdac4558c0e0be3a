"""One event model of all recordings: jobs that run, pause and end on units, kept as columns of integers.

A recording of ten million events has more jobs than fit into memory as objects. `Executions` keeps them in arrays, at
about 60 bytes each, and makes an `Execution` where one is looked at. Instants that are no whole nanoseconds turn the
columns of times into lists of exact numbers.
"""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections.abc import Sequence
from typing import TYPE_CHECKING, overload

from halpipe.core.diagnostics import Location
from halpipe.core.durations import Duration
from halpipe.importers.traces import codes
from halpipe.models.trace import Execution

if TYPE_CHECKING:
    from collections.abc import Hashable, Mapping
    from fractions import Fraction

    from halpipe.core.diagnostics import Findings

    Instant = int | Fraction
    """Nanoseconds on the clock of the trace."""
    Times = array[int] | list[int | Fraction]

_NONE = -(2**63)


def report_unused(counts: Mapping[str, int], file: str, findings: Findings) -> None:
    """Report how many events of which kinds make no jobs."""
    if counts:
        kinds = ", ".join(f"{count} of {kind}" for kind, count in sorted(counts.items()))
        findings.add(codes.LEFT_OUT(f"events not used: {kinds}", at=Location(file)))


class Executions(Sequence[Execution]):
    """The jobs of one line of time, as columns; names are numbers of a list."""

    def __init__(self, file: str) -> None:
        self.file = file
        self._names: dict[Hashable, int] = {}
        self._texts: list[str] = []
        self._units: list[tuple[str, ...]] = []
        self._task, self._on, self._table, self._line = array("i"), array("i"), array("i"), array("q")
        self._cycle = array("q")
        self._start: Times = array("q")
        self._end: Times = array("q")
        self._busy: Times = array("q")
        self._stretches: dict[int, tuple[tuple[Instant, Instant], ...]] = {}
        self._order: Sequence[int] = ()

    def __len__(self) -> int:
        return len(self._task)

    @overload
    def __getitem__(self, index: int) -> Execution: ...
    @overload
    def __getitem__(self, index: slice) -> list[Execution]: ...
    def __getitem__(self, index: int | slice) -> Execution | list[Execution]:
        if isinstance(index, slice):
            return [self[number] for number in range(*index.indices(len(self)))]
        at = self._order[index]
        end, busy, cycle, line = self._end[at], self._busy[at], self._cycle[at], self._line[at]
        return Execution(
            task=self._texts[self._task[at]],
            units=self._units[self._on[at]],
            start=Duration(self._start[at]),
            end=None if end == _NONE else Duration(end),
            busy=None if busy == _NONE else Duration(busy),
            table=self._texts[self._table[at]] if cycle != _NONE else "",
            cycle=None if cycle == _NONE else cycle,
            stretches=tuple((Duration(a), Duration(b)) for a, b in self._stretches.get(at, ())),
            at=Location(self.file, line) if line else Location(self.file),
        )

    def _number(self, text: str) -> int:
        if text not in self._names:
            self._names[text] = len(self._texts)
            self._texts.append(text)
        return self._names[text]

    def add(self, job: Job, end: Instant | None, busy: Instant | None) -> None:
        """Add a job that ended, or one that still runs: `end` and `busy` are None."""
        on = self._names.get(job.units)
        if on is None:
            on = self._names[job.units] = len(self._units)
            self._units.append(job.units)
        self._task.append(self._number(job.task))
        self._on.append(on)
        self._line.append(job.line)
        self._table.append(0)
        self._cycle.append(_NONE)
        if len(job.stretches) > 1:
            self._stretches[len(self._task) - 1] = tuple(job.stretches)
        try:
            self._start.append(job.start)  # type: ignore[arg-type]
            self._end.append(_NONE if end is None else end)  # type: ignore[arg-type]
            self._busy.append(_NONE if busy is None else busy)  # type: ignore[arg-type]
        except (TypeError, OverflowError):
            count = len(self._task)
            for column in (self._start, self._end, self._busy):
                del column[count - 1 :]
            self._start, self._end, self._busy = [*self._start], [*self._end], [*self._busy]
            self._start.append(job.start)
            self._end.append(_NONE if end is None else end)
            self._busy.append(_NONE if busy is None else busy)

    def sort(self, marks: Sequence[tuple[Instant, str, int]] = ()) -> None:
        """Order the jobs by their start and line; let those from a mark on belong to its table and cycle."""
        order = sorted(range(len(self)), key=self._line.__getitem__)
        order.sort(key=self._start.__getitem__)
        self._order = array("q", order)
        if not marks:
            return
        begins, tables = [at for at, _, _ in marks], [self._number(table) for _, table, _ in marks]
        for at in order:
            # A table of length zero ends where it begins; what starts there belongs to the next one, which comes later.
            position = bisect_right(begins, self._start[at]) - 1
            if position >= 0:
                self._table[at], self._cycle[at] = tables[position], marks[position][2]


class Job:
    """A job between its first and its last instant; `since` is None while it does not run."""

    __slots__ = ("line", "since", "start", "stretches", "task", "units")

    def __init__(self, task: str, unit: str, at: Instant, line: int) -> None:
        self.task = task
        self.units: tuple[str, ...] = (unit,) if unit else ()
        self.start = at
        self.since: Instant | None = at
        self.line = line
        self.stretches: list[tuple[Instant, Instant]] = []

    def run(self, unit: str, at: Instant) -> None:
        """Note that it runs on a unit, again or still."""
        if self.since is None:
            self.since = at
        if unit not in self.units:
            self.units = (*self.units, unit)

    def pause(self, at: Instant) -> None:
        """Note that it no longer runs."""
        if self.since is not None:
            self.stretches.append((self.since, at))
        self.since = None


class Jobs:
    """Follows every job from its start to its end; `executions` are those that ended."""

    def __init__(self, file: str, findings: Findings) -> None:
        self.file = file
        self.findings = findings
        self.running: dict[Hashable, Job] = {}
        self.executions = Executions(file)

    def end(self, key: Hashable, at: Instant) -> bool:
        """End a job; return False if it does not run."""
        job = self.running.pop(key, None)
        if job is None:
            return False
        job.pause(at)
        stretches = job.stretches
        busy = stretches[0][1] - job.start if len(stretches) == 1 else sum(end - start for start, end in stretches)
        self.executions.add(job, at, busy)
        return True

    def result(self, marks: Sequence[tuple[Instant, str, int]] = ()) -> Executions:
        """Return what ran, with what still runs."""
        if self.running:
            self.findings.add(
                codes.UNFINISHED(f"{len(self.running)} jobs run when the trace ends", at=Location(self.file))
            )
        for job in self.running.values():
            self.executions.add(job, None, None)
        self.executions.sort(marks)
        return self.executions
