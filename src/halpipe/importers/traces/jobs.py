"""Jobs that run, pause and end on units: what readers of traces make of events, as columns of executions."""

from __future__ import annotations

from array import array
from bisect import bisect_right
from itertools import islice
from operator import le
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Location
from halpipe.core.suggest import counted
from halpipe.importers.traces import codes
from halpipe.models.trace import Executions

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence

    from halpipe.core.diagnostics import Findings
    from halpipe.models.trace import Instant, Times


def report_unused(counts: Mapping[str, int], file: str, findings: Findings) -> None:
    """Report how many events of which kinds make no jobs."""
    if counts:
        kinds = ", ".join(f"{count} of {kind}" for kind, count in sorted(counts.items()))
        findings.add(codes.LEFT_OUT(f"events not used: {kinds}", at=Location(file)))


def report_unfinished(count: int, noun: str, file: str, findings: Findings) -> None:
    """Report how many jobs or slices still ran when the trace ended."""
    if count:
        findings.add(codes.UNFINISHED(f"{counted(count, noun)} without an end", at=Location(file)))


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


class Marks:
    """Begins and ends of the slices of one thread, one track or one id, as columns; names are numbers of the reader."""

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

    def slices(self, names: Sequence[Any], odd: Oddities) -> Iterator[tuple[int, Instant | None]]:
        """Yield the row of the begin and the end of each slice, None where it has none; ends alone are `odd`.

        In a text that is not in the order of time, ends come before begins of the same instant.
        """
        at, begins, task = self.at, self.begins, self.task
        rows: Iterable[int] = range(len(at))
        if not all(map(le, at, islice(at, 1, None))):
            rows = sorted(rows, key=lambda row: (at[row], begins[row]))
        begun: list[int] = []
        for row in rows:
            if begins[row]:
                begun.append(row)
                continue
            # A slice that ends by its name may have another one above it, which begins at this instant.
            of_name = (place for place in reversed(range(len(begun))) if task[row] == task[begun[place]])
            place = next(of_name, len(begun) - 1)
            if place < 0:
                odd.add("a slice ends that did not begin", self.line[row], names[task[row]])
            else:
                yield begun.pop(place), at[row]
        yield from ((row, None) for row in begun)


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
        for row in found.order if marks else ():
            # A table of length zero ends where it begins; what starts there belongs to the next one, which comes later.
            position = bisect_right(begins, found.start[row]) - 1
            if position >= 0:
                found.table[row], found.cycle[row] = tables[position], marks[position][2]
        return found
