"""Conditions on the model without which "valid" has no meaning; `halpipe validate` reports more."""

from __future__ import annotations

from collections import Counter
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Location, about, named
from halpipe.core.durations import ZERO
from halpipe.models import Access, Anchor, Interrupt, Match, Mode, Precedence, Task, TaskModel, Version
from halpipe.pipeline.verify.codes import MODEL_FAULT

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.pipeline.verify.tables import ActiveTask


def _fault(path: str, message: str, at: Location) -> Diagnostic:
    return MODEL_FAULT(message, at=at, path=path, help="correct the model; `halpipe validate` explains it in full")


def repeated_names(model: TaskModel) -> Iterator[Diagnostic]:
    """Names must be defined once."""
    kinds: tuple[tuple[str, list[str]], ...] = (
        ("unit", [u.name for u in model.units]),
        ("resource", [r.name for r in model.resources]),
        ("task", [t.name for t in model.tasks]),
        ("chain", [c.name for c in model.chains]),
        ("mode", [m.name for m in model.modes]),
    )
    for kind, names in kinds:
        yield from (_fault(named(kind, name), "is defined more than once", model.at) for name in _repeated(names))
    for task in model.tasks:
        for name in _repeated(v.name for v in task.versions):
            yield _fault(about(task=task.name, version=name), "is defined more than once", task.at)


def _repeated(names: Iterable[str]) -> list[str]:
    return [name for name, count in Counter(names).items() if count > 1]


def unknown_names(model: TaskModel) -> Iterator[Diagnostic]:
    """Modes, chains and transitions must name what exists."""
    versions = {task.name: {v.name for v in task.versions} for task in model.tasks}
    for mode in model.modes:
        yield from _mode_names(mode, versions)
    for chain in model.chains:
        for name in sorted(set(chain.tasks) - versions.keys()):
            yield _fault(about(chain=chain.name), f'names task "{name}", which does not exist', chain.at)
    modes = {mode.name for mode in model.modes}
    for transition in model.transitions:
        for name in sorted({transition.source, transition.target} - modes):
            path = about(transition=(transition.source, transition.target))
            yield _fault(path, f'names mode "{name}", which does not exist', transition.at)


def _mode_names(mode: Mode, versions: dict[str, set[str]]) -> Iterator[Diagnostic]:
    path = about(mode=mode.name)
    for name in _repeated(run.task for run in mode.runs):
        yield _fault(path, f'runs task "{name}" more than once', mode.at)
    for run in mode.runs:
        if run.task not in versions:
            yield _fault(path, f'runs task "{run.task}", which does not exist', run.at)
            continue
        for name in sorted(set(run.versions) - versions[run.task]):
            yield _fault(path, f'runs version "{name}" of task "{run.task}", which does not exist', run.at)


def events(model: TaskModel) -> Iterator[Diagnostic]:
    """Chains count between instants that jobs have."""
    tasks = {task.name: task for task in reversed(model.tasks)}
    for chain in model.chains:
        first = tasks.get(chain.tasks[0]) if chain.tasks else None
        is_released = chain.anchor is not Anchor.RELEASE or first is None or first.period is not None
        is_backward = len(chain.tasks) == 1 and (chain.anchor, chain.to) == (Anchor.END, Anchor.START)
        if not is_released or is_backward or chain.anchor is Anchor.POINT or chain.to not in (None, *_EVENTS):
            text = f"counts from the {chain.anchor} of its first task to the {chain.to} of its last"
            yield _fault(about(chain=chain.name), text, chain.at)


def instants(tasks: dict[str, ActiveTask]) -> Iterator[Diagnostic]:
    """Windows count between instants that the jobs of a mode have (MODEL 10)."""
    for name, active in tasks.items():
        for version in active.versions.values():
            for row in version.precedences:
                for text in _instants(row, active, tasks.get(row.task)):
                    path = about(task=name, version=version.name)
                    yield _fault(path, f'has a constraint on "{row.task}" {text}', row.at)


def _instants(row: Precedence, active: ActiveTask, before: ActiveTask | None) -> Iterator[str]:
    if row.to not in _EVENTS:
        yield f"that leads to its {row.to}"
    if (row.anchor is Anchor.POINT) != (row.point is not None) or (row.point is not None and row.point < ZERO):
        yield "without a point to count from, or with one that it does not count from"
    if before is None:
        return
    if row.anchor is Anchor.RELEASE and before.period is None:
        yield "from its release, but it has no period"
    if row.match is Match.CYCLE and None in (active.period, before.period):
        yield "of the same cycle, but one of the two has no period"
    wcets = [v.wcet for v in before.versions.values() if v.wcet is not None]
    if row.anchor is Anchor.POINT and row.point is not None and any(row.point > wcet for wcet in wcets):
        yield f"from the point {row.point}, beyond its WCET"


def interrupts(model: TaskModel) -> Iterator[Diagnostic]:
    """Interrupts come at most once in a positive distance, and take a time that is not negative."""
    for unit in model.units:
        for interrupt in unit.interrupts:
            if not is_interrupt(interrupt):
                text = f'has the interrupt "{interrupt.name}" of {interrupt.wcet} every {interrupt.distance}'
                yield _fault(about(unit=unit.name), f"{text}; its distance must be positive", interrupt.at)


def is_interrupt(interrupt: Interrupt) -> bool:
    """Tell whether T > 0 and c >= 0."""
    return interrupt.distance > ZERO and interrupt.wcet >= ZERO


def timing(task: Task) -> Iterator[Diagnostic]:
    """A period is positive, a slack is a share; arrivals are polled, at least as often as they come."""
    return (_fault(about(task=task.name), text, task.at) for text in _timing(task))


_EVENTS = (Anchor.START, Anchor.END)


def _timing(task: Task) -> Iterator[str]:
    deadline = task.period if task.deadline is None else task.deadline
    if task.let is not None and (task.period is None or deadline is None or not ZERO < task.let <= deadline):
        yield f"has the logical execution time {task.let}; it must be above zero and at most the deadline"
    if task.period is not None and task.period <= ZERO:
        yield f"has the period {task.period}; it must be positive"
    if not 0 <= task.slack <= 1:
        yield f"has the slack {task.slack}; it must lie between 0 and 1"
    if task.distance is not None and (task.period is None or task.period > task.distance):
        text = f"serves arrivals {task.distance} apart and is polled every {task.period or 'never'}"
        yield f"{text}; its period must be at most the distance"


def version(task: Task, version: Version, locks: frozenset[str]) -> Iterator[Diagnostic]:
    """A version that is available in a mode states a WCET, a gang, windows and access phases that make sense."""
    told = (*_stated(version, locks), *_split(version, locks))
    return (_fault(about(task=task.name, version=version.name), text, at) for text, at in told)


def _stated(version: Version, locks: frozenset[str]) -> Iterator[tuple[str, Location]]:
    if version.wcet is None:
        yield "has no WCET, so nothing can be said about its jobs", version.at
    elif version.wcet <= ZERO:
        yield f"has the WCET {version.wcet}; it must be above 0", version.at
    if version.gang < 1:
        yield f"has the gang size {version.gang}; it must be at least 1", version.at
    for precedence in version.precedences:
        if precedence.min < ZERO:
            yield f'has a window after "{precedence.task}" that begins below zero', precedence.at
    for access in version.accesses:
        if not is_phase(access, version):
            text = f'has an access to "{access.resource}" from {access.start} to {access.end} with bound {access.bound}'
            yield f"{text}; it must lie within the WCET, with a bound above 0 and up to 1", access.at
        if access.resource in locks and (access.bound != 1 or access.transfers):
            yield f'has an access to the lock "{access.resource}" with a bound or data', access.at


def _split(version: Version, locks: frozenset[str]) -> Iterator[tuple[str, Location]]:
    """Split points ascend within (0, C) and cut no access phase; `anywhere` says how often."""
    split, wcet = version.split, version.wcet
    points = split.points
    if any(a >= b for a, b in pairwise((ZERO, *points, *([wcet] if wcet is not None else [])))) and points:
        yield "has split points that do not ascend between 0 and the WCET", version.at
    for access in version.accesses:
        for point in points if access.resource not in locks else ():
            if access.start < point < access.end:
                text = f'has the split point {point} within its access to "{access.resource}"'
                yield text, version.at
    if split.anywhere and (points or split.max_gaps is None):
        yield "may be split anywhere, but does not say how often at most (max-gaps)", version.at
    is_below = (split.max_gaps is not None and split.max_gaps < 0, split.min_part is not None and split.min_part < ZERO)
    if split.resume < ZERO or any(is_below):
        yield "has a negative resume, max-gaps or min-part", version.at


def is_phase(access: Access, version: Version) -> bool:
    """Tell whether 0 <= start < end <= C and 0 < bound <= 1."""
    wcet = version.wcet
    in_job = ZERO <= access.start < access.end and (wcet is None or access.end <= wcet)
    return in_job and 0 < access.bound <= 1


def cycle(mode: str, tasks: dict[str, ActiveTask], at: Location) -> Iterator[Diagnostic]:
    """The predecessor relation of the versions available in a mode must be acyclic."""
    graph = {
        name: {p.task for v in active.versions.values() for p in v.precedences if p.task in tasks}
        for name, active in tasks.items()
    }
    try:
        TopologicalSorter({name: sorted(before) for name, before in graph.items()}).prepare()
    except CycleError as failure:
        names = " after ".join(f'"{name}"' for name in reversed(failure.args[1]))
        yield _fault(about(mode=mode), f"its precedence constraints form a cycle: {names}", at)
