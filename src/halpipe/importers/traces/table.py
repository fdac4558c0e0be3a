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
from typing import TYPE_CHECKING, TypeVar

from halpipe.core.diagnostics import Location
from halpipe.core.durations import Duration
from halpipe.importers.traces import codes
from halpipe.importers.traces.jobs import Job, Jobs
from halpipe.importers.traces.numbers import SCALES_NS, DecimalSign, instant, separator_of, whole
from halpipe.models.trace import NONE, Execution, Executions, Trace

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator

    from halpipe.core.diagnostics import Findings

T = TypeVar("T")

TIMES = ("start", "end", "busy")
_ALIASES = {"unit": "units", "table": "mode", "callback": "task", "core": "units"}
_LONG = {"callback_name": "task", "name": "task", "node": "task"}
_LONG |= {
    f"{way}{name}{form}": name for name in ("start", "end") for way in ("", "callback_") for form in ("_timestamp", "")
}
_START, _END = "/callback_start_timestamp", "/callback_end_timestamp"
_ABSENT = ("", "nan", "none", "<na>")
_CLOCKS = ("time", "timestamp", "timestamps", "t", "zeit")
_STATES = {"0": False, "1": True, "0.0": False, "1.0": True, "0,0": False, "1,0": True}
_MICRO = str.maketrans("\xb5\u03bc", "uu")
"""Both signs of micro; the Greek letter is what the other becomes in small letters of some systems."""
_UNITS_LINE = 3


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


def is_time(name: str) -> bool:
    """Whether a column without a unit in its name is one of instants or durations of jobs."""
    return _LONG.get(_plain(name), _plain(name)) in TIMES


def _columns(names: list[str]) -> dict[str, tuple[int, str]]:
    """Return position and unit of time of each column, by its plain name."""
    found: dict[str, tuple[int, str]] = {}
    for position, name in enumerate(names):
        full = _plain(name)
        plain, _, unit = _LONG.get(full, full).partition("_")
        if plain in TIMES and (unit or "ns") in SCALES_NS:
            found.setdefault(plain, (position, unit or "ns"))
        elif not unit:
            found.setdefault(_ALIASES.get(plain, plain), (position, ""))
    return found


def read(lines: Iterable[str], file: str, findings: Findings) -> list[Trace]:
    """Return the one line of time in the table."""
    executions = _executions(lines, file, findings)
    executions.sort()
    unfinished = executions.end.count(NONE)
    if unfinished:
        findings.add(codes.UNFINISHED(f"{unfinished} jobs have no end", at=Location(file)))
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
    rest = iter(lines)
    head = next((line for line in rest if line.strip()), "")
    separator = separator_of(head)
    rows = csv.reader(itertools.chain([head], rest), delimiter=separator)
    names = [name.strip() for name in next(rows)]
    scale, numbers = SCALES_NS[_clock(names[0]) or "s"], DecimalSign(separator)
    jobs, others = Jobs(file, findings), set[str]()
    for cells in rows:
        line = rows.line_num
        if not any(cells) or (line <= _UNITS_LINE and not any(c.isdigit() for c in cells[0])):
            continue
        try:
            at = instant(numbers.point(cells[0].strip()), scale)
        except ValueError as failure:
            help = "correct the row; times are whole or decimal numbers"
            findings.add(codes.BROKEN_ROW(str(failure), at=Location(file, line), help=help))
            continue
        for name, cell in zip(names[1:], cells[1:], strict=False):
            state = _STATES.get(cell.strip())
            if state is None and cell.strip():
                others.add(name)
            elif state and name not in jobs.running:
                jobs.running[name] = Job(name, "", at, line)
            elif state is False:
                jobs.end(name, at)
    report_signals(others, file, findings)
    found = [execution for execution in jobs.result() if execution.task not in others]
    return [Trace(name="", executions=tuple(found), is_shared=True)]


def report_signals(others: Collection[str], file: str, findings: Findings) -> None:
    """Report the signals that are no states of tasks."""
    if others:
        message = f"{len(others)} signals are not 0 or 1 only: {', '.join(sorted(others)[:5])}"
        findings.add(codes.LEFT_OUT(message, at=Location(file)))


def _executions(lines: Iterable[str], file: str, findings: Findings) -> Executions:
    rest = iter(lines)
    before = list(_up_to_header(rest))
    separator = separator_of(before[-1] if before else "")
    rows = csv.reader(itertools.chain(before, rest), delimiter=separator)
    filled = (cells for cells in rows if any(cell.strip() for cell in cells))
    executions, jobs, is_complete, absent = Executions(file), dict[Execution, None](), False, 0
    try:
        header = next(filled, [])
        columns, records = _columns(header), _records(header)
        row, is_complete = _Row(columns, file, DecimalSign(separator)), _is_complete(columns)
        for cells in filled:
            try:
                if is_complete:
                    executions.append(row.execution(cells, rows.line_num))
                else:
                    found = _recorded(records, cells, row.numbers, Location(file, rows.line_num))
                    jobs.update(dict.fromkeys(found))
                    absent += len(records) - len(found)
            except ValueError as failure:
                help = "correct the row; times are whole or decimal numbers"
                findings.add(codes.BROKEN_ROW(str(failure), at=Location(file, rows.line_num), help=help))
    except csv.Error as failure:
        findings.add(codes.BROKEN_ROW(str(failure), at=Location(file, rows.line_num), help="write plain CSV"))
    if absent:
        message = f"{absent} cells of records have no start: the message did not come so far, or was not recorded"
        findings.add(codes.LEFT_OUT(message, at=Location(file)))
    for job in jobs:
        executions.append(job)
    return executions


def _up_to_header(lines: Iterator[str]) -> Iterator[str]:
    """Yield lines up to the first that is not blank."""
    for line in lines:
        yield line
        if line.strip():
            return


def _recorded(
    records: dict[str, tuple[int, int]], cells: list[str], numbers: DecimalSign, at: Location
) -> list[Execution]:
    """Return the jobs of a row of CARET's records; rows of a path repeat a job for each message that it made."""
    found = []
    for name, places in records.items():
        start, end = (cells[place].strip() if place < len(cells) else "" for place in places)
        if start.lower() in _ABSENT:
            continue
        began = Duration(instant(numbers.point(start), 1))
        ended = None if end.lower() in _ABSENT else Duration(instant(numbers.point(end), 1))
        if ended is not None and ended < began:
            raise ValueError(f"{name} ends at {end}, before it starts")
        found.append(Execution(task=name, start=began, end=ended, at=at))
    return found


def _flag(text: str) -> bool:
    if text not in ("0", "1"):
        raise ValueError(f"data is {text[:20]!r}, neither 0 nor 1")
    return text == "1"


class _Row:
    """Reads the cells of a row by the names of their columns."""

    def __init__(self, columns: dict[str, tuple[int, str]], file: str, numbers: DecimalSign) -> None:
        self.columns = columns
        self.numbers = numbers
        self.file = file

    def execution(self, cells: list[str], line: int) -> Execution:
        task = self._cell(cells, "task")
        start = self._time(cells, "start")
        if not task or start is None:
            raise ValueError("the row has no task or no start")
        end = self._time(cells, "end")
        if end is not None and end < start:
            raise ValueError(f"ends at {cells[self.columns['end'][0]]}, before it starts")
        return Execution(
            task=task,
            units=tuple(self._cell(cells, "units").split()),
            start=start,
            end=end,
            busy=self._time(cells, "busy"),
            table=self._cell(cells, "mode"),
            cycle=self._optional(cells, "cycle", whole),
            job=self._optional(cells, "job", whole),
            has_data=self._optional(cells, "data", _flag),
            at=Location(self.file, line),
        )

    def _cell(self, cells: list[str], name: str) -> str:
        position, _ = self.columns.get(name, (len(cells), ""))
        return cells[position].strip() if position < len(cells) else ""

    def _time(self, cells: list[str], name: str) -> Duration | None:
        if name not in self.columns:
            return None
        scale = SCALES_NS[self.columns[name][1]]
        return self._optional(cells, name, lambda text: Duration(instant(self.numbers.point(text), scale)))

    def _optional(self, cells: list[str], name: str, read: Callable[[str], T]) -> T | None:
        text = self._cell(cells, name)
        return read(text) if text else None
