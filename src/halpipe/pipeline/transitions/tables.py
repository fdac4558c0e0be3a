"""Transition tables for the allowed mode pairs: the shortest length for which the search finds one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from halpipe.diagnostics import Diagnostic, error, warning
from halpipe.models import Job, Status, TransitionTable
from halpipe.pipeline.transitions.modes import on_common_grid
from halpipe.pipeline.transitions.search import Blocked, Table

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.durations import Duration
    from halpipe.models import Schedule, TaskModel, Transition
    from halpipe.pipeline.transitions.line import LineJob
    from halpipe.pipeline.transitions.modes import GridMode

NO_TABLE = error(
    "HAL0410",
    "No transition table found",
    "For a mode pair that the model lists, no table of an allowed length was found. The finding names the task and "
    "the rule that stood in the way of the longest table tried.",
)
NO_IMPLIED_TABLE = warning(
    "HAL0411",
    "Mode pair has no transition table",
    "The model lists no transitions, so every pair may be switched; for this one no table was found, and the switch "
    "must not be performed.",
)

LENGTHS = 400
"""Lengths that are considered for one pair."""

WORK = 400_000
"""Jobs, times lengths, that are looked at for one pair: large modes get fewer tries."""

Check = Callable[[TransitionTable], bool]
"""Decides whether a table is valid: the independent check of the stages."""


@dataclass(frozen=True, slots=True)
class Switched:
    """The tables found, and a finding for every pair without one."""

    tables: tuple[TransitionTable, ...]
    diagnostics: tuple[Diagnostic, ...]


def switch_tables(model: TaskModel, schedule: Schedule, check: Check, *, all_or_none: bool = False) -> Switched:
    """Find a table for every allowed pair of scheduled modes; `check` has the last word on each.

    With `all_or_none`, stop at the first pair without a table.
    """
    scheduled = {mode.name: mode for mode in schedule.modes if mode.status is Status.VALID}
    tables, diagnostics = [], []
    for pair in model.allowed_transitions():
        if pair.source not in scheduled or pair.target not in scheduled:
            continue
        before, after = on_common_grid(model, scheduled[pair.source], scheduled[pair.target])
        found = _shortest(pair, before, after, check)
        if isinstance(found, TransitionTable):
            tables.append(found)
        else:
            diagnostics.append(_failure(model, pair, found))
            if all_or_none:
                break
    return Switched(tuple(tables), tuple(diagnostics))


def _shortest(pair: Transition, before: GridMode, after: GridMode, check: Check) -> TransitionTable | Blocked:
    """Try lengths from short to long until a table passes the check."""
    blocked = Blocked("", "no length is allowed")
    paces = list(_paces(before, after))
    tries = max(8, WORK // max(1, len(before.jobs) + len(after.jobs)))
    for length in _lengths(pair, before, after):
        starving = next((pace.task for pace in paces if not pace.can_be_kept(length)), None)
        if starving is not None:
            blocked = Blocked(starving, "would not start often enough") if not blocked.progress else blocked
            continue
        tries -= 1
        if tries < 0:
            break
        jobs = Table(before, after, length).fill()
        if isinstance(jobs, Blocked):
            blocked = jobs if jobs.progress >= blocked.progress else blocked
            continue
        table = _named(pair, before, after, length, jobs)
        if check(table):
            return table
        blocked = Blocked("", "a chain limit or another rule that only the whole line shows", progress=2)
    return blocked


@dataclass(frozen=True, slots=True)
class _Pace:
    """How often a task of both modes must start: `gap` is the time without a start if the table has length zero."""

    task: str
    gap: int
    most: int
    shortest: int

    def can_be_kept(self, length: int) -> bool:
        """Return whether some number of starts divides the gap into parts that are neither too long nor too short.

        A condition that is quick to check and rules out most lengths of strictly periodic tasks.
        """
        gap = self.gap + length
        return -(-gap // self.most) <= gap // self.shortest


def _paces(before: GridMode, after: GridMode) -> Iterator[_Pace]:
    for active in after.expansion.tasks:
        name, period = active.name, active.task.period
        if name not in before.expansion.by_name or period is None:
            continue
        last = max(job.start for job in before.jobs if job.task == name) - before.hyperperiod
        first = min(job.start for job in after.jobs if job.task == name)
        wcets = [shape.wcet for mode in (before, after) for shape in mode.shapes[name]]
        yield _Pace(name, first - last, (period * (1 + active.task.slack)) // after.tick, min(wcets))


def _lengths(pair: Transition, before: GridMode, after: GridMode) -> list[int]:
    """Return the lengths to try: those at which something begins to fit, and an even grid up to the limit."""
    last = _longest(pair.max_length, before, after)
    ends = {job.end - before.hyperperiod for job in before.jobs} | {0}
    starts = {job.start for job in after.jobs}
    exact = sorted({end - start for end in ends for start in starts if 0 < end - start <= last} | {0})
    for window in (w for windows in after.windows.values() for w in windows):
        if len(exact) > LENGTHS:
            break
        instants = {window.instant(job) - before.hyperperiod for job in before.jobs if job.task == window.task}
        exact += [i + window.low - s for i in instants for s in starts if 0 < i + window.low - s <= last]
    step = max(1, last // LENGTHS)
    return sorted({*sorted(set(exact))[:LENGTHS], *range(0, last + 1, step)})


def _longest(limit: Duration | None, before: GridMode, after: GridMode) -> int:
    """Return the stated limit in ticks; without one, room for a cycle of each mode and its longest job."""
    if limit is not None:
        return limit // before.tick
    longest = max((shape.wcet for shapes in after.shapes.values() for shape in shapes), default=0)
    return before.hyperperiod + after.hyperperiod + longest


def _named(
    pair: Transition, before: GridMode, after: GridMode, length: int, jobs: tuple[LineJob, ...]
) -> TransitionTable:
    tick = after.tick
    return TransitionTable(
        source=pair.source,
        target=pair.target,
        length=tick * length,
        worst_latency=tick * (before.hyperperiod + length),
        status=Status.VALID,
        jobs=tuple(
            Job(
                task=job.task,
                index=job.index,
                start=tick * job.start,
                end=tick * job.end,
                version=job.shape.version,
                units=job.units,
            )
            for job in sorted(jobs)
        ),
    )


def _failure(model: TaskModel, pair: Transition, blocked: Blocked) -> Diagnostic:
    code = NO_TABLE if model.transitions else NO_IMPLIED_TABLE
    who = f'task "{blocked.task}": ' if blocked.task else "of "
    return code(
        f"no table found; the closest try failed because {who}{blocked.rule}",
        at=pair.at,
        path=f'transition "{pair.source}" to "{pair.target}"',
        help="allow a longer table, more slack or wider windows, or another --seed",
    )
