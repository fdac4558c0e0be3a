"""Recorded executions of a simulation, a board or a Linux system, kept as columns of integers.

A recording of ten million events has more jobs than fit into memory as objects: a row of the columns takes about 60
bytes, and an `Execution` is made of it where one is looked at.
"""

from __future__ import annotations

from array import array
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from halpipe.core.diagnostics import NOWHERE, Location
from halpipe.core.durations import Duration
from halpipe.core.records import record

if TYPE_CHECKING:
    from fractions import Fraction

    Instant = int | Fraction
    """Nanoseconds on the clock of the trace."""
    Times = array[int] | list[int | Fraction]

Column: TypeAlias = "np.ndarray[Any, Any]"
"""Numbers that are computed with at once: of 64 bits, or objects where some are fractions or large."""

NONE = -(2**63)
"""What stands in a column of numbers for a value that the trace does not state."""
_LARGE = 2**61
"""Instants below have sums and differences of three within 64 bits."""


def column(values: Sequence[Instant]) -> Column:
    """Return numbers as a column on which sums and differences are exact; a copy only where that needs objects."""
    if isinstance(values, array):
        found = np.asarray(values)
        if not ((found >= _LARGE) | ((found <= -_LARGE) & (found != NONE))).any():
            return found
    elif all(type(value) is int and -_LARGE < value < _LARGE for value in values):
        return np.array(values, dtype=np.int64)
    found = np.empty(len(values), dtype=object)
    found[:] = values
    return found


def plain(value: Any) -> Any:
    """Return an element of a column as a number of Python."""
    return value.item() if isinstance(value, np.generic) else value


def groups(numbers: Column) -> Iterator[tuple[int, Column]]:
    """Yield each number of a column, from 0 on, with its places in order."""
    if numbers.size and numbers.max() < 2**15:
        numbers = numbers.astype(np.int16)  # which are sorted faster
    order = np.argsort(numbers, kind="stable")
    for places in np.split(order, np.flatnonzero(np.diff(numbers[order])) + 1):
        if places.size:
            yield int(numbers[places[0]]), places


@record
class BoundCallback:
    """The ROS callback of a task: `kind` timer or subscription, `topic` of a subscription, `period` of a timer in ns.

    `order` counts equal ones of the node in their order of construction; `group` is its callback group, empty where
    the graph does not tell; `longest` its longest traced job in ns, or 0.
    """

    node: str
    kind: str
    topic: str = ""
    period: int = 0
    order: int = 0
    group: str = ""
    longest: int = 0


@record(kw_only=True)
class Execution:
    """One job as it was seen: from the first instant at which it ran to the last, on the clock of the trace.

    `busy` is the time in which it really ran, less than `end` - `start` where it was preempted. `end` and `busy` are
    None for what still ran when the trace ended. `table` (a mode, or ``a->b`` for the switch), `cycle` (tables
    played, from 0) and `job` (index in the table) are stated by some traces; empty or None by the others. `stretches`
    are the intervals in which it ran, of a job that paused, where the trace tells. `has_data` is false for a job for
    which there was no message, None where the trace does not tell. `planned` is the instant at which the recorder
    states that the job is due.
    """

    task: str
    units: tuple[str, ...] = ()
    start: Duration
    end: Duration | None
    busy: Duration | None = None
    table: str = ""
    cycle: int | None = None
    job: int | None = None
    stretches: tuple[tuple[Duration, Duration], ...] = ()
    has_data: bool | None = None
    planned: Duration | None = None
    at: Location = field(default=NOWHERE, compare=False, repr=False)


class Executions(Sequence[Execution]):
    """Executions as columns; `order` has the rows by their start. Columns of times are lists where some are fractions.

    `task` and `table` are numbers of `names`, `on` those of `units`. Few traces state `job`, `planned` and `has_data`,
    few jobs have `stretches`: these are kept by row.
    """

    def __init__(self, file: str = "") -> None:
        self.file = file
        self.names: list[str] = []
        self.units: list[tuple[str, ...]] = []
        self.task, self.on, self.table = array("i"), array("i"), array("i")
        self.line, self.cycle = array("q"), array("q")
        self.start: Times = array("q")
        self.end: Times = array("q")
        self.busy: Times = array("q")
        self.job: dict[int, int] = {}
        self.planned: dict[int, Instant] = {}
        self.has_data: dict[int, bool] = {}
        self.stretches: dict[int, tuple[tuple[Instant, Instant], ...]] = {}
        self.order: Column = np.arange(0)
        self._numbers: dict[Hashable, int] = {}

    @classmethod
    def of(cls, executions: Iterable[Execution]) -> Executions:
        """Return the columns of executions."""
        found = executions if isinstance(executions, cls) else cls()
        if found is not executions:
            for each in executions:
                found.append(each)
            found.sort()
        return found

    def copy(self) -> Executions:
        """Return columns with names and units of their own; the numbers are shared until they are replaced."""
        found = Executions(self.file)
        vars(found).update(vars(self))
        vars(found).update({name: copy(vars(self)[name]) for name in ("names", "units", "_numbers")})
        return found

    def detach(self) -> None:
        """Copy what joins of executions change."""
        vars(self).update({name: copy(vars(self)[name]) for name in ("on", "start", "end", "busy", "stretches")})

    def rename(self, names: Mapping[int, str]) -> None:
        """Give tasks other names, by the numbers of those of before."""
        numbers = np.arange(len(self.names), dtype=np.int32)
        numbers[[*names]] = [self.number(name) for name in names.values()]
        self.task = array("i", numbers[np.asarray(self.task)].tobytes())

    def __len__(self) -> int:
        return len(self.order)

    def __getitem__(self, index: Any) -> Any:
        rows = self.order[index]
        return [self.row(row) for row in rows] if isinstance(index, slice) else self.row(rows)

    def row(self, row: int) -> Execution:
        """Return the execution in a row."""
        end, busy, cycle = self.end[row], self.busy[row], self.cycle[row]
        planned = self.planned.get(row)
        return Execution(
            task=self.names[self.task[row]],
            units=self.units[self.on[row]],
            start=Duration(self.start[row]),
            end=None if end == NONE else Duration(end),
            busy=None if busy == NONE else Duration(busy),
            table=self.names[self.table[row]],
            cycle=None if cycle == NONE else cycle,
            job=self.job.get(row),
            stretches=tuple((Duration(a), Duration(b)) for a, b in self.stretches.get(row, ())),
            has_data=self.has_data.get(row),
            planned=None if planned is None else Duration(planned),
            at=Location(self.file, self.line[row]),
        )

    def number(self, name: str) -> int:
        """Return the number of the name of a task or table."""
        found = self._numbers.get(name)
        if found is None:
            found = self._numbers[name] = len(self.names)
            self.names.append(name)
        return found

    def add(
        self,
        task: str,
        units: tuple[str, ...],
        start: Instant,
        end: Instant | None,
        busy: Instant | None,
        line: int = 0,
        table: str = "",
        cycle: int | None = None,
    ) -> int:
        """Add an execution, with `end` and `busy` of None if it still runs; return its row."""
        row, known = len(self.task), self._numbers
        self.task.append(known[task] if task in known else self.number(task))
        self.on.append(known[units] if units in known else self._on(units))
        self.line.append(line)
        self.table.append(known[table] if table in known else self.number(table))
        self.cycle.append(NONE if cycle is None else cycle)
        times = (start, NONE if end is None else end, NONE if busy is None else busy)
        try:
            self.start.append(times[0])  # type: ignore[arg-type]
            self.end.append(times[1])  # type: ignore[arg-type]
            self.busy.append(times[2])  # type: ignore[arg-type]
        except (TypeError, OverflowError):
            columns = self.start, self.end, self.busy
            self.start, self.end, self.busy = ([*c[:row], v] for c, v in zip(columns, times, strict=True))
        return row

    def run_on(self, row: int, units: tuple[str, ...]) -> None:
        """Let an execution be on some units."""
        self.on[row] = self._on(units)

    def _on(self, units: tuple[str, ...]) -> int:
        on = self._numbers.get(units)
        if on is None:
            on = self._numbers[units] = len(self.units)
            self.units.append(units)
        return on

    def append(self, each: Execution) -> None:
        """Add an execution with all that is known of it."""
        end, busy = (None if time is None else time.ns for time in (each.end, each.busy))
        self.file = self.file or each.at.file
        row = self.add(each.task, each.units, each.start.ns, end, busy, each.at.line or 0, each.table, each.cycle)
        planned = None if each.planned is None else each.planned.ns
        stretches = tuple((a.ns, b.ns) for a, b in each.stretches) or None
        for name, value in (
            ("job", each.job),
            ("planned", planned),
            ("has_data", each.has_data),
            ("stretches", stretches),
        ):
            if value is not None:
                getattr(self, name)[row] = value

    def extend(self, others: Executions) -> None:
        """Add the executions of another recording, as far as columns have them."""
        rows, places = others.order, {row: len(self.task) + place for place, row in enumerate(others.order.tolist())}
        task, on, line = (np.asarray(each)[rows] for each in (others.task, others.on, others.line))
        start, end, busy = (column(each)[rows] for each in (others.start, others.end, others.busy))
        self.add_all(others.names, others.units, task=task, on=on, start=start, end=end, busy=busy, line=line)
        self.stretches |= {places[row]: found for row, found in others.stretches.items() if row in places}

    def add_all(self, names: Sequence[str], units: Sequence[tuple[str, ...]], **columns: Column) -> None:
        """Add executions by columns; tasks and units are numbers of the given ones."""
        count = len(columns["task"])
        for name, given, number in (("task", names, self.number), ("on", units, self._on)):
            used, inverse = np.unique(columns[name], return_inverse=True)
            columns[name] = np.array([number(given[of]) for of in used], dtype=np.int32)[inverse]
        columns |= {"table": np.full(count, self.number(""), dtype=np.int32), "cycle": np.full(count, NONE)}
        for name, values in columns.items():
            known = getattr(self, name)
            if values.dtype == object or not isinstance(known, array):
                setattr(self, name, [*known, *values.tolist()])
            else:
                known.frombytes(values.tobytes())

    def sort(self) -> None:
        """Order the rows by their start and line."""
        order = np.argsort(np.asarray(self.line), kind="stable")
        self.order = order[np.argsort(column(self.start)[order], kind="stable")]


@record(kw_only=True)
class Trace:
    """The executions on one line of time, by start; `name` tells the lines of one recording apart.

    `is_shared`: it shows all programs of a computer, of which the schedule has some.
    """

    name: str
    executions: Sequence[Execution]
    is_shared: bool = False
