"""Timing constraints of tasks: deadlines, start jitter, precedence windows, orders, event chains, data ages."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.core.quantities import quoted
from halpipe.core.records import record
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.chains import Chained, read_chains
from halpipe.importers.amalthea.entities import Entities, Place
from halpipe.importers.amalthea.names import legal
from halpipe.importers.amalthea.reactions import MAPPINGS, Reaction
from halpipe.models import Anchor, Match, Origin

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.importers.amalthea.parts import Draft, Drafts
    from halpipe.importers.amalthea.xmi import Forest, Item

_TASK_KINDS = ("Task", "ISR")
_NO_MAPPING = ("", "_undefined_")
_UNREAD = (
    "EventSynchronizationConstraint",
    "EventChainSynchronizationConstraint",
    "SynchronisationConstraint",
    "RepetitionConstraint",
)


@record
class Window:
    """The start of `later` lies `low` to `high` after the instant `anchor` of `earlier`; `high` None: not stated.

    `shifted` and `to_end`: the window is for the end of `later`. `runnable`: it holds where that runnable runs only.
    `point`: the execution time of `earlier`, for that anchor. `match`: any job of `earlier`, or that of the same cycle.
    """

    earlier: Draft
    later: Draft
    cause: Item
    low: Duration = ZERO
    high: Duration | None = None
    anchor: Anchor = Anchor.END
    shifted: bool = False
    to_end: bool = False
    runnable: Item | None = None
    point: Duration | None = None
    match: Match = Match.WINDOW


@dataclass(slots=True)
class Timing:
    """All constraints, as far as the task model has something for them."""

    deadlines: dict[Item, Duration] = field(default_factory=dict)
    most_between_starts: dict[Item, Duration] = field(default_factory=dict)
    windows: list[Window] = field(default_factory=list)
    reactions: list[tuple[str, Window]] = field(default_factory=list)
    """Windows by which each `earlier` job needs a later one, with their mapping."""
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


def limit_of(forest: Forest, item: Item, tag: str) -> Duration | None:
    """Return a time in a child element."""
    child = item.one(tag)
    return None if child is None else forest.time(child)


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
        time = None if stated is None else forest.time(stated)
        if time and stated is not None:
            stated.use()
            _least(timing.deadlines, task, time)
    help = "only upper limits of response times and of distances between starts of tasks are imported"
    forest.report_each(codes.NOT_IMPORTED, "requirements", unread, help)


def _deadline(forest: Forest, item: Item, task: Item, timing: Timing) -> bool:
    """Take a limit of a process; return whether there is something for it."""
    limit = item.one("limit")
    assert limit is not None
    time = limit_of(forest, limit, "limitValue")
    if time is None or limit.get("limitType") not in ("UpperLimit", ""):
        return False
    if limit.get("metric") == "ResponseTime":
        _least(timing.deadlines, task, time)
        return True
    if limit.get("metric") == "StartToStart":
        _least(timing.most_between_starts, task, time)
        return True
    return False


def _least(limits: dict[Item, Duration], task: Item, time: Duration) -> None:
    limits[task] = min(time, limits.get(task, time))


# ----------------------------------------------------------------------------------- delays and orders


def _delays(forest: Forest, entities: Entities, timing: Timing) -> None:
    bad = []
    for item in forest.kinds("DelayConstraint"):
        source, target = (entities.place(forest.ref(item, end)) for end in ("source", "target"))
        low, high = limit_of(forest, item, "lower"), limit_of(forest, item, "upper")
        pairs = _pairs(source, target)
        if source is None or target is None or not pairs or target.anchor is Anchor.RELEASE:
            bad.append(item)
            continue
        item.use_all()
        _use_events(forest, item)
        anchor = source.anchor
        if anchor is Anchor.RELEASE and any(earlier.release is None for earlier, _ in pairs):
            bad.append(item)
            continue
        runnable = target.runnable if target.runnable is not None and not target.is_end else None
        windows = [
            Window(earlier, later, item, low or ZERO, high, anchor, target.is_end, runnable=runnable)
            for earlier, later in pairs
        ]
        mapping = item.get("mappingType")
        if mapping not in (*MAPPINGS, *_NO_MAPPING):
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
            timing.reactions += [(mapping, window) for window in windows]
    help = "let it connect starts and ends of tasks; the source may also be the activation of a periodic task"
    forest.report_each(codes.BAD_CHAIN, "delay constraints connect no two instants of tasks", bad, help)


def _use_events(forest: Forest, item: Item) -> None:
    for end in ("source", "target"):
        if (event := forest.ref(item, end)) is not None:
            event.use()


def reactions_of(timing: Timing) -> list[Reaction]:
    """Return the delay constraints whose sources need targets, by the names of the tasks."""
    found = []
    for mapping, window in timing.reactions:
        at, name = window.cause.at, legal(window.cause.name or window.cause.kind)
        assert window.high is not None
        reaction = Reaction(
            mapping=mapping,
            source=window.earlier.name,
            target=window.later.name,
            low=window.low,
            high=window.high,
            source_ends=window.anchor is Anchor.END,
            target_ends=window.shifted,
            origin=Origin(at.file, at.line, name),
        )
        found.append(reaction)
    return found


def _pairs(source: Place | None, target: Place | None) -> list[tuple[Draft, Draft]]:
    if source is None or target is None:
        return []
    return [(a, b) for a in source.drafts for b in target.drafts if a is not b]


def _sequences(forest: Forest, entities: Entities, timing: Timing) -> None:
    """Order tasks whose runnables a sequencing constraint orders; runnables of one task have their order already."""
    bad = []
    for item in forest.kinds("RunnableSequencingConstraint"):
        groups = [forest.refs(group, "runnables") for group in item.all("runnableGroups")]
        callers = [[draft for runnable in group for draft in entities.callers(runnable)] for group in groups]
        if len(callers) < 2 or not all(callers):
            bad.append(item)
            continue
        windows = [w for earlier, later in itertools.pairwise(callers) for w in _ordered(earlier, later, item)]
        item.use_all()
        for earlier, later in itertools.pairwise(groups):
            _report_order(forest, entities, earlier, later, item)
        timing.windows += windows
    help = "let it name runnables that tasks call"
    forest.report_each(codes.BAD_CHAIN, "sequencing constraints order no tasks", bad, help)


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


def _ordered(earlier: Sequence[Draft], later: Sequence[Draft], item: Item) -> list[Window]:
    return [Window(a, b, item) for a in dict.fromkeys(earlier) for b in dict.fromkeys(later) if a.task is not b.task]
