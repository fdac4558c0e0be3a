"""Timing constraints of tasks: deadlines, start jitter, precedence windows, orders, and delays by their mapping.

A precedence of the task model gives each target a source. `Reaction` means the other direction: each source gets a
target within [lower, upper]. On a schedule that repeats every H, "some target lies d after this source" is the same as
"this source lies K - d after some target", for every multiple K of H. So the source gets a precedence on the target,
with the window turned round, and that is exact. K depends on the periods, which an overlay may change; so these
constraints are added once the overlay is on the model.

A window in which no two starts of one task fit makes pairs by itself: where both tasks have one period, each target
with its source is then each source with its target, and the plain direction serves.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, Findings
from halpipe.core.durations import ZERO, Duration, least_common_multiple
from halpipe.core.quantities import quoted
from halpipe.core.records import record
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.chains import Chained, read_chains
from halpipe.importers.amalthea.entities import Entities, Place, combined
from halpipe.importers.amalthea.parts import Draft, Drafts, comes_after
from halpipe.importers.common.names import legal
from halpipe.models import Anchor, Match, Origin, Precedence, Task, TaskModel

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.importers.amalthea.xmi import Forest, Item

REACTION, UNIQUE, ONE_TO_ONE = MAPPINGS = ("Reaction", "UniqueReaction", "OneToOne")


@record
class Reaction:
    """A delay constraint whose sources need targets, as the precedence by which each `target` has a source."""

    mapping: str
    target: str
    row: Precedence


@record
class Reactions:
    """The delay constraints of a model that wait for its periods."""

    items: Sequence[Reaction]

    def complete(self, model: TaskModel) -> tuple[TaskModel, tuple[Diagnostic, ...]]:
        """Return `model` with the constraints; report those that no schedule keeps, and what is not ensured."""
        findings = Findings()
        for item in self.items:
            if {item.row.task, item.target} <= {task.name for task in model.tasks}:
                model = _with(model, item, findings)
        return model, tuple(findings.items)


def _with(model: TaskModel, item: Reaction, findings: Findings) -> TaskModel:
    """Return the model in which each source has a target: by the plain row where that pairs them, or turned round."""
    row = item.row
    source, target = model.task(row.task), model.task(item.target)
    where = _where(row)
    if source.period is None or target.period is None:
        help = "state the periods in an overlay"
        text = "each target gets a source, not each source a target: a task on demand has as many jobs as it takes"
        findings.add(codes.REACTION(text, **where, help=help))
        return _added(model, target, row)
    unequal = item.mapping == ONE_TO_ONE and source.period != target.period
    if unequal or (item.mapping == UNIQUE and source.period < target.period):
        text = (
            f'{item.mapping} wants a target of its own for each source, but "{source.name}" runs every '
            f'{source.period}, "{target.name}" every {target.period}'
        )
        help = "let both have one period, or let the mapping be Reaction"
        findings.add(codes.NO_PARTNERS(text, **where, help=help))
        return model
    width = row.max - row.min
    pairs = source.period == target.period and width < _apart(target, row.to)
    if pairs and not _is_after(model, source.name, target.name):
        return _added(model, target, row)
    if item.mapping != REACTION and not width < _apart(source, row.anchor):
        text = f"{item.mapping}: each source gets a target, but two may get the same one within a window of {width}"
        help = "state a narrower window, or deadlines and slack that keep the starts apart"
        findings.add(codes.REACTION(text, **where, help=help))
    if _is_after(model, target.name, source.name):
        text = (
            f'each target gets a source, not each source a target, since "{target.name}" comes after "{source.name}" '
            "by another constraint, too"
        )
        help = "leave out the other constraint, or narrow the window below the distance of two starts"
        findings.add(codes.REACTION(text, **where, help=help))
        return _added(model, target, row)
    whole = least_common_multiple(task.period for task in model.tasks if task.period is not None)
    turns = whole * max(1, -(-row.max // whole))
    turned = replace(row, task=target.name, min=turns - row.max, max=turns - row.min, anchor=row.to, to=row.anchor)
    return _added(model, source, turned)


def _where(row: Precedence) -> dict[str, Any]:
    """Return the place and the path of a delay constraint, for a finding."""
    assert row.origin is not None
    return {"at": row.origin.location, "path": f'delay constraint "{row.origin.path}"'}


def _added(model: TaskModel, task: Task, row: Precedence) -> TaskModel:
    versions = tuple(replace(version, precedences=(*version.precedences, row)) for version in task.versions)
    changed = replace(task, versions=versions)
    return replace(model, tasks=tuple(changed if other is task else other for other in model.tasks))


def _apart(task: Task, instant: Anchor) -> Duration:
    """Return a distance that two starts (or ends) of a task always have: jobs end before the time of the next one."""
    assert task.period is not None
    by_slack = ZERO if instant is Anchor.END else task.period - task.period * task.slack
    if task.deadline is not None and task.deadline > task.period:
        return by_slack
    return max(by_slack, min((version.wcet or ZERO for version in task.versions), default=ZERO))


def _is_after(model: TaskModel, last: str, first: str) -> bool:
    """Return whether a task is a predecessor of another, directly or through others."""
    before = {task.name: [p.task for version in task.versions for p in version.precedences] for task in model.tasks}
    return comes_after(last, first, lambda name: before.get(name, ()))


_TASK_KINDS = ("Task", "ISR")
_UNSTATED = ("", "_undefined_")
_UNREAD = (
    "EventSynchronizationConstraint",
    "EventChainSynchronizationConstraint",
    "SynchronisationConstraint",
    "RepetitionConstraint",
)


@record
class Window:
    """The start of `later` lies `low` to `high` after the instant `anchor` of `earlier`; `high` None: not stated.

    `to_end`: the window is for the end of `later`. `point`: the execution time of `earlier`, for that anchor. `match`:
    any job of `earlier`, or that of the same cycle.
    """

    earlier: Draft
    later: Draft
    cause: Item
    low: Duration = ZERO
    high: Duration | None = None
    anchor: Anchor = Anchor.END
    to_end: bool = False
    point: Duration | None = None
    match: Match = Match.WINDOW

    @property
    def end(self) -> Duration:
        """End of the window; where none is stated, the longer of both periods after its beginning."""
        if self.high is not None:
            return self.high
        periods = [draft.activation.period for draft in (self.earlier, self.later) if draft.activation is not None]
        return self.low + max(periods, default=ZERO)

    def precedence(self) -> Precedence:
        """Return the window as a constraint of a version."""
        at = self.cause.at
        return Precedence(
            task=self.earlier.name,
            min=self.low,
            max=self.end,
            anchor=self.anchor,
            point=self.point,
            to=Anchor.END if self.to_end else Anchor.START,
            match=self.match,
            origin=Origin(at.file, at.line, legal(self.cause.name or self.cause.kind)),
        )


@dataclass(slots=True)
class Timing:
    """All constraints, as far as the task model has something for them."""

    deadlines: dict[Item, Duration] = field(default_factory=dict)
    most_between_starts: dict[Item, Duration] = field(default_factory=dict)
    windows: list[Window] = field(default_factory=list)
    reactions: list[Reaction] = field(default_factory=list)
    chains: list[Chained] = field(default_factory=list)


def read_timing(forest: Forest, drafts: Drafts) -> Timing:
    """Read the constraints; report those that the task model has nothing for."""
    entities = Entities(forest, drafts)
    timing = Timing()
    _deadlines(forest, entities, timing)
    _delays(forest, entities, timing)
    _sequences(forest, entities, timing)
    timing.chains += read_chains(forest, entities)
    unread = [c for c in forest.within("ConstraintsModel", "timingConstraints") if c.kind in _UNREAD]
    help = "state what matters of them as precedence or chains in an overlay"
    forest.report_each(codes.NOT_IMPORTED, "timing constraints of other kinds", unread, help)
    return timing


# ---------------------------------------------------------------------------------------- requirements


def _deadlines(forest: Forest, entities: Entities, timing: Timing) -> None:
    unread = []
    for item in forest.within("ConstraintsModel", "requirements"):
        if item.kind == "ProcessChainRequirement":
            continue
        task = forest.ref(item, "process") if item.kind == "ProcessRequirement" else None
        limit = item.one("limit")
        if task is None or task.kind not in _TASK_KINDS or limit is None or not _deadline(forest, item, task, timing):
            unread.append(item)
        elif entities.of(task):
            item.use_all()
    for task in forest.within("SWModel", "tasks", "isrs"):  # ITEA
        stated = task.one("deadline")
        time = forest.time(stated)
        if time and stated is not None:
            stated.use()
            _least(timing.deadlines, task, time)
    help = "only upper limits of response times and of distances between starts of tasks are imported"
    forest.report_each(codes.NOT_IMPORTED, "requirements", unread, help)


def _deadline(forest: Forest, item: Item, task: Item, timing: Timing) -> bool:
    """Take a limit of a process; return whether there is something for it."""
    limit = item.one("limit")
    assert limit is not None
    limits = {"ResponseTime": timing.deadlines, "StartToStart": timing.most_between_starts}.get(limit.get("metric"))
    time = forest.time(limit.one("limitValue"))
    if time is None or limits is None or limit.get("limitType") not in ("UpperLimit", ""):
        return False
    _least(limits, task, time)
    return True


def _least(limits: dict[Item, Duration], task: Item, time: Duration) -> None:
    limits[task] = min(time, limits.get(task, time))


# ----------------------------------------------------------------------------------- delays and orders


def _delays(forest: Forest, entities: Entities, timing: Timing) -> None:
    bad: list[Item] = []
    within: list[Item] = []
    for item in forest.kinds("DelayConstraint"):
        source, target = (entities.place(forest.ref(item, end)) for end in ("source", "target"))
        low, high = forest.time(item.one("lower")), forest.time(item.one("upper"))
        pairs = _pairs(forest, item, source, target)
        if source is None or target is None or not pairs or target.anchor is Anchor.RELEASE:
            bad.append(item)
            continue
        item.use_all()
        events = {end: event for end in ("source", "target") if (event := forest.ref(item, end)) is not None}
        for event in events.values():
            event.use()
        anchor = source.anchor
        if anchor is Anchor.RELEASE and any(earlier.release is None for earlier, _ in pairs):
            bad.append(item)
            continue
        to_end = target.is_end
        if inner := [end for end, event in events.items() if _is_open(event) or entities.is_inner(event)]:
            within.append(item)
            anchor = _widest(high, at_end=False) if "source" in inner else anchor
            to_end = _widest(high, at_end=True) is Anchor.END if "target" in inner else to_end
        windows = [Window(earlier, later, item, low or ZERO, high, anchor, to_end) for earlier, later in pairs]
        mapping = item.get("mappingType")
        if mapping not in (*MAPPINGS, *_UNSTATED):
            help = f"write one of {', '.join(MAPPINGS)}"
            text = f"each target gets a source: the mapping {quoted(mapping)} is unknown"
            forest.report(codes.REACTION, text, item, help)
        if mapping in MAPPINGS and anchor is Anchor.RELEASE:
            text = "each target gets a source, not each source a target: the source is an activation"
            forest.report(codes.REACTION, text, item, "let the source be a start or an end")
        if mapping not in MAPPINGS or anchor is Anchor.RELEASE:
            timing.windows += windows
        elif high is None:
            continue  # some later target always comes
        elif len(target.drafts) > 1:
            help = "let the target be an event of one task"
            text = "each target gets a source, not each source a target: the target event happens in several tasks"
            forest.report(codes.REACTION, text, item, help)
            timing.windows += windows
        else:
            timing.reactions += [Reaction(mapping, window.later.name, window.precedence()) for window in windows]
    help = "let it connect starts and ends of tasks; the source may also be the activation of a periodic task"
    forest.report_each(codes.BAD_CHAIN, "delay constraints connect no two instants of tasks", bad, help)
    help = "let them name tasks, or runnables that begin or end their task"
    what = "delay constraints count from the start or to the end of a job, though they name what happens within it"
    forest.report_each(codes.WHOLE_JOB, what, within, help)


def _is_open(event: Item) -> bool:
    """Return whether an event may be any instant of a job: an access of a label, or one that is not stated."""
    untyped = event.kind in ("ProcessEvent", "RunnableEvent") and event.get("eventType") in _UNSTATED
    return untyped or event.kind == "LabelEvent"


def _widest(high: Duration | None, *, at_end: bool) -> Anchor:
    """Return the instant of a job for an event within it: an upper limit counts over all of the job."""
    return Anchor.END if at_end is (high is not None) else Anchor.START


def _pairs(forest: Forest, item: Item, source: Place | None, target: Place | None) -> list[tuple[Draft, ...]]:
    if source is None or target is None:
        return []
    return [pair for pair in combined(forest, item, source.drafts, target.drafts) if pair[0] is not pair[1]]


def _sequences(forest: Forest, entities: Entities, timing: Timing) -> None:
    """Order tasks whose runnables a sequencing constraint orders; runnables of one task have their order already."""
    bad: list[Item] = []
    within: list[Item] = []
    for item in forest.kinds("RunnableSequencingConstraint"):
        groups = [forest.refs(group, "runnables") for group in item.all("runnableGroups")]
        callers = [[draft for runnable in group for draft in entities.callers(runnable)] for group in groups]
        if len(callers) < 2 or not all(callers):
            bad.append(item)
            continue
        windows = [
            Window(first, second, item)
            for earlier, later in itertools.pairwise(callers)
            for first, second in combined(forest, item, [*dict.fromkeys(earlier)], [*dict.fromkeys(later)])
            if first.task is not second.task
        ]
        item.use_all()
        for earlier, later in itertools.pairwise(groups):
            _report_order(forest, entities, earlier, later, item)
        timing.windows += windows
        ends = [(group, True) for group in groups[:-1]] + [(group, False) for group in groups[1:]]
        if windows and any(_is_inner(entities, group, end) for group, end in ends):
            within.append(item)
    help = "let it name runnables that tasks call"
    forest.report_each(codes.BAD_CHAIN, "sequencing constraints order no tasks", bad, help)
    help = "let the earlier runnables end their tasks and the later ones begin theirs"
    what = "sequencing constraints order whole jobs, though they name runnables within them"
    forest.report_each(codes.WHOLE_JOB, what, within, help)


def _is_inner(entities: Entities, group: Sequence[Item], end: bool) -> bool:
    """Return whether some task runs the runnables of a group, and none of them at the end, or start, of its jobs."""
    drafts = dict.fromkeys(draft for runnable in group for draft in entities.callers(runnable))
    called = [(draft, [each for each in group if each in entities.calls(draft)]) for draft in drafts]
    return any(all(entities.is_within([draft], each, end=end) for each in names) for draft, names in called)


def _report_order(
    forest: Forest, entities: Entities, earlier: Sequence[Item], later: Sequence[Item], item: Item
) -> None:
    """Report a constraint on runnables that one task calls in another order."""
    for first, second in itertools.product(earlier, later):
        for draft in entities.callers(first):
            calls = [runnable for runnable in entities.calls(draft) if runnable in (first, second)]
            if second in calls and calls.index(second) < len(calls) - 1 - calls[::-1].index(first):
                text = f'wants "{first.name}" before "{second.name}", which task "{draft.task.name}" calls after it'
                help = "exchange the calls, or remove the constraint"
                forest.report(codes.CALL_ORDER, text, item, help)
                return
