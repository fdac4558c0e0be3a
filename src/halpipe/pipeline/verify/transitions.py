"""The rules of a switch from mode n to mode m (MODEL 5), on the line: cycles of n, the table, cycles of m.

Two of each are enough but where a job or a window reaches further.
"""

from __future__ import annotations

from itertools import pairwise
from math import floor
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.chains import check_chain_on_line
from halpipe.pipeline.verify.jobs import check_binding_on_line, check_unit, check_version
from halpipe.pipeline.verify.precedence import check_precedence_on_line
from halpipe.pipeline.verify.preemption import check_nested_on_line, check_parts
from halpipe.pipeline.verify.sharing import check_access, check_exclusive
from halpipe.pipeline.verify.tables import TABLE, ActiveTask, Placed, Rule, Switch, key_of, reached
from halpipe.pipeline.verify.timing import late_for_arrivals

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Precedence


def check_length(switch: Switch) -> Iterator[Diagnostic]:
    """Check 0 <= L <= the stated maximum, the reported worst latency, and that no job is given twice.

    (D) The worst mode-change latency is that of a request just after an end of the hyperperiod: t_P of mode n, plus L.
    """
    given, path = switch.table, switch.path()
    if given.length < ZERO or (switch.max_length is not None and given.length > switch.max_length):
        limit = f"at most {switch.max_length}" if switch.max_length is not None else "any length from 0"
        text = f"takes {given.length}, the model allows {limit}"
        yield codes.TOO_LONG(text, at=given.at, path=path, help="find a shorter table, or allow a longer one")
    worst = switch.source.period + switch.length
    if given.worst_latency * switch.clock.scale != Duration(worst):
        text = f"worst latency {given.worst_latency}; hyperperiod and length make {switch.clock.text(worst)}"
        yield codes.WRONG_FIGURE(text, at=given.at, path=path, help="have the report made again from the jobs")
    open_jobs = switch.in_progress() + switch.jobs
    if switch.cycles_needed(open_jobs) > switch.cycles_of(open_jobs):
        text = f"a job in progress lasts over {switch.cycles_needed(open_jobs)} cycles of the mode to come"
        yield codes.TOO_LONG(text, at=given.at, path=path, help="split the job less, so that it ends earlier")
    seen: set[tuple[str, int]] = set()
    for placed in switch.jobs:
        key = (placed.job.task, placed.job.index)
        if key in seen:
            text = f"is given more than once, here to start at {placed.job.start}"
            yield codes.REPEATED_JOB(text, at=placed.job.at, path=switch.path(placed), help="number the jobs of a task")
        seen.add(key)


def check_continuity(switch: Switch) -> Iterator[Diagnostic]:
    """Check the starts of every task that runs in both modes, wherever one of two neighbours is not in the same mode.

    (D) Within one mode, section 3 decides: it admits jobs of one task side by side where the deadline exceeds the
    period. Tasks on demand cannot starve, as they have no period; they must not run against themselves.
    """
    line: dict[str, list[Placed]] = {}
    for placed in (*switch.before(2), *switch.jobs, *switch.after(2)):
        line.setdefault(placed.job.task, []).append(placed)
    for name, active in switch.target.mode.tasks.items():
        if name not in switch.source.mode.tasks:
            continue
        jobs = sorted(line.get(name, ()), key=lambda p: (p.start, p.job.index))
        for before, placed in pairwise(jobs):
            if before.where != placed.where or placed.where == TABLE:
                yield from _neighbours(switch, active, before, placed)
        yield from _against_itself(switch, jobs)


def _neighbours(switch: Switch, active: ActiveTask, before: Placed, placed: Placed) -> Iterator[Diagnostic]:
    clock, path = switch.clock, switch.path(placed)
    at = placed.job.at
    gap = placed.start - before.start
    if active.period is not None:
        most = floor((1 + active.task.slack) * active.period)
        if gap > most:
            text = f"starts at {clock.text(placed.start)} after the switch, {clock.text(gap)} after {before.label}; "
            text += f"at most {clock.text(most)} is allowed: {clock.text(gap - most)} too late"
            yield codes.STARVED(text, at=at, path=path, help="start a job of the task in between")
    for text in late_for_arrivals(active.task, before, placed, clock):
        yield codes.ARRIVAL_LATE(text, at=at, path=path, help="start a job of the task in between")


def _against_itself(switch: Switch, jobs: list[Placed]) -> Iterator[Diagnostic]:
    """Compare each job with the one of another part of the line, or of the table, that ends last of those before it.

    The job that ends last is not always the one before: a shorter one may lie between.
    """
    clock = switch.clock
    last: dict[str, Placed] = {}
    for placed in jobs:
        others = [p for where, p in last.items() if where != placed.where or where == TABLE]
        longest = max(others, key=lambda p: p.end, default=placed)
        if longest is not placed and longest.end > placed.start:
            text = f"starts at {clock.text(placed.start)} after the switch, while {longest.label} runs until "
            text += f"{clock.text(longest.end)}: {clock.text(longest.end - placed.start)} too early"
            help = "start it after the end of the job before"
            yield codes.AGAINST_ITSELF(text, at=placed.job.at, path=switch.path(placed), help=help)
        if placed.span and (placed.where not in last or placed.end > last[placed.where].end):
            last[placed.where] = placed


def check_edge_on_line(switch: Switch) -> Iterator[Diagnostic]:
    """Check that nothing is in progress where a mode with a closed edge begins, and the LET of jobs of the table.

    (D) A job of the table is released when it starts.
    """
    clock = switch.clock
    for placed in (*switch.in_progress(), *switch.jobs) if switch.target.mode.is_closed else ():
        if placed.end > switch.length:
            text = f"ends at {clock.text(placed.end)}, after the mode with a closed edge begins at "
            text += clock.text(switch.length)
            help = "lengthen the table, or open the edge of the mode"
            yield codes.OVER_THE_EDGE(text, at=placed.job.at, path=switch.path(placed), help=help)
    for placed in switch.jobs:
        let = placed.active.let
        if let is not None and placed.span is not None and placed.span > let:
            text = f"lasts {clock.text(placed.span)}, longer than its LET of {clock.text(let)}"
            yield codes.LATE(text, at=placed.job.at, path=switch.path(placed), help="choose a shorter version")


def check_entering(switch: Switch) -> Iterator[Diagnostic]:
    """Check that a job of a task that enters lies in a window of some job of the table or of mode m.

    (D) Such a job is needed if it satisfies a constraint, even where another job would satisfy it as well.
    """
    entering = [p for p in switch.jobs if p.job.task not in switch.source.mode.tasks]
    if not entering:
        return
    needed = _Needs(switch)
    for placed in entering:
        if placed.version is not None and not needed.covers(placed):
            text = (
                f"starts at {placed.job.start} although its task enters with the mode and no constraint needs the job"
            )
            yield codes.STARTED_EARLY(text, at=placed.job.at, path=switch.path(placed), help="remove the job")


class _Needs:
    """For every predecessor, what jobs of the table and of the cycles of mode m ask of it."""

    def __init__(self, switch: Switch) -> None:
        self._clock = switch.clock
        self._cycle = switch.target.period
        self._of_table = _wanted_by(switch.jobs)
        self._of_mode = _wanted_by(p.moved(switch.length, "") for p in switch.target.jobs)

    def covers(self, placed: Placed) -> bool:
        """Tell whether the start (or the end) of the job lies in a window of one of them."""
        if any(self._lies(placed, 0, start, need) for start, need in self._of_table.get(placed.job.task, ())):
            return True
        return any(self._lies_in_a_cycle(placed, start, need) for start, need in self._of_mode.get(placed.job.task, ()))

    def _lies_in_a_cycle(self, placed: Placed, start: int, need: Precedence) -> bool:
        # the last cycle in which the job is not too old: in earlier ones it is younger
        turn = (self._clock.ticks(need.max) - self._age(placed, start, need)) // self._cycle
        return turn >= 0 and self._lies(placed, turn, start, need)

    def _lies(self, placed: Placed, turn: int, start: int, need: Precedence) -> bool:
        age = self._age(placed, start, need) + turn * self._cycle
        return self._clock.ticks(need.min) <= age <= self._clock.ticks(need.max)

    def _age(self, placed: Placed, start: int, need: Precedence) -> int:
        instant = placed.instant(key_of(need, self._clock))
        return start - (placed.end if instant is None else instant)


def _wanted_by(jobs: Iterable[Placed]) -> dict[str, list[tuple[int, Precedence]]]:
    """Return, for every predecessor, the instants of `jobs` to which windows lead from it, with the constraints."""
    wanted: dict[str, list[tuple[int, Precedence]]] = {}
    for placed in jobs:
        for need in placed.version.precedences if placed.version else ():
            wanted.setdefault(need.task, []).append((reached(need, placed), need))
    return wanted


SWITCH_RULES: tuple[Rule[Switch], ...] = (
    Rule(
        "transition length",
        "The table of a switch is no longer than the model allows, and its reported worst latency is the hyperperiod "
        "of the mode before plus its length.",
        check_length,
    ),
    Rule(
        "transition version",
        "Every job of the table uses a version of its task that is available in the mode to come.",
        check_version,
    ),
    Rule(
        "transition unit",
        "Every job of the table occupies exactly as many distinct units as the gang size of its version, all valid.",
        check_unit,
    ),
    Rule(
        "transition parts",
        "The parts of every job of the table make up the job, with gaps where it may be interrupted.",
        check_parts,
    ),
    Rule(
        "transition exclusive",
        "On every unit, the parts of jobs of the mode before, the table and the mode to come do not overlap.",
        check_exclusive,
    ),
    Rule(
        "transition nested",
        "Of two jobs of the mode before, the table and the mode to come that share a unit, one ends before the other "
        "starts or lies in one gap of the other; in each other's gaps lie no jobs of one task.",
        check_nested_on_line,
    ),
    Rule(
        "transition access",
        "At every instant of the switch, the bounds of all access phases in force on a resource sum to at most 1.",
        check_access,
    ),
    Rule(
        "transition binding",
        "The jobs of the table use the units of the mode to come, where their tasks are bound.",
        check_binding_on_line,
    ),
    Rule(
        "transition precedence",
        "Every precedence constraint of every job of the table and of the mode to come holds, with predecessors from "
        "the mode before, the table or the mode to come.",
        check_precedence_on_line,
    ),
    Rule(
        "transition continuity",
        "Across the switch, consecutive starts of a task that runs in both modes are at most (1 + slack) periods "
        "apart, and no job starts before all that started earlier have ended. Those of a task that serves arrivals "
        "keep distance and deadline across the switch.",
        check_continuity,
    ),
    Rule(
        "transition edge",
        "Nothing is in progress where a mode with a closed edge begins, and no job of the table outlasts its logical "
        "execution time.",
        check_edge_on_line,
    ),
    Rule(
        "transition entering",
        "A task that enters is started during the switch only where a constraint needs it; one that leaves, never.",
        check_entering,
    ),
    Rule(
        "transition chain",
        "Every chain whose tasks run in both modes keeps its limits across the switch.",
        check_chain_on_line,
    ),
)
