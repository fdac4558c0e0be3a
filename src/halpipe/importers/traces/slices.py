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
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

from halpipe.core.diagnostics import Location
from halpipe.importers.traces import codes
from halpipe.importers.traces.jobs import report_unused
from halpipe.importers.traces.json_events import events
from halpipe.importers.traces.numbers import SCALES_NS
from halpipe.models.trace import Executions, Trace

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.core.diagnostics import Findings
    from halpipe.models.trace import Instant

_MAX_EXPONENT = 30
_ENDS = {"E": "B", "e": "b", "F": "S"}
_NUMBER = re.compile(r"-?[0-9]{1,30}(\.[0-9]{1,30})?([eE][-+]?[0-9]{1,2})?")


def read(pieces: Iterable[str], file: str, findings: Findings) -> list[Trace]:
    """Return one line of time for each process, in their order."""
    reader = _Reader(file, findings)
    for number, (line, event) in enumerate(events(pieces, file, findings)):
        reader.take(event, number, line)
    return reader.traces()


class _Slice(NamedTuple):
    """Start of a slice, or a whole one; `process` and `thread` are keys of the names."""

    at: Instant
    task: Any
    process: int | str
    thread: int | str
    arguments: dict[str, Any]
    number: int
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
        self.parts: dict[tuple[Any, ...], list[tuple[_Slice, Instant]]] = {}
        self.marks: dict[tuple[Any, ...], list[tuple[Instant, bool, _Slice]]] = {}
        """Begins and ends of slices, and which it is, by what a begin and its end share."""
        self.others: Counter[str] = Counter()

    def take(self, event: dict[str, Any], number: int, line: int) -> None:
        """Take one event."""
        phase = str(event.get("ph"))
        if phase == "M":
            self._name(event)
            return
        process = _key(event.get("pid"))
        self.found.setdefault(process, Executions(self.file))
        if phase not in ("X", *_ENDS, *_ENDS.values()):
            self.others[f"phase {phase[:20]}"] += 1
            return
        at, arguments = _instant(event.get("ts")), event.get("args")
        thread = _key(event.get("tid", ""))
        length = _instant(event.get("dur")) if phase == "X" else 0
        if at is None or length is None or length < 0:
            self._broken(number, line)
            return
        arguments = arguments if isinstance(arguments, dict) else {}
        slice = _Slice(at, event.get("name"), process, thread, arguments, number, line)
        if phase == "X":
            self._slice(slice, at + length)
        else:
            begin = _ENDS.get(phase, phase)
            self.marks.setdefault((begin, process, *_pair(event, begin)), []).append((at, begin == phase, slice))

    def traces(self) -> list[Trace]:
        """Return the lines of all processes."""
        self._match()
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

    def _match(self) -> None:
        """Match the begins and ends of slices."""
        left = [slice for marks in self.marks.values() for slice in self._open(marks)]
        for slice in left:
            self._slice(slice, None)
        if left:
            self.findings.add(codes.UNFINISHED(f"{len(left)} slices have no end", at=Location(self.file)))

    def _open(self, marks: list[tuple[Instant, bool, _Slice]]) -> list[_Slice]:
        """Take the slices of one thread, or of one id, and return those without an end.

        Where the text is not in the order of time, ends come before begins of the same instant, as of jobs in a row.
        """
        if any(later[0] < before[0] for before, later in pairwise(marks)):
            marks = sorted(marks, key=lambda mark: mark[:2])
        begun: list[_Slice] = []
        for at, is_begin, slice in marks:
            if is_begin:
                begun.append(slice)
                continue
            # A slice that ends by its name may have another one above it, which begins at this instant.
            of_name = (place for place in range(len(begun) - 1, -1, -1) if slice.task == begun[place].task)
            if (place := next(of_name, len(begun) - 1)) < 0:
                message = f"event {slice.number} ends a slice that did not begin"
                where = Location(self.file, slice.line)
                self.findings.add(codes.ODD_SEQUENCE(message, at=where, help="check the recorder for lost events"))
            else:
                self._slice(begun.pop(place), at)
        return begun

    def _broken(self, number: int, line: int) -> None:
        message = f"event {number} has no name, ts or dur that can be read"
        self.findings.add(codes.BROKEN_ROW(message, at=Location(self.file, line), help="record it again"))

    def _slice(self, slice: _Slice, end: Instant | None) -> None:
        """Take one slice as a job, or as a further unit or part of one."""
        task, arguments = slice.task, slice.arguments
        if "began" in arguments or "ends" in arguments:
            self.others["slices across the edge of the picture"] += 1
            return
        if not isinstance(task, str) or not task:
            self._broken(slice.number, slice.line)
            return
        job = arguments.get("job")
        if job is None:
            self._add(slice, slice.at, end, None, _units(slice))
            return
        cycle = _key(arguments.get("played", arguments.get("cycle")))
        if "part" in arguments:
            key = (slice.process, task, arguments.get("table", ""), _key(job), cycle)
            self.parts.setdefault(key, []).append((slice, slice.at if end is None else end))
            return
        key = (slice.process, task, slice.at, _key(job), cycle)
        found = self.found[slice.process]
        if (row := self.jobs.get(key)) is None:
            self.jobs[key] = self._add(slice, slice.at, end, None, _units(slice))
        else:
            found.run_on(row, (*found.units[found.on[row]], *_units(slice)))

    def _joined(self, key: tuple[Any, ...], slices: list[tuple[_Slice, Instant]]) -> None:
        """Add a job with all the stretches, and on all the units, that its slices show."""
        stretches = sorted({(slice.at, end) for slice, end in slices})
        units = tuple(dict.fromkeys(unit for slice, _ in slices for unit in _units(slice)))
        busy = sum(end - start for start, end in stretches)
        row = self._add(slices[-1][0], stretches[0][0], max(end for _, end in stretches), busy, units)
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


def _pair(event: dict[str, Any], begin: str) -> tuple[int | str, ...]:
    """Return what the begin and the end of a slice share: their thread, or their category and id."""
    pair = (event.get("tid"),) if begin == "B" else (event.get("cat"), event.get("id", str(event.get("id2"))))
    return tuple(map(_key, pair))


def _key(value: Any) -> int | str:
    """Return an identifier that can be looked up, whatever the JSON has; some writers have numbers as texts."""
    if isinstance(value, int):
        return value
    text = str(value)
    return int(text) if text.isdecimal() and text.isascii() and len(text) < _MAX_EXPONENT else text


def _instant(value: Any) -> Instant | None:
    """Return nanoseconds of a number of microseconds; None if it is none."""
    if isinstance(value, bool):
        return None
    if isinstance(value, int):
        return value * 1000
    if isinstance(value, str) and _NUMBER.fullmatch(value):
        value = Decimal(value)
    if not isinstance(value, Decimal) or not value.is_finite() or abs(value.adjusted()) > _MAX_EXPONENT:
        return None
    ns = Fraction(value) * SCALES_NS["us"]
    return ns.numerator if ns.denominator == 1 else ns
