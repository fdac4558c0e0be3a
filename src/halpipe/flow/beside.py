"""Second rows of charts: the worst cycle of each table in a trace, or another schedule."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Exit, Findings, HalpipeError, Severity, about, error, warning
from halpipe.core.durations import ZERO, Duration
from halpipe.core.suggest import counted
from halpipe.exporters.common.timeline import Placement, Window, shows_context, unroll, unroll_switch
from halpipe.exporters.report.beside import Beside, Seen, Spread, Strip
from halpipe.models.trace import NONE, Executions
from halpipe.pipeline.compare import CompareOptions, Comparison, compare, is_stated
from halpipe.pipeline.compare.codes import Kind
from halpipe.pipeline.compare.histograms import histograms
from halpipe.pipeline.compare.judging import Judge, Scope

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.exporters.report import ReportOptions
    from halpipe.models import Job, Schedule, TaskModel
    from halpipe.models.trace import Instant
    from halpipe.pipeline.compare.matching import Matching
    from halpipe.pipeline.compare.tables import Due

DEVIATES = warning(
    "HAL1475",
    "Trace or schedule under the report deviates",
    "The trace of `--trace`, or the schedule of `--against`, differs from the schedule of the report. The report marks "
    "and lists where; `halpipe compare` and `halpipe diff` do so in the terminal.",
)
NOT_COMPARABLE = error(
    "HAL1476",
    "Nothing can be drawn under the schedule",
    "The trace has no job of the schedule, or the other schedule is of another model or has cycles of another length.",
)

Drawn = dict[str, tuple[Window, list["Placement"]]]


def with_beside(
    model: TaskModel, schedule: Schedule, options: ReportOptions
) -> tuple[ReportOptions, tuple[Diagnostic, ...]]:
    """Return the options of a report with what is drawn under its jobs, and what the user should know of it."""
    if options.trace:
        beside, remarks = _run(model, schedule, options)
    else:
        from halpipe.importers.native import read_schedule

        other = read_schedule(options.against)
        beside, remarks = against(model, schedule, other, options.against, options.mode), []
    if beside.found:
        message = f"{counted(len(beside.found), 'deviation')} from the schedule, first: {beside.found[0]}"
        remarks.append(DEVIATES(message, path=beside.name, help="they are marked and listed in the report"))
    return replace(options, beside=beside), tuple(remarks)


def _drawn(schedule: Schedule, *, context: bool) -> Drawn:
    """Return the window and the jobs of each chart by the name of its table."""
    found: Drawn = {mode.name: (Window(ZERO, mode.hyperperiod), unroll(mode)) for mode in schedule.modes}
    for switch in schedule.transitions:
        around = schedule.mode(switch.source), schedule.mode(switch.target)
        found[switch.name] = unroll_switch(switch, *around, context=context)
    return found


# ------------------------------------------------------------------------------------------------ a recorded run


def _run(model: TaskModel, schedule: Schedule, options: ReportOptions) -> tuple[Beside, list[Diagnostic]]:
    from halpipe.importers.traces import read_traces

    recording = read_traces(options.trace)
    findings = Findings(list(recording.diagnostics))
    findings.stop_on_errors()
    lines = []
    for trace in recording.traces:
        # A trace that names its tables needs no mode: one that is stated only selects what is drawn.
        executions = Executions.of(trace.executions)
        mode = "" if executions and is_stated(executions) else options.mode
        asked = CompareOptions(mode=mode, tolerance=options.tolerance, origin=options.origin)
        lines.append(compare(schedule, trace, asked, model))
    if not any(len(line.ran.row) for line in lines):
        help = "give a recording of this schedule; `halpipe compare` says what it has"
        raise HalpipeError(NOT_COMPARABLE("the trace has no job of the schedule", path=options.trace, help=help))
    windows = {name: window for name, (window, _) in _drawn(schedule, context=shows_context(schedule)).items()}
    units = {unit.name for unit in model.units}
    strips = {
        name: _Cycle(lines[-found[0][2]], -found[0][3], windows[name], options.tolerance, units).strip(len(found))
        for name, found in _worst_cycles(lines).items()
        if name in windows
    }
    found = [d for line in lines for d in line.diagnostics]
    findings.extend(d for d in found if d.severity is Severity.NOTE)
    listed = tuple(f"{d.path}: {d.message}" for d in found if d.severity is not Severity.NOTE)
    absent = "The trace has no cycle of this table."
    spreads = tuple(
        Spread(h.task, h.figure, str(h.least), str(h.worst), str(h.width), h.counts)
        for line in lines
        for h in histograms(line, model)
    )
    return Beside(options.trace, strips, listed, absent, spreads), [*findings.items]


def _worst_cycles(lines: Sequence[Comparison]) -> dict[str, list[tuple[int, int, int, int]]]:
    """Return the cycles of each table, first the one with the most deviations, of equals that with the most jobs.

    A cycle is its deviations, its jobs with those before, and the numbers of its comparison and its line, both negative
    so that the first of equals comes first.
    """
    cycles: dict[str, list[tuple[int, int, int, int]]] = defaultdict(list)
    for number, comparison in enumerate(lines):
        played, before = comparison.matching.lines, ""
        for line, table in enumerate(played.table):
            # With the cycle before, since jobs that wrap are drawn, too.
            slots = comparison.matching.slots[played.slot[max(0, line - 1)] : played.slot[line + 1]]
            jobs, found = int((slots >= 0).sum()), int(comparison.by_line[line])
            # A switch of length zero is no line of its own.
            for name in (table.name, f"{before}->{table.name}"):
                if jobs or found:
                    cycles[name].append((found, jobs, -number, -line))
            before = table.name
    return {name: sorted(found, reverse=True) for name, found in cycles.items()}


class _Cycle:
    """Everything that ran while one table was played, relative to the start of it."""

    def __init__(self, comparison: Comparison, line: int, window: Window, tolerance: Duration, units: set[str]) -> None:
        self.matching: Matching = comparison.matching
        self.line, self.units, self.tolerance = line, units, tolerance
        self.deviations = int(comparison.by_line[line])
        self.zero = self.matching.lines.start[line] + self.matching.origin
        self.low, self.high = self.zero + window.start.ns, self.zero + window.end.ns

    def strip(self, played: int) -> Strip:
        """Return the boxes of the cycle, the worst of those that were `played`."""
        seen, lines = self.matching.executions, self.matching.lines
        extra = set(self.matching.extra.tolist())
        rows = [row for row in seen.order.tolist() if self._shows(seen.start[row], seen.end[row])]
        own = [row for row in rows if self.matching.slot[row] >= 0]
        marks = Judge(self.tolerance, "", Scope()).mark(self.matching, own)
        boxes = [box for row in own for box in self._boxes(row, marks.get(row, []))]
        boxes += [box for row in rows if row in extra for box in self._extra(row)]
        boxes += [box for slot in self.matching.missing.tolist() for box in self._missing(*self.matching.at(slot))]
        many = f", the one of {played} with the most deviations" if played > 1 else ""
        when = f"from {Duration(self.zero)} of the trace on"
        count = counted(self.deviations, "deviation")
        return Strip(tuple(boxes), f"Cycle {lines.cycle[self.line]}{many}, {when}: {count}.")

    def _shows(self, start: Instant, end: Instant) -> bool:
        return start < self.high and (end == NONE or end > self.low or start >= self.low)

    def _at(self, instant: Instant) -> Duration:
        return Duration(instant - self.zero)

    def _boxes(self, row: int, marks: list[tuple[Kind, Instant, str]]) -> Iterator[Seen]:
        match, seen = self.matching.match(row), self.matching.executions
        job, start = match.job, seen.start[row]
        end = self.high if seen.end[row] == NONE else seen.end[row]
        title = _title(job.task, job.index, self._at(start), self._at(end), [text for _, _, text in marks])
        units = self._on(match.execution.units) or job.units
        for low, high in seen.stretches.get(row) or ((start, end),):
            yield Seen(job.task, units, self._at(low), self._at(high), "off" if marks else "", title)
        for kind, amount, _ in marks:
            if kind is Kind.LATE:
                yield Seen(job.task, units, self._at(start - amount), self._at(start), "delay", title)
            elif kind is Kind.OVERRUN:
                yield Seen(job.task, units, self._at(end - amount), self._at(end), "over", title)

    def _on(self, units: tuple[str, ...]) -> tuple[str, ...]:
        return units if self.units.issuperset(units) else ()

    def _extra(self, row: int) -> Iterator[Seen]:
        execution = self.matching.executions.row(row)
        start, end = execution.start.ns, self.high if execution.end is None else execution.end.ns
        if units := self._on(execution.units):
            title = _title(execution.task, None, self._at(start), self._at(end), ["no job of it is due"])
            yield Seen(execution.task, units, self._at(start), self._at(end), "extra", title)

    def _missing(self, line: int, due: Due) -> Iterator[Seen]:
        start = self.matching.lines.start[line] + self.matching.origin + due.start
        if self._shows(start, start + due.length):
            low, high = self._at(start), self._at(start + due.length)
            title = _title(due.job.task, due.job.index, low, high, ["did not run"])
            yield Seen(due.job.task, due.job.units, low, high, "missing", title)


def _title(task: str, index: int | None, start: Duration, end: Duration, texts: Sequence[str]) -> str:
    number = "" if index is None else f" #{index}"
    return "\n".join([f"{task}{number}", f"{start} – {end} ({end - start})", *texts])


# ------------------------------------------------------------------------------------------------ another schedule


def against(model: TaskModel, schedule: Schedule, other: Schedule, name: str, mode: str = "") -> Beside:
    """Return the other schedule, called `name`, with what differs marked; raise `HalpipeError` if it does not fit."""
    _require_comparable(model, schedule, other, name)
    context = shows_context(schedule)
    above, below = _drawn(schedule, context=context), _drawn(other, context=context)
    strips, found = {}, []
    for table in above:
        if table not in below or (mode and table != mode):
            continue
        strips[table], texts = _compared(above[table][1], below[table][1])
        found += [f'table "{table}", {text}' for text in texts]
    return Beside(name, strips, tuple(found), "The other schedule does not have this table.")


def _require_comparable(model: TaskModel, schedule: Schedule, other: Schedule, file: str) -> None:
    """Raise `HalpipeError` if jobs of the other schedule have no place in the report."""
    findings = Findings()
    help = "give a schedule of the same model"
    if other.model != schedule.model:
        findings.add(NOT_COMPARABLE(f'it is a schedule of "{other.model}"', path=file, help=help))
    lengths = {mode.name: mode.hyperperiod for mode in schedule.modes}
    if not any(mode.name in lengths for mode in other.modes):
        findings.add(NOT_COMPARABLE("it has none of the modes of the schedule", path=file, help=help))
    for mode in other.modes:
        if lengths.get(mode.name, mode.hyperperiod) != mode.hyperperiod:
            message = f"its cycle is {mode.hyperperiod}, not {lengths[mode.name]}"
            findings.add(NOT_COMPARABLE(message, path=about(mode=mode.name), help=help))
    tasks, units = ({each.name for each in some} for some in (model.tasks, model.units))
    jobs = other.all_jobs()
    unknown = {f'task "{job.task}"' for job in jobs if job.task not in tasks}
    unknown |= {f'unit "{unit}"' for job in jobs for unit in job.units if unit not in units}
    for name in sorted(unknown):
        findings.add(NOT_COMPARABLE(f"the model has no {name}", path=file, help=help))
    if findings.items:
        raise HalpipeError(*findings.items, exit=Exit.FINDINGS)


def _compared(above: Sequence[Placement], below: Sequence[Placement]) -> tuple[Strip, list[str]]:
    """Return the boxes of the lower of two schedules, and how its jobs differ."""
    own, other = ({(p.part, p.job.task, p.job.index): p.job for p in some} for some in (above, below))
    texts = {key: _difference(own.get(key), other.get(key)) for key in {**own, **other}}
    boxes = []
    for row in below:
        key = row.part, row.job.task, row.job.index
        mark = "" if not texts[key] else "off" if key in own else "extra"
        for start, end in row.stretches():
            title = _title(row.job.task, row.job.index, start, end, texts[key])
            boxes.append(Seen(row.job.task, row.job.units, start, end, mark, title))
    for row in above:
        key = row.part, row.job.task, row.job.index
        if key not in other:
            title = _title(row.job.task, row.job.index, row.start, row.end, texts[key])
            boxes.append(Seen(row.job.task, row.job.units, row.start, row.end, "missing", title))
    found = [f'job {index} of task "{task}": {"; ".join(t)}' for (_, task, index), t in sorted(texts.items()) if t]
    return Strip(tuple(boxes), f"Jobs that differ: {len(found)}."), found


def _difference(own: Job | None, other: Job | None) -> list[str]:
    if own is None or other is None:
        return ["the schedule does not have it" if own is None else "the other schedule does not have it"]
    by = other.start - own.start
    found = [f"starts {by} later" if by > ZERO else f"starts {-by} earlier"] if by else []
    if other.units != own.units:
        found.append(f"runs on {' '.join(other.units)} instead of {' '.join(own.units)}")
    if other.version != own.version:
        found.append(f"is version {other.version} instead of {own.version}")
    shifted = [(start - by, end - by) for start, end in other.occupations()]
    if shifted != [*own.occupations()]:
        found.append("runs for another time, or in other parts")
    return found
