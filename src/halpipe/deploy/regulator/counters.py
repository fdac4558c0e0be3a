"""Bandwidth counters of a board, compared with the timeline that a bundle of regulators promises and grants.

A row of the CSV is what one unit moved in one direction in an interval: `unit`, `direction`, `bytes`, and `window` (of
its table) or `start` and `end` from the begin of the table on, in nanoseconds or as the column says (``start_us``).
`table` names the mode or the switch (``a->b``); with one table it may be left out. Modes repeat; a switch does not.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING, TypeVar

from halpipe.core.diagnostics import Diagnostic, HalpipeError, Location, sort_diagnostics
from halpipe.core.grouping import grouped
from halpipe.core.quantities import parse_rational, quoted
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.deploy.regulator.arithmetic import RATES, Arithmetic, Planned
from halpipe.deploy.regulator.codes import BROKEN_COUNTERS, USED_ABOVE_BUDGET, USED_ABOVE_CAPACITY
from halpipe.deploy.regulator.promise import ZERO, promised_bursts
from halpipe.deploy.regulator.reading import DIRECTIONS, Table, Tables, Unit, read_tables

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from fractions import Fraction

    from halpipe.deploy.base import Target

T = TypeVar("T")

SCALES = {"ns": 1, "us": 10**3, "ms": 10**6, "s": 10**9}
COLUMNS = ("unit", "direction", "bytes", "window", "start", "end", "table")
MOST_WINDOWS = 2**20
"""Windows that one row may span."""


@record
class Sample:
    """Bytes that a unit moved in a direction, in [start, end) nanoseconds from the begin of a table; and its line."""

    table: Table
    unit: Unit
    direction: str
    start: Fraction
    end: Fraction
    used: int
    line: int


@dataclass(slots=True)
class Usage:
    """Bytes of one table, unit and direction, over all samples."""

    samples: int = 0
    promised: Fraction = ZERO
    granted: int = 0
    used: int = 0


@record
class Counted:
    """The findings, and the bytes by table, unit and direction."""

    diagnostics: tuple[Diagnostic, ...]
    usage: Mapping[tuple[str, str, str], Usage]


def compare_counters(target: Target, text: str, file: str, mode: str = "") -> Counted:
    """Hold counters against the budgets of a bundle; rows without a table are of `mode`.

    Raise `HalpipeError` where the bundle itself is wrong, has no budgets for windows, or the file has no columns.
    """
    tables = read_tables(target.bundle)
    if tables.backend in RATES:
        help = "use a bundle of the back-end table or axi-realm: others grant rates, and no bytes in windows"
        raise HalpipeError(
            BROKEN_COUNTERS(f"{tables.backend} has no budgets", at=target.bundle.at("tables.json"), help=help)
        )
    arithmetic = Arithmetic(target, tables)
    wrong = list(arithmetic.findings())
    if wrong:
        raise HalpipeError(*sort_diagnostics(wrong))
    findings: list[Diagnostic] = []
    samples = list(_Reader(tables, file, mode).samples(text, findings))
    judge = Judge(tables, {plan.table.index: plan for plan in arithmetic.planned})
    findings += [*judge.rows(samples, file), *judge.sums(samples, file)]
    return Counted(tuple(sort_diagnostics(findings)), judge.usage)


# ------------------------------------------------------------------------------------------------ reading


class _Reader:
    """Reads rows; each that cannot be used is a finding."""

    def __init__(self, tables: Tables, file: str, mode: str) -> None:
        self._file = file
        self._tables = {table.name: table for table in tables.tables}
        self._units = {unit.name: unit for unit in tables.units}
        self._mode = mode or (tables.tables[0].name if len(tables.tables) == 1 else "")
        self._window = tables.platform.window_ns
        self._scales: dict[str, int] = {}

    def samples(self, text: str, findings: list[Diagnostic]) -> Iterator[Sample]:
        rows = csv.reader(io.StringIO(text, newline=""))
        try:
            self._header(next(rows, []))
            for cells in rows:
                row = dict(zip(self._scales, (cell.strip() for cell in cells), strict=False))
                if not any(row.values()):
                    continue
                try:
                    yield self._sample(row, rows.line_num)
                except ValueError as failure:
                    at, help = Location(self._file, rows.line_num), "correct the row, or leave it out"
                    findings.append(BROKEN_COUNTERS(str(failure), at=at, help=help))
        except csv.Error as failure:
            findings.append(
                BROKEN_COUNTERS(str(failure), at=Location(self._file, rows.line_num), help="write plain CSV")
            )

    def _header(self, names: Sequence[str]) -> None:
        for name in names:
            plain, _, scale = name.strip().lower().partition("_")
            known = plain in COLUMNS and (not scale or (plain in ("start", "end") and scale in SCALES))
            if not known or plain in self._scales:
                help = did_you_mean(name, COLUMNS, "known are " + ", ".join(COLUMNS) + "; start_us, end_us and so on")
                text = f"the column {quoted(name)} is {'there twice' if known else 'not known'}"
                raise HalpipeError(BROKEN_COUNTERS(text, at=Location(self._file, 1), help=help))
            self._scales[plain] = SCALES[scale or "ns"]
        lacking = [name for name in ("unit", "direction", "bytes") if name not in self._scales]
        if "window" not in self._scales:
            lacking += [name for name in ("start", "end") if name not in self._scales]
        if lacking:
            text, help = (
                f"lacks the columns {', '.join(lacking)}",
                "name them in the first line; window stands for start and end",
            )
            raise HalpipeError(BROKEN_COUNTERS(text, at=Location(self._file, 1), help=help))

    def _sample(self, row: Mapping[str, str], line: int) -> Sample:
        table = self._one_of("table", self._tables, row.get("table", "") or self._mode)
        unit = self._one_of("unit", self._units, row.get("unit", ""))
        direction = self._one_of("direction", {name: name for name in DIRECTIONS}, row.get("direction", ""))
        if row.get("window", ""):
            start = _whole("window", row.get("window", "")) * self._window
            end = start + self._window
        else:
            start, end = (parse_rational(row.get(name, "")) * self._scales[name] for name in ("start", "end"))
        if start >= end:
            raise ValueError(f"the interval from {start} to {end} ns is empty")
        if not table.successor == table.index and end > table.windows * self._window:
            raise ValueError(f'ends at {end} ns; the table "{table.name}" is {table.windows * self._window} ns long')
        if (end - start) / self._window > MOST_WINDOWS:
            raise ValueError(f"the interval has more than {MOST_WINDOWS} windows; give shorter ones")
        return Sample(table, unit, direction, start, end, _whole("bytes", row.get("bytes", "")), line)

    def _one_of(self, what: str, known: Mapping[str, T], text: str) -> T:
        if text not in known:
            raise ValueError(
                f"there is no {what} {quoted(text)}; {did_you_mean(text, known, 'known are ' + ', '.join(known))}"
            )
        return known[text]


def _whole(what: str, text: str) -> int:
    if not (text.isascii() and text.isdecimal() and len(text) <= 18):
        raise ValueError(f"{what} is {quoted(text)}, not a whole number")
    return int(text)


# ------------------------------------------------------------------------------------------------ judging


class Judge:
    """Holds samples against the windows that they touch, exactly."""

    def __init__(self, tables: Tables, plans: Mapping[int, Planned]) -> None:
        self.usage: dict[tuple[str, str, str], Usage] = {}
        self._tables, self._plans = tables, plans
        self._budgets: dict[tuple[int, str, str], list[int]] = {}
        self._volumes: dict[tuple[int, str, str], tuple[list[int], int]] = {}

    def rows(self, samples: Sequence[Sample], file: str) -> Iterator[Diagnostic]:
        """Yield samples above what could pass: the budgets of the windows, and a burst that was waiting before them."""
        for sample in samples:
            granted, most = self.limits(sample)
            usage = self.usage.setdefault((sample.table.name, sample.unit.name, sample.direction), Usage())
            usage.samples += 1
            usage.promised += self.promised(sample)
            usage.granted += granted
            usage.used += sample.used
            if sample.used > most:
                text = f"{sample.used} B were used {_when(sample)}; budgets are {granted} B, at most {most} B can pass"
                path = f'table "{sample.table.name}", unit "{sample.unit.name}", {sample.direction}'
                help = (
                    "is the regulator in front of this unit, started with the table, and are its bursts short enough?"
                )
                yield USED_ABOVE_BUDGET(text, at=Location(file, sample.line), path=path, help=help)

    def sums(self, samples: Sequence[Sample], file: str) -> Iterator[Diagnostic]:
        """Yield intervals in which all that were counted together are above the capacity."""
        for several in grouped(((sample.table.index, sample.start, sample.end), sample) for sample in samples).values():
            first = several[0]
            total = sum(sample.used for sample in several)
            most = len(self._windows(first)) * self._tables.platform.capacity_bytes
            if total > most:
                text = f"{total} B were used by all {_when(first)}; the capacity is {most} B"
                help = "measure the capacity of the memory, or look for a manager that is not regulated"
                path = f'table "{first.table.name}"'
                yield USED_ABOVE_CAPACITY(text, at=Location(file, first.line), path=path, help=help)

    def _windows(self, sample: Sample) -> range:
        width = self._tables.platform.window_ns
        return range(sample.start // width, ceil(sample.end / width))

    def limits(self, sample: Sample) -> tuple[int, int]:
        """Return the budgets of the windows that a sample touches, and the most that can pass in them."""
        key = (sample.table.index, sample.unit.name, sample.direction)
        if key not in self._budgets:
            self._budgets[key] = sample.table.budgets(sample.unit.name, sample.direction)
        budgets, windows = self._budgets[key], self._windows(sample)
        granted = sum(budgets[window % len(budgets)] for window in windows)
        over = sample.unit.overshoot[sample.direction] * len(windows)
        waiting = max(0, self._tables.platform.burst_bytes - budgets[windows[0] % len(budgets)])
        return granted, granted + over + (waiting if self._had(sample, windows[0], budgets) else 0)

    def _had(self, sample: Sample, window: int, budgets: Sequence[int]) -> bool:
        if window:
            return budgets[(window - 1) % len(budgets)] > 0
        before = self._tables.before(sample.table)
        return any(table.entries[sample.unit.name][-1].budget(sample.direction) for table in before)

    def promised(self, sample: Sample) -> Fraction:
        """Return the bytes that the schedule promises in an interval; linear within windows that it cuts."""
        key = (sample.table.index, sample.unit.name, sample.direction)
        if key not in self._volumes:
            plan = self._plans[sample.table.index]
            phases = plan.timeline.by_row().get((sample.unit.name, sample.direction), [])
            self._volumes[key] = promised_bursts(plan.timeline, self._tables.platform, phases, sample.table.windows)
        volumes, scale = self._volumes[key]
        width, burst = self._tables.platform.window_ns, self._tables.platform.burst_bytes

        def until(instant: Fraction) -> Fraction:
            turns, rest = divmod(instant / width, len(volumes) - 1)
            window = rest // 1
            inside = (rest - window) * (volumes[window + 1] - volumes[window])
            return (turns * volumes[-1] + volumes[window] + inside) * burst / scale

        return until(sample.end) - until(sample.start)


def _when(sample: Sample) -> str:
    return f"from {sample.start} to {sample.end} ns"
