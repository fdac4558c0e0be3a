"""Rule nested: of two jobs that share a unit, one ends before the other starts or fits into one gap of it (MODEL 8.2).

The jobs of a unit are looked at in order of their starts. Of those split that have not ended, each lies in a gap of the
one that started before it, so a job that fits into a gap of the last one fits into all of them. Where neither job has a
gap, rule exclusive says it all.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.rules import Rule
from halpipe.pipeline.verify.tables import TABLE

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.pipeline.verify.tables import Clock, ModeTable, Placed, Switch


def check_nested(table: ModeTable) -> Iterator[Diagnostic]:
    """Look at two cycles of every unit; a job that lasts longer than one lies across its own copies."""
    for unit, jobs in _split_units(table.jobs).items():
        path = about(table.path(), unit=unit)
        for placed in jobs:
            if _has_gaps(placed) and placed.end - placed.start > table.period:
                lasting = table.clock.text(placed.end - placed.start)
                text = f"{placed.label} lasts {lasting}, longer than the hyperperiod"
                help = "end the job before its next one starts"
                yield codes.NOT_NESTED(text, at=placed.job.at, path=path, help=help, subjects=[placed.subject])
        short = [placed for placed in jobs if placed.end - placed.start <= table.period]
        line = [p.moved(-table.period, " of the cycle before") for p in short if p.end > table.period] + short
        for outer, inner in _crossing(line):
            if not inner.where:  # else both are copies
                yield _not_nested(outer, inner, table.clock, path)


def check_nested_on_line(switch: Switch) -> Iterator[Diagnostic]:
    """Look along the line of a switch, for jobs of different parts of it; those of one mode are that mode's matter."""
    for unit, jobs in _split_units(switch.meeting()).items():
        for outer, inner in _crossing(jobs):
            if outer.where != inner.where or outer.where == TABLE:
                yield _not_nested(outer, inner, switch.clock, about(switch.path(), unit=unit))


def _split_units(jobs: Iterable[Placed]) -> dict[str, list[Placed]]:
    """Return the jobs of every unit on which any job is split."""
    found: dict[str, list[Placed]] = {}
    for placed in jobs:
        if placed.span:
            for unit in dict.fromkeys(placed.job.units):
                found.setdefault(unit, []).append(placed)
    return {unit: on for unit, on in found.items() if any(map(_has_gaps, on))}


def _has_gaps(placed: Placed) -> bool:
    return len(placed.stretches) > 1


def _crossing(jobs: list[Placed]) -> Iterator[tuple[Placed, Placed]]:
    """Yield pairs that are not nested, the earlier job first: for every job one at most that it collides with."""
    nest: list[Placed] = []  # preemptive jobs that have not ended, each in a gap of the one before
    whole: Placed | None = None  # the job in one piece that ends last
    last: dict[str, Placed] = {}  # by task, the job that ends last
    for placed in sorted(jobs, key=lambda p: (p.start, -p.end, p.job.task, p.job.index)):
        while nest and nest[-1].end <= placed.start:
            nest.pop()
        gaps = _has_gaps(placed)
        own = last.get(placed.job.task)
        if nest and not _is_in_a_gap(placed, nest[-1]):
            yield nest[-1], placed
        elif gaps and whole is not None and whole.end > placed.start:
            yield whole, placed
        elif own is not None and own.end > placed.start and _has_gaps(own):
            yield own, placed  # in one piece, it is no other than `whole`
        if gaps:
            nest.append(placed)
        elif whole is None or placed.end > whole.end:
            whole = placed
        if own is None or placed.end > own.end:
            last[placed.job.task] = placed


def _is_in_a_gap(inner: Placed, outer: Placed) -> bool:
    """Tell whether a job that starts no earlier than another lies in one of its gaps, from start to end."""
    begin, end = inner.start - outer.start, inner.end - outer.start
    place = bisect_right(outer.stretches, begin, key=lambda stretch: stretch[0])
    if place == len(outer.stretches):
        return False  # behind the start of the last part; whether it has ended is asked before
    return outer.stretches[place - 1][1] <= begin and end <= outer.stretches[place][0]


def _not_nested(outer: Placed, inner: Placed, clock: Clock, path: str) -> Diagnostic:
    text = f"{inner.label} lasts from {clock.text(inner.start)} to {clock.text(inner.end)} and {outer.label} from "
    text += f"{clock.text(outer.start)} to {clock.text(outer.end)}; "
    if inner.job.task == outer.job.task:
        text += "jobs of one task do not interrupt each other"
    else:
        text += "neither lies in one gap of the other"
    help = "let the preempting job end before the other resumes"
    return codes.NOT_NESTED(text, at=inner.job.at, path=path, help=help)


NESTED = Rule(
    "nested",
    "Of two jobs that share a unit, one ends before the other starts or lies in one gap of the other, also round the "
    "end of the hyperperiod; jobs of one task that share a unit do not lie in each other's gaps.",
    check_nested,
)
