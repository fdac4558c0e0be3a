"""Best Trace Format (BTF 2.x): ``time,source,instance,type,target,instance,event[,note]``, one event per line.

Read leniently, as recorders write it: comments anywhere, headers twice, ``#timescale`` in any spelling, types and
entities by their numbers in the tables of the header. Task and ISR events make the executions; where there are none,
those of runnables do. A job runs on each core that a run event names, also while it polls. A stimulus
``STI_TABLE_<name>`` marks the start of a table with its trigger.
"""

from __future__ import annotations

import re
from collections import Counter
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, Location
from halpipe.core.suggest import counted
from halpipe.importers.traces import codes
from halpipe.importers.traces.jobs import Job, Jobs, Oddities, report_unused
from halpipe.importers.traces.numbers import SCALES_NS, instant, whole
from halpipe.models.trace import Executions, Trace

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from fractions import Fraction


TABLE_MARK = "STI_TABLE_"
_MANY_DIGITS = 18
_KEY = re.compile("#[A-Za-z]")
_EVENT = re.compile(r"-?[0-9]+,[^,]*,-?[0-9]+,[^,]*,[^,]*,-?[0-9]+,[^,]+(,.*)?")
_SCALE = re.compile(r"#\s*timescale\s+(\w+)", re.IGNORECASE)
_JOBS = frozenset(("T", "ISR", "I"))
_TABLE = re.compile(r"#\s*(typetable|entitytype|entitytable|entitytypetable)", re.IGNORECASE)
_ROW = re.compile(r"#-(\d+) (.*)")
_RUNS = frozenset(("start", "resume", "poll_parking", "run", "poll"))
"""`run` and `poll` also occur while a job runs: it polls, or has what it polled for, on the same core."""
_PAUSES = frozenset(("preempt", "wait", "park"))
_KEEPS = frozenset(("activate", "release", "release_parking", "mtalimitexceeded"))
"""Events after which a job runs or pauses as before."""


def is_begin(first: str, head: bytes) -> bool:
    """Whether a text begins as this format does: with an event, a key such as ``#version``, or remarks before them."""
    if not first.startswith("#"):
        return _EVENT.fullmatch(first) is not None
    lines = [line.strip() for line in head.decode("utf-8", "replace").splitlines()]
    event = next((line for line in lines if line and not line.startswith("#")), None)
    return event is None or _KEY.match(first) is not None or _EVENT.fullmatch(event) is not None


def read(lines: Iterable[str], file: str, findings: Findings) -> list[Trace]:
    """Return the one line of time of the trace."""
    reader = _Reader(file, findings)
    for number, line in enumerate(lines, 1):
        line = line.strip()
        if line.startswith("#"):
            reader.comment(line, number)
        elif line:
            reader.event(line, number)
    return [Trace(name="", executions=reader.result())]


class _Reader(Jobs):
    def __init__(self, file: str, findings: Findings) -> None:
        super().__init__(file, findings)
        self.scale: int | Fraction = 1
        self.marks: list[tuple[int | Fraction, str, int]] = []
        self.others: Counter[str] = Counter()
        self.odd, self.late = Oddities(), Oddities()
        self.last: dict[str, int | Fraction] = {}
        """Instant of the last event on each core."""
        self.table = ""
        self.is_of_runnables = True
        """Whether no event of a task has come yet; runnables start after their tasks."""
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
        if " " in line or "\t" in line:
            parts = [part.strip() for part in parts]
        if len(parts) < 7:
            message = f"{counted(len(parts), 'column')}; an event has 7 or 8"
            self._broken(number, message, "write time, source, ... event")
            return
        time, source, _, kind, target, instance, event = parts[:7]
        try:
            at = instant(time, self.scale)
            if len(instance) > _MANY_DIGITS or not instance.isdecimal():
                whole(instance)
        except ValueError as failure:
            self._broken(number, str(failure), "times and instances are whole numbers")
            return
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
            if at < self.last.get(source, at):
                self.late.add(f"its instant precedes that of the event before on {source[:60]}", number)
            if self.is_of_runnables:
                self.is_of_runnables = False
                super().__init__(self.file, self.findings)
                self.odd = Oddities()
            if event == "terminate" and source not in self.last and (target, instance) not in self.running:
                self.cut((target, instance))
            self.last[source] = at
            self._job(target, instance, event, source, at, number)
        elif kind == "R":
            if self.is_of_runnables:
                self._job(target, instance, "preempt" if event == "suspend" else event, source, at, number)
        elif kind == "STI" and target.startswith(TABLE_MARK) and event == "trigger":
            self.marks.append((at, target.removeprefix(TABLE_MARK), int(instance)))
        else:
            self.others[kind] += 1

    def _job(self, task: str, instance: str, event: str, source: str, at: int | Fraction, line: int) -> None:
        if event in _KEEPS:
            return
        key = task, instance
        job = self.running.get(key)
        if event == "start" and job is None:
            self.begun.discard(key)
            self.running[key] = Job(task, source, at, line)
        elif event in _RUNS:
            if job is None:
                self.cut(key)
                return
            if job.since is not None and event not in ("run", "poll"):
                self.odd.add(f"{event} while it runs", line, f'job {instance} of task "{task}"')
            job.run(source, at)
        elif event in _PAUSES:
            if job is None:
                self.cut(key)
            else:
                job.pause(at)
        elif event == "terminate":
            if not self.end(key, at):
                self.odd.add("terminate without start", line, f'job {instance} of task "{task}"')
        else:
            self.others[event] += 1

    def result(self, marks: Sequence[tuple[int | Fraction, str, int]] = ()) -> Executions:
        """Return what ran, by start, with the table it belongs to where marks tell."""
        report_unused(self.others, self.file, self.findings)
        self.odd.report(self.file, self.findings)
        help = "sort the events by time; counters of 32 bits that wrap need their overflows added"
        self.late.report(self.file, self.findings, help)
        in_order = sorted(self.marks, key=lambda mark: (mark[0], mark[2]))
        self.marks.sort(key=lambda mark: mark[0])
        if all(earlier[2] < later[2] for earlier, later in pairwise(in_order)):
            self.marks = in_order  # those of one instant, too, in whatever order they are written
        else:
            # halpipe counts all tables, other writers the instances of each stimulus: then the order counts.
            self.marks = [(at, table, cycle) for cycle, (at, table, _) in enumerate(self.marks)]
        return super().result(self.marks)

    def _broken(self, line: int, message: str, help: str) -> None:
        self.findings.add(codes.BROKEN_ROW(message, at=Location(self.file, line), help=help))
