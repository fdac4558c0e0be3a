"""Judgement of a recorded run: every job once, with its data, in order, apart from what excludes it, in time."""

from __future__ import annotations

import csv
import io
import itertools
from collections import Counter, defaultdict
from fractions import Fraction
from typing import TYPE_CHECKING, NamedTuple

from halpipe.core.diagnostics import Findings, HalpipeError, about
from halpipe.core.records import record
from halpipe.deploy.linux import codes

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from halpipe.core.diagnostics import Code, Diagnostic
    from halpipe.models import Job, Schedule, TaskModel

_COLUMNS = ("task", "job", "mode", "cycle", "start", "end", "units", "busy", "planned", "data")
_ENDLESS = 2**62


MOST_CYCLES = 10_000_000
"""A year of cycles of 3 s; the largest number in a recording is also how many are looked at."""


class Ran(NamedTuple):
    """A recorded job; times are nanoseconds from the first instant on, those of the end of a running job infinite."""

    task: str
    job: int
    table: str
    cycle: int
    start: int
    end: int
    planned: int
    has_data: bool = True

    @property
    def is_over(self) -> bool:
        """Whether the job ended before the recording did."""
        return self.end < _ENDLESS


@record
class Judgement:
    """What was found; `start_errors` are the median, the 99th percentile and the maximum, in nanoseconds.

    `missing` and `disordered` count jobs that did not run, and that started out of order.
    """

    diagnostics: tuple[Diagnostic, ...]
    jobs: int
    missing: int
    disordered: int
    tables: int
    switches: int
    start_errors: tuple[int, int, int]


def read_recording(data: bytes) -> list[Ran]:
    """Read what the dispatcher recorded; raise `HalpipeError` if it is not of its form."""
    try:
        rows = list(csv.reader(io.StringIO(data.decode(), newline="")))
        if tuple(rows[0]) != _COLUMNS:
            raise ValueError("other columns")
        found = [_ran(row) for row in rows[1:]]
        if wrong := next((ran.cycle for ran in found if not 0 <= ran.cycle < MOST_CYCLES), None):
            raise ValueError(f"there is no cycle {wrong}")
    except (ValueError, IndexError, csv.Error) as failure:
        text = f"the recording cannot be read: {failure}"
        raise HalpipeError(codes.NOT_RUN(text, help="export the bundle again")) from None
    if not found:
        raise HalpipeError(codes.NOT_RUN("nothing was recorded", help="let it run longer: --cycles"))
    return sorted(found, key=lambda ran: (ran.start, ran.end, ran.task))


def _ran(r: Sequence[str]) -> Ran:
    end = int(r[5]) if r[5] else _ENDLESS
    return Ran(r[0], int(r[1]), r[2], int(r[3]), int(r[4]), end, int(r[8]), r[9] != "0")


def judge(model: TaskModel, schedule: Schedule, recording: Sequence[Ran], *, is_timed: bool) -> Judgement:
    """Judge a recording; without `is_timed`, only whether every job ran once and in the order of its unit."""
    judging = _Judge(model, schedule, recording)
    tables = judging.sequence()
    judging.completeness(tables)
    judging.order()
    judging.data()
    if is_timed:
        judging.exclusion()
        judging.ends()
    errors = sorted(ran.start - ran.planned for ran in recording)
    at = (len(errors) - 1) // 2, -(-len(errors) * 99 // 100) - 1, len(errors) - 1
    switches = sum("->" in name for name in tables.values())
    p50, p99, most = (errors[i] for i in at)
    missing, disordered = (judging.count(code) for code in (codes.MISSING_JOB, codes.WRONG_ORDER))
    found = tuple(judging.diagnostics())
    return Judgement(found, len(recording), missing, disordered, len(tables), switches, (p50, p99, most))


class _Judge:
    def __init__(self, model: TaskModel, schedule: Schedule, recording: Sequence[Ran]) -> None:
        self.model = model
        self.recording = recording
        self.tables: dict[str, dict[tuple[str, int], Job]] = {
            mode.name: {(job.task, job.index): job for job in mode.jobs} for mode in schedule.modes
        }
        self.after: Mapping[str, set[str]] = {mode.name: {mode.name} for mode in schedule.modes}
        for table in schedule.transitions:
            self.tables[table.name] = {(job.task, job.index): job for job in table.jobs}
            self.after[table.source].add(table.name)
            self.after = {**self.after, table.name: {table.target}}
        self.faults: dict[tuple[str, str], list[str]] = defaultdict(list)
        self.kinds: dict[str, Code] = {}

    def _fault(self, code: Code, about: str, text: str) -> None:
        self.kinds[code.id] = code
        self.faults[code.id, about].append(text)

    def count(self, code: Code) -> int:
        """Return how many faults of a kind were found."""
        return sum(len(texts) for (id, _), texts in self.faults.items() if id == code.id)

    def diagnostics(self) -> Iterable[Diagnostic]:
        """Yield one finding for each kind of fault and what it is about: how often, and the first."""
        findings = Findings()
        helps = {
            codes.MISSING_JOB.id: "give the programs less to do, or the tasks longer WCETs",
            codes.NO_DATA.id: "start the publisher before the tables, or let the task run later in the table",
            codes.ENDLESS_JOB.id: "bound the loops and waits of the program",
            codes.LATE_JOB.id: "measure the programs on this machine, and state WCETs that they keep",
        }
        for (id, path), texts in self.faults.items():
            help = helps.get(id, "this is a fault of the dispatcher or of the recording; export and run again")
            more = f" ({len(texts)} times)" if len(texts) > 1 else ""
            findings.add(self.kinds[id](f"{texts[0]}{more}", path=path, help=help))
        return findings.items

    def sequence(self) -> dict[int, str]:
        """Return the table of each cycle from the first to the last, those without jobs filled in."""
        seen: dict[int, str] = {}
        for ran in self.recording:
            if ran.table not in self.tables or (ran.task, ran.job) not in self.tables[ran.table]:
                text = f"job {ran.job} of table {ran.table[:60]} is not in the schedule"
                self._fault(codes.FOREIGN_JOB, about(task=ran.task), text)
            elif seen.setdefault(ran.cycle, ran.table) != ran.table:
                self._fault(codes.FOREIGN_JOB, about(task=ran.task), f"cycle {ran.cycle} has jobs of two tables")
        tables: dict[int, str] = {}
        last: str | None = None
        for cycle in range(max(seen, default=-1) + 1):
            name = seen.get(cycle) or self._between(last, seen.get(cycle + 1))
            if name is None:
                continue
            if last is not None and name not in self.after[last]:
                self._fault(codes.FOREIGN_JOB, about(table=name), f"cycle {cycle} follows on table {last}")
            tables[cycle] = last = name
        return tables

    def _between(self, last: str | None, following: str | None) -> str | None:
        """Return the table of a cycle in which nothing ran."""
        if last is None:
            return following
        if following is not None and f"{last}->{following}" in self.tables:
            return f"{last}->{following}"
        return next(iter(self.after[last])) if "->" in last else last

    def completeness(self, tables: Mapping[int, str]) -> None:
        """Find jobs that did not run, or ran twice."""
        count = Counter((ran.cycle, ran.task, ran.job) for ran in self.recording)
        for cycle, name in tables.items():
            for task, index in self.tables[name]:
                times = count[cycle, task, index]
                if times != 1:
                    code = codes.FOREIGN_JOB if times else codes.MISSING_JOB
                    text = f"job {index} of table {name} ran {times} times in cycle {cycle}"
                    self._fault(code, about(task=task), text)

    def _known(self) -> list[tuple[Ran, Job]]:
        return [
            (ran, self.tables[ran.table][ran.task, ran.job])
            for ran in self.recording
            if ran.table in self.tables and (ran.task, ran.job) in self.tables[ran.table]
        ]

    def data(self) -> None:
        """Find jobs without data, and jobs that never ended."""
        for ran in self.recording:
            if not ran.has_data:
                self._fault(codes.NO_DATA, about(task=ran.task), f"no message for job {ran.job} in cycle {ran.cycle}")
            if not ran.is_over:
                text = f"job {ran.job} of table {ran.table[:60]} still runs at the end of the recording"
                self._fault(codes.ENDLESS_JOB, about(task=ran.task), text)

    def order(self) -> None:
        """Find jobs of a unit that started before one whose instant is earlier."""
        latest: dict[str, Ran] = {}
        for ran, job in self._known():
            for unit in job.units[:1]:
                before = latest.get(unit)
                if before is not None and ran.planned < before.planned and ran.start > before.start:
                    text = f"starts after {before.task}, whose instant is {before.planned - ran.planned}ns later"
                    self._fault(codes.WRONG_ORDER, about(task=ran.task), text)
                if before is None or ran.planned >= before.planned:
                    latest[unit] = ran

    def exclusion(self) -> None:
        """Find jobs at the same time that share a unit, or a resource that both need wholly all the time."""
        for share in self._shared():
            running: list[tuple[Ran, Job]] = []
            for ran, job in share:
                running = [(other, its) for other, its in running if ran.start < other.end < _ENDLESS]
                for other, its in running:
                    if not _nests(ran, job, other, its):
                        shared = min(ran.end, other.end) - ran.start
                        text = f"runs {shared}ns at the time of {other.task}"
                        self._fault(codes.OVERLAP, about(task=ran.task), text)
                running.append((ran, job))

    def _shared(self) -> Iterable[list[tuple[Ran, Job]]]:
        by: dict[tuple[str, str], list[tuple[Ran, Job]]] = defaultdict(list)
        for ran, job in self._known():
            by["unit", job.units[0]].append((ran, job))
            version = self.model.task(job.task).version(job.version)
            for access in version.accesses:
                if access.bound == 1 and not access.start and access.end == version.wcet:
                    by["resource", access.resource].append((ran, job))
        return by.values()

    def ends(self) -> None:
        """Find jobs that ended after their time."""
        for ran, job in self._known():
            due = Fraction(ran.planned) + (job.end - job.start).fraction
            if ran.is_over and ran.end > due + 1:
                self._fault(codes.LATE_JOB, about(task=ran.task), f"ends {int(ran.end - due)}ns late")


def _nests(ran: Ran, job: Job, other: Ran, its: Job) -> bool:
    """Return whether one of two jobs was planned to start in a gap of the other."""
    for inner, outer, parts in ((ran, other, its.parts), (other, ran, job.parts)):
        for before, after in itertools.pairwise(parts):
            low, high = ((instant - parts[0].start).fraction for instant in (before.end, after.start))
            if outer.planned + low <= inner.planned < outer.planned + high:
                return True
    return False
