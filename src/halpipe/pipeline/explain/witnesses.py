"""Proofs that a mode has no schedule, from necessary conditions: instant, exact, and checkable by hand (MODEL 6).

What validate checks is not repeated, except for loads, once more, when a version proves unusable.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import tasks_named
from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.models import Anchor, Edge, Match, ResourceKind
from halpipe.pipeline.explain.facts import Witness, mode_facts
from halpipe.pipeline.explain.meetings import crowds
from halpipe.pipeline.explain.sharing import packings, prune, resources_met, units_met
from halpipe.pipeline.explain.windows import blockings, contradictions
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import Context, by_name
from halpipe.pipeline.validate.load import check_resources, check_units, least_length

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Access, Chain, Precedence, Run, Task, TaskModel, Unit, Version
    from halpipe.pipeline.explain.facts import ModeFacts
    from halpipe.pipeline.validate.context import ActiveMode

__all__ = ["Hopeless", "Witness", "find_witnesses"]


@record
class Hopeless:
    """A mode without a schedule: the witnesses, and what they build upon."""

    mode: str
    notes: tuple[Diagnostic, ...]
    witnesses: tuple[Witness, ...]

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """All findings, the premises first."""
        return (*self.notes, *(found.diagnostic.concerning(tasks_named(found.tasks)) for found in self.witnesses))

    @property
    def tasks(self) -> tuple[str, ...]:
        """The tasks that the witnesses are about."""
        return tuple(dict.fromkeys(name for witness in self.witnesses for name in witness.tasks))


def find_witnesses(model: TaskModel, modes: Collection[str] = ()) -> tuple[Hopeless, ...]:
    """Return the modes (of those named, or all) of a validated model that certainly have no schedule, and why.

    Sound: what has a valid schedule is never called hopeless. Not complete: most conflicts need a search.
    """
    context = Context(relaxed(model))
    found = (_judge(context, mode) for mode in context.active if not modes or mode.mode.name in modes)
    return tuple(hopeless for hopeless in found if hopeless is not None)


def _judge(context: Context, mode: ActiveMode) -> Hopeless | None:
    if mode.hyperperiod is None:
        return None
    facts, notes, witnesses = prune(mode_facts(mode, context.units))
    witnesses += _loads(context.model, facts, bool(notes))
    witnesses += [*units_met(facts, context.model), *resources_met(facts), *contradictions(facts)]
    witnesses += blockings(facts, context.model)
    if not witnesses:
        witnesses += packings(facts)
    if not witnesses:
        witnesses += crowds(facts)
    return Hopeless(mode.mode.name, tuple(notes), tuple(witnesses)) if witnesses else None


def _loads(model: TaskModel, facts: ModeFacts, has_fewer_versions: bool) -> Iterator[Witness]:
    """Check the loads again with the versions that are left."""
    if not has_fewer_versions:
        return
    left = {name: tuple(v.version.name for v in task.versions) for name, task in facts.tasks.items()}
    runs = tuple(replace(run, versions=left.get(run.task, run.versions)) for run in facts.mode.mode.runs)
    reduced = Context(replace(model, modes=(replace(facts.mode.mode, runs=runs),)))
    for found in (*check_units(reduced), *check_resources(reduced)):
        yield Witness(found, ())


# ------------------------------------------------------------------------------------------------ relaxed models

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


# ------------------------------------------------------------------------------------------------ findings of validate

ABOUT_A_MODE = {
    codes.PREDECESSOR_ABSENT.id,
    codes.CHAIN_LIMIT_TOO_LOW.id,
    codes.UNITS_OVERLOADED.id,
    codes.RESOURCE_OVERLOADED.id,
    codes.WCET_BEYOND_HYPERPERIOD.id,
}
"""Errors that leave a mode without a schedule."""

ABOUT_A_VERSION = {
    codes.WCET_BEYOND_DEADLINE.id,
    codes.BAD_GANG.id,
    codes.EMPTY_WINDOW.id,
    codes.PHASES_OVERLOAD.id,
    codes.ARRIVAL_TOO_LATE.id,
}
"""Errors that make a version unusable; they prove something where a task has no other one in some mode."""


def proves_infeasible(model: TaskModel, errors: Sequence[Diagnostic]) -> bool:
    """Tell whether the model, being complete otherwise, has a mode that certainly has no schedule.

    A model with an error of another kind means nothing yet, so nothing is proven of it.
    """
    found = {d.code for d in errors}
    if not found <= ABOUT_A_MODE | ABOUT_A_VERSION:
        return False
    return bool(found & ABOUT_A_MODE) or any(_has_no_version(model, run.task, run.versions) for run in _runs(model))


def _runs(model: TaskModel) -> Iterable[Run]:
    return (run for mode in model.modes for run in mode.runs)


def _has_no_version(model: TaskModel, name: str, available: Sequence[str]) -> bool:
    task = model.task(name)
    units = by_name(model.units)
    return all(_is_dead(units, task, version) for version in task.versions if version.name in available)


def _is_dead(units: Mapping[str, Unit], task: Task, version: Version) -> bool:
    """Tell whether no job can run in this version, whatever else there is."""
    return (
        _is_too_long(task, least_length(units, version) or ZERO)
        or version.gang > len(set(version.units))
        or any(row.min > row.max for row in version.precedences)
        or _overloads_itself(version)
    )


def _is_too_long(task: Task, length: Duration) -> bool:
    """Tell whether a job takes longer than its deadline allows, which may count from the start of the job before."""
    if task.period is None:
        return False
    if task.let is not None and length > task.let:
        return True
    if task.distance is not None:
        return task.period + length > (task.distance if task.deadline is None else task.deadline)
    return length > (task.period if task.deadline is None else task.deadline)


def _overloads_itself(version: Version) -> bool:
    return any(
        sum(a.bound for a in version.accesses if a.resource == b.resource and a.start <= b.start < a.end) > 1
        for b in version.accesses
    )


def tasks_of(model: TaskModel, findings: Iterable[Diagnostic]) -> tuple[str, ...]:
    """Return the tasks that findings of verify are about, in the order of the model."""
    named = {subject.name for d in findings for subject in d.subjects if subject.kind == "task"}
    return tuple(task.name for task in model.tasks if task.name in named)
