"""Trace Event Format (JSON) of Perfetto and Chrome: slices on threads, which are the units.

Slices are complete (``X``), or begin and end: ``B`` and ``E`` nested on a thread, ``b`` and ``e`` (before: ``S`` and
``F``) by their id. Each process is a line of time of its own. The arguments of halpipe's own slices (table, cycle, job)
are used; slices that lie across the edge of the picture are left out. The text is read in parts, so that its size does
not decide; like Perfetto, the reader takes numbers that are written as texts.
"""

from __future__ import annotations

import re
from collections import Counter
from decimal import Decimal
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

from halpipe.core.diagnostics import Location
from halpipe.importers.traces import codes
from halpipe.importers.traces.jobs import Marks, Oddities, report_unfinished, report_unused
from halpipe.importers.traces.json_events import events
from halpipe.importers.traces.numbers import instant, plain
from halpipe.models.trace import Executions, Trace

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from halpipe.core.diagnostics import Findings
    from halpipe.models.trace import Instant

_MAX_EXPONENT = 30
_ENDS = {"E": "B", "e": "b", "F": "S"}
_PHASES = frozenset(("X", *_ENDS, *_ENDS.values()))
_NUMBER = re.compile(r"-?[0-9]{1,30}(\.[0-9]{1,30})?([eE][-+]?[0-9]{1,2})?")


def read(pieces: Iterable[str], file: str, findings: Findings) -> list[Trace]:
    """Return one line of time for each process, in their order."""
    reader = _Reader(file, findings)
    for number, (line, event) in enumerate(events(pieces, file, findings)):
        reader.take(event, number, line)
    return reader.traces()


class _Slice(NamedTuple):
    """Slice with the keys of its process and its thread; `end` is None if it has none."""

    at: Instant
    end: Instant | None
    task: Any
    process: int | str
    thread: int | str
    arguments: Mapping[str, Any]
    line: int


class _Reader:
    """Collects slices by process; one job is one slice on each of its units."""

    def __init__(self, file: str, findings: Findings) -> None:
        self.file = file
        self.findings = findings
        self.processes: dict[int | str, str] = {}
        self.threads: dict[tuple[int | str, str], str] = {}
        self.found: dict[int | str, Executions] = {}
        self.jobs: dict[tuple[Any, ...], int] = {}
        self.parts: dict[tuple[Any, ...], list[_Slice]] = {}
        self.marks: dict[tuple[Any, ...], Marks] = {}
        """Begins and ends of slices by what a begin and its end share: their phase, their process and their pair."""
        self.names: dict[Any, int] = {}
        """Names of slices and keys of threads, with their number in the columns."""
        self.others: Counter[str] = Counter()

    def take(self, event: dict[str, Any], number: int, line: int) -> None:
        """Take one event."""
        phase = str(event.get("ph"))
        if phase == "M":
            self._name(event)
            return
        process = _key(event.get("pid"))
        if process not in self.found:
            self.found[process] = Executions(self.file)
        if phase not in _PHASES:
            self.others[f"phase {phase[:20]}"] += 1
            return
        at, task, arguments = instant_of(event.get("ts")), event.get("name"), event.get("args") or {}
        length = instant_of(event.get("dur")) if phase == "X" else 0
        is_named = phase in _ENDS or (isinstance(task, str) and task)
        arguments = arguments if isinstance(arguments, dict) else {}
        if at is None or length is None or length < 0 or not (is_named or _is_partial(arguments)):
            message = f"event {number} has no name, ts or dur that can be read"
            self.findings.add(codes.BROKEN_ROW(message, at=Location(self.file, line), help="record it again"))
            return
        thread = _key(event.get("tid", ""))
        if phase == "X":
            self._slice(_Slice(at, at + length, task, process, thread, arguments, line))
            return
        begin = _ENDS.get(phase, phase)
        key = (
            (begin, process, thread)
            if begin == "B"
            else (begin, process, _key(event.get("cat")), _key(event.get("id", str(event.get("id2")))))
        )
        if (marks := self.marks.get(key)) is None:
            marks = self.marks[key] = Marks()
        if arguments:
            marks.arguments[len(marks.at)] = arguments
        name, unit = (
            self.names.setdefault(each, len(self.names)) for each in (task if isinstance(task, str) else "", thread)
        )
        marks.add(at, begin == phase, name, unit, line)

    def traces(self) -> list[Trace]:
        """Return the lines of all processes."""
        names, odd, left = [*self.names], Oddities(), 0
        for key in [*self.marks]:
            marks = self.marks.pop(key)
            for row, end in marks.slices(names, odd):
                left += end is None
                task, thread, own = names[marks.task[row]], names[marks.thread[row]], marks.arguments.get(row, {})
                self._slice(_Slice(marks.at[row], end, task, key[1], thread, own, marks.line[row]))
        odd.report(self.file, self.findings)
        report_unfinished(left, "slice", self.file, self.findings)
        for key, slices in self.parts.items():
            self._joined(key, slices)
        report_unused(self.others, self.file, self.findings)
        found = []
        for process, executions in self.found.items():
            executions.sort()
            executions.units = [
                tuple(self.threads.get((process, unit), unit) for unit in units) for units in executions.units
            ]
            found.append(Trace(name=self.processes.get(process, str(process)), executions=executions))
        return found

    def _name(self, event: dict[str, Any]) -> None:
        arguments = event.get("args")
        name = arguments.get("name") if isinstance(arguments, dict) else None
        if isinstance(name, str) and event.get("name") == "process_name":
            self.processes[_key(event.get("pid"))] = name
        elif isinstance(name, str) and event.get("name") == "thread_name":
            self.threads[_key(event.get("pid")), str(_key(event.get("tid", "")))] = name

    def _slice(self, slice: _Slice) -> None:
        """Take one slice as a job, or as a further unit or part of one."""
        arguments = slice.arguments
        if _is_partial(arguments):
            self.others["slices across the edge of the picture"] += 1
            return
        job = arguments.get("job")
        if job is None:
            self._add(slice, slice.at, slice.end, None, _units(slice))
            return
        cycle = _key(arguments.get("played", arguments.get("cycle")))
        if "part" in arguments:
            key = (slice.process, slice.task, arguments.get("table", ""), _key(job), cycle)
            self.parts.setdefault(key, []).append(slice)
            return
        key = (slice.process, slice.task, slice.at, _key(job), cycle)
        found = self.found[slice.process]
        if (row := self.jobs.get(key)) is None:
            self.jobs[key] = self._add(slice, slice.at, slice.end, None, _units(slice))
        else:
            found.run_on(row, (*found.units[found.on[row]], *_units(slice)))

    def _joined(self, key: tuple[Any, ...], slices: list[_Slice]) -> None:
        """Add a job with all the stretches, and on all the units, that its slices show."""
        stretches = sorted({(each.at, each.at if each.end is None else each.end) for each in slices})
        units = tuple(dict.fromkeys(unit for each in slices for unit in _units(each)))
        busy = sum(end - start for start, end in stretches)
        row = self._add(slices[-1], stretches[0][0], max(end for _, end in stretches), busy, units)
        self.found[key[0]].stretches[row] = tuple(stretches)

    def _add(
        self, slice: _Slice, start: Instant, end: Instant | None, busy: Instant | None, units: tuple[str, ...]
    ) -> int:
        arguments, found = slice.arguments, self.found[slice.process]
        table, job = arguments.get("table"), arguments.get("job")
        cycle = arguments.get("played", arguments.get("cycle"))
        row = found.add(
            slice.task,
            units,
            start,
            end,
            busy,
            slice.line,
            table if isinstance(table, str) else "",
            cycle if isinstance(cycle, int) else None,
        )
        if isinstance(job, int):
            found.job[row] = job
        return row


def _units(slice: _Slice) -> tuple[str, ...]:
    """Return the unit of a slice by the key of its thread; none where no thread is stated."""
    return () if slice.thread == "" else (str(slice.thread),)


def _key(value: Any) -> int | str:
    """Return an identifier that can be looked up, whatever the JSON has; some writers have numbers as texts."""
    if isinstance(value, int):
        return value
    text = str(value)
    return int(text) if text.isdecimal() and text.isascii() and len(text) < _MAX_EXPONENT else text


def instant_of(value: Any) -> Instant | None:
    """Return nanoseconds of a number of microseconds, which may be a text; None if it is none."""
    if isinstance(value, int):
        return None if isinstance(value, bool) else value * 1000
    if not isinstance(value, str):
        return None
    try:
        return instant(value, 1000)
    except ValueError:
        exact = _NUMBER.fullmatch(value) and abs(Decimal(value).adjusted()) <= _MAX_EXPONENT
        return plain(Fraction(value) * 1000) if exact else None


def _is_partial(arguments: Mapping[str, Any]) -> bool:
    """Whether a slice of halpipe lies across the edge of its picture."""
    return "began" in arguments or "ends" in arguments
