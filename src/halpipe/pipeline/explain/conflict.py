"""A minimal set of tasks and constraints that have no schedule together, by leaving out one after the other.

Every part of the mode keeps its hyperperiod, since with another one there might be more schedules or fewer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from graphlib import TopologicalSorter
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError, about, tasks_named
from halpipe.core.records import record
from halpipe.core.suggest import few
from halpipe.models import Anchor, Edge, Match
from halpipe.pipeline.explain import codes
from halpipe.pipeline.jobs import ActiveTask, Demand, demand_ranges, expand
from halpipe.pipeline.parts import has_whole_jobs
from halpipe.pipeline.solve.exact import Answer, Effort, is_installed, is_small, solve_expansion
from halpipe.pipeline.validate.context import place

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Chain, Mode, Precedence, TaskModel

MAX_JOBS = 300
"""Jobs of a mode up to which a conflicting set is looked for."""

EFFORT = 5
"""Deterministic seconds for every part tried."""


@record
class Kept:
    """Reduced mode: its tasks, the constraints kept of them, the chains with their limits, and its edge."""

    tasks: tuple[ActiveTask, ...]
    chains: tuple[Chain, ...]
    edge: Edge = Edge.OPEN


@record
class Conflict:
    """Answer of the exact engine for a mode; where infeasible, the part of the mode that already is."""

    answer: Answer
    kept: Kept | None = None
    is_minimal: bool = False


def find_conflict(model: TaskModel, mode: Mode, go_on: Callable[[], bool]) -> Conflict:
    """Return the conflicting set of a mode; `Answer.UNKNOWN` where it is too large or the effort is spent.

    And where jobs are preemptive, bound or interrupted, or serve arrivals: the exact engine's word on whole jobs is no
    proof for them.
    """
    if not has_whole_jobs(model):
        return Conflict(Answer.UNKNOWN)
    expansion = expand(model, mode)
    if not is_installed() or expansion.job_count > MAX_JOBS or not is_small(expansion):
        return Conflict(Answer.UNKNOWN)
    whole = Kept(expansion.tasks, model.chains, mode.edge)

    def answer(kept: Kept, seed: int = 1) -> Answer:
        part = replace(expansion, tasks=kept.tasks, mode=replace(mode, edge=kept.edge))
        try:
            return solve_expansion(model, part, Effort(work=EFFORT, seed=seed, go_on=go_on), chains=kept.chains).status
        except HalpipeError:  # too many variables
            return Answer.UNKNOWN

    first = answer(whole)
    if first is not Answer.INFEASIBLE:
        return Conflict(first)
    kept, is_minimal = _reduce(whole, answer, go_on)
    if answer(kept, seed=2) is not Answer.INFEASIBLE:
        return Conflict(Answer.UNKNOWN)
    return Conflict(Answer.INFEASIBLE, kept, is_minimal)


def _reduce(kept: Kept, answer: Callable[[Kept], Answer], go_on: Callable[[], bool]) -> tuple[Kept, bool]:
    """Leave out whole tasks first, then constraints, whatever is not needed for the conflict."""
    is_minimal = True
    for parts in (_tasks, _constraints):
        for leave_out in parts(kept):
            smaller = leave_out(kept)
            if smaller == kept:
                continue
            if not go_on():
                return kept, False
            found = answer(smaller)
            if found is Answer.INFEASIBLE:
                kept = smaller
            elif found is Answer.UNKNOWN:
                is_minimal = False
    return kept, is_minimal


Change = Callable[[Kept], Kept]


def _tasks(kept: Kept) -> Iterable[Change]:
    """Return how to leave out each task, with what names it; tasks on demand go with those who demand them."""
    return [_without_task(active.name) for active in kept.tasks]


def _without_task(name: str) -> Change:
    def change(kept: Kept) -> Kept:
        others = (active for active in kept.tasks if active.name != name)
        tasks = tuple(active.with_windows(lambda row: row.task != name) for active in others)
        return replace(kept, tasks=_demanded(tasks), chains=tuple(c for c in kept.chains if name not in c.tasks))

    return change


def _demanded(tasks: tuple[ActiveTask, ...]) -> tuple[ActiveTask, ...]:
    """Count the demands again, and leave out the tasks on demand that nothing demands any more."""
    most = {
        (active.name, target): count
        for active in tasks
        for target, (_, count) in demand_ranges(active.versions).items()
    }
    by_name = {active.name: active for active in tasks}
    graph: dict[str, list[str]] = {name: [] for name in by_name}
    for by, target in most:
        if target in graph:
            graph[target].append(by)
    settled: dict[str, ActiveTask] = {}
    for name in TopologicalSorter(graph).static_order():
        active = by_name[name]
        if active.task.period is None:
            demanders = [settled[by] for by in graph[name] if by in settled]
            demands = tuple(
                Demand(by.name, index, slot)
                for by in demanders
                for index in range(by.jobs)
                for slot in range(most[by.name, name])
            )
            active = replace(active, jobs=len(demands), demands=demands)
        if active.jobs:
            settled[name] = active
    return tuple(settled[name] for name in by_name if name in settled)


def _constraints(kept: Kept) -> Iterable[Change]:
    """Return how to leave out edge, chain limits, LETs, offsets, resources, and windows that demand nothing."""
    changes: list[Change] = [lambda kept: replace(kept, edge=Edge.OPEN)]
    changes += [_without_chain(chain.name) for chain in kept.chains]
    periodic = {active.name for active in kept.tasks if active.task.period is not None}
    for active in kept.tasks:
        changes += [_without(active.name, stated) for stated in ("offset", "let")]
        named = dict.fromkeys(p.task for v in active.versions for p in v.precedences)
        changes += [_without_window(active.name, other) for other in named if other in periodic]
    resources = dict.fromkeys(a.resource for active in kept.tasks for v in active.versions for a in v.accesses)
    changes += [_without_resource(name) for name in resources]
    return changes


def _without_chain(name: str) -> Change:
    return lambda kept: replace(kept, chains=tuple(c for c in kept.chains if c.name != name))


def _each(change: Callable[[ActiveTask], ActiveTask], name: str | None = None) -> Change:
    """Change the task of a name, or all tasks."""
    return lambda kept: replace(
        kept, tasks=tuple(change(active) if name in (None, active.name) else active for active in kept.tasks)
    )


def _without(name: str, stated: str) -> Change:
    changes: dict[str, Any] = {stated: None}
    return _each(lambda active: replace(active, task=replace(active.task, **changes)), name)


def _without_window(name: str, other: str) -> Change:
    return _each(lambda active: active.with_windows(lambda row: row.task != other), name)


def _without_resource(name: str) -> Change:
    def free(active: ActiveTask) -> ActiveTask:
        versions = (replace(v, accesses=tuple(a for a in v.accesses if a.resource != name)) for v in active.versions)
        return replace(active, versions=tuple(versions))

    return _each(free)


# ------------------------------------------------------------------------------------------------ text


def describe(mode: Mode, conflict: Conflict) -> Diagnostic:
    """Name the tasks and constraints of a conflicting set."""
    kept = conflict.kept
    assert kept is not None, "an infeasible answer comes with its part of the mode"
    names = [active.name for active in kept.tasks]
    kind = "a minimal set" if conflict.is_minimal else "a set, perhaps not minimal"
    text = f"{few(names, 12)} cannot be scheduled together ({kind}, found and checked again by the exact engine)"
    parts = list(_parts(kept))
    text += f"; what it takes: {few(parts, 12, quote='', between='; ')}" if parts else ""
    is_needed = "; without any single one of them a schedule exists" if conflict.is_minimal else ""
    help = f"relax one of these tasks or constraints{is_needed}"
    path, subjects = about(mode=mode.name), tasks_named(names)
    return codes.NO_SCHEDULE_FOR(text, at=place(mode), path=path, help=help, subjects=subjects)


def _window(task: str, row: Precedence) -> str:
    to = "" if row.to is Anchor.START else f"the {row.to} of "
    anchor = f"{row.anchor} {row.point}" if row.point is not None else row.anchor
    cycle = " of the same cycle" if row.match is Match.CYCLE else ""
    return f'{to}"{task}" [{row.min}, {row.max}] after the {anchor} of "{row.task}"{cycle}'


def _parts(kept: Kept) -> Iterable[str]:
    for active in kept.tasks:
        task = active.task
        wcets = "/".join(dict.fromkeys(str(v.wcet) for v in active.versions))
        units = dict.fromkeys(unit for v in active.versions for unit in v.units)
        rhythm = f"every {task.period}" if task.period is not None else "on demand"
        offset = f" from {task.offset}" if task.offset is not None else ""
        yield f'"{task.name}" {wcets} {rhythm}{offset} on {few(units, 3)}'
        if task.let is not None:
            yield f'"{task.name}" with a logical execution time of {task.let}'
        yield from dict.fromkeys(_window(task.name, row) for v in active.versions for row in v.precedences)
    resources = dict.fromkeys(a.resource for active in kept.tasks for v in active.versions for a in v.accesses)
    for name in resources:
        yield f'accesses to "{name}"'
    running = {active.name for active in kept.tasks}
    for chain in kept.chains:
        limits = (chain.max_latency, chain.max_reaction, chain.max_age)
        if running.issuperset(chain.tasks) and any(limit is not None for limit in limits):
            yield f'limits of chain "{chain.name}"'
    if kept.edge is Edge.CLOSED:
        yield "a closed edge of the mode"
