"""Deviations of a trace: for each job of each table the worst of every kind, with count and instant."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import NOWHERE, Path, Subject, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.core.suggest import counted
from halpipe.models.trace import NONE
from halpipe.pipeline.compare.codes import CODES, Kind

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from halpipe.core.diagnostics import Code, Diagnostic, Location
    from halpipe.models import Job, TaskModel
    from halpipe.models.trace import Execution, Instant
    from halpipe.pipeline.compare.matching import Match, Matching


@dataclass(slots=True)
class _Deviation:
    """All deviations of one kind of one job: how many, and the worst."""

    code: Code
    path: str
    count: int
    amount: Instant
    message: str
    at: Location
    help: str


@record(kw_only=True)
class Scope:
    """Scope of a judgement: the code of each kind of deviation, those without one are not reported.

    `is_whole`: the recording holds whole tables, from the first cycle of the first mode on.
    """

    codes: Mapping[Kind, Code] = field(default_factory=lambda: CODES)
    is_whole: bool = False


class Judge:
    """Collects deviations beyond the tolerance, and counts them by kind."""

    def __init__(self, tolerance: Duration, prefix: str, scope: Scope) -> None:
        self.origin = ZERO
        self.tolerance = tolerance
        self.prefix = prefix
        self.scope = scope
        self.counts: Counter[Kind] = Counter()
        self.by_line: Counter[int] = Counter()
        self.marks: dict[int, list[tuple[Kind, Instant, str]]] | None = None
        self._worst: dict[tuple[str, str], _Deviation] = {}

    def judge(self, matching: Matching, model: TaskModel | None) -> None:
        """Judge everything that ran, and what did not."""
        self.origin = Duration(matching.origin)
        self._matching = matching
        self._each(matching.rows())
        lines = matching.lines
        for line, place in matching.missing:
            self.by_line[line] += 1
            table, job = lines.table[line], lines.table[line].due[place].job
            start = Duration(lines.start[line] + job.start.ns)
            message = f"did not run at {start} (cycle {lines.cycle[line]})"
            self.add(Kind.MISSING, _job(table.name, job), 0, message, job.at, "check whether the trace lost events")
        self._pauses(matching)
        for row in matching.extra:
            execution = matching.executions.row(row)
            message = f"ran at {execution.start} of the trace, where no job of it is due"
            self.add(Kind.EXTRA, about(task=execution.task), 0, message, execution.at, "check who starts it")
        self._order(model)

    def mark(self, matching: Matching, rows: Sequence[int]) -> dict[int, list[tuple[Kind, Instant, str]]]:
        """Return how some executions deviate from their jobs: kinds, amounts and messages by row."""
        self.origin, self._matching, self.marks = Duration(matching.origin), matching, {}
        self._each(rows)
        return self.marks

    def _each(self, rows: Iterable[int]) -> None:
        """Compare executions with their jobs; objects are made only of those that deviate."""
        matching, tolerance, origin = self._matching, self.tolerance.ns, self.origin.ns
        seen = matching.executions
        starts, ends, planned, lacking = seen.start, seen.end, seen.planned, seen.has_data
        units = [frozenset(names) for names in seen.units]
        instants = (starts[row] if ends[row] == NONE else ends[row] for row in matching.rows())
        last = max(instants, default=origin) - origin
        for row in rows:
            due, start = matching.due(row), matching.start(row)
            late = starts[row] - origin - start
            if late > tolerance or -late > tolerance:
                self._start(matching.match(row), late)
            if planned and row in planned and not -tolerance <= start + origin - planned[row] <= tolerance:
                match = matching.match(row)
                when = f"was due at {Duration(planned[row])} by its recorder, and is at {match.start + self.origin}"
                self._of(match, Kind.PLAN, 0, f"{when} by the schedule", "load the tables of this schedule")
            if lacking and lacking.get(row) is False:
                message = f"ran without a message at {Duration(starts[row] - origin)}"
                help = "start its publisher before the tables, or schedule it later"
                self._of(matching.match(row), Kind.NO_DATA, 0, message, help)
            length = seen.length(row)
            if length is None:
                self._endless(row, last)
            else:
                if length - due.reserved > tolerance:
                    self._overrun(matching.match(row), length)
                if (late := ends[row] - origin - start - due.length) > tolerance:
                    match = matching.match(row)
                    message = f"ends {Duration(late)} late: at {Duration(ends[row] - origin)} instead of {match.end}"
                    self._of(match, Kind.LATE_END, late, message, "look at its start, its preemptions and its run time")
            if due.job.parts:
                self._parts(matching.match(row))
            on = units[seen.on[row]]
            if on and on != due.units:
                message = f"ran on {' '.join(seen.units[seen.on[row]])} instead of {' '.join(due.job.units)}"
                self._of(matching.match(row), Kind.UNIT, 0, message, "bind it to its unit")

    def _pauses(self, matching: Matching) -> None:
        lines = matching.lines
        for before, after in lines.pauses:
            line, silent = lines.cycle.index(after), after - before - 1
            table = lines.table[line]
            rows = (row for row in matching.slots[lines.slot[line] : lines.slot[line + 1]] if row >= 0)
            at = next((matching.executions.row(row).at for row in rows), NOWHERE)
            pause = f"nothing ran in the {counted(silent, 'cycle')} after cycle {before}"
            message = f"{pause}, whose jobs are not counted as missing"
            help = "compare the pieces before and after it, or correct the instants and their unit"
            self.add(Kind.PAUSE, about(mode=table.name), table.length * silent, message, at, help)

    def _start(self, match: Match, late: Instant) -> None:
        word, size = ("late", late) if late > 0 else ("early", -late)
        message = f"starts {Duration(size)} {word}: at {match.execution.start - self.origin} instead of {match.start}"
        kind = Kind.LATE if late > 0 else Kind.EARLY
        self._of(match, kind, size, message, "look at what ran before it on its unit")

    def _endless(self, row: int, last: Instant) -> None:
        match = self._matching.match(row)
        by = last - match.end.ns
        if self.scope.is_whole or by > self.tolerance.ns:
            message = f"still runs when the trace ends, at {Duration(last)}; its end is at {match.end}"
            self._of(match, Kind.ENDLESS, by, message, "bound the loops and waits of the program")

    def _overrun(self, match: Match, length: Instant) -> None:
        budget = match.reserved
        by = Duration(length) - budget
        message = f"runs for {Duration(length)}, {by} more than the {budget} of its version {match.job.version}"
        self._of(match, Kind.OVERRUN, by.ns, message, "correct the WCET, or the program")

    def _parts(self, match: Match) -> None:
        """Compare what ran with the parts of a job with gaps, where the trace tells when it ran."""
        for start, end in _stretches(match.execution):
            outside, instant = _outside(start - self.origin, end - self.origin, match.due())
            if outside > self.tolerance:
                message = f"runs {outside} outside its parts, near {instant}"
                self._of(match, Kind.PARTS, outside.ns, message, "hold it at the end of a part until the next")

    def _order(self, model: TaskModel | None) -> None:
        """Compare each job with those before it on its units, and with those that need the same resources."""
        matching = self._matching
        seen = matching.executions
        starts, ends = seen.start, seen.end
        furthest: dict[str, tuple[Instant, int]] = {}
        longest: dict[str | tuple[str], int] = {}
        held = _resources(model) if model else {}
        for row in self._by_start():
            due, start = matching.due(row), matching.start(row)
            units = seen.units[seen.on[row]] or due.job.units
            for unit in units:
                before = furthest.get(unit)
                if before is not None and start < before[0]:
                    self._together(Kind.ORDER, before[1], row, "before it on a unit")
                else:
                    furthest[unit] = start, row
            own = held.get((due.job.task, due.job.version), ()) if held else ()
            for key in (*units, *own):
                other = longest.get(key)
                end = NONE if other is None else ends[other]
                if other is not None and end != NONE and (overlap := end - starts[row]) > 0:
                    self._at_once(other, row, key, overlap)
                if end == NONE or (ends[row] != NONE and ends[row] >= end):
                    longest[key] = row

    def _by_start(self) -> Iterator[int]:
        """Yield the rows with a job by their start; those of one instant by the start of the job."""
        matching = self._matching
        starts, line = matching.executions.start, matching.line
        rows: Iterable[int] = (row for row in matching.executions.order if line[row] >= 0)
        if matching.is_joined:
            rows = sorted(rows, key=starts.__getitem__)
        for _, equals in groupby(rows, key=starts.__getitem__):
            first, *others = equals
            yield from sorted((first, *others), key=matching.start) if others else (first,)

    def _at_once(self, before: int, row: int, key: str | tuple[str], overlap: Instant) -> None:
        """Report two executions at once on a unit, or with the resource of a `key` that is a tuple."""
        # A unit runs one job at a time, whatever the tolerance; of two units each may be late by it.
        if isinstance(key, tuple) and overlap <= self.tolerance.ns:
            return
        if _may_interrupt(self._matching.match(before), self._matching.match(row)):
            return
        kind = Kind.EXCLUSION if isinstance(key, tuple) else Kind.OVERLAP
        where = f'for {Duration(overlap)} with resource "{key[0]}"' if isinstance(key, tuple) else "on a unit"
        self._together(kind, before, row, f"at the same time {where}", overlap)

    def _together(self, kind: Kind, before: int, row: int, what: str, amount: Instant = 0) -> None:
        first = self._matching.executions.row(before)
        message = f'task "{first.task}" ran {what}, at {first.start - self.origin}'
        help = "one unit runs one job at a time, in order"
        if kind is Kind.EXCLUSION:
            help = "look at their starts and run times: only the table keeps them apart"
        self._of(self._matching.match(row), kind, amount, message, help)

    def _of(self, match: Match, kind: Kind, amount: Instant, message: str, help: str) -> None:
        path = _job(match.table.name, match.job)
        if kind in self.scope.codes:
            self.by_line[self._matching.line[match.row]] += 1
        if self.marks is not None:
            self.marks.setdefault(match.row, []).append((kind, amount, message))
        self.add(kind, path, amount, f"{message} (cycle {match.cycle})", match.execution.at, help)

    def add(self, kind: Kind, path: str, amount: Instant, message: str, at: Location, help: str) -> None:
        """Report a deviation; of one kind and `path`, that of the largest `amount` is kept."""
        code = self.scope.codes.get(kind)
        if code is None:
            return
        self.counts[kind] += 1
        subjects = path.subjects if isinstance(path, Path) else ()
        path = Path(f"{self.prefix}{path}", subjects)
        known = self._worst.get((code.id, path))
        if known is None:
            self._worst[code.id, path] = _Deviation(code, path, 1, amount, message, at, help)
            return
        known.count += 1
        if amount > known.amount:
            known.amount, known.message, known.at = amount, message, at

    def diagnostics(self) -> list[Diagnostic]:
        """Return one diagnostic for each job and kind of deviation, in the order of code and job."""
        found = []
        for (_, _), worst in sorted(self._worst.items()):
            often = f"; {worst.count} times, this is the worst" if worst.count > 1 else ""
            found.append(worst.code(worst.message + often, at=worst.at, path=worst.path, help=worst.help))
        return found


def _stretches(execution: Execution) -> tuple[tuple[Duration, Duration], ...]:
    """Return when an execution ran, as far as the trace tells: one that was busy all the time ran in one piece."""
    if execution.end is not None and execution.busy == execution.end - execution.start:
        return ((execution.start, execution.end),)
    return execution.stretches


def _outside(start: Duration, end: Duration, due: list[tuple[Duration, Duration]]) -> tuple[Duration, Duration]:
    """Return by how much [start, end) reaches out of the interval that it fits best, and where."""
    best: tuple[Duration, Duration] | None = None
    for first, last in due:
        before, after = max(ZERO, first - start), max(ZERO, end - last)
        found = (before, start) if before >= after else (after, end)
        best = found if best is None or found[0] < best[0] else best
    return best or (ZERO, start)


def _may_interrupt(before: Match, match: Match) -> bool:
    """Whether the schedule has one of two jobs in a gap of the other."""
    return _lies_in_gap(match, before) or _lies_in_gap(before, match)


def _lies_in_gap(inner: Match, outer: Match) -> bool:
    return any(end <= inner.start and inner.end <= again for (_, end), (again, _) in pairwise(outer.due()))


def _resources(model: TaskModel) -> dict[tuple[str, str], list[tuple[str]]]:
    """Return, by task and version, the resources that the version needs wholly, from its start to its end."""
    return {
        (task.name, version.name): [
            (access.resource,)
            for access in version.accesses
            if access.bound == 1 and not access.start and access.end == version.wcet
        ]
        for task in model.tasks
        for version in task.versions
    }


def _job(table: str, job: Job) -> Path:
    text = f'table "{table}", job {job.index} of task "{job.task}"'
    return Path(text, (Subject("table", table), Subject("task", job.task), Subject("job", str(job.index))))
