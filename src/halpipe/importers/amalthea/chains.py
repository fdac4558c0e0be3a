"""Event chains, chains of processes and ages of data as cause-effect chains of tasks."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.entities import ENDS, Entities, combined
from halpipe.importers.amalthea.graph import CALLS, everything, steps
from halpipe.models import Anchor

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from halpipe.core.durations import Duration
    from halpipe.importers.amalthea.parts import Draft
    from halpipe.importers.amalthea.xmi import Forest, Item

_ITEM_TAGS = ("items", "segments", "strands")
_MOST_LEVELS = 50
_MOST_WAYS = 50
_MOST_EVENTS = 10_000
"""Ways through a chain, and events along them, in all."""
_BEGINS = ("activate", "start")
_RANKS = {"StimulusEvent": {"": 0}, "ProcessEvent": {"activate": 0, "start": 1, "terminate": 3}}
"""Order of the events of a job; what happens within it has 2."""


@record
class Chained:
    """A chain of drafts in the order of the data, with its limits.

    `is_polled`: it begins at the arrivals that its first task polls for, so that its latency is a reaction time.
    `is_triggered`: it begins at the activations of a task that others trigger. `is_inner`: an end of it lies within a
    job, so that the limits count over more of the job.
    """

    name: str
    drafts: tuple[Draft, ...]
    item: Item
    latency: Duration | None = None
    reaction: Duration | None = None
    age: Duration | None = None
    anchor: Anchor | None = None
    to: Anchor | None = None
    is_polled: bool = False
    is_triggered: bool = False
    is_inner: bool = False

    @property
    def stated(self) -> dict[str, Any]:
        """The attributes of a chain of the model that the source states."""
        limits = {"max_latency": self.latency, "max_reaction": self.reaction, "max_age": self.age}
        return limits | {"anchor": self.anchor, "to": self.to}


def read_chains(forest: Forest, entities: Entities) -> list[Chained]:
    """Read all chains and their limits; report those that name no tasks."""
    reader = _Reader(forest, entities)
    chains = [chain for item in forest.within("ConstraintsModel", "eventChains") for chain in reader.chains(item)]
    chains = reader.limited(chains)
    chains += reader.processes()
    chains += reader.ages()
    by_item = grouped((chain.item, chain) for chain in chains)
    stricter = [item for item, same in by_item.items() if _is_stricter(same, entities)]
    help = "state the limits of one activation or writer as chains in an overlay, if the others may be late"
    forest.report_each(codes.STRICTER, "chains keep their limits for each activation or writer alone", stricter, help)
    inner = list(dict.fromkeys(chain.item for chain in chains if chain.is_inner and _limited(chain)))
    help = "let the chain begin with the first runnable of its task and end with the last one, or name the tasks"
    what = "chains count from the start or to the end of a job, though a runnable within it begins or ends them"
    forest.report_each(codes.WHOLE_JOB, what, inner, help)
    partial = [item for item in reader.partial if any(map(_limited, by_item.get(item, ())))]
    help = "state the limits of the other activations as chains in an overlay"
    what = "chains pass tasks that wait, of which the first activation alone keeps their limits"
    forest.report_each(codes.NOT_IMPORTED, what, partial, help)
    help = "let events name tasks, or runnables that one task calls"
    forest.report_each(codes.BAD_CHAIN, "chains name no tasks", reader.bad, help)
    forest.report_each(
        codes.NOT_IMPORTED, "limits of chains", reader.unread, "the upper limits of age and reaction are imported"
    )
    return chains


@record
class _Way:
    """The events along one way through a chain; `broken` says where its parts contradict each other."""

    events: tuple[Item, ...]
    broken: str = ""


class _Reader:
    def __init__(self, forest: Forest, entities: Entities) -> None:
        self.forest = forest
        self.entities = entities
        self.bad: list[Item] = []
        self.unread: list[Item] = []
        self._known: dict[Item, list[_Way]] = {}
        self._open: set[Item] = set()
        self.partial: dict[Item, None] = {}
        """Chains through a task that waits and has several activations, of which the first alone counts."""

    # ------------------------------------------------------------------------------------ event chains

    def chains(self, item: Item) -> list[Chained]:
        """Return the chain of tasks of an event chain, several where parts are parallel."""
        found = self._ways(item)
        broken = next((way.broken for way in found if way.broken), "")
        if broken:
            help = "let the parts begin, follow on each other and end as the chain does"
            self.forest.report(codes.CONTRADICTION, f"is not imported: {broken}", item, help)
            return []
        back = next((pair for way in found if (pair := self._return(way.events))), None)
        if back is not None:
            first, second = back
            message = f'leads from "{first.name}" to "{second.name}", which is earlier in the jobs of its task'
            self.forest.report(codes.RETURNS, message, item, "let it end before, or state the limit in an overlay")
            return []
        known = [(way, self._tasks(way.events)) for way in found]
        if any(path is None for _, path in known):
            self.bad.append(item)
        paths = [(way, each) for way, path in known if path is not None for each in self._activated(item, path)]
        if paths:
            item.use_all()
        for way, _ in paths:
            for event in way.events:
                event.use()
        names = [item.name] if len(paths) == 1 else [f"{item.name}.{i}" for i, _ in enumerate(paths, 1)]
        return [
            replace(
                _begun(Chained(name, path, item), self._begin(way)),
                to=self._end(way),
                is_inner=any(map(self.entities.is_inner, (way.events[0], way.events[-1]))),
            )
            for name, (way, path) in zip(names, paths, strict=True)
        ]

    def _return(self, events: Sequence[Item]) -> tuple[Item, Item] | None:
        """Return two events that follow on each other, of which the second is in the next job of their task."""
        kept = [event for event, _ in itertools.groupby(events)]
        if len(kept) < len(events) == 2:
            return events[0], events[1]
        return next((pair for pair in itertools.pairwise(kept) if self._is_back(*pair)), None)

    def _is_back(self, one: Item, other: Item) -> bool:
        """Return whether an event is earlier than another in the jobs of one task, as far as its calls say."""
        places = self.entities.place(one), self.entities.place(other)
        both = [{draft.task for draft in place.drafts} if place else set() for place in places]
        if len(both[0]) != 1 or both[0] != both[1]:
            return False
        first, second = (self.forest.ref(event, "entity") for event in (one, other))
        task = both[0].pop()
        calls = [c for d in self.entities.path(task) if d.task is task for c in self.entities.calls(d)]
        ranks = [_RANKS[e.kind].get(e.get("eventType"), 2) if e.kind in _RANKS else 2 for e in (one, other)]
        if one.get("eventType") in _BEGINS and calls[:1] == [first]:
            ranks[0] = 1  # the first runnable starts with its task
        if ranks[0] != ranks[1] or {one.kind, other.kind} != {"RunnableEvent"}:
            return ranks[0] > ranks[1]
        if first is None or second is None or calls.count(first) != 1 or calls.count(second) != 1:
            return False
        if first is second:
            return one.get("eventType") in ENDS and other.get("eventType") not in ENDS
        inner = [step for outer in (first, second) for step in everything(self.forest, steps(outer))]
        called = {self.forest.ref(step, CALLS[step.kind]) for step in inner if step.kind in CALLS}
        return called.isdisjoint((first, second)) and calls.index(second) < calls.index(first)

    def _activated(self, item: Item, path: tuple[Draft, ...]) -> list[tuple[Draft, ...]]:
        """Return a path for each activation of its first and of its last task.

        Between them one activation in each mode is enough: with more, data could only pass earlier.
        """
        firsts, lasts = self._equal(item, path[0]), self._equal(item, path[-1])
        if len(path) == 1:
            return [(first,) for first in firsts]
        inner = [_one_in_each_mode(self._equal(item, draft)) for draft in path[1:-1]]
        found = combined(self.forest, item, firsts, *inner, lasts)
        return [way for way in found if frozenset.intersection(*(frozenset(draft.modes) for draft in way))] or [path]

    def _equal(self, item: Item, draft: Draft) -> list[Draft]:
        """Return the drafts of the task for its activations; of a task that waits the first alone, which is noted."""
        drafts = self.entities.of(draft.task)
        if not any(other.part.index for other in drafts):
            return list(drafts)
        if sum(other.part is draft.part for other in drafts) > 1:
            self.partial[item] = None
        return [draft]

    def _begin(self, way: _Way) -> Anchor | None:
        """Return the instant of the first task from which a chain counts; None: its start."""
        place = self.entities.place(way.events[0])
        if place is None or place.anchor is Anchor.START:
            return None
        is_inner = place.anchor is Anchor.END and way.events[0].kind != "ProcessEvent"
        return None if is_inner else place.anchor  # within a job: its start is before

    def _end(self, way: _Way) -> Anchor | None:
        """Return the instant of the last task to which a chain counts; None: its end."""
        last = way.events[-1]
        return Anchor.START if last.kind == "ProcessEvent" and last.get("eventType") in _BEGINS else None

    def _ways(self, item: Item) -> list[_Way]:
        """Return each way through a chain; refuse one of too many levels or events."""
        if item in self._open:
            return [_Way((), f'"{item.name}" is a part of itself')]
        if item not in self._known:
            help = "state its limit in an overlay, as a chain of tasks"
            if len(self._open) > _MOST_LEVELS:
                self.forest.refuse(f"is nested in more than {_MOST_LEVELS} chains", item, help)
            self._open.add(item)
            self._known[item] = self._made(item)
            self._open.remove(item)
            if sum(1 + len(way.events) for way in self._known[item]) > _MOST_EVENTS:
                self.forest.refuse(f"has more than {_MOST_EVENTS} ways and events along them", item, help)
        return self._known[item]

    def _made(self, item: Item) -> list[_Way]:
        ends = [self.forest.ref(item, end) for end in ("stimulus", "response")]
        inner = [link for tag in _ITEM_TAGS for link in item.all(tag)]
        if not inner:
            return [_Way(tuple(event for event in ends if event is not None))]
        links = [self._ways(chain) for link in inner if (chain := self._chain(link)) is not None]
        if item.get("itemType") == "parallel" or all(link.tag == "strands" for link in inner):
            return [_with_ends(ends, way) for ways in links for way in ways]
        ways = [_Way(())]
        for choices in links:
            ways = [self._joined(way, choice) for way in ways for choice in choices]
            if len(ways) > _MOST_WAYS:
                return [_Way((), f"there are more than {_MOST_WAYS} ways through it")]
        return [self._closed(ends, way) for way in ways]

    def _joined(self, way: _Way, then: _Way) -> _Way:
        """Return a continued path; where it continues in another task, data must pass from one to the other."""
        broken = way.broken or then.broken
        if not broken and way.events and then.events and not self._meet(way.events[-1], then.events[0]):
            broken = f'a part ends at "{way.events[-1].name}", the next one begins at "{then.events[0].name}"'
        return _Way((*way.events, *then.events), broken)

    def _closed(self, ends: Sequence[Item | None], way: _Way) -> _Way:
        """Return a way through a sequence with the ends of the chain, which must be those of its parts."""
        first, last = ends
        broken = way.broken
        if not broken and first is not None and way.events and not self._meet(first, way.events[0]):
            broken = f'it begins at "{first.name}", its first part at "{way.events[0].name}"'
        if not broken and last is not None and way.events and not self._meet(way.events[-1], last):
            broken = f'it ends at "{last.name}", its last part at "{way.events[-1].name}"'
        return _with_ends(ends, _Way(way.events, broken))

    def _meet(self, one: Item, other: Item) -> bool:
        """Return whether two events are one, happen in one task, or are accesses to one label."""
        if one is other:
            return True
        places = [self.entities.place(event) for event in (one, other)]
        if None in places:
            return True  # an event in no task is reported elsewhere
        first, second = (place for place in places if place is not None)
        if first.label is not None and first.label is second.label:
            return True
        return bool({draft.task for draft in first.drafts} & {draft.task for draft in second.drafts})

    def _chain(self, link: Item) -> Item | None:
        """Return the chain that a link contains or refers to; until 0.8.0 the link is the chain."""
        link.use()
        if link.kind == "EventChainReference" or link.get("eventChain"):
            return self.forest.ref(link, "eventChain")
        return link.one("eventChain") or link

    def _tasks(self, events: Sequence[Item]) -> tuple[Draft, ...] | None:
        """Return the tasks in which events happen, each once where several events of one follow on each other."""
        events = [event for event, _ in itertools.groupby(events)]
        groups: list[list[tuple[Item, Draft]]] = []
        for index, event in enumerate(events):
            before = groups[-1][-1][1] if groups else None
            draft = self._draft(event, before, events[index + 1 :])
            if draft is None:
                return None
            if before is None or before.task is not draft.task:
                groups.append([])
            groups[-1].append((event, draft))
        found = [self._through(group, group is groups[-1]) for group in groups]
        return tuple(draft for drafts in found for draft in drafts) or None

    def _draft(self, event: Item, before: Draft | None, rest: Sequence[Item]) -> Draft | None:
        """Return where an event happens; None if that is open.

        Of several tasks that access a label the first on a chain is the one that writes it, the last the one that
        reads it; between them the chain stays in its task where it can, else the next event says which.
        """
        place = self.entities.place(event)
        if place is None:
            return None
        if place.label is None or len({draft.task for draft in place.drafts}) == 1:
            return _only(place.drafts)
        reading = [draft for draft in place.drafts if draft not in place.writers]
        if before is None:
            return _only(place.writers)
        if not rest:
            return _only(reading) or _only([draft for draft in place.drafts if draft.task is before.task])
        following = self.entities.place(rest[0])
        near = {draft.task for draft in following.drafts} if following is not None else set()
        return _only([draft for draft in place.drafts if draft.task is before.task]) or _only(
            [draft for draft in place.drafts if draft.task in near]
        )

    def _through(self, group: list[tuple[Item, Draft]], is_last: bool) -> list[Draft]:
        """Return the parts of a task that data passes: all of them, unless the chain begins or ends inside."""
        if is_last and all(event.get("eventType") in _BEGINS for event, _ in group):
            return [group[0][1]]
        if any(event.kind == "ProcessEvent" for event, _ in group):
            return self.entities.path(group[0][1].task)
        drafts = list(dict.fromkeys(draft for _, draft in group))
        rest = [] if is_last else self.entities.path(drafts[-1].task)
        return drafts + (rest[rest.index(drafts[-1]) + 1 :] if drafts[-1] in rest else [])

    def limited(self, chains: list[Chained]) -> list[Chained]:
        """Return the chains with their latency constraints."""
        limits: dict[Item, dict[str, Duration]] = {}
        for item in self.forest.kinds("EventChainLatencyConstraint", "AgeConstraint", "ReactionConstraint"):
            scope, kind = self.forest.ref(item, "scope"), item.get("type") or item.kind.removesuffix("Constraint")
            time = self.forest.time(item.one("maximum"))
            least = self.forest.time(item.one("minimum"))
            known = [chain for chain in chains if chain.item is scope]
            is_read = kind in ("Age", "Reaction") and not any(
                chain.is_triggered or (kind == "Age" and chain.is_polled) for chain in known
            )
            if scope is None or time is None or not known or not is_read:
                self.unread.append(item)
                continue
            if least:
                self.unread.append(item)
            item.use_all()
            kept = limits.setdefault(scope, {})
            kept[kind] = min(time, kept.get(kind, time))
        found = ((chain, limits.get(chain.item, {})) for chain in chains)
        # A reaction counts from each stimulus event, as a latency does.
        return [replace(_within(chain, kept.get("Reaction")), age=kept.get("Age")) for chain, kept in found]

    # ------------------------------------------------------------------------- processes and data ages

    def processes(self) -> list[Chained]:
        """Return chains of processes; an end-to-end limit counts from the first activation to the last end."""
        found: dict[Item, list[Chained]] = {}
        for item in self.forest.kinds("ProcessChain"):
            tasks = self.forest.refs(item, "processes")
            parts = [self.entities.path(task) for task in tasks]
            if parts and all(parts) and len(tasks) == len(item.get("processes").split()):
                item.use_all()
                found[item] = self._process_chains(item, tuple(draft for drafts in parts for draft in drafts))
            else:
                self.bad.append(item)
        for item in self.forest.kinds("ProcessChainRequirement"):
            chain, limit = self.forest.ref(item, "processChain"), item.one("limit")
            time = self.forest.time(limit and limit.one("limitValue"))
            upper = limit is not None and limit.get("limitType") in ("UpperLimit", "")
            known = found.get(chain) if chain is not None else None
            if (
                chain is None
                or known is None
                or time is None
                or limit is None
                or limit.get("metric") != "EndToEnd"
                or not upper
            ):
                self.unread.append(item)
                continue
            item.use_all()
            found[chain] = [_within(one, time) for one in known]
        return [one for known in found.values() for one in known]

    def _process_chains(self, item: Item, path: tuple[Draft, ...]) -> list[Chained]:
        paths = self._activated(item, path)
        names = [item.name] if len(paths) == 1 else [f"{item.name}.{i}" for i, _ in enumerate(paths, 1)]
        return [_begun(Chained(name, each, item), Anchor.RELEASE) for name, each in zip(names, paths, strict=True)]

    def ages(self) -> list[Chained]:
        """Return a chain from each writer of a label to the tasks whose runnable must read it fresh."""
        found = []
        for item in self.forest.kinds("DataAgeConstraint"):
            runnable, label = self.forest.ref(item, "runnable"), self.forest.ref(item, "label")
            age = item.one("dataAge")
            time = self.forest.time(age and age.one("maximumTime"))
            if runnable is None or label is None or time is None:
                self.unread.append(item)
                continue
            readers, writers = self.entities.callers(runnable), self.entities.writers(label)
            ways = combined(self.forest, item, writers, readers)
            pairs = [(writer, reader) for writer, reader in ways if writer is not reader]
            if not pairs:
                self.bad.append(item)
                continue
            item.use_all()
            names = [item.name] if len(pairs) == 1 else [f"{item.name}.{i}" for i, _ in enumerate(pairs, 1)]
            found += [Chained(name, pair, item, age=time) for name, pair in zip(names, pairs, strict=True)]
        return found


def _is_stricter(chains: Sequence[Chained], entities: Entities) -> bool:
    """Return whether other jobs of a task in a mode could keep a limit that each chain has to keep.

    Of the last task each job has an age, and of the first each has a response.
    """
    limited = [chain for chain in chains if _limited(chain)]
    ages = {chain.drafts[0] for chain in limited if chain.age is not None}
    others = {chain.drafts[-1] for chain in limited if chain.latency is not None or chain.reaction is not None}
    inner = {draft for chain in limited for draft in chain.drafts[1:-1]}
    pairs = ((a, b) for a in inner for b in entities.of(a.task) if a is not b and a.part is b.part)
    return any(_share_a_mode(found) for found in (ages, others, *pairs))


def _share_a_mode(drafts: Collection[Draft]) -> bool:
    """Return whether two of some drafts are in one mode."""
    return len({mode for draft in drafts for mode in draft.modes}) < sum(len(draft.modes) for draft in drafts)


def _limited(chain: Chained) -> bool:
    return any(limit is not None for limit in (chain.latency, chain.reaction, chain.age))


def _one_in_each_mode(drafts: Sequence[Draft]) -> list[Draft]:
    """Return drafts, the first in each mode."""
    kept: list[Draft] = []
    for draft in drafts:
        if not draft.modes <= {mode for other in kept for mode in other.modes}:
            kept.append(draft)
    return kept or list(drafts[:1])


def _only(drafts: Sequence[Draft]) -> Draft | None:
    """Return the first of drafts that all belong to one task."""
    return drafts[0] if len({draft.task for draft in drafts}) == 1 else None


def _begun(chain: Chained, anchor: Anchor | None) -> Chained:
    """Return a chain that counts from an instant of its first task: from the activation if that is its release.

    The release of a triggered task is no instant of the model, so that limits from there are not imported.
    """
    first = chain.drafts[0]
    if anchor is not Anchor.RELEASE:
        return replace(chain, anchor=anchor)
    if first.release is not None:
        return replace(chain, anchor=Anchor.RELEASE)
    return replace(chain, is_polled=first.trigger is None, is_triggered=first.trigger is not None)


def _within(chain: Chained, limit: Duration | None) -> Chained:
    """Return a chain with a limit from each event at its begin to the response."""
    if limit is None:
        return chain
    if chain.is_polled:
        return replace(chain, reaction=_least(limit, chain.reaction))
    return replace(chain, latency=_least(limit, chain.latency))


def _least(limit: Duration, known: Duration | None) -> Duration:
    return limit if known is None else min(limit, known)


def _with_ends(ends: Sequence[Item | None], way: _Way) -> _Way:
    """Return a way with the ends of its chain around it, as far as they are stated."""
    events = (ends[0], *way.events, ends[1])
    return _Way(tuple(event for event in events if event is not None), way.broken)
