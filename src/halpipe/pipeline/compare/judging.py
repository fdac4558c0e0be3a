"""Deviations of a trace: for each job of each table the worst of every kind, with count and instant."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import NOWHERE, Path, Subject, about
from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.pipeline.compare.codes import CODES, Kind
from halpipe.pipeline.compare.matching import lateness

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.core.diagnostics import Code, Diagnostic, Location
    from halpipe.core.durations import Duration
    from halpipe.models import Job, TaskModel
    from halpipe.models.trace import Execution
    from halpipe.pipeline.compare.matching import Match, Matching


@dataclass(slots=True)
class _Deviation:
    """All deviations of one kind of one job: how many, and the worst."""

    code: Code
    path: str
    count: int
    amount: Duration
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
        self._worst: dict[tuple[str, str], _Deviation] = {}

    def judge(self, matching: Matching, origin: Duration, model: TaskModel | None) -> None:
        """Judge everything that ran, and what did not, by a schedule whose zero lies at `origin`."""
        self.origin = origin
        instants = (match.execution.end or match.execution.start for match in matching.matches)
        last = max(instants, default=ZERO) - self.origin
        for match in matching.matches:
            self._start(match)
            self._plan(match)
            self._data(match)
            if match.execution.end is None and (self.scope.is_whole or last - match.end > self.tolerance):
                message = f"still runs when the trace ends, at {last}; its end is at {match.end}"
                self._of(match, Kind.ENDLESS, last - match.end, message, "bound the loops and waits of the program")
            self._end(match)
            self._parts(match)
            self._units(match)
        for table, cycle, job, start in matching.missing:
            path = _job(table.name, job)
            message = f"did not run at {start} (cycle {cycle})"
            self.add(Kind.MISSING, path, ZERO, message, job.at, "check whether the trace lost events")
        self._pauses(matching)
        for execution in matching.extra:
            message = f"ran at {execution.start} of the trace, where no job of it is due"
            self.add(Kind.EXTRA, about(task=execution.task), ZERO, message, execution.at, "check who starts it")
        self._order(matching, model)

    def _pauses(self, matching: Matching) -> None:
        first = {match.cycle: match for match in reversed(matching.matches)} if matching.pauses else {}
        for before, after in matching.pauses:
            match, silent = first.get(after), after - before - 1
            message = f"nothing ran in the {silent} cycles after cycle {before}, whose jobs are not counted as missing"
            help = "compare the pieces before and after it, or correct the instants and their unit"
            path, length = (about(mode=match.table.name), match.table.length * silent) if match else ("", ZERO)
            self.add(Kind.PAUSE, path, length, message, match.execution.at if match else NOWHERE, help)

    def _start(self, match: Match) -> None:
        late = lateness(match, self.origin)
        if late > self.tolerance or -late > self.tolerance:
            word = "late" if late > ZERO else "early"
            size = late if late > ZERO else -late
            message = f"starts {size} {word}: at {match.execution.start - self.origin} instead of {match.start}"
            kind = Kind.LATE if late > ZERO else Kind.EARLY
            self._of(match, kind, size, message, "look at what ran before it on its unit")

    def _plan(self, match: Match) -> None:
        """Compare the instant that the recorder states with that of the schedule."""
        planned = match.execution.planned
        if planned is not None and not -self.tolerance <= match.start + self.origin - planned <= self.tolerance:
            message = f"was due at {planned} by its recorder, and is at {match.start + self.origin} by the schedule"
            self._of(match, Kind.PLAN, ZERO, message, "load the tables of this schedule")

    def _data(self, match: Match) -> None:
        if match.execution.has_data is False:
            message = f"ran without a message at {match.execution.start - self.origin}"
            self._of(match, Kind.NO_DATA, ZERO, message, "start its publisher before the tables, or schedule it later")

    def _end(self, match: Match) -> None:
        execution = match.execution
        if execution.end is None:
            return
        budget = match.reserved
        busy = execution.end - execution.start if execution.busy is None else execution.busy
        if busy - budget > self.tolerance:
            message = f"runs for {busy}, {busy - budget} more than the {budget} of its version {match.job.version}"
            self._of(match, Kind.OVERRUN, busy - budget, message, "correct the WCET, or the program")
        late = execution.end - self.origin - match.end
        if late > self.tolerance:
            message = f"ends {late} late: at {execution.end - self.origin} instead of {match.end}"
            self._of(match, Kind.LATE_END, late, message, "look at its start, its preemptions and its run time")

    def _parts(self, match: Match) -> None:
        """Hold what ran against the parts of a job with gaps, where the trace tells when it ran."""
        execution = match.execution
        if not match.job.parts:
            return
        for start, end in _stretches(execution):
            outside, instant = _outside(start - self.origin, end - self.origin, match.due())
            if outside > self.tolerance:
                message = f"runs {outside} outside its parts, near {instant}"
                self._of(match, Kind.PARTS, outside, message, "hold it at the end of a part until the next")

    def _units(self, match: Match) -> None:
        seen, due = match.execution.units, match.job.units
        if seen and set(seen) != set(due):
            message = f"ran on {' '.join(seen)} instead of {' '.join(due)}"
            self._of(match, Kind.UNIT, ZERO, message, "bind it to its unit")

    def _order(self, matching: Matching, model: TaskModel | None) -> None:
        """Compare each job with those before it on its units, and with those that need the same resources."""
        furthest: dict[str, Match] = {}
        longest: dict[tuple[Kind, str], Match] = {}
        held = _resources(model) if model else {}
        for match in sorted(matching.matches, key=lambda match: (match.execution.start.ns, match.start.ns)):
            units = match.execution.units or match.job.units
            for unit in units:
                before = furthest.setdefault(unit, match)
                if match.start < before.start:
                    self._together(Kind.ORDER, before, match, "before it on a unit")
                else:
                    furthest[unit] = match
            keys = [(Kind.OVERLAP, unit) for unit in units]
            keys += [(Kind.EXCLUSION, name) for name in held.get((match.job.task, match.job.version), ())]
            for key in keys:
                other = longest.get(key)
                end = other.execution.end if other else None
                overlap = end - match.execution.start if end else ZERO
                # A unit runs one job at a time, whatever the tolerance; of two units each may be late by it.
                allowed = ZERO if key[0] is Kind.OVERLAP else self.tolerance
                if other and overlap > allowed and not _may_interrupt(other, match):
                    where = "on a unit" if key[0] is Kind.OVERLAP else f'for {overlap} with resource "{key[1]}"'
                    self._together(key[0], other, match, f"at the same time {where}", overlap)
                if end is None or (match.execution.end is not None and match.execution.end >= end):
                    longest[key] = match

    def _together(self, kind: Kind, before: Match, match: Match, what: str, amount: Duration = ZERO) -> None:
        message = f'task "{before.execution.task}" ran {what}, at {before.execution.start - self.origin}'
        help = "one unit runs one job at a time, in order"
        if kind is Kind.EXCLUSION:
            help = "look at their starts and run times: only the table keeps them apart"
        self._of(match, kind, amount, message, help)

    def _of(self, match: Match, kind: Kind, amount: Duration, message: str, help: str) -> None:
        path = _job(match.table.name, match.job)
        self.add(kind, path, amount, f"{message} (cycle {match.cycle})", match.execution.at, help)

    def add(self, kind: Kind, path: str, amount: Duration, message: str, at: Location, help: str) -> None:
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


def _resources(model: TaskModel) -> dict[tuple[str, str], list[str]]:
    """Return, by task and version, the resources that the version needs wholly, from its start to its end."""
    return {
        (task.name, version.name): [
            access.resource
            for access in version.accesses
            if access.bound == 1 and not access.start and access.end == version.wcet
        ]
        for task in model.tasks
        for version in task.versions
    }


def _job(table: str, job: Job) -> Path:
    text = f'table "{table}", job {job.index} of task "{job.task}"'
    return Path(text, (Subject("table", table), Subject("task", job.task), Subject("job", str(job.index))))
