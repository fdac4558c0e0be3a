"""Jobs that run, pause and end on units: what readers of traces make of events, as columns of executions."""

from __future__ import annotations

from bisect import bisect_right
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Location
from halpipe.importers.traces import codes
from halpipe.models.trace import Executions

if TYPE_CHECKING:
    from collections.abc import Hashable, Mapping, Sequence

    from halpipe.core.diagnostics import Findings
    from halpipe.models.trace import Instant


def report_unused(counts: Mapping[str, int], file: str, findings: Findings) -> None:
    """Report how many events of which kinds make no jobs."""
    if counts:
        kinds = ", ".join(f"{count} of {kind}" for kind, count in sorted(counts.items()))
        findings.add(codes.LEFT_OUT(f"events not used: {kinds}", at=Location(file)))


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
        self._add(job, at, busy)
        return True

    def _add(self, job: Job, end: Instant | None, busy: Instant | None) -> None:
        row = self.executions.add(job.task, job.units, job.start, end, busy, job.line)
        if len(job.stretches) > 1:
            self.executions.stretches[row] = tuple(job.stretches)

    def result(self, marks: Sequence[tuple[Instant, str, int]] = ()) -> Executions:
        """Return what ran, with what still runs; from a mark on, it belongs to the table and cycle of the mark."""
        if self.running:
            self.findings.add(
                codes.UNFINISHED(f"{len(self.running)} jobs run when the trace ends", at=Location(self.file))
            )
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
