"""Jobs that run, pause and end on units: what readers of traces make of events, as columns of executions."""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections import Counter
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from halpipe.core.diagnostics import Findings, Location
from halpipe.core.files import refuse_more_than
from halpipe.core.suggest import counted
from halpipe.importers.traces import codes
from halpipe.models.trace import NONE, Executions, column

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Mapping, Sequence

    from halpipe.models.trace import Column, Instant, Times

    Rows = Column | list[int]


def report_unused(counts: Mapping[str, int], file: str, findings: Findings) -> None:
    """Report how many events of which kinds make no jobs."""
    if counts:
        kinds = ", ".join(f"{count} of {kind}" for kind, count in sorted(counts.items()))
        findings.add(codes.LEFT_OUT(f"events not used: {kinds}", at=Location(file)))


def report_unfinished(count: int, noun: str, file: str, findings: Findings) -> None:
    """Report how many jobs or slices still ran when the trace ended."""
    if count:
        findings.add(codes.UNFINISHED(f"{counted(count, noun)} without an end", at=Location(file)))


def line_of(process: int | str, lines: dict[Any, Executions], file: str) -> Executions:
    """Return the executions of a process, which begin empty."""
    if (found := lines.get(process)) is None:
        found = lines[process] = Executions(file)
        refuse_more_than(MOST_PROCESSES, len(lines), "or more processes with slices", Location(file))
    return found


def unfinished(ends: Rows) -> int:
    """Return how many slices have no end."""
    return ends.count(-1) if isinstance(ends, list) else int((ends < 0).sum())


class Oddities:
    """Events that contradict each other, by what they are: how many, and where the first is."""

    def __init__(self) -> None:
        self._found: dict[str, list[Any]] = {}

    def add(self, what: str, line: int, path: str = "") -> None:
        """Count an event."""
        self._found.setdefault(what, [0, line, path])[0] += 1

    def report(self, file: str, findings: Findings, help: str = "check the recorder for lost events") -> None:
        """Report each kind once."""
        for what, (count, line, path) in self._found.items():
            message = what + (f"; {count} times, this is the first" if count > 1 else "")
            findings.add(codes.ODD_SEQUENCE(message, at=Location(file, line), path=path, help=help))


MOST_PROCESSES = 4000
"""Processes with slices: each has a line of time of its own, which is compared alone."""

FEW = 64
"""Begins and ends below which columns cost more than they save."""


class Marks:
    """Begins and ends of the slices of one thread, one track or one id, as columns; names are numbers of the reader."""

    is_busy = False
    """Whether a slice runs all the time."""

    def __init__(self) -> None:
        self.at: Times = array("q")
        self.begins, self.task, self.thread, self.line = array("b"), array("i"), array("i"), array("q")
        self.arguments: dict[int, Mapping[str, Any]] = {}

    def add(self, at: Instant, is_begin: bool, task: int, thread: int = 0, line: int = 0) -> None:
        """Append a begin or an end."""
        try:
            self.at.append(at)  # type: ignore[arg-type]
        except (TypeError, OverflowError):
            self.at = [*self.at, at]
        self.begins.append(is_begin)
        self.task.append(task)
        self.thread.append(thread)
        self.line.append(line)

    def slices(self, names: Sequence[Any], odd: Oddities) -> tuple[Rows, Rows]:
        """Return the rows of the begin and the end of each slice, the end of -1 where it has none.

        Ends alone are `odd`. In a text that is not in the order of time, ends come before begins of the same instant.
        A few are lists, since a trace may have as many tracks as slices, and columns of one row cost the most.
        """
        if len(self.at) < FEW:
            few: Iterable[int] = range(len(self.at))
            if any(after < before for before, after in pairwise(self.at)):
                few = sorted(few, key=lambda row: (self.at[row], self.begins[row]))
            return self._by_name(few, names, odd)
        at, task, begins = column(self.at), np.asarray(self.task), np.asarray(self.begins).astype(bool)
        rows = np.arange(len(at))
        if (at[1:] < at[:-1]).any():
            rows = np.argsort(begins, kind="stable")
            rows = rows[np.argsort(at[rows], kind="stable")]
        is_begin = begins[rows]
        depth = np.cumsum(np.where(is_begin, 1, -1)) + ~is_begin
        order = np.argsort(depth, kind="stable")  # at one depth, begins and ends take turns
        place = order[:-1][is_begin[order[:-1]] & (depth[order[:-1]] == depth[order[1:]])]
        ends = order[1:][is_begin[order[:-1]] & (depth[order[:-1]] == depth[order[1:]])]
        ended = np.argsort(ends)
        first, last = rows[place[ended]], rows[ends[ended]]
        nameless = np.isin(task, [each for each in np.unique(task).tolist() if not names[each]])
        is_plain = (nameless[last] & ~nameless[first]) | (task[first] == task[last])
        if depth.min() < 1 or not is_plain.all():
            return self._by_name(rows.tolist(), names, odd)
        left = is_begin.copy()
        left[place] = False
        return np.concatenate((first, rows[left])), np.concatenate((last, np.full(left.sum(), -1)))

    def put(
        self, found: Executions, begins: Rows, ends: Rows, names: Sequence[str], units: Sequence[tuple[str, ...]]
    ) -> None:
        """Add slices to executions, by the names and the units that are numbered."""
        if len(begins) < FEW:
            for row, last in zip(begins, ends, strict=True):
                begin, over = self.at[row], None if last < 0 else self.at[last]
                ran = None if over is None or not self.is_busy else over - begin
                found.add(names[self.task[row]], units[self.thread[row]], begin, over, ran, self.line[row])
            return
        task, thread, line = (np.asarray(each)[begins] for each in (self.task, self.thread, self.line))
        is_open = np.asarray(ends) < 0
        start, end = column(self.at)[begins], np.where(is_open, NONE, column(self.at)[ends])
        busy = np.where(is_open | (not self.is_busy), NONE, end - start)
        found.add_all(names, units, task=task, on=thread, start=start, end=end, busy=busy, line=line)

    def _by_name(self, rows: Iterable[int], names: Sequence[Any], odd: Oddities) -> tuple[list[int], list[int]]:
        begun: list[int] = []
        first: list[int] = []
        last: list[int] = []
        for row in rows:
            if self.begins[row]:
                begun.append(row)
                continue
            # A slice that ends by its name may have another one above it, which begins at this instant.
            of_name = (at for at in reversed(range(len(begun))) if self.task[row] == self.task[begun[at]])
            place, name = next(of_name, -1), names[self.task[row]]
            if place < 0 and begun and name:
                odd.add("a slice ends by another name than the one that runs", self.line[row], name)
            if not begun:
                odd.add("a slice ends that did not begin", self.line[row], name)
            else:
                first.append(begun.pop(place))
                last.append(row)
        return first + begun, last + [-1] * len(begun)


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
        self.begun: set[Hashable] = set()
        """Jobs that began before the recording, up to their ends: their starts and run times are unknown."""
        self.cuts: Counter[Hashable] = Counter()
        self.executions = Executions(file)

    def cut(self, key: Hashable) -> None:
        """Note a job that began before the recording, and leave it out."""
        if key not in self.begun:
            self.cuts[key] += 1
            self.begun.add(key)

    def state(self, task: str, at: Instant, line: int = 0, *, runs: bool, is_first: bool) -> None:
        """Take a sample of a signal that is 1 while its task runs."""
        if not runs:
            self.end(task, at)
        elif is_first:
            self.cut(task)
        elif task not in self.running and task not in self.begun:
            self.running[task] = Job(task, "", at, line)

    def end(self, key: Hashable, at: Instant) -> bool:
        """End a job; return False if it does not run."""
        job = self.running.pop(key, None)
        if job is None:
            is_cut = key in self.begun
            self.begun.discard(key)
            return is_cut
        if job.stretches or job.since is None:
            job.pause(at)
            self._add(job, at, sum(end - start for start, end in job.stretches))
        else:  # as most did, it ran in one piece
            self.executions.add(job.task, job.units, job.start, at, at - job.start, job.line)
        return True

    def _add(self, job: Job, end: Instant | None, busy: Instant | None) -> None:
        row = self.executions.add(job.task, job.units, job.start, end, busy, job.line)
        if len(job.stretches) > 1:
            self.executions.stretches[row] = tuple(job.stretches)

    def result(self, marks: Sequence[tuple[Instant, str, int]] = ()) -> Executions:
        """Return what ran, with what still runs; from a mark on, it belongs to the table and cycle of the mark."""
        report_unfinished(len(self.running), "job", self.file, self.findings)
        for job in self.running.values():
            self._add(job, None, None)
        found = self.executions
        found.sort()
        begins, tables = [at for at, _, _ in marks], [found.number(table) for _, table, _ in marks]
        early = sum(found.start[row] < begins[0] for row in found.order) if marks else 0
        found.order = found.order[early:]
        cut = ((self.cuts.total(), "without a start"), (early, "before the first table"))
        for count, where in ((count, where) for count, where in cut if count):
            self.findings.add(codes.ALREADY_RUNNING(f"{counted(count, 'job')} {where}", at=Location(self.file)))
        for row in found.order if marks else ():
            # A table of length zero ends where it begins; what starts there belongs to the next one, which comes later.
            position = bisect_right(begins, found.start[row]) - 1
            found.table[row], found.cycle[row] = tables[position], marks[position][2]
        return found
