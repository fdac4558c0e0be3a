"""WCETs from measured durations: an exact order statistic of the samples, and a margin on top.

The quantile q of n samples is the smallest of them that at least q * n samples do not exceed: the one at rank
ceil(q * n), without interpolation; 1 is the maximum. It is an observation, not a bound: what was not measured may take
longer, which is what the margin is for.

Samples come from traces of every form that `compare` reads, and from two tables (CSV) without instants:

* one row for each execution: columns ``callback`` and ``duration``; the table of durations that ros2_tracing's analysis
  makes is of this form once a column names the callback;
* CARET's plots of latency as a data frame: a row of callback names above a row with ``latency [ms]``.

Durations are whole nanoseconds, as the clocks are that measured them: other values are rounded to the nearest one,
which undoes what floating-point milliseconds did to them.
"""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, Location, Severity, about
from halpipe.core.durations import Duration
from halpipe.core.files import read_bytes
from halpipe.core.quantities import format_rational
from halpipe.core.records import record
from halpipe.core.samples import quantile, with_margin
from halpipe.core.suggest import counted, did_you_mean, few
from halpipe.importers.ros import codes
from halpipe.importers.ros.graph import Callback, printable
from halpipe.importers.ros.traced import measure
from halpipe.importers.traces.codes import NO_EXECUTIONS, UNKNOWN_TRACE
from halpipe.importers.traces.ctf import folders
from halpipe.importers.traces.numbers import SCALES_NS, DecimalSign
from halpipe.importers.traces.read import parse_traces
from halpipe.importers.traces.ros2 import RosTrace, read_ros_trace
from halpipe.importers.traces.table import ABSENT, require_columns, rows_of
from halpipe.models import Origin, Task, TaskModel

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from halpipe.importers.common.base import Coverage
    from halpipe.importers.ros.options import RosImportOptions


FEWEST_SAMPLES = 10
"""With fewer executions than this, even the maximum says little."""


@record
class Estimate:
    """Estimate from the samples of a task: the WCET, the sample that decided it, and the words that say how."""

    wcet: Duration
    sample: Sample
    words: str
    count: int


def calibrate(
    model: TaskModel,
    tasks_of: Mapping[str, str],
    callbacks: Sequence[Callback],
    trace: RosTrace | None,
    options: RosImportOptions,
    findings: Findings,
    coverage: Coverage,
) -> TaskModel:
    """Return `model` with the WCETs that the files of `options.calibrate`, and the trace of the import, give.

    `tasks_of` has the task of every name that the files may use for it. Rows that cannot be read are errors.
    """
    if not options.calibrate and trace is None:
        return model
    measured = Measurements()
    if trace is not None:
        measure(trace, callbacks, measured, findings)
    for file in options.calibrate:
        if folders(file):
            measure(read_ros_trace(file, findings), callbacks, measured, findings)
        else:
            read_measured(read_bytes(file), file, measured, findings)
    findings.stop_on_errors()
    aliases = {**tasks_of, **{task.name: task.name for task in model.tasks}}
    first = trace.file if trace is not None else options.calibrate[0]
    samples = _by_task(measured, aliases, findings, coverage)
    tasks = tuple(_calibrated(task, samples.get(task.name, []), options, findings) for task in model.tasks)
    _report_unmeasured(model, samples, first, findings)
    return replace(model, tasks=tasks)


def estimate(samples: Sequence[Sample], share: Fraction, margin: Fraction) -> Estimate:
    """Return the WCET from at least one sample, rounded up to whole nanoseconds where a margin makes fractions."""
    sample = quantile(sorted(samples, key=lambda found: found.ns), share)
    how = "maximum" if share == 1 else f"quantile {format_rational(share)}"
    words = f"{how} of {len(samples)} sample{'s' if len(samples) > 1 else ''}"
    if margin:
        words += f", {Duration(sample.ns)}, with a margin of {format_rational(margin)} of it"
    return Estimate(with_margin(sample.ns, margin), sample, words, len(samples))


def _by_task(
    measured: Measurements, aliases: Mapping[str, str], findings: Findings, coverage: Coverage
) -> dict[str, list[Sample]]:
    samples: dict[str, list[Sample]] = {}
    strangers = []
    for callback, found in measured.samples.items():
        if callback in aliases:
            coverage.mapped("measured_callback")
            samples.setdefault(aliases[callback], []).extend(found)
        else:
            strangers.append(callback)
            coverage.ignored("measured_callback", callback, "no task has this name", found[0].at)
    if strangers:
        text = f"{len(strangers)} measured callbacks are no tasks: {few(strangers)}"
        help = did_you_mean(strangers[0], sorted(aliases), "use the names of callbacks or tasks")
        at = measured.samples[strangers[0]][0].at
        findings.add(codes.MEASURED_STRANGER(text, at=at, help=help))
    return samples


def _calibrated(task: Task, samples: Sequence[Sample], options: RosImportOptions, findings: Findings) -> Task:
    if not samples:
        return task
    path = about(task=task.name)
    found = estimate(samples, options.quantile, options.margin)
    at = found.sample.at
    several = len(task.versions) > 1 and any(version.wcet is not None for version in task.versions)
    if several or not found.wcet:
        reason = "it has several versions with WCETs" if several else "every sample that counts is zero"
        text, help = f"its measurements are not used: {reason}", "state its WCETs in an overlay"
        findings.add(codes.UNMEASURED(text, at=at, path=path, help=help))
        return task
    _report_few(found, options.quantile, path, findings)
    findings.add(codes.CALIBRATED(f"WCET {found.wcet}: {found.words}", at=at, path=path))
    origin = Origin(at.file, at.line, found.words)
    return replace(task, versions=tuple(replace(v, wcet=found.wcet, origin=origin) for v in task.versions))


def _report_few(found: Estimate, share: Fraction, path: str, findings: Findings) -> None:
    needed = FEWEST_SAMPLES if share == 1 else max(FEWEST_SAMPLES, math.ceil(1 / (1 - share)))
    if found.count < needed:
        effect = "" if share == 1 or math.ceil(share * found.count) < found.count else ", so it is the maximum"
        text = f"{found.words}: fewer than {needed}{effect}"
        help = "measure longer, or add a --margin"
        findings.add(codes.FEW_SAMPLES(text, at=found.sample.at, path=path, help=help))


def _report_unmeasured(model: TaskModel, samples: Mapping[str, object], file: str, findings: Findings) -> None:
    left = [t.name for t in model.tasks if t.name not in samples and any(v.wcet is None for v in t.versions)]
    if left:
        text = f"neither measured nor stated, the WCET of {counted(len(left), 'task')}: {few(left)}"
        help = "record them too, or state their WCETs in an overlay"
        findings.add(codes.UNMEASURED(text, at=Location(file), help=help, severity=Severity.NOTE))


_NAMES = ("callback", "callback_name", "task", "node", "name")
_DURATIONS = ("duration", "latency", "execution_time", "elapsed")
_COLUMN = re.compile(r"(?P<name>.*?)(?:[ _]?[\[(](?P<bracket>ns|us|ms|s)[\])]|_(?P<suffix>ns|us|ms|s))?")
_NUMBER = re.compile(r"-?[0-9]{1,30}(?:\.[0-9]{0,40})?(?:[eE][+-]?[0-9]{1,2})?")
_DECIMAL = re.compile(r"([0-9]{1,30})(?:\.([0-9]{1,40}))?")
_WITH_UNIT = re.compile(r"[0-9.]{1,60} ?(?:ns|us|ms|s)")
_TIMEDELTA = re.compile(r"(?:([0-9]{1,6}) days? )?([0-9]{1,3}):([0-9]{2}):([0-9]{2}(?:\.[0-9]{1,9})?)")
_FORM = "give it the columns callback and duration_ns, or export it from CARET as it is"


@record
class Sample:
    """One execution: its duration in nanoseconds, and where it stands."""

    ns: int
    at: Location


@dataclass(slots=True)
class Measurements:
    """All executions by callback, in the order of the files."""

    samples: dict[str, list[Sample]] = field(default_factory=dict)

    def add(self, callback: str, ns: int, at: Location) -> None:
        """Record one execution."""
        self.samples.setdefault(callback, []).append(Sample(ns, at))


@record
class _Column:
    """A column of durations: its callback, or the column that names it, and the nanoseconds of its unit."""

    callback: str | None
    name: int
    position: int
    scale: int


def read_measured(data: bytes, file: str, into: Measurements, findings: Findings) -> None:
    """Add the executions of one file; raise `HalpipeError` if it has none, add findings for rows that are broken."""
    if _read_durations(data, file, into, findings):
        return
    try:
        recording = parse_traces(data, file)
    except HalpipeError as failure:
        unknown = (UNKNOWN_TRACE.id, NO_EXECUTIONS.id)
        raise HalpipeError(
            *(
                codes.NO_MEASUREMENTS(found.message, at=found.at, help=_FORM) if found.code in unknown else found
                for found in failure.diagnostics
            )
        ) from None
    findings.extend(recording.diagnostics)
    for execution in (one for trace in recording.traces for one in trace.executions if one.end is not None):
        took = execution.busy or execution.end - execution.start  # type: ignore[operator]
        into.add(printable(execution.task), _nearest(took.fraction), execution.at)


def _read_durations(data: bytes, file: str, into: Measurements, findings: Findings) -> bool:
    """Read a table of durations; return False for what is none."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as failure:
        if b"\0" in data:  # a binary trace
            return False
        text, line = f"byte {failure.start} is no UTF-8", data[: failure.start].count(b"\n") + 1
        raise HalpipeError(codes.NO_MEASUREMENTS(text, at=Location(file, line), help=_FORM)) from None
    rows, sign = rows_of(text.splitlines(keepends=True))
    filled = (cells for cells in rows if any(cell.strip() for cell in cells))
    try:
        header: list[str] = next(filled, [])
        columns = _long(header) or _caret_frames(header, next(filled, []))
    except csv.Error:
        return False
    try:
        for cells in filled if columns else ():
            at = Location(file, rows.line_num)
            require_columns(cells, len(header), at, findings)
            for column in columns:
                _take(column, cells, sign, at, into, findings)
    except csv.Error as failure:
        raise HalpipeError(codes.NO_MEASUREMENTS(str(failure), at=Location(file, 1), help=_FORM)) from None
    return bool(columns)


# -------------------------------------------------------------------------------------------------- headers


def _column(text: str) -> tuple[str, int]:
    """Return the plain name of a column, and how many nanoseconds its unit has."""
    match = _COLUMN.fullmatch(text.strip())
    if match is None:
        return text.strip(), 1
    return match["name"].strip(), int(SCALES_NS[match["bracket"] or match["suffix"] or "ns"])


def _long(header: Sequence[str]) -> list[_Column]:
    columns: dict[str, tuple[int, int]] = {}
    for position, (column, scale) in enumerate(map(_column, header)):
        columns.setdefault(column.lower().replace(" ", "_"), (position, scale))
    name, duration = (
        next((columns[known] for known in group if known in columns), None) for group in (_NAMES, _DURATIONS)
    )
    return [] if name is None or duration is None else [_Column(None, name[0], *duration)]


def _caret_frames(names: Sequence[str], header: Sequence[str]) -> list[_Column]:
    found = []
    for position, (callback, text) in enumerate(zip(names, header, strict=False)):
        name, scale = _column(text)
        if callback.strip() and name.lower() in _DURATIONS:
            found.append(_Column(printable(callback), -1, position, scale))
    return found


# ----------------------------------------------------------------------------------------------------- rows


def _take(
    column: _Column, cells: Sequence[str], sign: DecimalSign, at: Location, into: Measurements, findings: Findings
) -> None:
    callback = column.callback or printable(_cell(cells, column.name))
    text = _cell(cells, column.position)
    if text.lower() in ABSENT:
        if column.callback is None:
            findings.add(codes.BAD_SAMPLE("the row has no callback or no duration", at=at, help="complete the row"))
        return
    try:
        duration = _nanoseconds(sign.point(text), column.scale)
    except ValueError as failure:
        findings.add(codes.BAD_SAMPLE(str(failure), at=at, path=_path(callback), help="correct the row"))
        return
    if duration < 0 or not callback:
        what = f"lasts {duration}ns" if callback else "the row names no callback"
        findings.add(codes.BAD_SAMPLE(what, at=at, path=_path(callback), help="correct or remove the row"))
        return
    into.add(callback, duration, at)


def _cell(cells: Sequence[str], position: int) -> str:
    return cells[position].strip() if 0 <= position < len(cells) else ""


def _path(callback: str) -> str:
    return f'callback "{callback}"' if callback else ""


def _nanoseconds(text: str, scale: int) -> int:
    """Return a time rounded to whole nanoseconds: a number, a duration with its unit, or pandas' 0 days 00:00:00.1."""
    if decimal := _DECIMAL.fullmatch(text):  # most tables are of these, and a Fraction takes its time
        digits = decimal[2] or ""
        parts = int(10 ** len(digits))
        return (2 * int(decimal[1] + digits) * scale + parts) // (2 * parts)
    if _NUMBER.fullmatch(text):
        return _nearest(Fraction(text) * scale)
    if match := _TIMEDELTA.fullmatch(text):
        days, hours, minutes, seconds = match.groups()
        whole = (int(days or 0) * 24 + int(hours)) * 60 + int(minutes)
        return _nearest((whole * 60 + Fraction(seconds)) * 10**9)
    if _WITH_UNIT.fullmatch(text):
        return _nearest(Duration.parse(text).fraction)
    raise ValueError(f"{text[:40]!r} is no duration")


def _nearest(value: Fraction) -> int:
    return math.floor(value + Fraction(1, 2))
