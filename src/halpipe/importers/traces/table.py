"""CSV reader of traces: one row for each execution, columns by name.

Needed are ``task``, ``start`` and ``end``; known are also ``units`` (separated by blanks), ``mode``, ``cycle``,
``job``, ``busy`` and ``data`` (0: there was no message for the job). Times are nanoseconds, or as the name of the
column says: ``start_us``. An empty end is that of a job which still ran when the trace ended. CARET's records have
two columns for each callback instead, which end in ``/callback_start_timestamp`` and ``/callback_end_timestamp``.
Columns are separated by commas, semicolons or tabulators; where no comma separates, numbers may have a decimal comma.
Measurement tools export signals over time instead: a first column ``Time [s]``, and one for each signal. A signal that
is 0 or 1 only is the state of the task of its name: it runs while the signal is 1. A second row may state units.
"""

from __future__ import annotations

import csv
import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from halpipe.core.diagnostics import Findings, Location
from halpipe.core.suggest import counted, few
from halpipe.importers.traces import codes
from halpipe.importers.traces.jobs import Jobs, report_unfinished
from halpipe.importers.traces.numbers import SCALES_NS, DecimalSign, instant, separator_of, whole
from halpipe.models.trace import NONE, Executions, Trace, column

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    from halpipe.models.trace import Instant

TIMES = ("start", "end", "busy")
_ROLES = frozenset(("task", *TIMES, "units", "mode", "cycle", "job", "data"))
_ALIASES = {"unit": "units", "table": "mode", "callback": "task", "core": "units"}
_LONG = {"callback_name": "task", "name": "task", "node": "task"}
_LONG |= {
    f"{way}{name}{form}": name for name in ("start", "end") for way in ("", "callback_") for form in ("_timestamp", "")
}
_START, _END = "/callback_start_timestamp", "/callback_end_timestamp"
ABSENT = ("", "nan", "nat", "none", "null", "<na>")
_CLOCKS = ("time", "timestamp", "timestamps", "t", "zeit")
_STATES = {"0": False, "1": True, "0.0": False, "1.0": True, "0,0": False, "1,0": True}
_MICRO = str.maketrans("\xb5\u03bc", "uu")
"""Both signs of micro; the Greek letter is what the other becomes in small letters of some systems."""


def is_header(line: str) -> bool:
    """Whether a line names the columns that are needed."""
    names = line.split(separator_of(line))
    return bool(_records(names)) or _is_complete(_columns(names))


def _is_complete(columns: dict[str, tuple[int, str]]) -> bool:
    return all(name in columns for name in ("task", "start", "end"))


def _records(names: list[str]) -> dict[str, tuple[int, int]]:
    """Return the positions of start and end of each callback, where a table is one of CARET's records."""
    plain = [name.strip().strip('"') for name in names]
    starts = {name.removesuffix(_START): position for position, name in enumerate(plain) if name.endswith(_START)}
    ends = {name.removesuffix(_END): position for position, name in enumerate(plain) if name.endswith(_END)}
    return {name: (starts[name], ends[name]) for name in starts if name in ends}


def _plain(name: str) -> str:
    """Return the name of a column in small letters, with its unit behind a line: ``start [us]`` is ``start_us``."""
    plain = name.strip().strip('"').lower().translate(_MICRO).replace("(", "[").replace(" [", "_").replace("[", "_")
    return plain.rstrip(")]")


def _role(name: str) -> tuple[str, str]:
    """Return what a column holds, and its unit if these are times; nothing of times in an unknown unit."""
    full = _plain(name)
    plain, _, unit = _LONG.get(full, full).partition("_")
    if plain in TIMES and (unit or "ns") in SCALES_NS:
        return plain, unit or "ns"
    return ("" if unit else _ALIASES.get(plain, plain)), ""


def is_time(name: str) -> bool:
    """Whether a column without a unit in its name is one of instants or durations of jobs."""
    return _LONG.get(_plain(name), _plain(name)) in TIMES


def _columns(names: list[str]) -> dict[str, tuple[int, str]]:
    found: dict[str, tuple[int, str]] = {}
    for position, (role, unit) in enumerate(map(_role, names)):
        if role:
            found.setdefault(role, (position, unit))
    return found


def read(lines: Iterable[str], file: str, findings: Findings) -> list[Trace]:
    """Return the one line of time in the table."""
    executions = _executions(lines, file, findings)
    is_open = np.equal(column(executions.end)[executions.order], NONE)
    report_unfinished(int(is_open.sum()), "job", file, findings)
    return [Trace(name="", executions=executions)]


def is_states(line: str) -> bool:
    """Whether a line is the head of signals over time."""
    names = line.split(separator_of(line))
    return len(names) > 1 and _clock(names[0]) is not None


def _clock(name: str) -> str | None:
    """Return the unit of a column of instants: seconds, if it states none; None for other columns."""
    plain, _, unit = _plain(name).partition("_")
    return (unit or "s") if plain in _CLOCKS and (unit or "s") in SCALES_NS else None


def read_states(lines: Iterable[str], file: str, findings: Findings) -> list[Trace]:
    """Return the one line of time of a table of signals."""
    rows, numbers = rows_of(lines)
    filled = (cells for cells in rows if any(cells))
    clock, *names = (name.strip() for name in next(filled))
    jobs, others, before, scale = Jobs(file, findings), set[str](), [""] * len(names), SCALES_NS[_clock(clock) or "s"]
    for number, cells in enumerate(filled):
        line = rows.line_num
        if not number and not any(c.isdigit() for c in cells[0]):  # it states units
            continue
        try:
            at = instant(numbers.point(cells.pop(0).strip()), scale)
        except ValueError as failure:
            _broken(str(failure), Location(file, line), findings)
            continue
        require_columns(cells, len(names), Location(file, line), findings)
        changes = [place for place, (cell, last) in enumerate(zip(cells, before, strict=False)) if cell != last]
        for place in changes:
            if not (cell := cells[place].strip()):  # no sample
                continue
            if (state := _STATES.get(cell)) is None:
                others.add(names[place])
            else:
                jobs.state(names[place], at, line, runs=state, is_first=not before[place])
            before[place] = cells[place]
    report_signals(others, file, findings)
    for name in others:
        jobs.running.pop(name, None)
        jobs.cuts.pop(name, None)
    found = jobs.result()
    wrong = [found.number(name) for name in others]
    found.order = found.order[~np.isin(np.asarray(found.task)[found.order], wrong)]
    return [Trace(name="", executions=found, is_shared=True)]


def require_columns(cells: Sequence[str], count: int, at: Location, findings: Findings) -> None:
    """Report a row with values that no column names, such as decimal commas in a table separated by commas."""
    if any(cell.strip() for cell in cells[count:]):
        _broken(f"{len(cells)} values, and {counted(count, 'column')}", at, findings)


def _broken(message: str, at: Location, findings: Findings) -> None:
    findings.add(codes.BROKEN_ROW(message, at=at, help="correct the row; times are whole or decimal numbers"))


def report_signals(others: Collection[str], file: str, findings: Findings) -> None:
    """Report the signals that are no states of tasks."""
    if others:
        message = f"not 0 or 1 only: {counted(len(others), 'signal')}: {few(sorted(others), quote='')}"
        findings.add(codes.LEFT_OUT(message, at=Location(file)))


def _executions(lines: Iterable[str], file: str, findings: Findings) -> Executions:
    rows, numbers = rows_of(lines)
    filled: Iterator[list[str]] = (cells for cells in rows if any(cell.strip() for cell in cells))
    table, absent, records = _Table(file, numbers), 0, dict[str, tuple[int, int]]()
    try:
        header = next(filled, [])
        columns = _columns(header)
        if len(stated := [role for role, _ in map(_role, header) if role in _ROLES]) > len({*stated}):
            findings.add(
                codes.BROKEN_ROW("two columns have one meaning", at=Location(file, 1), help="leave one of them")
            )
        if "mode" not in columns and (unused := [name for name in ("cycle", "job") if name in columns]):
            text = f"{' and '.join(unused)} without mode"
            findings.add(codes.NO_MODE(text, at=Location(file, 1), help="name the table of each row in a column mode"))
        records = {} if _is_complete(columns) else _records(header)
        for cells in filled:
            require_columns(cells, len(header), Location(file, rows.line_num), findings)
            try:
                if records:
                    absent += table.record(records, cells, rows.line_num)
                else:
                    table.row(columns, cells, rows.line_num)
            except ValueError as failure:
                _broken(str(failure), Location(file, rows.line_num), findings)
    except csv.Error as failure:
        findings.add(codes.BROKEN_ROW(str(failure), at=Location(file, rows.line_num), help="write plain CSV"))
    if absent:
        message = f"{absent} cells of records have no start: the message did not come so far, or was not recorded"
        findings.add(codes.LEFT_OUT(message, at=Location(file)))
    table.found.sort()
    if records:
        _remove_repeats(table.found)
    return table.found


def rows_of(lines: Iterable[str]) -> tuple[Any, DecimalSign]:
    """Return the rows of a table, and the reader of its numbers, by the separator of its first line that has text."""
    rest, before = iter(lines), list[str]()
    for line in rest:
        before.append(line)
        if line.strip():
            break
    separator = separator_of(before[-1] if before else "")
    return csv.reader(itertools.chain(before, rest), delimiter=separator), DecimalSign(separator)


def _remove_repeats(found: Executions) -> None:
    """Keep each job of CARET's records once: rows of a path repeat a job for each message that it made."""
    order = found.order
    task, start, end = np.asarray(found.task)[order], column(found.start)[order], column(found.end)[order]
    places = np.arange(len(order))
    for each in (end, task, start):
        places = places[np.argsort(each[places], kind="stable")]
    is_new = np.ones(len(order), dtype=bool)
    same = [each[places[1:]] == each[places[:-1]] for each in (end, task, start)]
    is_new[places[1:]] = ~(same[0] & same[1] & same[2])
    found.order = order[is_new]


class _Table:
    def __init__(self, file: str, numbers: DecimalSign) -> None:
        self.numbers = numbers
        self.found = Executions(file)

    def row(self, columns: Mapping[str, tuple[int, str]], cells: Sequence[str], line: int) -> None:
        """Take a row that is a job."""
        of = {name: cells[at].strip() if at < len(cells) else "" for name, (at, _) in columns.items()}
        start, end, busy = (self._time(of[name], columns[name][1]) if name in of else None for name in TIMES)
        if not of["task"] or start is None:
            raise ValueError("the row has no task or no start")
        if end is not None and end < start:
            raise ValueError(f"ends at {of['end']}, before it starts")
        if busy is not None and busy < 0:
            raise ValueError(f"runs for {of['busy']}")
        cycle, job = (whole(of[name]) if of.get(name) else None for name in ("cycle", "job"))
        if (flag := of.get("data", "")) not in ("", "0", "1"):
            raise ValueError(f"data is {flag[:20]!r}, neither 0 nor 1")
        units = tuple(of.get("units", "").split())
        row = self.found.add(of["task"], units, start, end, busy, line, of.get("mode", ""), cycle)
        if job is not None:
            self.found.job[row] = job
        if flag:
            self.found.has_data[row] = flag == "1"

    def record(self, records: Mapping[str, tuple[int, int]], cells: Sequence[str], line: int) -> int:
        """Take the jobs of a row of CARET's records; return how many callbacks have none."""
        found = []
        for name, places in records.items():
            texts = (cells[place].strip() if place < len(cells) else "" for place in places)
            start, end = (self._time("" if text.lower() in ABSENT else text, "ns") for text in texts)
            if start is not None and end is not None and end < start:
                raise ValueError(f"{name} ends at {end}, before it starts")
            if start is not None:
                found.append((name, start, end))
        for name, start, end in found:
            self.found.add(name, (), start, end, None, line)
        return len(records) - len(found)

    def _time(self, text: str, unit: str) -> Instant | None:
        return instant(self.numbers.point(text), SCALES_NS[unit]) if text else None
