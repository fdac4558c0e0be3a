"""Checks of where jobs may be interrupted, and of the units that tasks are bound to (MODEL 8.1)."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.models import WHOLE, Binding
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import Check, place, quoted, task_path, version_path

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.core.durations import Duration
    from halpipe.models import Task, Version
    from halpipe.pipeline.validate.context import ActiveMode, Context

_MOST_SETS = 1000
"""Sets of common units that are carried from mode to mode; beyond it a contradiction may be missed."""


def check_points(context: Context) -> Iterator[Diagnostic]:
    """Split points ascend within (0, C) and lie in no access phase."""
    for task, version in context.versions_of_tasks:
        if version.split.points:
            yield from _points(context, task, version, version.split.points)


def _points(context: Context, task: Task, version: Version, points: tuple[Duration, ...]) -> Iterator[Diagnostic]:
    at, path, wcet = place(version, task), version_path(task, version), version.wcet
    outside = [p for p in points if p <= ZERO or (wcet is not None and p >= wcet)]
    if outside:
        text = f"has the split point{'s' * (len(outside) > 1)} {_listed(outside)}, not between 0 and the WCET {wcet}"
        help = (
            "split points count execution time from the start of the job: remove those at its start, its end or beyond"
        )
        yield codes.SPLIT_OUTSIDE(text, at=at, path=path, help=help)
    wrong = [later for before, later in pairwise(points) if later <= before]
    if wrong:
        ascending = " ".join(map(str, sorted(set(points) - set(outside))))
        text = f"has split points that do not ascend, at {_listed(wrong)}"
        help = f'write split="{ascending}"' if ascending else "leave the split out"
        yield codes.SPLIT_NOT_ASCENDING(text, at=at, path=path, help=help)
    for access in version.accesses:
        if context.is_lock(access.resource):
            continue  # held through the gap
        inside = [p for p in points if access.start < p < access.end]
        if inside:
            text = f"has the split point{'s' * (len(inside) > 1)} {_listed(inside)} within its access to "
            text += f'"{access.resource}" from {access.start} to {access.end}'
            help = "move the points to an end of the phase, or cut the phase in two"
            yield codes.SPLIT_IN_PHASE(text, at=place(access, version, task), path=path, help=help)


def _listed(times: list[Duration]) -> str:
    more = f" and {len(times) - 3} more" if len(times) > 3 else ""
    return ", ".join(map(str, times[:3])) + more


def check_limits(context: Context) -> Iterator[Diagnostic]:
    """`anywhere` says how many gaps there may be; what belongs to a split is stated for one, and leaves a gap."""
    for task, version in context.versions_of_tasks:
        split, wcet = version.split, version.wcet
        if split == WHOLE:
            continue
        at, path = place(version, task), version_path(task, version)
        if split.anywhere and split.max_gaps is None:
            help = 'state max-gaps, such as max-gaps="3"'
            text = "may be split anywhere, but states no largest number of gaps"
            yield codes.NO_MAX_GAPS(text, at=at, path=path, help=help)
        for text, help in _without_effect(version, wcet):
            yield codes.SPLIT_WITHOUT_EFFECT(text, at=at, path=path, help=help)


def _without_effect(version: Version, wcet: Duration | None) -> Iterator[tuple[str, str]]:
    """Say what does nothing, and what to do about it."""
    split = version.split
    stated = [
        name
        for name, is_stated in (
            ("resume", split.resume != ZERO),
            ("max-gaps", split.max_gaps is not None),
            ("min-part", split.min_part is not None),
        )
        if is_stated
    ]
    if not split.is_allowed:
        if stated:
            yield f"states {' and '.join(stated)}, but is not split", 'state a split, or split="anywhere", or remove it'
        return
    if split.max_gaps == 0:
        yield "is split, but allows no gap (max-gaps 0)", "allow at least one gap, or remove the split"
    if split.min_part is None:
        return
    if not split.anywhere:
        yield "states min-part for a list of split points", "remove it: the parts of a list are as long as its pieces"
    elif wcet is not None and split.min_part * 2 > wcet:
        text = f"demands parts of at least {split.min_part}, more than half of its WCET {wcet}, so it has no gap"
        yield text, f"use at most {wcet / 2}, or remove the split"


# ------------------------------------------------------------------------------------------------ binding


def check_bindings(context: Context) -> Iterator[Diagnostic]:
    """A task that is bound in the whole system has a unit set on which it can run in every mode."""
    for task in context.tasks.values():
        if task.binding is not Binding.SYSTEM:
            continue
        modes = [mode for mode in context.active if task.name in mode.tasks]
        sizes = {version.gang for mode in modes for version in mode.tasks[task.name].versions}
        if modes and not any(_has_common(task, modes, size) for size in sizes):
            text = f"is bound to one set of units in the whole system, but {_why(task, modes)}"
            help = 'give its versions common units and gang sizes, or bind it within each mode (binding="mode")'
            yield codes.NOTHING_TO_BIND_TO(text, at=place(task), path=task_path(task), help=help)


def _has_common(task: Task, modes: Iterable[ActiveMode], size: int) -> bool:
    """Tell whether some `size` units can be used in each of the modes, by some version available there."""
    common: set[frozenset[str]] | None = None
    for mode in modes:
        here = {frozenset(v.units) for v in mode.tasks[task.name].versions if v.gang == size}
        both = here if common is None else {one & other for one in common for other in here}
        common = {units for units in both if len(units) >= size}
        if len(common) > _MOST_SETS:
            return True
    return bool(common)


def _why(task: Task, modes: list[ActiveMode]) -> str:
    """Say what its modes allow: the first two that have nothing in common, or all."""
    for number, one in enumerate(modes):
        for other in modes[number + 1 :]:
            sizes = {v.gang for v in one.tasks[task.name].versions}
            if not any(_has_common(task, (one, other), size) for size in sizes):
                return f"{_allowed(task, one)} and {_allowed(task, other)}"
    return "; ".join(_allowed(task, mode) for mode in modes[:5])


def _allowed(task: Task, mode: ActiveMode) -> str:
    sets = []
    for version in mode.tasks[task.name].versions:
        gang = f"{version.gang} of " if version.gang > 1 else ""
        sets.append(gang + quoted(version.units))
    return f'mode "{mode.mode.name}" allows {" or ".join(dict.fromkeys(sets))}'


CHECKS = (
    Check(
        "split-points",
        "The split points of a version ascend between 0 and its WCET, and none is strictly within an access phase.",
        (codes.SPLIT_OUTSIDE, codes.SPLIT_NOT_ASCENDING, codes.SPLIT_IN_PHASE),
        check_points,
    ),
    Check(
        "split-limits",
        "A version that may be split anywhere states max-gaps; resume, max-gaps and min-part are stated where they "
        "have an effect.",
        (codes.NO_MAX_GAPS, codes.SPLIT_WITHOUT_EFFECT),
        check_limits,
    ),
    Check(
        "binding",
        "A task that is bound in the whole system can run on one and the same set of units in all its modes.",
        (codes.NOTHING_TO_BIND_TO,),
        check_bindings,
    ),
)
