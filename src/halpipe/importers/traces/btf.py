"""Best Trace Format (BTF 2.x): ``time,source,instance,type,target,instance,event[,note]``, one event per line.

Read leniently, as recorders write it: comments anywhere, headers twice, ``#timescale`` in any spelling, types and
entities by their numbers in the tables of the header. Task and ISR events make the executions. A job runs on each core
that a run event names, also while it polls. A stimulus ``STI_TABLE_<name>`` marks the start of a table with its
trigger.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections import Counter
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Location
from halpipe.core.durations import ZERO, Duration
from halpipe.importers.traces import codes
from halpipe.importers.traces.numbers import SCALES_NS, instant, whole
from halpipe.models.trace import Execution, Trace

if TYPE_CHECKING:
    from fractions import Fraction

    from halpipe.core.diagnostics import Findings

TABLE_MARK = "STI_TABLE_"
_EVENT = re.compile(r"-?[0-9]+,[^,]*,-?[0-9]+,[^,]*,[^,]*,-?[0-9]+,[^,]+(,.*)?")
_SCALE = re.compile(r"#\s*timescale\s+(\w+)", re.IGNORECASE)
_JOBS = ("T", "ISR", "I")
_TABLE = re.compile(r"#\s*(typetable|entitytype|entitytable|entitytypetable)", re.IGNORECASE)
_ROW = re.compile(r"#-(\d+) (.*)")
_RUNS = ("start", "resume", "poll_parking", "run", "poll")
"""`run` and `poll` also occur while a job runs: it polls, or has what it polled for, on the same core."""
_PAUSES = ("preempt", "wait", "park")
_KEEPS = ("activate", "release", "release_parking", "mtalimitexceeded")
"""Events after which a job runs or pauses as before."""


def is_event(line: str) -> bool:
    """Whether a line is an event of this format."""
    return _EVENT.fullmatch(line) is not None


@dataclass(slots=True)
class _Running:
    """A job between its first and its last instant; `since` is None while it does not run."""

    task: str
    units: list[str]
    start: Duration
    line: int
    since: Duration | None
    stretches: list[tuple[Duration, Duration]] = field(default_factory=list)

    def pause(self, at: Duration) -> None:
        """Note that it no longer runs."""
        if self.since is not None:
            self.stretches.append((self.since, at))
        self.since = None

    @property
    def busy(self) -> Duration:
        """The time in which it ran."""
        return sum((end - start for start, end in self.stretches), ZERO)


def read(text: str, file: str, findings: Findings) -> list[Trace]:
    """Return the one line of time of the trace."""
    reader = _Reader(file, findings)
    for number, line in enumerate(text.splitlines(), 1):
        line = line.strip()
        if line.startswith("#"):
            reader.comment(line, number)
        elif line:
            reader.event(line, number)
    return [Trace(name="", executions=reader.executions())]


class _Reader:
    """Follows every job from start to terminate."""

    def __init__(self, file: str, findings: Findings) -> None:
        self.file = file
        self.findings = findings
        self.scale: int | Fraction = 1
        self.running: dict[tuple[str, int], _Running] = {}
        self.done: list[Execution] = []
        self.marks: list[tuple[Duration, str, int]] = []
        self.others: Counter[str] = Counter()
        self.table = ""
        self.numbered: dict[str, dict[str, str]] = {}

    def comment(self, line: str, number: int) -> None:
        """Take the time scale and the tables of types and entities from a header line."""
        if heading := _TABLE.fullmatch(line):
            self.table = heading[1].lower().removesuffix("table")
        elif row := _ROW.match(line):
            self.numbered.setdefault(self.table, {})[row[1]] = row[2].strip()
        stated = _SCALE.match(line)
        if stated and stated[1].lower() in SCALES_NS:
            self.scale = SCALES_NS[stated[1].lower()]
        elif stated:
            self._broken(number, f"#timeScale {stated[1]} is unknown", "write ps, ns, us, ms or s")

    def event(self, line: str, number: int) -> None:
        """Take one event."""
        parts = line.split(",", 7)
        if len(parts) < 7:
            self._broken(number, f"{len(parts)} columns; an event has 7 or 8", "write time, source, ... event")
            return
        try:
            at, instance = instant(parts[0].strip(), self.scale), whole(parts[5].strip())
        except ValueError as failure:
            self._broken(number, str(failure), "times and instances are whole numbers")
            return
        source, kind, target, event = (parts[column].strip() for column in (1, 3, 4, 6))
        if kind.isdecimal():
            try:
                kind = (self.numbered.get("type") or self.numbered["entitytype"])[kind]
                source, target = (self.numbered["entity"][entity] for entity in (source, target))
            except KeyError as unknown:
                help = "write the tables of types and entities into the header, or use names"
                self._broken(number, f"no table of the header has the number {unknown}", help)
                return
        event = event.lower()
        if kind in _JOBS:
            self._job(target, instance, event, source, at, number)
        elif kind == "STI" and target.startswith(TABLE_MARK) and event == "trigger":
            self.marks.append((at, target.removeprefix(TABLE_MARK), instance))
        else:
            self.others[kind] += 1

    def _job(self, task: str, instance: int, event: str, source: str, at: Duration, line: int) -> None:
        job = self.running.get((task, instance))
        if event in _RUNS:
            if job is None:
                self.running[task, instance] = _Running(task, [source], at, line, at)
                return
            if job.since is None:
                job.since = at
            elif event not in ("run", "poll"):
                self._odd(task, instance, f"{event} while it runs", line)
            if source not in job.units:
                job.units.append(source)
        elif event in _PAUSES and job is not None:
            job.pause(at)
        elif event == "terminate":
            self._terminate(job, (task, instance), at, line)
        elif event not in (*_PAUSES, *_KEEPS):
            self.others[event] += 1

    def _terminate(self, job: _Running | None, key: tuple[str, int], at: Duration, line: int) -> None:
        if job is None:
            self._odd(*key, "terminate without start", line)
            return
        job.pause(at)
        del self.running[key]
        self.done.append(self._execution(job, at, job.busy))

    def _execution(self, job: _Running, end: Duration | None, busy: Duration | None) -> Execution:
        return Execution(
            task=job.task,
            units=tuple(job.units),
            start=job.start,
            end=end,
            busy=busy,
            stretches=tuple(job.stretches) if len(job.stretches) > 1 else (),
            at=Location(self.file, job.line),
        )

    def executions(self) -> tuple[Execution, ...]:
        """Return what ran, by start, with the table it belongs to where marks tell."""
        left = [self._execution(job, None, None) for job in self.running.values()]
        if left:
            self.findings.add(codes.UNFINISHED(f"{len(left)} jobs run when the trace ends", at=Location(self.file)))
        if self.others:
            kinds = ", ".join(f"{count} of {kind}" for kind, count in sorted(self.others.items()))
            self.findings.add(codes.LEFT_OUT(f"events not used: {kinds}", at=Location(self.file)))
        found = sorted(self.done + left, key=lambda execution: (execution.start.ns, execution.at.line))
        self.marks.sort(key=lambda mark: mark[0].ns)
        if any(later[2] <= earlier[2] for earlier, later in pairwise(self.marks)):
            # halpipe counts all tables, other writers the instances of each stimulus: then the order counts.
            self.marks = [(at, table, cycle) for cycle, (at, table, _) in enumerate(self.marks)]
        return tuple(self._labelled(execution) for execution in found) if self.marks else tuple(found)

    def _labelled(self, execution: Execution) -> Execution:
        position = bisect_right(self.marks, execution.start.ns, key=lambda mark: mark[0].ns) - 1
        if position < 0:
            return execution
        # A table of length zero ends where it begins; what starts there belongs to the next one, which comes later.
        _, table, cycle = self.marks[position]
        return replace(execution, table=table, cycle=cycle)

    def _odd(self, task: str, instance: int, what: str, line: int) -> None:
        at, path = Location(self.file, line), f'job {instance} of task "{task}"'
        self.findings.add(codes.ODD_SEQUENCE(what, at=at, path=path, help="check the recorder for lost events"))

    def _broken(self, line: int, message: str, help: str) -> None:
        self.findings.add(codes.BROKEN_ROW(message, at=Location(self.file, line), help=help))
