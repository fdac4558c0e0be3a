"""Traces as CSV: one row for each execution, columns by name.

Needed are ``task``, ``start`` and ``end``; known are also ``units`` (separated by blanks), ``mode``, ``cycle``,
``job`` and ``busy``. Times are nanoseconds, or as the name of the column says: ``start_us``. An empty end is that of a
job which still ran when the trace ended.
"""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING, TypeVar

from halpipe.diagnostics import Location
from halpipe.importers.traces import codes
from halpipe.importers.traces.numbers import SCALES_NS, instant, whole
from halpipe.models import Execution, Trace

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.diagnostics import Findings
    from halpipe.durations import Duration

T = TypeVar("T")

TIMES = ("start", "end", "busy")
_ALIASES = {"unit": "units", "table": "mode", "callback": "task", "core": "units"}


def is_header(line: str) -> bool:
    """Whether a line names the columns that are needed."""
    columns = _columns(line.split(","))
    return all(name in columns for name in ("task", "start", "end"))


def _columns(names: list[str]) -> dict[str, tuple[int, str]]:
    """Return position and unit of time of each column, by its plain name."""
    found: dict[str, tuple[int, str]] = {}
    for position, name in enumerate(names):
        plain, _, unit = name.strip().strip('"').lower().partition("_")
        if plain in TIMES and (unit or "ns") in SCALES_NS:
            found.setdefault(plain, (position, unit or "ns"))
        elif not unit:
            found.setdefault(_ALIASES.get(plain, plain), (position, ""))
    return found


def read(text: str, file: str, findings: Findings) -> list[Trace]:
    """Return the one line of time in the table."""
    rows = csv.reader(io.StringIO(text))
    row = _Row(_columns(next(rows)), file)
    executions = []
    try:
        for cells in rows:
            if not cells or (len(cells) == 1 and not cells[0].strip()):
                continue
            try:
                executions.append(row.execution(cells, rows.line_num))
            except ValueError as failure:
                help = "correct the row; times are whole or decimal numbers"
                findings.add(codes.BROKEN_ROW(str(failure), at=Location(file, rows.line_num), help=help))
    except csv.Error as failure:
        findings.add(codes.BROKEN_ROW(str(failure), at=Location(file, rows.line_num), help="write plain CSV"))
    executions.sort(key=lambda execution: execution.start.ns)
    unfinished = sum(execution.end is None for execution in executions)
    if unfinished:
        findings.add(codes.UNFINISHED(f"{unfinished} jobs have no end", at=Location(file)))
    return [Trace(name="", executions=tuple(executions))]


class _Row:
    """Reads the cells of a row by the names of their columns."""

    def __init__(self, columns: dict[str, tuple[int, str]], file: str) -> None:
        self.columns = columns
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
            at=Location(self.file, line),
        )

    def _cell(self, cells: list[str], name: str) -> str:
        position, _ = self.columns.get(name, (len(cells), ""))
        return cells[position].strip() if position < len(cells) else ""

    def _time(self, cells: list[str], name: str) -> Duration | None:
        if name not in self.columns:
            return None
        scale = SCALES_NS[self.columns[name][1]]
        return self._optional(cells, name, lambda text: instant(text, scale))

    def _optional(self, cells: list[str], name: str, read: Callable[[str], T]) -> T | None:
        text = self._cell(cells, name)
        return read(text) if text else None
