"""Priority relation of tasks at run time that lets fully preemptive jobs end in time.

Fixed priorities that are preemptive play the gaps of such jobs if a task i is above a task k wherever a job of i starts
in a gap of a job of k, over all modes and tables (MODEL 8.2, run time). The relation is reported for each unit, and
where it is a circle: then the table itself must suspend and resume.
"""

from __future__ import annotations

from bisect import bisect_left
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import NOWHERE, about
from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.rules import Rule

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.pipeline.verify.binding import Tables
    from halpipe.pipeline.verify.tables import ModeTable, Placed

Above = dict[str, dict[str, set[str]]]
"""For every unit and task split anywhere on it, the tasks of which a job starts in a gap of one of its jobs."""


def check_priorities(tables: Tables) -> Iterator[Diagnostic]:
    """Tell the relation of every unit, and a circle in it."""
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
