"""Switches of threads on CPUs as jobs, and the texts of ftrace, trace-cmd and perf that list them.

A thread has a job from the switch to it up to the switch away from it in which it no longer wants to run. A switch away
from a runnable thread is a preemption. The task has the name of the thread, the unit is called ``cpu`` and its number.
Both spellings of a switch are read: that of ftrace (``prev_comm=A prev_pid=1 ...``) and that of trace-cmd
(``A:1 [120] S ==> B:2 [120]``).
"""

from __future__ import annotations

import re
from collections import Counter
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, Location
from halpipe.importers.traces import codes
from halpipe.importers.traces.jobs import Job, Jobs, report_unused
from halpipe.importers.traces.numbers import SCALES_NS, instant
from halpipe.models.trace import Trace

if TYPE_CHECKING:
    from collections.abc import Iterable
    from fractions import Fraction


BEGIN = re.compile(
    rb"(\xef\xbb\xbf)?(# tracer: |(#.*\n|\s)*.{1,32}[- ]\d+(/\d+)? +(\(.{7}\) +)?\[\d+\] "
    rb"|cpus=\d+\n|version = \d+\n(CPU|cpus))"
)
_SWITCH = "sched_switch:"
_PLACE = re.compile(r"\[(\d+)\]\s(?:.*\s)?(\d+\.\d+):\s*(?:sched:)?$")
_LONG = re.compile(r"prev_pid=(\d+) .*?prev_state=(\S+) .*?next_comm=(.*) next_pid=(\d+)")
_SHORT = re.compile(r".*:(\d+) \[\d+\] (\S+) ==> (.*):(\d+) \[\d+\]")
_EVENT = re.compile(r"\d+\.\d+:\s+(?:\w+:)?(\w+):")
_LOST = re.compile(r"CPU:\s*\d+ \[(?:LOST )?(\d+) EVENTS(?: DROPPED)?\]")
_LONGEST = 300
"""Characters of a line that patterns are tried on: two names of threads and all numbers are shorter."""
_RUNNABLE = "R"
_WAITING = 0xFF
"""Bits of the states in which a thread waits; that of a preempted one is above them since Linux 4.14."""
_IDLE = 0


def is_runnable(state: int) -> bool:
    """Whether a thread that is switched away from still wants to run, by the number of its state."""
    return not state & _WAITING


class Switches(Jobs):
    """Follows the threads by the switches between them, in the order of time."""

    def switch(
        self, cpu: int, at: int | Fraction, left: int, goes_on: bool, entered: int, name: str, line: int = 0
    ) -> None:
        """Take one switch from the thread `left`, which still wants to run or not, to the thread `entered`."""
        if goes_on:
            if (job := self.running.get(left)) is not None:
                job.pause(at)
            elif left != _IDLE:
                self.cut(left)
        else:
            self.end(left, at)
        if entered == _IDLE or entered in self.begun:
            return
        known = self.running.get(entered)
        if known is None:
            self.running[entered] = Job(name, f"cpu{cpu}", at, line)
        else:
            known.run(f"cpu{cpu}", at)

    def trace(self, lost: int = 0) -> Trace:
        """Return the line of time; report lost events, which may hide ends of jobs."""
        if lost:
            help = "record again with larger buffers"
            text = f"{lost} events were discarded while tracing, so jobs may be missing or joined"
            self.findings.add(codes.LOST_EVENTS(text, at=Location(self.file), help=help))
        return Trace(name="", executions=self.result(), is_shared=True)


def read(lines: Iterable[str], file: str, findings: Findings) -> list[Trace]:
    """Return the one line of time of the text."""
    switches = Switches(file, findings)
    others: Counter[str] = Counter()
    lost, at = 0, instant("0", 1)
    for number, line in enumerate(lines, 1):
        where, is_switch, what = line.partition(_SWITCH)
        if is_switch:
            place, what = _PLACE.search(where[-_LONGEST:]), what[:_LONGEST]
            found = _LONG.search(what) or _SHORT.search(what)
            if place is None or found is None:
                help = "let its clock count seconds (`trace_clock` local, global or mono), and print all fields"
                message = "its CPU, its time in seconds or its threads cannot be read"
                findings.add(codes.BROKEN_ROW(message, at=Location(file, number), help=help))
                continue
            before, at, (left, state, name, entered) = at, instant(place[2], SCALES_NS["s"]), found.groups()
            if at < before:
                message = f"its instant {place[2]} s lies before that of a switch above it"
                help = "sort the lines by time; `trace-cmd report` and the file trace of tracefs are in its order"
                findings.add(codes.BROKEN_ROW(message, at=Location(file, number), help=help))
            goes_on = is_runnable(int(state)) if state.isdecimal() else state.startswith(_RUNNABLE)
            switches.switch(int(place[1]), at, int(left), goes_on, int(entered), name, number)
        elif event := _EVENT.search(line[:_LONGEST]):
            others[event[1]] += 1
        elif dropped := _LOST.search(line[:_LONGEST]):
            lost += int(dropped[1])
    report_unused(others, file, findings)
    return [switches.trace(lost)]
