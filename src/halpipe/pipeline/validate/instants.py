"""Checks of the instants to which requirements refer: of windows, cycles, chains and logical execution times."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.core.durations import ZERO
from halpipe.models import Anchor, Match
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import Check, place, task_path, version_path

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Chain, Precedence, Task, Version
    from halpipe.pipeline.validate.context import ActiveMode, Context

PLAIN = (Anchor.START, Anchor.END)
MAX_JOBS = 10_000
"""Jobs of a task whose releases are compared with those of a predecessor."""


def check_lets(context: Context) -> Iterator[Diagnostic]:
    """A logical execution time is at most the deadline."""
    for task in context.model.tasks:
        if task.let is None or task.period is None:
            continue
        deadline = task.period if task.deadline is None else task.deadline
        whose = " (its period)" if task.deadline is None else ""
        if task.let > deadline or task.let == ZERO:
            text = f"has the LET {task.let}, its deadline is {deadline}{whose}"
            help = f"set the LET to more than 0ms and at most {deadline}"
            yield codes.LET_BEYOND_DEADLINE(text, at=place(task), path=task_path(task), help=help)


def check_windows(context: Context) -> Iterator[Diagnostic]:
    """Windows refer to instants that both jobs have."""
    for task, version in context.versions_of_tasks:
        for row in version.precedences:
            if row.anchor in PLAIN and row.to is Anchor.START and row.point is None and row.match is Match.WINDOW:
                continue
            at = place(row, version, task)
            path = about(version_path(task, version), precedence_on=row.task)
            before = context.tasks.get(row.task)
            for text, help in _instants(row, before):
                places = [] if before is None else [place(before)]
                yield codes.NO_SUCH_INSTANT(text, at=at, path=path, help=help, places=places)
            if row.match is Match.CYCLE:
                lacking = [one for one in (task, before) if one is not None and not one.period]
                for one in lacking:
                    text = f'belongs to the same cycle, but task "{one.name}" has no period'
                    help = f'give "{one.name}" a period, or leave out match="cycle"'
                    yield codes.CYCLE_WITHOUT_PERIOD(text, at=at, path=path, help=help, places=[place(one)])


def _instants(row: Precedence, before: Task | None) -> Iterator[tuple[str, str]]:
    if row.to not in PLAIN:
        yield f"leads to the {row.to} of its job", 'write to="start" or to="end"'
    if (row.anchor is Anchor.POINT) != (row.point is not None):
        what = "no point" if row.point is None else f'the point {row.point}, but from="{row.anchor}"'
        yield f"counts from the {row.anchor}, and states {what}", 'write from="point" with a point, such as point="3ms"'
    if before is None:
        return
    if row.anchor is Anchor.RELEASE and before.period is None:
        yield f'counts from the release of "{row.task}", which has no period', "count from its start or its end"
    short = [v for v in before.versions if v.wcet is not None and row.point is not None and row.point > v.wcet]
    for version in short if row.anchor is Anchor.POINT else ():
        text = f'counts from the point {row.point}, but version "{version.name}" of "{row.task}" takes {version.wcet}'
        yield text, f"use a point of at most {version.wcet}"


def check_chains(context: Context) -> Iterator[Diagnostic]:
    """The events of a chain are instants of its first and its last task."""
    for chain in context.model.chains:
        first = context.tasks.get(chain.tasks[0]) if chain.tasks else None
        for text, help in _events(chain, first):
            places = [] if first is None else [place(first)]
            yield codes.NO_SUCH_INSTANT(text, at=place(chain), path=about(chain=chain.name), help=help, places=places)


def _events(chain: Chain, first: Task | None) -> Iterator[tuple[str, str]]:
    if chain.anchor is Anchor.POINT:
        yield "counts from a point of its first task", 'write from="release", from="start" or from="end"'
    if chain.anchor is Anchor.RELEASE and first is not None and first.period is None:
        text = f'counts from the release of "{first.name}", which has no period'
        yield text, "count from its start or its end"
    if chain.to not in (None, *PLAIN):
        yield f"counts to the {chain.to} of its last task", 'write to="start" or to="end"'
    if len(chain.tasks) == 1 and chain.anchor is Anchor.END and chain.to is Anchor.START:
        yield "counts from the end of its only task to the start", "exchange the events"


# ------------------------------------------------------------------------------------------------ contradictions


def check_contradictions(context: Context) -> Iterator[Diagnostic]:
    """Windows to the job of the same cycle meet each other and the releases of both tasks."""
    for task, version in context.versions_of_tasks:
        rows = [row for row in version.precedences if row.match is Match.CYCLE and row.min <= row.max]
        for one, other in combinations(rows, 2):
            if _instant(one) == _instant(other) and (one.min > other.max or other.min > one.max):
                text = f"asks for {_window(one)} and for {_window(other)} after the same job"
                path = about(version_path(task, version), precedence_on=one.task)
                at, places = place(other, version, task), [place(one, version, task)]
                help = "let the windows meet, or remove one of them"
                yield codes.CONTRADICTION(text, at=at, path=path, help=help, places=places)
    for mode in context.active:
        for name, active in mode.tasks.items():
            usable = {v.name: list(_unmet(mode, name, v)) for v in active.versions}
            if all(usable.values()):
                yield from (found for each in usable.values() for found in each)


def _instant(row: Precedence) -> tuple[object, ...]:
    return row.task, row.anchor, row.point, row.to


def _window(row: Precedence) -> str:
    return f"[{row.min}, {row.max}]"


def _unmet(mode: ActiveMode, name: str, version: Version) -> Iterator[Diagnostic]:
    """Compare windows from a release to a start with the releases and slacks of both tasks."""
    task = mode.tasks[name].task
    for row in version.precedences:
        before = mode.tasks[row.task].task if row.task in mode.tasks else None
        if row.match is not Match.CYCLE or before is None or row.to is not Anchor.START:
            continue
        offsets, periods = (task.offset, before.offset), (task.period, before.period)
        if None in offsets or None in periods or not all(periods) or row.anchor not in (Anchor.START, Anchor.RELEASE):
            continue
        yield from _apart(mode, task, version, row, before)


def _apart(mode: ActiveMode, task: Task, version: Version, row: Precedence, before: Task) -> Iterator[Diagnostic]:
    period, other = task.period, before.period
    assert period
    assert other
    assert task.offset is not None
    assert before.offset is not None
    own, jitter = task.offset % period, period * task.slack
    others, late = before.offset % other, other * before.slack if row.anchor is Anchor.START else ZERO
    hyperperiod = mode.hyperperiod
    for job in range(min(MAX_JOBS, hyperperiod // period if hyperperiod else 1)):
        between = own + period * job - (others + other * ((period * job) // other))
        if between - late <= row.max and between + jitter >= row.min:
            continue
        text = f"asks for {_window(row)}, but its job {job} starts {between - late} to {between + jitter} after"
        path = about(mode.path, task=task.name, version=version.name, precedence_on=row.task)
        help = "change the window, an offset, or a slack"
        places = [place(before), place(task)]
        yield codes.CONTRADICTION(text, at=place(row, version, task), path=path, help=help, places=places)
        return


CHECKS = (
    Check(
        "lets",
        "A logical execution time is above zero and at most the deadline of its task.",
        (codes.LET_BEYOND_DEADLINE,),
        check_lets,
    ),
    Check(
        "instants",
        "Windows count between instants that both jobs have; tasks with constraints of the same cycle have periods.",
        (codes.NO_SUCH_INSTANT, codes.CYCLE_WITHOUT_PERIOD),
        check_windows,
    ),
    Check(
        "events",
        "The latencies of a chain count between instants that jobs of its first and its last task have.",
        (codes.NO_SUCH_INSTANT,),
        check_chains,
    ),
    Check(
        "contradictions",
        "Windows to the job of the same cycle meet each other, and the releases and slacks of both tasks.",
        (codes.CONTRADICTION,),
        check_contradictions,
    ),
)
