"""Checks of precedence constraints, and of the instants to which windows and chains refer (MODEL 10)."""

from __future__ import annotations

from graphlib import CycleError, TopologicalSorter
from itertools import combinations, pairwise
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, about
from halpipe.core.durations import ZERO, greatest_common_divisor
from halpipe.core.suggest import few
from halpipe.models import Anchor, Chain, Match, Precedence, Task, Version
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import check, place, task_path, version_path

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from halpipe.pipeline.validate.context import ActiveMode, ActiveTask, Context

MAX_CYCLES = 20
"""Cycles reported for one mode; a dense knot has more than anyone can read."""


@check("windows", codes.EMPTY_WINDOW, codes.SELF_PRECEDENCE)
def check_windows(context: Context) -> Iterator[Diagnostic]:
    """Every precedence window has min <= max, and no task is its own predecessor."""
    for task, version in context.versions_of_tasks:
        for constraint in version.precedences:
            is_self = constraint.task == task.name
            if constraint.min <= constraint.max and not is_self:
                continue
            at = place(constraint, version, task)
            path = about(version_path(task, version), precedence_on=constraint.task)
            if constraint.min > constraint.max:
                text = f"has the minimum {constraint.min} beyond its maximum {constraint.max}"
                yield codes.EMPTY_WINDOW(text, at=at, path=path, help="exchange them, or correct one of them")
            if is_self:
                help = "remove the constraint; period and slack already bound how far the task's own jobs are apart"
                yield codes.SELF_PRECEDENCE("names the task itself", at=at, path=path, help=help)


# ------------------------------------------------------------------------------------------------ cycles


@check("cycles", codes.PRECEDENCE_CYCLE)
def check_cycles(context: Context) -> Iterator[Diagnostic]:
    """In every mode the predecessor relation of the available versions is acyclic.

    (D) What counts are the versions available in the mode: two tasks may depend on each other in versions that are
    never available together.
    """
    if not context.modes:
        graph = {
            task.name: dict.fromkeys(p.task for version in task.versions for p in version.precedences)
            for task in context.tasks.values()
        }
        yield from _cycles(context, about(model=context.model.name), graph, None)
    for mode in context.active:
        if not mode.order:
            yield from _cycles(context, mode.path, mode.named, mode)


def _cycles(
    context: Context, path: str, named: Mapping[str, Mapping[str, object]], mode: ActiveMode | None
) -> Iterator[Diagnostic]:
    """Report cycles that share no edge, until none is left."""
    graph = {name: [other for other in others if other != name] for name, others in named.items()}
    for _ in range(MAX_CYCLES):
        try:
            TopologicalSorter(graph).prepare()
        except CycleError as failure:
            cycle: list[str] = failure.args[1]  # each a predecessor of the next, the first repeated at the end
        else:
            return
        for before, after in pairwise(cycle):
            graph[after].remove(before)
        yield _cycle(context, path, _from_first(cycle[:-1], graph), mode)


def _from_first(cycle: list[str], order: Mapping[str, object]) -> list[str]:
    """Turn the cycle so that it begins with the task that stands first in the model."""
    position = {name: index for index, name in enumerate(order)}
    first = min(cycle, key=position.__getitem__)
    turn = cycle.index(first)
    return [*cycle[turn:], *cycle[:turn], first]


def _cycle(context: Context, path: str, cycle: list[str], mode: ActiveMode | None) -> Diagnostic:
    constraint, version = _constraint(context, cycle[1], cycle[0], mode)
    steps = ", ".join(f'"{after}" needs "{before}"' for before, after in pairwise(cycle[:12]))
    text = f"{len(cycle) - 1} tasks are each other's predecessors: {steps}" + (", ..." if len(cycle) > 12 else "")
    help = "remove one of these constraints; the reader of that edge then takes the data of an earlier job"
    return codes.PRECEDENCE_CYCLE(text, at=place(constraint, version), path=path, help=help)


def _constraint(context: Context, name: str, predecessor: str, mode: ActiveMode | None) -> tuple[Precedence, Version]:
    versions = mode.tasks[name].versions if mode else context.tasks[name].versions
    return next((p, v) for v in versions for p in v.precedences if p.task == predecessor)


# ------------------------------------------------------------------------------------------------ who runs


@check("predecessors", codes.PREDECESSOR_ABSENT, codes.VERSION_UNUSABLE)
def check_predecessors(context: Context) -> Iterator[Diagnostic]:
    """In every mode each task has an available version whose predecessors all run there; versions that have not are
    pointed out.
    """
    for mode in context.active:
        for active in mode.tasks.values():
            lacking = [(version, _absent(context, mode, version)) for version in active.versions]
            if all(absent for _, absent in lacking):
                for version, absent in lacking:
                    yield _unmet(mode, active, version, absent, is_last=True)
            else:
                for version, absent in lacking:
                    if absent:
                        yield _unmet(mode, active, version, absent, is_last=False)


def _absent(context: Context, mode: ActiveMode, version: Version) -> list[str]:
    """Return the predecessors that exist but do not run in the mode; unknown ones are reported elsewhere."""
    if not version.precedences:
        return []
    named = dict.fromkeys(p.task for p in version.precedences)
    return [name for name in named if name not in mode.tasks and name in context.tasks]


def _unmet(mode: ActiveMode, active: ActiveTask, version: Version, absent: list[str], *, is_last: bool) -> Diagnostic:
    path = about(mode.path, task=active.task.name, version=version.name)
    at = place(active.run, mode.mode, version, active.task)
    text = f"is constrained by {few(absent)}, which {'do' if len(absent) > 1 else 'does'} not run in the mode"
    if is_last:
        help = "let the predecessor run in the mode, or make a version without the constraint available"
        return codes.PREDECESSOR_ABSENT(text, at=at, path=path, help=help)
    help = "let the predecessor run in the mode, or take the version out of the mode"
    return codes.VERSION_UNUSABLE(text + ", so it is never chosen", at=at, path=path, help=help)


@check("demand", codes.NEVER_DEMANDED)
def check_demand(context: Context) -> Iterator[Diagnostic]:
    """In every mode each task without a period is named by a precedence constraint of another task."""
    for mode in context.active:
        on_demand = [name for name, active in mode.tasks.items() if active.task.period is None]
        if len(on_demand) == len(mode.tasks):
            continue  # reported as a mode without a periodic task
        demanded = {name for others in mode.named.values() for name in others}
        for name in on_demand:
            if name not in demanded:
                active = mode.tasks[name]
                text = "has no period, and no constraint of the mode names it: it never runs"
                help = "give it a period, or let a task that needs it name it in a precedence constraint"
                path, at = about(mode.path, task=name), place(active.run, mode.mode, active.task)
                yield codes.NEVER_DEMANDED(text, at=at, path=path, help=help)


# ------------------------------------------------------------------------------------------------ instants

PLAIN = (Anchor.START, Anchor.END)


@check("lets", codes.LET_BEYOND_DEADLINE)
def check_lets(context: Context) -> Iterator[Diagnostic]:
    """A logical execution time is above zero and at most the deadline of its task."""
    for task in context.model.tasks:
        if task.let is None or task.period is None:
            continue
        deadline = task.period if task.deadline is None else task.deadline
        whose = " (its period)" if task.deadline is None else ""
        if task.let > deadline or task.let == ZERO:
            text = f"has the LET {task.let}, its deadline is {deadline}{whose}"
            help = f"set the LET to more than 0ms and at most {deadline}"
            yield codes.LET_BEYOND_DEADLINE(text, at=place(task), path=task_path(task), help=help)


@check("instants", codes.NO_SUCH_INSTANT, codes.CYCLE_WITHOUT_PERIOD)
def check_instants(context: Context) -> Iterator[Diagnostic]:
    """Windows count between instants that both jobs have; tasks with constraints of the same cycle have periods."""
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


@check("events", codes.NO_SUCH_INSTANT)
def check_events(context: Context) -> Iterator[Diagnostic]:
    """The latencies of a chain count between instants that jobs of its first and its last task have."""
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


@check("contradictions", codes.CONTRADICTION)
def check_contradictions(context: Context) -> Iterator[Diagnostic]:
    """Windows to the job of the same cycle meet each other, and the releases and slacks of both tasks."""
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
            usable = {v.name: list(_unmet_windows(mode, name, v)) for v in active.versions}
            if all(usable.values()):
                yield from (found for each in usable.values() for found in each)


def _instant(row: Precedence) -> tuple[object, ...]:
    return row.task, row.anchor, row.point, row.to


def _window(row: Precedence) -> str:
    return f"[{row.min}, {row.max}]"


def _unmet_windows(mode: ActiveMode, name: str, version: Version) -> Iterator[Diagnostic]:
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
    """Compare the window with the jobs that are released soonest and latest after the job of their cycle.

    A job may follow by every multiple of the greatest common divisor of the periods that is below the other period.
    """
    period, other = task.period, before.period
    assert period
    assert other
    assert task.offset is not None
    assert before.offset is not None
    own, jitter = task.offset % period, period * task.slack
    others, late = before.offset % other, other * before.slack if row.anchor is Anchor.START else ZERO
    step = greatest_common_divisor((period, other))
    latest = pow(-(period // step), -1, other // step)
    for job in (0, latest):
        between = own - others + (period * job) % other
        if between - late <= row.max and between + jitter >= row.min:
            continue
        text = f"asks for {_window(row)}, but its job {job} starts {between - late} to {between + jitter} after"
        path = about(mode.path, task=task.name, version=version.name, precedence_on=row.task)
        help = "change the window, an offset, or a slack"
        places = [place(before), place(task)]
        yield codes.CONTRADICTION(text, at=place(row, version, task), path=path, help=help, places=places)
        return
