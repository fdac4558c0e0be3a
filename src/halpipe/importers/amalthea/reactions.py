"""Delay constraints by their mapping: who needs a partner, the source event, the target event, or both.

A precedence of the task model gives each target a source. `Reaction` means the other direction: each source gets a
target within [lower, upper]. On a schedule that repeats every H, "some target lies d after this source" is the same as
"this source lies K - d after some target", for every multiple K of H. So the source gets a precedence on the target,
with the window turned round, and that is exact. K depends on the periods, which an overlay may change; so these
constraints are added once the overlay is on the model.

A window in which no two starts of one task fit makes pairs by itself: where both tasks have one period, each target
with its source is then each source with its target, and the plain direction serves.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings
from halpipe.core.durations import ZERO, Duration, least_common_multiple
from halpipe.core.records import record
from halpipe.importers.amalthea import codes
from halpipe.models import Anchor, Precedence

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Origin, Task, TaskModel

REACTION, UNIQUE, ONE_TO_ONE = MAPPINGS = ("Reaction", "UniqueReaction", "OneToOne")


@record
class Reaction:
    """A delay constraint whose sources need targets: `low` to `high` from an event of `source` to one of `target`.

    `source_ends` and `target_ends`: the event is the end of the job, not its start.
    """

    mapping: str
    source: str
    target: str
    low: Duration
    high: Duration
    source_ends: bool
    target_ends: bool
    origin: Origin


@record
class Reactions:
    """The delay constraints of a model that wait for its periods."""

    items: Sequence[Reaction]

    def complete(self, model: TaskModel) -> tuple[TaskModel, tuple[Diagnostic, ...]]:
        """Return `model` with the constraints; report those that no schedule keeps, and what is not ensured."""
        findings = Findings()
        for item in self.items:
            if {item.source, item.target} <= {task.name for task in model.tasks}:
                model = _with(model, item, findings)
        return model, tuple(findings.items)


def _with(model: TaskModel, item: Reaction, findings: Findings) -> TaskModel:
    source, target = model.task(item.source), model.task(item.target)
    at, path = item.origin.location, f'delay constraint "{item.origin.path}"'
    if source.period is None or target.period is None:
        help = "state the periods in an overlay"
        text = "each target gets a source, not each source a target: a task on demand has as many jobs as it takes"
        findings.add(codes.REACTION(text, at=at, path=path, help=help))
        return _added(model, target, _plain(item, target))
    unequal = item.mapping == ONE_TO_ONE and source.period != target.period
    if unequal or (item.mapping == UNIQUE and source.period < target.period):
        text = (
            f'{item.mapping} wants a target of its own for each source, but "{source.name}" runs every '
            f'{source.period}, "{target.name}" every {target.period}'
        )
        help = "let both have one period, or let the mapping be Reaction"
        findings.add(codes.NO_PARTNERS(text, at=at, path=path, help=help))
        return model
    width = item.high - item.low
    pairs = source.period == target.period and width < _apart(target, item.target_ends)
    if pairs and not _reaches(model, item.source, item.target):
        return _added(model, target, _plain(item, target))
    if item.mapping != REACTION and not width < _apart(source, item.source_ends):
        text = f"{item.mapping}: each source gets a target, but two may get the same one within a window of {width}"
        help = "state a narrower window, or deadlines and slack that keep the starts apart"
        findings.add(codes.REACTION(text, at=at, path=path, help=help))
    return _turned_round(model, item, findings)


def _turned_round(model: TaskModel, item: Reaction, findings: Findings) -> TaskModel:
    """Return the model in which each source has a target, by a precedence of the source on the target."""
    if _reaches(model, item.target, item.source):
        at, path = item.origin.location, f'delay constraint "{item.origin.path}"'
        text = (
            f'each target gets a source, not each source a target, since "{item.target}" comes after "{item.source}" '
            "by another constraint, too"
        )
        help = "leave out the other constraint, or narrow the window below the distance of two starts"
        findings.add(codes.REACTION(text, at=at, path=path, help=help))
        target = model.task(item.target)
        return _added(model, target, _plain(item, target))
    whole = least_common_multiple(task.period for task in model.tasks if task.period is not None)
    most = item.high + max((version.wcet or ZERO for version in model.task(item.source).versions), default=ZERO)
    turns = max(1, -(-most.fraction // whole.fraction))
    source = model.task(item.source)
    anchor = Anchor.END if item.target_ends else Anchor.START
    found = {}
    for version in source.versions:
        shift = version.wcet or ZERO if item.source_ends else ZERO
        low, high = (whole * int(turns) - end - shift for end in (item.high, item.low))
        found[version.name] = Precedence(task=item.target, min=low, max=high, anchor=anchor, origin=item.origin)
    return _added(model, source, found)


def _plain(item: Reaction, target: Task) -> dict[str, Precedence]:
    """Return the constraint by which each target has a source, for each version of the target."""
    anchor = Anchor.END if item.source_ends else Anchor.START
    found = {}
    for version in target.versions:
        shift = version.wcet or ZERO if item.target_ends else ZERO
        low, high = (max(ZERO, end - shift) for end in (item.low, item.high))
        found[version.name] = Precedence(task=item.source, min=low, max=high, anchor=anchor, origin=item.origin)
    return found


def _added(model: TaskModel, task: Task, constraints: dict[str, Precedence]) -> TaskModel:
    versions = tuple(
        replace(v, precedences=(*v.precedences, constraints[v.name])) if v.name in constraints else v
        for v in task.versions
    )
    changed = replace(task, versions=versions)
    return replace(model, tasks=tuple(changed if other is task else other for other in model.tasks))


def _apart(task: Task, ends: bool) -> Duration:
    """Return a distance that two starts (or ends) of a task always have: jobs end before the time of the next one."""
    assert task.period is not None
    by_slack = ZERO if ends else task.period - task.period * task.slack
    if task.deadline is not None and task.deadline > task.period:
        return by_slack
    return max(by_slack, min((version.wcet or ZERO for version in task.versions), default=ZERO))


def _reaches(model: TaskModel, start: str, goal: str) -> bool:
    """Return whether `goal` is a predecessor of `start`, directly or through others."""
    before = {task.name: {p.task for version in task.versions for p in version.precedences} for task in model.tasks}
    seen, rest = {start}, [start]
    while rest:
        for name in before.get(rest.pop(), ()):
            if name not in seen:
                seen.add(name)
                rest.append(name)
    return goal in seen
