"""Rules of preemptive jobs: parts, nesting on a unit, and the priorities that play their gaps (MODEL 8.2)."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import NOWHERE, Diagnostic, about
from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.tables import TABLE, Clock, ModeTable, Placed, Rule, Switch

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.models import Part, Version
    from halpipe.pipeline.verify.jobs import Tables


def check_parts(table: ModeTable | Switch) -> Iterator[Diagnostic]:
    """Check the parts of every job of a mode or table."""
    clock = table.clock
    on: dict[tuple[str, ...], Placed] = {}
    for placed in table.jobs:
        job = placed.job
        on.setdefault(job.units, placed)
        version = placed.version
        if job.parts and version is not None and job.version in placed.active.wcets:
            path = table.path(placed)
            for text in _shape(placed, clock):
                yield codes.PARTS_DIFFER(text, at=job.at, path=path, help="give each part its start, end, from and to")
            for text in _gaps(placed, version, table.mode.locks):
                yield codes.WRONG_GAP(text, at=job.at, path=path, help="interrupt the job where its version allows it")
            for text in _lengths(placed, version, clock):
                yield codes.WRONG_LENGTH(text, at=job.at, path=path, help="move the start or the end of the part")
    for units, placed in on.items():
        if placed.service.is_full:  # known by now: the lengths of all its jobs have been asked for
            names = ", ".join(f'"{unit}"' for unit in units)
            text = f"is on {names}, where interrupts take all of the time"
            help = "lighten the interrupts, or use other units"
            yield codes.NO_LENGTH(text, at=placed.job.at, path=table.path(placed), help=help)


def _shape(placed: Placed, clock: Clock) -> Iterator[str]:
    """Say where the parts do not make up the job: its start and end, its WCET from 0 to C, gaps between them."""
    job, parts = placed.job, placed.job.parts
    wcet = placed.active.wcets[job.version]
    if parts[0].start != job.start or parts[-1].end != job.end:
        yield f"lasts from {job.start} to {job.end}, its parts from {parts[0].start} to {parts[-1].end}"
    done = 0
    for number, part in enumerate(parts, 1):
        begun, ended = clock.ticks(part.executed_from), clock.ticks(part.executed_to)
        if begun != done or ended <= begun:
            yield f"executes {part.executed_from} to {part.executed_to} in part {number}, after {clock.text(done)}"
        done = ended
    if done != wcet:
        yield f"executes {clock.text(done)} in all, its WCET is {clock.text(wcet)}"
    for number, (part, then) in enumerate(pairwise(parts), 1):
        if then.start <= part.end:
            yield f"has no gap between part {number}, until {part.end}, and part {number + 1}, from {then.start}"


def _gaps(placed: Placed, version: Version, locks: frozenset[str]) -> Iterator[str]:
    """Say which gaps lie where the version does not allow them."""
    parts, split = placed.job.parts, version.split
    if len(parts) < 2:
        return
    if not split.is_allowed:
        yield f'has {len(parts) - 1} gaps, but version "{version.name}" is not split'
    elif split.max_gaps is not None and len(parts) - 1 > split.max_gaps:
        yield f"has {len(parts) - 1} gaps, at most {split.max_gaps} are allowed"
    points = frozenset(split.points)
    for part in parts[:-1]:
        at = part.executed_to
        if split.points and at not in points:
            yield f"is interrupted after {at}, which is no split point"
        for access in version.accesses:
            if access.start < at < access.end and access.resource not in locks:
                yield f'is interrupted after {at}, in its access to "{access.resource}"'
    if split.anywhere and split.min_part is not None:
        short = [part for part in parts if part.executed_to - part.executed_from < split.min_part]
        for part in short:
            yield f"has a part of {part.executed_to - part.executed_from}, at least {split.min_part} is allowed"


def _lengths(placed: Placed, version: Version, clock: Clock) -> Iterator[str]:
    """Say which parts have not their reserved length."""
    lost = 0
    for number, part in enumerate(placed.job.parts, 1):
        work = lost + clock.ticks(part.executed_to) - clock.ticks(part.executed_from)
        length = placed.service.length(work)
        given = clock.ticks(part.end) - clock.ticks(part.start)
        if length is not None and given != length:
            made = f"{_reason(part, lost, placed, clock)} {clock.text(length)}"
            yield f"lasts {clock.text(given)} in part {number}, {made}"
        lost = clock.ticks(version.split.resume)


def _reason(part: Part, lost: int, placed: Placed, clock: Clock) -> str:
    resumed = f" + {clock.text(lost)} to resume" if lost else ""
    made = "with interrupts make" if placed.service.interrupts else "make"
    return f"{part.executed_to - part.executed_from} of execution{resumed} {made}"


PARTS = Rule(
    "parts",
    "The parts of a job execute its WCET in order, with gaps between them, at most max-gaps of them, at split points "
    "of its version (or anywhere outside access phases, in parts of at least min-part); each part lasts the reserved "
    "length of what it executes, after a gap with the time to resume.",
    check_parts,
)


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
    """Yield pairs that are not nested, the earlier job first: for every job one at most that it collides with.

    In order of starts, each preemptive job that has not ended lies in a gap of the one that started before it, so a job
    that fits into a gap of the last one fits into all of them. Where neither has a gap, rule exclusive says it all.
    """
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


Above = dict[str, dict[str, set[str]]]
"""For every unit and task split anywhere on it, the tasks of which a job starts in a gap of one of its jobs."""


def check_priorities(tables: Tables) -> Iterator[Diagnostic]:
    """Report the relation of every unit, and a circle in it.

    Preemptive fixed priorities play the gaps of fully preemptive jobs if a task i is above a task k wherever a job of i
    starts in a gap of a job of k, over all modes and tables. With a circle, the table must suspend and resume itself.
    """
    above: Above = {}
    for table in tables.modes:
        if table.period:
            _note(above, table.jobs, _unrolled(table))
    for switch in tables.switches:
        if switch.source.period and switch.target.period:
            line = switch.in_progress() + switch.jobs
            _note(above, line, line + switch.after(switch.cycles_of(line)))
    at = tables.modes[0].at if tables.modes else NOWHERE
    for unit, lower in sorted(above.items()):
        told = "; ".join(f"{_listed(lower[task])} above {_listed([task])}" for task in sorted(lower))
        yield codes.PRIORITIES(told, at=at, path=about(unit=unit))
        circle = _circle(lower)
        if circle:
            help = (
                "state split points as a list for one of them; a target that suspends by the table needs no priorities"
            )
            text = "no fixed priorities play the table: " + " above ".join(f'"{task}"' for task in circle)
            yield codes.PRIORITY_CIRCLE(text, at=at, path=about(unit=unit), help=help)


def _unrolled(table: ModeTable) -> list[Placed]:
    """Return the jobs of as many cycles as the longest preemptive job lasts, and one more."""
    last = max((p.end for p in table.jobs if len(p.stretches) > 1), default=0)
    return [p.moved(turn * table.period, "") for turn in range(last // table.period + 1) for p in table.jobs]


def _note(above: Above, jobs: Iterable[Placed], line: Iterable[Placed]) -> None:
    split = [p for p in jobs if len(p.stretches) > 1 and p.version is not None and p.version.split.anywhere]
    if not split:
        return
    starts: dict[str, list[tuple[int, str]]] = {}
    for placed in line:
        for unit in dict.fromkeys(placed.job.units):
            starts.setdefault(unit, []).append((placed.start, placed.job.task))
    for on_unit in starts.values():
        on_unit.sort()
    for placed in split:
        for unit in dict.fromkeys(placed.job.units):
            found = {task for task in _in_gaps(placed, starts[unit]) if task != placed.job.task}
            if found:
                above.setdefault(unit, {}).setdefault(placed.job.task, set()).update(found)


def _in_gaps(placed: Placed, starts: list[tuple[int, str]]) -> Iterator[str]:
    for before, after in pairwise(placed.stretches):
        begin, end = placed.start + before[1], placed.start + after[0]
        for start, task in starts[bisect_left(starts, (begin, "")) :]:
            if start >= end:
                break
            yield task


def _circle(lower: dict[str, set[str]]) -> list[str]:
    """Return tasks each of which must be above the next, the last the first again; none if levels can be given."""
    try:
        TopologicalSorter({task: sorted(lower[task]) for task in sorted(lower)}).prepare()
    except CycleError as failure:
        return list(failure.args[1])
    return []


def _listed(tasks: Iterable[str]) -> str:
    return ", ".join(f'"{task}"' for task in sorted(tasks))


PRIORITY_RULE = Rule(
    "run time",
    "Told, not judged: which tasks must be above which on a unit so that preemptive fixed priorities play the gaps of "
    "jobs that may be interrupted anywhere, over all modes and tables, and where that is a circle.",
    check_priorities,
)
