"""Deviations of a trace: for each job of each table the worst of every kind, with count and instant."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import field
from itertools import pairwise, permutations
from operator import itemgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from halpipe.core.diagnostics import NOWHERE, Code, Diagnostic, Location, Path, Subject, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.core.suggest import counted
from halpipe.models.trace import column, groups, plain
from halpipe.pipeline.compare.codes import CODES, KINDS, ROUNDED, TIMED, Kind
from halpipe.pipeline.compare.matching import Match, Matching, Ran

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from halpipe.models import Job, TaskModel
    from halpipe.models.trace import Column, Instant


@record(kw_only=True)
class Scope:
    """Scope of a judgement: the code of each kind of deviation, those without one are not reported.

    `is_whole`: the recording holds whole tables, from the first cycle of the first mode on.
    """

    codes: Mapping[Kind, Code] = field(default_factory=lambda: CODES)
    is_whole: bool = False


_TEXTS = {
    Kind.LATE: "starts {by} late: at {m.began} instead of {m.start}".format,
    Kind.EARLY: "starts {by} early: at {m.began} instead of {m.start}".format,
    Kind.PLAN: "was due at {m.execution.planned} by its recorder, and is at {instant} by the schedule".format,
    Kind.NO_DATA: "ran without a message at {m.began}".format,
    Kind.ENDLESS: "still runs when the trace ends, at {end}; its end is at {m.end}".format,
    Kind.OVERRUN: "runs for {length}, {by} more than the {m.reserved} of its version {m.job.version}".format,
    Kind.LATE_END: "ends {by} late: at {end} instead of {m.end}".format,
    Kind.PARTS: "runs {by} outside its parts, near {other}".format,
    Kind.UNIT: "ran on {on} instead of {units}".format,
    Kind.ORDER: 'task "{other[0].job.task}" ran before it on a unit, at {other[0].began}'.format,
    Kind.OVERLAP: 'task "{other[0].job.task}" ran at the same time on a unit, at {other[0].began}'.format,
    Kind.EXCLUSION: (
        'task "{other[0].job.task}" ran at the same time for {by} with resource "{other[1]}", at {other[0].began}'
    ).format,
}


def _text(kind: Kind, match: Match, amount: Instant, other: Any) -> str:
    by, on, units = Duration(amount), " ".join(match.execution.units), " ".join(match.job.units)
    end, length, instant = match.end + by, match.reserved + by, match.origin + match.start
    values = {"end": end, "length": length, "instant": instant, "on": on, "units": units, "other": other}
    return _TEXTS[kind](m=match, by=by, **values)


_KEYS = 1_000_000
"""Units and resources of a job are fewer; a rank is the place of the job times this, and the number of the key."""


class Judge:
    """Collects deviations beyond the tolerance, and counts them by kind."""

    def __init__(self, tolerance: Duration, prefix: str, scope: Scope) -> None:
        self.origin = ZERO
        self.tolerance = tolerance
        self.prefix = prefix
        self.scope = scope
        self.counts: Counter[Kind] = Counter()
        self.by_line: Column
        self._often: Counter[tuple[str, Path]] = Counter()
        self._worst: dict[tuple[str, Path], tuple[Instant, int, Code, str, Location, str]] = {}
        """By code and path the amount, the rank from 0 down, and what is reported."""

    def judge(self, matching: Matching, ran: Ran, model: TaskModel | None) -> None:
        """Judge everything that ran, and what did not."""
        self._begin(matching, ran)
        self._alone()
        lines, seen = matching.lines, matching.executions
        line_of, job_of = matching.located(matching.missing)
        np.add.at(self.by_line, line_of, 1)
        for _, places in groups(job_of):
            line, due = matching.at(int(matching.missing[places[0]]))
            message = f"did not run at {Duration(lines.start[line] + due.start)} (cycle {lines.cycle[line]})"
            path = _job(lines.table[line].name, due.job)
            self.add(Kind.MISSING, path, 0, message, due.job.at, count=len(places))
        self._pauses(matching)
        for _, places in groups(np.asarray(seen.task)[matching.extra]):
            execution = seen.row(int(matching.extra[places[0]]))
            message = f"ran at {execution.start} of the trace, where no job of it is due"
            self.add(Kind.EXTRA, about(task=execution.task), 0, message, execution.at, count=len(places))
        self._order(model)

    def mark(self, matching: Matching, rows: Sequence[int]) -> dict[int, list[tuple[Kind, Instant, str]]]:
        """Return how some executions deviate from their jobs: kinds, amounts and messages by row."""
        self._begin(matching, Ran(matching))
        is_asked, found = np.isin(self._ran.row, rows), defaultdict(list)
        for kind, at, amounts, others in self._each() if rows else ():
            for number in np.flatnonzero(is_asked[at]).tolist():
                match, amount = matching.match(int(self._ran.row[at[number]])), plain(amounts[number])
                found[match.row].append((kind, amount, _text(kind, match, amount, others(number))))
        return found

    def _begin(self, matching: Matching, ran: Ran) -> None:
        self.origin, self._matching, self._ran = Duration(matching.origin), matching, ran
        self.by_line = np.zeros(len(matching.lines.table), dtype=np.int64)

    def _each(self) -> Iterator[tuple[Kind, Column, Column, Callable[[int], Any]]]:
        """Yield deviations: places among what ran, amounts, and by their numbers what is named beside them."""
        matching, ran, tolerance = self._matching, self._ran, column([self.tolerance.ns])
        seen, origin, has_end, amounts = matching.executions, column([matching.origin]), ran.has_end, ran.late
        nothing = np.broadcast_to(np.int64(0), len(ran.row))

        def where(kind: Kind, is_so: Column, amounts: Column = nothing) -> tuple[Kind, Column, Column, Any]:
            at = np.flatnonzero(is_so)
            return kind, at, nothing[: len(at)] if amounts is nothing else amounts[at], lambda _: None

        yield where(Kind.LATE, amounts > tolerance, amounts)
        yield where(Kind.EARLY, -amounts > tolerance, -amounts)
        if seen.planned:
            due = (ran.due + origin).tolist()
            by = [due - seen.planned.get(row, due) for row, due in zip(ran.row.tolist(), due, strict=True)]
            yield where(Kind.PLAN, abs(column(by)) > tolerance)
        if seen.has_data:
            yield where(Kind.NO_DATA, np.array([seen.has_data.get(row) is False for row in ran.row.tolist()]))
        amounts = ran.length - matching.of_jobs("reserved")[ran.job]
        yield where(Kind.OVERRUN, has_end & (amounts > tolerance), amounts)
        amounts, length = np.where(has_end, ran.end, ran.start) - origin, matching.of_jobs("length")
        at, last = np.flatnonzero(~has_end), amounts.max()
        amounts = amounts - ran.due - length[ran.job]
        yield where(Kind.LATE_END, has_end & (amounts > tolerance), amounts)
        left = last - ran.due[at] - length[ran.job[at]]
        is_over = (left > tolerance) | self.scope.is_whole
        yield Kind.ENDLESS, at[is_over], left[is_over], lambda _: None
        has_parts = np.array([bool(each.job.parts) for _, each in matching.jobs], dtype=bool)[ran.job]
        outside = [(at, *each) for at in np.flatnonzero(has_parts).tolist() for each in self._outside(int(ran.row[at]))]
        at, amounts = np.array([at for at, *_ in outside], dtype=np.int64), column([by.ns for _, by, _ in outside])
        yield Kind.PARTS, at, amounts, lambda number: outside[number][2]
        numbers: dict[frozenset[str], int] = {frozenset(): 0}
        on, stated = (
            np.array([numbers.setdefault(each, len(numbers)) for each in units], dtype=np.int32)
            for units in (map(frozenset, seen.units), (each.units for _, each in matching.jobs))
        )
        own = on[np.asarray(seen.on)[ran.row]]
        yield where(Kind.UNIT, (own != 0) & (own != stated[ran.job]))

    def _alone(self) -> None:
        """Judge each job by itself; the columns of deviations are released at the return."""
        for kind, at, amounts, others in self._each() if len(self._ran.row) else ():
            self._deviate(kind, at, amounts, at, others)

    def _deviate(self, kind: Kind, at: Column, amounts: Column, rank: Column, others: Callable[[int], Any]) -> None:
        """Report executions that deviate; of each job the worst is described, of equals the one of the least rank."""
        if kind not in self.scope.codes:
            return
        ran, matching = self._ran, self._matching
        np.add.at(self.by_line, ran.line[at], 1)
        for _, places in groups(ran.job[at]):
            worst = int(places[np.argmax(amounts[places])])
            match, amount = matching.match(int(ran.row[at[worst]])), plain(amounts[worst])
            message = f"{_text(kind, match, amount, others(worst))} (cycle {match.cycle})"
            path, place = _job(match.table.name, match.job), match.execution.at
            self.add(kind, path, amount, message, place, count=len(places), rank=int(rank[worst]))

    def _pauses(self, matching: Matching) -> None:
        lines = matching.lines
        line_of = {cycle: line for line, cycle in enumerate(lines.cycle)}
        for before, after in lines.pauses.items():
            line, silent = line_of[after], after - before - 1
            table = lines.table[line]
            rows = matching.slots[lines.slot[line] : lines.slot[line + 1]]
            at = next((matching.executions.row(row).at for row in rows.tolist() if row >= 0), NOWHERE)
            pause = f"nothing ran in the {counted(silent, 'cycle')} after cycle {before}"
            message = f"{pause}, whose jobs are not counted as missing"
            self.add(Kind.PAUSE, about(mode=table.name), table.length * silent, message, at)

    def _outside(self, row: int) -> Iterator[tuple[Duration, Duration]]:
        """Yield by how much, and near which instants, a job with gaps ran outside its parts, where the trace tells.

        One that was busy all the time ran in one piece. Of a stretch the part that it fits best counts.
        """
        match = self._matching.match(row)
        seen, due = match.execution, match.due()
        is_whole = seen.end is not None and seen.busy == seen.end - seen.start
        for start, end in ((seen.start, seen.end or ZERO),) if is_whole else seen.stretches:
            first, last = start - self.origin, end - self.origin
            out = (max((max(ZERO, a - first), True), (max(ZERO, last - b), False)) for a, b in due)
            by, is_before = min(out, key=itemgetter(0))
            if by > self.tolerance:
                yield by, first if is_before else last

    def _order(self, model: TaskModel | None) -> None:
        """Compare each job with those before it on its units, and with those that need the same resources."""
        matching, ran, held = self._matching, self._ran, _resources(model) if model else {}
        seen, jobs = matching.executions, matching.jobs
        start, end = column(seen.start), column(seen.end)
        order = np.full(len(seen.task), -1, dtype=np.int32)
        order[ran.row] = np.arange(len(ran.row))
        order = order[seen.order]
        order = order[order >= 0]
        order = order[np.argsort(ran.due[order], kind="stable")]
        # Of those that start at once, the job that is due first comes first.
        order = order[np.argsort(start[ran.row[order]], kind="stable")]
        on, job = np.asarray(seen.on)[ran.row[order]], ran.job[order]
        is_bare = np.array([not names for names in seen.units], dtype=bool)[on]
        ranks: dict[str | tuple[str], list[Column]] = defaultdict(list)
        for number, places in groups(np.where(is_bare, len(seen.units) + job, on)):
            units = seen.units[number] if number < len(seen.units) else jobs[number - len(seen.units)][1].job.units
            for key, unit in enumerate(dict.fromkeys(units)):
                ranks[unit].append(places * _KEYS + key)
        for number, places in groups(job) if held else ():
            due = jobs[number][1]
            for key, resource in enumerate(held.get((due.job.task, due.job.version), ()), _KEYS // 2):
                ranks[resource].append(places * _KEYS + key)
        for name, parts in ranks.items():
            rank = np.sort(np.concatenate(parts))
            own = order[rank // _KEYS]
            if isinstance(name, str):
                before, at = _after_larger(due := ran.due[own], due)
                nothing = np.zeros(len(at), dtype=np.int64)
                self._together(Kind.ORDER, own[before], own[at], nothing, rank[at])
            rows = ran.row[own]
            before, at = _after_larger(end[rows], start[rows])
            overlap = end[rows[before]] - start[rows[at]]
            self._at_once(own[before], own[at], overlap, name, rank[at])

    def _at_once(self, before: Column, at: Column, overlap: Column, key: str | tuple[str], rank: Column) -> None:
        """Report executions that ran at once on a unit, or with the resource of a tuple."""
        ran, matching = self._ran, self._matching
        # A unit runs one job at a time, whatever the tolerance; of two units each may be late by it.
        is_long = overlap > column([self.tolerance.ns if isinstance(key, tuple) else 0])
        before, at, rank, overlap = before[is_long], at[is_long], rank[is_long], overlap[is_long]
        pairs = (ran.job[before].tolist(), ran.job[at].tolist(), (ran.due[at] - ran.due[before]).tolist())
        known: dict[tuple[int, int, Instant], bool] = {}
        for number, pair in enumerate(zip(*pairs, strict=True)):
            if pair not in known:
                known[pair] = not _may_interrupt(*(matching.match(int(ran.row[of[number]])) for of in (before, at)))
        kept = np.array([known[pair] for pair in zip(*pairs, strict=True)], dtype=bool)
        kind = Kind.EXCLUSION if isinstance(key, tuple) else Kind.OVERLAP
        self._together(kind, before[kept], at[kept], overlap[kept], rank[kept], key[0])

    def _together(
        self, kind: Kind, before: Column, at: Column, amounts: Column, rank: Column, resource: str = ""
    ) -> None:
        rows, match = self._ran.row[before], self._matching.match
        self._deviate(kind, at, amounts, rank, lambda number: (match(int(rows[number])), resource))

    def add(
        self,
        kind: Kind,
        path: str,
        amount: Instant,
        message: str,
        at: Location,
        help: str = "",
        count: int = 1,
        rank: int = 0,
    ) -> None:
        """Report deviations; of one kind and `path`, that of the largest `amount` is kept, of equals the least rank."""
        code = self.scope.codes.get(kind)
        if code is None:
            return
        self.counts[kind] += count
        key = code.id, Path(f"{self.prefix}{path}", path.subjects if isinstance(path, Path) else ())
        self._often[key] += count
        if key not in self._worst or (amount, -rank) > self._worst[key][:2]:
            help = ROUNDED if kind in TIMED and amount < 1 else help or KINDS[kind][1]
            self._worst[key] = amount, -rank, code, message, at, help

    def diagnostics(self) -> list[Diagnostic]:
        """Return one diagnostic for each job and kind of deviation, in the order of code and job."""
        found = []
        for key, (_, _, code, message, at, help) in sorted(self._worst.items(), key=itemgetter(0)):
            often = f"; {self._often[key]} times, this is the worst" if self._often[key] > 1 else ""
            found.append(code(message + often, at=at, path=key[1], help=help))
        return found


def _after_larger(values: Column, limits: Column) -> tuple[Column, Column]:
    """Return the places whose limit is below a value before them, each after the last place of the largest such."""
    largest = np.maximum.accumulate(values) if len(values) else values
    place = np.maximum.accumulate(np.where(values == largest, np.arange(len(values)), 0)) if len(values) else values
    at = np.flatnonzero(limits[1:] < largest[:-1]) + 1
    return place[at - 1], at


def _may_interrupt(*matches: Match) -> bool:
    """Whether the schedule has one of two jobs in a gap of the other."""
    return any(
        end <= inner.start and inner.end <= again
        for inner, outer in permutations(matches)
        for (_, end), (again, _) in pairwise(outer.due())
    )


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
