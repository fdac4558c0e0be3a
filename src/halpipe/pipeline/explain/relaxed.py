"""Models without the requirements of MODEL 10, for proofs: every schedule of a model is one of its relaxed model."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.models import Anchor, Edge, Match, ResourceKind

if TYPE_CHECKING:
    from halpipe.models import Access, Chain, Precedence, Task, TaskModel, Version

ALWAYS = Duration(10**21)
"""A window as wide as any hyperperiod holds always."""


def relaxed(model: TaskModel) -> TaskModel:
    """Return a model of which every schedule of `model` is one; `model` itself if it states nothing of MODEL 10."""
    locks = {resource.name for resource in model.resources if resource.kind is ResourceKind.LOCK}
    if not locks and not any(True for _ in model.refinements()):
        return model
    lets = {task.name for task in model.tasks if task.let is not None}
    return replace(
        model,
        resources=tuple(replace(resource, kind=ResourceKind.MEMORY) for resource in model.resources),
        tasks=tuple(_task(task, locks) for task in model.tasks),
        chains=tuple(chain for chain in model.chains if _is_plain(chain, lets)),
        modes=tuple(replace(mode, edge=Edge.OPEN) for mode in model.modes),
    )


def _is_plain(chain: Chain, lets: set[str]) -> bool:
    return (chain.anchor, chain.to) == (None, None) and lets.isdisjoint(chain.tasks)


def _task(task: Task, locks: set[str]) -> Task:
    deadline = task.deadline if task.let is None or task.distance is not None else task.let
    return replace(task, let=None, deadline=deadline, versions=tuple(_version(v, locks) for v in task.versions))


def _version(version: Version, locks: set[str]) -> Version:
    accesses = (part for access in version.accesses for part in _access(access, version, locks))
    return replace(version, accesses=tuple(accesses), precedences=tuple(map(_window, version.precedences)))


def _access(access: Access, version: Version, locks: set[str]) -> tuple[Access, ...]:
    """Cut the access to a lock where the job may be interrupted: in a gap it is not seen to hold it."""
    split = version.split
    if access.resource not in locks or not split.is_allowed:
        return (access,)
    if split.anywhere:
        return ()
    cuts = [access.start, *(point for point in split.points if access.start < point < access.end), access.end]
    return tuple(replace(access, start=a, end=b) for a, b in pairwise(cuts))


def _window(row: Precedence) -> Precedence:
    """A job of the same cycle lies in the window, too; windows between other instants hold always."""
    if row.to is Anchor.START and row.anchor in (Anchor.START, Anchor.END):
        return replace(row, match=Match.WINDOW)
    plain = replace(row, anchor=Anchor.START, point=None, to=Anchor.START, match=Match.WINDOW)
    return replace(plain, min=ZERO, max=ALWAYS)
