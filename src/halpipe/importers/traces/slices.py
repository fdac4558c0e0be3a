"""Trace Event Format (JSON) of Perfetto and Chrome: slices on threads, which are the units.

Slices are complete (``X``), or begin and end: ``B`` and ``E`` nested on a thread, ``b`` and ``e`` (before: ``S`` and
``F``) by their id. Each process is a line of time of its own. The arguments of halpipe's own slices (table, cycle, job)
are used; slices that lie across the edge of the picture are left out. The text is read in parts, so that its size does
not decide: an event at a time is decoded by the standard library. Like Perfetto, the reader takes numbers that are
written as texts.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from decimal import Decimal
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.core.files import json_decoder
from halpipe.importers.traces import codes
from halpipe.importers.traces.jobs import FEW, Marks, Oddities, line_of, report_unfinished, report_unused, unfinished
from halpipe.importers.traces.numbers import instant, plain
from halpipe.models.trace import Executions, Trace

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from halpipe.models.trace import Instant

LARGEST_VALUE = 2**28
"""Characters of one event, or of one value beside the list."""
_DELIMITERS = frozenset(",:]} \t\r\n")
_decode = json_decoder(str).raw_decode
_scan: Callable[[str, int], tuple[Any, int]] = vars(json_decoder(str))["scan_once"]
"""Numbers with a point stay texts, of which readers make exact numbers."""
_blank = re.compile("[ \t\r\n]*").match
_comma = re.compile("[ \t\r\n]*,[ \t\r\n]*").match


def events(pieces: Iterable[str], file: str, findings: Findings) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield each event with its line; raise `HalpipeError` where the text is no JSON or has no list of events.

    A list without its closing bracket is noted in `findings`: recorders may omit it, or the file is cut off.
    """
    text, has_list = _Text(pieces), False
    try:
        if text.next() == "[":
            has_list = True
            yield from text.elements()
        else:
            for key in text.entries():
                is_list = key == "traceEvents" and text.next() == "["
                has_list = has_list or is_list
                if is_list:
                    yield from text.elements()
                else:
                    text.value()
        if text.is_closed and text.next():
            raise ValueError(f"after its end comes {text.next()!r}")
    except (ValueError, RecursionError) as failure:
        message = f"it is no JSON: {getattr(failure, 'msg', failure)}"
        help = "give a file in the Trace Event Format; record it again if its JSON is only cut off"
        raise HalpipeError(codes.UNKNOWN_TRACE(message, at=Location(file, text.line), help=help)) from None
    if not has_list:
        help = "record in the Trace Event Format"
        raise HalpipeError(codes.UNKNOWN_TRACE("it has no list traceEvents", at=Location(file), help=help))
    if not text.is_closed:
        findings.add(codes.NO_END("the list of events has no closing bracket", at=Location(file)))


class _Text:
    def __init__(self, pieces: Iterable[str]) -> None:
        self._pieces = iter(pieces)
        self._text, self._at = "", 0
        self._line, self._counted = 1, 0
        self.is_closed = True
        """Whether every list and object had its bracket."""

    @property
    def line(self) -> int:
        """Return the line of the next character."""
        self._line += self._text.count("\n", self._counted, self._at)
        self._counted = self._at
        return self._line

    def _more(self) -> bool:
        """Read at least as much again as there is, so that the cost of a large value grows with it."""
        left = len(self._text) - self._at
        if left > LARGEST_VALUE:
            raise ValueError(f"an event has more than {LARGEST_VALUE} characters")
        found = []
        for piece in self._pieces:
            found.append(piece)
            left -= len(piece)
            if left <= 0:
                break
        self._line = self.line
        self._text = "".join((self._text[self._at :], *found))
        self._at = self._counted = 0
        return bool(found)

    def next(self) -> str:
        """Return the next character that is not blank, without using it; empty at the end."""
        while True:
            self._at = _blank(self._text, self._at).end()  # type: ignore[union-attr]
            if self._at < len(self._text):
                return self._text[self._at]
            if not self._more():
                return ""

    def _take(self, signs: str) -> str:
        """Use the next character, one of `signs`; at the end of the text nothing."""
        sign = self.next()
        if sign and sign not in signs:
            raise ValueError(f"{sign!r} stands where one of {signs} is due")
        self._at += len(sign)
        return sign

    def value(self) -> Any:
        """Use one value and return it."""
        self.next()
        while True:
            try:
                value, end = _decode(self._text, self._at)
            except json.JSONDecodeError:
                if not self._more():
                    raise
                continue
            if self._text[end : end + 1] in _DELIMITERS or not self._more():  # a number may go on in the next piece
                self._at = end
                return value

    def elements(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Use a list, and yield each object in it with its line."""
        self._take("[")
        while self.next() not in ("]", ""):
            line, value = self.line, self.value()
            if type(value) is dict:
                yield line, value
            if self.next() == ",":
                self._take(",")
                yield from self._whole()
            elif self.next() != "]":
                break
        self.is_closed = bool(self._take("]"))

    def _whole(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Use the elements of a list that are in the text with the comma after them, as most are."""
        self.next()
        text, at, line = self._text, self._at, self.line
        while True:
            try:
                value, end = _scan(text, at)
            except (StopIteration, json.JSONDecodeError):
                return
            between = _comma(text, end)
            if between is None or (begin := between.end()) == len(text):
                return
            self._at = begin
            if type(value) is dict:
                yield line, value
            line += text.count("\n", at, begin)
            at = begin

    def entries(self) -> Iterator[str]:
        """Use an object, and yield each key; its value is to be used before the next."""
        self._take("{")
        used = set()
        while self.next() not in ("}", ""):
            key = self.value()
            if key in used:
                raise ValueError(f'the key "{str(key)[:80]}" is repeated')
            used.add(key)
            self._take(":")
            yield key
            if not self.is_closed or self._take(",}") != ",":
                return
        self._take("}")


_MAX_EXPONENT = 30
_CACHED = 10_000
_LAST_CYCLE = 10**18
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
    def __init__(self, file: str, findings: Findings) -> None:
        self.file = file
        self.findings = findings
        self.processes: dict[int | str, str] = {}
        self.threads: dict[tuple[int | str, str], str] = {}
        self.found: dict[int | str, Executions] = {}
        self.jobs: dict[tuple[Any, ...], list[_Slice]] = {}
        self.marks: dict[tuple[Any, ...], Marks] = {}
        """Begins and ends of slices by what a begin and its end share: their phase, their process and their pair."""
        self.names: dict[Any, int] = {}
        """Names of slices and keys of threads, with their number in the columns."""
        self.known: dict[tuple[Any, ...], tuple[Any, ...]] = {}
        """Where slices without arguments go, by what most events share: phase, process, thread and name."""
        self.others: Counter[str] = Counter()
        self.open = 0
        """Slices without a duration, which Chrome writes where recording ended within them."""

    def take(self, event: dict[str, Any], number: int, line: int) -> None:
        """Take one event."""
        key = event.get("ph"), event.get("pid"), event.get("tid"), event.get("name")
        try:
            found, task, unit = self.known[key]
            at = instant_of(event.get("ts"))
            length = 0 if isinstance(found, Marks) else instant_of(event.get("dur"))
        except (KeyError, TypeError):  # a new one, or one with a list or an object in it
            at = length = None
        if at is not None and length is not None and length >= 0 and "args" not in event:
            if isinstance(found, Marks):
                found.add(at, key[0] == "B", task, unit, line)
            else:
                found.add(task, unit, at, at + length, None, line)
            return
        phase = str(event.get("ph"))
        if phase == "M":
            self._name(event)
            return
        process = _key(event.get("pid"))
        line_of(process, self.found, self.file)
        if phase not in _PHASES:
            self.others[f"phase {phase[:20]}"] += 1
            return
        at, task, arguments = instant_of(event.get("ts")), event.get("name"), event.get("args") or {}
        is_open = phase == "X" and "dur" not in event
        length = instant_of(event.get("dur")) if phase == "X" and not is_open else 0
        is_named = phase in _ENDS or (isinstance(task, str) and task)
        arguments = arguments if isinstance(arguments, dict) else {}
        cycle = arguments.get("played", arguments.get("cycle"))
        is_counted = not isinstance(cycle, int) or abs(cycle) <= _LAST_CYCLE
        if at is None or length is None or length < 0 or not is_counted or not (is_named or _is_partial(arguments)):
            message = f"event {number} has no name, ts, dur or cycle that can be read"
            self.findings.add(codes.BROKEN_ROW(message, at=Location(self.file, line), help="record it again"))
            return
        thread = _key(event.get("tid", ""))
        if phase == "X":
            slice = _Slice(at, None if is_open else at + length, task, process, thread, arguments, line)
            self.open += is_open
            self._know(key, self.found[process], task, _units(slice))
            self._slice(slice)
            return
        begin = _ENDS.get(phase, phase)
        pair = (thread,) if begin == "B" else (_key(event.get("cat")), _key(event.get("id", str(event.get("id2")))))
        pair = begin, process, *pair
        marks = self.marks.get(pair) or self.marks.setdefault(pair, Marks())
        if arguments:
            marks.arguments[len(marks.at)] = arguments
        name, unit = (
            self.names.setdefault(each, len(self.names)) for each in (task if isinstance(task, str) else "", thread)
        )
        if begin == "B":
            self._know(key, marks, name, unit)
        marks.add(at, begin == phase, name, unit, line)

    def _know(self, key: tuple[Any, ...], *where: Any) -> None:
        if len(self.known) < _CACHED and all(isinstance(each, str | int | None) for each in key):
            self.known[key] = where

    def traces(self) -> list[Trace]:
        """Return the lines of all processes."""
        names, odd, left = [*self.names], Oddities(), self.open
        units: list[tuple[str, ...]] = [() if name == "" else (str(name),) for name in names]
        for key in [*self.marks]:
            marks = self.marks.pop(key)
            begins, ends = marks.slices(names, odd)
            left += unfinished(ends)
            if len(begins) >= FEW and not marks.arguments:
                marks.put(self.found[key[1]], begins, ends, names, units)
                continue
            for row, last in zip(map(int, begins), map(int, ends), strict=True):
                end = None if last < 0 else marks.at[last]
                name, on, own = names[marks.task[row]], names[marks.thread[row]], marks.arguments.get(row, {})
                self._slice(_Slice(marks.at[row], end, name, key[1], on, own, marks.line[row]))
        odd.report(self.file, self.findings)
        report_unfinished(left, "slice", self.file, self.findings)
        for slices in self.jobs.values():
            self._job(slices)
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
        arguments, process = event.get("args"), _key(event.get("pid"))
        name = arguments.get("name") if isinstance(arguments, dict) else None
        if isinstance(name, str) and event.get("name") == "process_name":
            self.processes[process] = name
        elif isinstance(name, str) and event.get("name") == "thread_name":
            self.threads[process, str(_key(event.get("tid", "")))] = name

    def _slice(self, slice: _Slice) -> None:
        arguments = slice.arguments
        if _is_partial(arguments):
            self.others["slices across the edge of the picture"] += 1
            return
        if (job := arguments.get("job")) is None:
            self._job([slice])
            return
        cycle = _key(arguments.get("played", arguments.get("cycle")))
        where = (None, arguments.get("table", "")) if "part" in arguments else (slice.at, "")
        self.jobs.setdefault((slice.process, slice.task, *where, _key(job), cycle), []).append(slice)

    def _job(self, slices: list[_Slice]) -> None:
        """Add a job by the slices that show it, one for each of its units and parts."""
        each, units = slices[0], tuple(dict.fromkeys(unit for each in slices for unit in _units(each)))
        start, end, busy, stretches = each.at, each.end, None, None
        if "part" in each.arguments:
            stretches = sorted({(part.at, part.at if part.end is None else part.end) for part in slices})
            start, end, each = stretches[0][0], max(end for _, end in stretches), slices[-1]
            busy = sum(end - start for start, end in stretches)
        arguments, found = each.arguments, self.found[each.process]
        table, job, cycle = (arguments.get(name) for name in ("table", "job", "cycle"))
        cycle = arguments.get("played", cycle)
        table, cycle = table if isinstance(table, str) else "", cycle if isinstance(cycle, int) else None
        row = found.add(each.task, units, start, end, busy, each.line, table, cycle)
        if isinstance(job, int):
            found.job[row] = job
        if stretches:
            found.stretches[row] = tuple(stretches)


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
