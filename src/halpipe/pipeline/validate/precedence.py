"""Checks of precedence constraints: windows, cycles, and predecessors that do not run."""

from __future__ import annotations

from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import Check, place, quoted, version_path

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Precedence, Version
    from halpipe.pipeline.validate.context import ActiveMode, ActiveTask, Context

MAX_CYCLES = 20
"""Cycles reported for one mode; a dense knot has more than anyone can read."""


def check_windows(context: Context) -> Iterator[Diagnostic]:
    """A window has min <= max, and its predecessor is another task."""
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


def check_cycles(context: Context) -> Iterator[Diagnostic]:
    """The predecessor relation of every mode is acyclic; of the whole model, while it has no modes.

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


def check_predecessors(context: Context) -> Iterator[Diagnostic]:
    """In every mode, some available version of each task has all its predecessors; those that have not are named."""
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
    text = f"is constrained by {quoted(absent)}, which {'do' if len(absent) > 1 else 'does'} not run in the mode"
    if is_last:
        help = "let the predecessor run in the mode, or make a version without the constraint available"
        return codes.PREDECESSOR_ABSENT(text, at=at, path=path, help=help)
    help = "let the predecessor run in the mode, or take the version out of the mode"
    return codes.VERSION_UNUSABLE(text + ", so it is never chosen", at=at, path=path, help=help)


def check_demand(context: Context) -> Iterator[Diagnostic]:
    """In every mode, a task without a period is demanded by a constraint of some other task."""
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


CHECKS = (
    Check(
        "windows",
        "Every precedence window has min <= max, and no task is its own predecessor.",
        (codes.EMPTY_WINDOW, codes.SELF_PRECEDENCE),
        check_windows,
    ),
    Check(
        "cycles",
        "In every mode the predecessor relation of the available versions is acyclic.",
        (codes.PRECEDENCE_CYCLE,),
        check_cycles,
    ),
    Check(
        "predecessors",
        "In every mode each task has an available version whose predecessors all run there; versions that have "
        "not are pointed out.",
        (codes.PREDECESSOR_ABSENT, codes.VERSION_UNUSABLE),
        check_predecessors,
    ),
    Check(
        "demand",
        "In every mode each task without a period is named by a precedence constraint of another task.",
        (codes.NEVER_DEMANDED,),
        check_demand,
    ),
)
