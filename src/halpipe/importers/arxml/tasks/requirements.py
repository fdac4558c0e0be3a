"""Requirements of tasks: deadlines, distances between their instants, chains with their limits.

A latency from the beginning to the end of one runnable is a deadline. Any other chain is a cause-effect chain of the
tasks that its events belong to."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import groupby, pairwise
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.words import listed
from halpipe.importers.arxml.tasks.activation import BEGINNINGS, Activation, Draft, are_in_order
from halpipe.importers.common.names import legal, unique_name
from halpipe.models import Anchor, Chain, Match

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from halpipe.core.diagnostics import Findings
    from halpipe.importers.arxml.system.values import (
        Distance,
        EventChain,
        LetGroup,
        Limit,
        Observable,
        Place,
        Synchronisation,
        System,
    )
    from halpipe.importers.arxml.tasks.dataflow import Actor, DataFlow

_MOST_STEPS = 10_000
"""Events along a chain and its segments."""
_ENDS = ("terminated", "sent")


@record
class Spacing:
    """Some job of `first` lies `low` to `high` (None: a period) before every job of `second` (task names)."""

    first: str
    second: str
    low: Duration | None
    high: Duration | None
    anchor: Anchor
    cause: Place
    to: Anchor = Anchor.START
    match: Match = Match.WINDOW

    @property
    def is_order(self) -> bool:
        """Whether `second` starts after the end of `first`, as an execution order demands."""
        return (self.anchor, self.to) == (Anchor.END, Anchor.START) and (self.low or ZERO) >= ZERO


@dataclass(slots=True)
class Requirements:
    """Requirements on tasks, by name, and the elements that they were read from.

    `together` are tasks with the instants of each that are to be within a tolerance of each other.
    """

    deadlines: dict[str, Duration] = field(default_factory=dict)
    lets: dict[str, Duration] = field(default_factory=dict)
    spacings: list[Spacing] = field(default_factory=list)
    together: list[tuple[Synchronisation, dict[str, tuple[Anchor, ...]]]] = field(default_factory=list)
    chains: list[Chain] = field(default_factory=list)
    used: list[Place] = field(default_factory=list)


@record
class _Occurrence:
    """An observable event of one task, in one component instance, and the calls of the task at which it happens."""

    observable: Observable
    draft: Draft
    calls: tuple[Activation, ...]

    @property
    def context(self) -> tuple[str, ...]:
        return self.calls[0].context

    @property
    def anchors(self) -> tuple[Anchor, ...]:
        """The start or the end of jobs at which it happens; both where it may happen between them."""
        what = self.observable.what
        end = what in _ENDS
        if what != "activated" and self.draft.is_within(self.calls, end=end):
            return (Anchor.START, Anchor.END)
        return (Anchor.END if end else Anchor.START,)

    @property
    def is_slower(self) -> bool:
        """Whether it may happen less often than jobs of its task."""
        return any(call.called_every is not None for call in self.calls)

    def is_before(self, other: _Occurrence) -> bool:
        """Return whether a job that both belong to has `other` at the same call, or at a later one."""
        works = {call.work for call in self.calls}
        return are_in_order(self.calls, [call for call in other.calls if call.work not in works])


def paths_of(member: Activation) -> set[str]:
    """Return the runnable and the event of an activation."""
    return {member.place.path, *([member.event.place.path] if member.event else [])}


def find_requirements(system: System, drafts: Sequence[Draft], dataflow: DataFlow, findings: Findings) -> Requirements:
    """Apply the constraints of the timing extension to tasks; report those that are about no task, or several."""
    return _Finder(system, drafts, dataflow, findings).find()


def report_inner(place: Place, drafts: Iterable[Draft], findings: Findings) -> None:
    """Report a constraint that counts over jobs of some tasks, within which its events are."""
    if names := listed(list(dict.fromkeys(draft.name for draft in drafts))):
        message = f"counts from the start, or to the end, of jobs of {names}, which call other runnables there"
        help = "keep its events with --granularity runnable, or let them be at the first, or last, runnable"
        place.report(findings, codes.WHOLE_JOB, message, help=help)


def _why_lost(way: Sequence[_Occurrence]) -> str:
    """Return why jobs do not have the events of a chain as its limits need them; nothing if they do."""
    if slower := next((event for event in way if event.is_slower), None):
        return f'"{slower.draft.name}" is activated more often than what it limits is called'
    first, last = way[0], way[-1]
    for one, other in pairwise(way):
        if one.draft is other.draft and not one.is_before(other):
            return f'"{one.draft.name}" does not call, or may not call, its events in their order'
    is_turned = first.observable.what in _ENDS and last.observable.what not in _ENDS
    is_one_call = all(event.draft is first.draft for event in way) and last.is_before(first)
    return "it ends before it begins" if is_turned and is_one_call else ""


class _Finder:
    def __init__(self, system: System, drafts: Sequence[Draft], dataflow: DataFlow, findings: Findings) -> None:
        self._findings = findings
        self._dataflow = dataflow
        self._system = system
        self._observables = {observable.place.path: observable for observable in system.timing.observables}
        self._chains = {chain.place.path: chain for chain in system.timing.chains}
        self._calls: dict[str, list[tuple[Draft, Activation]]] = {}
        self._by_actor: dict[Actor, list[tuple[Draft, Activation]]] = {}
        self._drafts = {draft.name: draft for draft in drafts}
        for draft in drafts:
            for member in draft.members:
                self._calls.setdefault(member.place.path, []).append((draft, member))
                self._by_actor.setdefault(member.actor, []).append((draft, member))
        self._result = Requirements()
        self._names: dict[str, int] = {}

    def find(self) -> Requirements:
        limited: dict[str, list[Limit]] = {}
        for limit in self._system.timing.limits:
            if limit.scope in self._chains:
                limited.setdefault(limit.scope, []).append(limit)
            else:
                self._age(limit)
        segments = {path for chain in self._chains.values() for path in chain.segments}
        for path, chain in self._chains.items():
            if path in limited or path not in segments:
                self._chain(chain, limited.get(path, []))
        for distance in self._system.timing.distances:
            self._distance(distance)
        for synchronisation in self._system.timing.synchronisations:
            self._together(synchronisation)
        for let in self._system.timing.lets:
            self._let(let, limited.get(let.interval, []))
        return self._result

    # -------------------------------------------------------------------------------------- occurrences

    def _occurrences(self, path: str | None) -> list[_Occurrence]:
        """Return the tasks that an observable event belongs to, each once for every component instance."""
        observable = self._observables.get(path or "")
        if observable is None:
            return []
        found: dict[tuple[str, tuple[str, ...]], tuple[Draft, list[Activation]]] = {}
        for draft, call in self._at_port(observable) if observable.port else self._calls.get(observable.subject, ()):
            if observable.prototype is None or observable.prototype in call.context:
                found.setdefault((draft.name, call.context), (draft, []))[1].append(call)
        return [_Occurrence(observable, draft, tuple(calls)) for draft, calls in found.values()]

    def _at_port(self, observable: Observable) -> Iterator[tuple[Draft, Activation]]:
        """Yield the calls, with their tasks, of the runnables that write (or read) a data element at a port."""
        for instance in self._system.instances:
            for runnable in instance.component.runnables:
                items = runnable.writes if observable.what == "sent" else runnable.reads
                events = [e.data for e in instance.component.events if e.runnable == runnable.place.path and e.data]
                accessed = [*items, *(events if observable.what == "received" else [])]
                if any(i.port == observable.port and i.element == observable.subject for i in accessed):
                    yield from self._by_actor.get((instance.context, runnable.place.path), ())

    # ------------------------------------------------------------------------------------------- chains

    def _steps(self, chain: EventChain) -> list[str | None]:
        """Return the observable events along a chain and its segments, in order; none where they are too many."""
        steps: list[str | None] = []
        rest: list[EventChain | str | None] = [chain]
        while rest and len(steps) + len(rest) <= _MOST_STEPS:
            item = rest.pop()
            if item is None or isinstance(item, str):
                steps.append(item)
            else:
                segments = [self._chains[path] for path in reversed(item.segments) if path in self._chains]
                rest += [item.response, *segments, item.stimulus]
        return [] if rest else steps

    def _chain(self, chain: EventChain, limits: list[Limit]) -> None:
        steps = self._steps(chain)
        ways = self._ways([self._occurrences(path) for path in steps]) if steps else None
        if ways is None:
            missing = [path or "nothing" for path in steps if not self._occurrences(path)]
            why = f"no task belongs to {missing[0]}" if missing else "its events belong to several tasks each"
            why = why if steps else f"it is a part of itself, or has more than {_MOST_STEPS} events"
            for place in (chain.place, *(limit.place for limit in limits)):
                self._lost(place, why)
            return
        if why := next(filter(None, map(_why_lost, ways)), ""):
            for limit in limits:
                self._lost(limit.place, why)
            return
        inner = [end.draft for way in ways for end in (way[0], way[-1]) if len(end.anchors) > 1]
        for limit in limits:
            report_inner(limit.place, inner, self._findings)
        for way in ways:
            task, first, last = way[0].draft, way[0].observable.what, way[-1].observable.what
            if any(event.draft is not task for event in way) or first not in BEGINNINGS or last != "terminated":
                label = f"@{way[0].context[-1].rpartition('/')[2]}" if len(ways) > 1 else ""
                self._cause_effect(chain.place.name + label, chain.place, limits, way)
                continue
            for limit in limits:
                known = self._result.deadlines.get(task.name)
                self._result.deadlines[task.name] = limit.maximum if known is None else min(known, limit.maximum)
        self._result.used += [limit.place for limit in limits]
        self._result.used += [self._observables[path].place for path in steps if path is not None]
        self._result.used += [chain.place, *(self._chains[p].place for p in chain.segments if p in self._chains)]

    def _ways(self, steps: list[list[_Occurrence]]) -> list[list[_Occurrence]] | None:
        """Return the ways through the steps, one for every instance of the first; None where a step is ambiguous."""
        if not all(steps):
            return None
        ways = []
        for first in steps[0]:
            way = [first]
            for candidates in steps[1:]:
                same = [c for c in candidates if c.context == way[-1].context] or candidates
                alike = [c for c in same if c.draft.name == way[-1].draft.name] or same
                if len({c.draft.name for c in alike}) != 1:
                    return None
                way.append(alike[0])
            ways.append(way)
        return ways

    def _cause_effect(self, name: str, place: Place, limits: list[Limit], way: list[_Occurrence]) -> None:
        """Make a chain: its latency is limited from event to event, but what comes at a port may just miss a job."""
        begin = Anchor.RELEASE if way[0].observable.what == "activated" else way[0].anchors[0]
        end = way[-1].anchors[-1]
        ages = [limit.maximum for limit in limits if limit.is_age]
        reactions = [limit.maximum for limit in limits if not limit.is_age]
        is_from_outside = way[0].observable.what == "received"
        most = min(reactions, default=None)
        self._result.chains.append(
            Chain(
                name=unique_name(legal(name), self._names),
                tasks=tuple(task for task, _ in groupby(occurrence.draft.name for occurrence in way)),
                max_latency=None if is_from_outside else most,
                max_reaction=most if is_from_outside else None,
                max_age=min(ages, default=None),
                anchor=None if begin is Anchor.START else begin,
                to=None if end is Anchor.END else end,
                origin=place.origin,
            )
        )

    def _age(self, limit: Limit) -> None:
        """Make chains of an AGE-CONSTRAINT: from every task that sends the data to the task that reads it."""
        found, why = False, "no task sends the data that it limits the age of"
        inner: list[Draft] = []
        for reader in self._occurrences(limit.scope):
            observable = reader.observable
            item = (reader.context, observable.port), observable.subject.rpartition("/")[2]
            for sender in self._dataflow.senders.get(item, ()):
                for draft, call in self._by_actor.get(sender, ()):
                    if draft is reader.draft:
                        why = f'"{draft.name}" both sends and reads the data that it limits the age of'
                        continue
                    found = True
                    inner += [draft] * draft.is_within([call], end=False)
                    inner += [reader.draft] * reader.draft.is_within(reader.calls, end=True)
                    self._result.chains.append(
                        Chain(
                            name=unique_name(legal(limit.place.name), self._names),
                            tasks=(draft.name, reader.draft.name),
                            max_age=limit.maximum,
                            origin=limit.place.origin,
                        )
                    )
        report_inner(limit.place, inner, self._findings)
        if found:
            self._result.used += [limit.place, self._observables[limit.scope].place]
        if not found or why.startswith('"'):
            self._lost(limit.place, why)

    # --------------------------------------------------------------------------------------- distances

    def _distance(self, distance: Distance) -> None:
        sources, targets = self._occurrences(distance.source), self._occurrences(distance.target)
        if not sources or not targets:
            self._lost(distance.place, "its events belong to no task")
            return
        if any(target.observable.what not in BEGINNINGS for target in targets):
            self._lost(distance.place, "it ends elsewhere than at the beginning of a runnable")
            return
        inner: list[Draft] = []
        pairs = [(s, t) for t in targets for s in [s for s in sources if s.context == t.context] or sources]
        for source, target in pairs:
            if source.draft.name == target.draft.name:
                self._lost(distance.place, f'both events are of the task "{source.draft.name}"')
            elif source.is_slower:
                self._lost(distance.place, f'"{source.draft.name}" is activated more often than its source is called')
            else:
                inner += [event.draft for event in (source, target) if len(event.anchors) > 1]
                if distance.minimum and target.observable.what == "activated":
                    message = f'its least distance to the activation of "{target.draft.name}" bounds the start alone'
                    help = "name the start (STARTED) if it is meant, or state offsets that keep the distance"
                    distance.place.report(self._findings, codes.TIMING_PART_LOST, message, help=help)
                has_release = source.observable.what == "activated" and source.draft.period is not None
                begins = (Anchor.RELEASE,) if has_release else source.anchors
                most = [] if distance.maximum is None else [(begins[0], target.anchors[-1])]
                ends = dict.fromkeys([(begins[-1], target.anchors[0]), *most])
                match = Match.WINDOW if len(ends) == 1 else Match.CYCLE
                names, limits = (source.draft.name, target.draft.name), (distance.minimum, distance.maximum)
                self._result.spacings += [Spacing(*names, *limits, a, distance.place, b, match) for a, b in ends]
        report_inner(distance.place, inner, self._findings)
        self._result.used += [self._observables[path].place for path in (distance.source, distance.target)]

    def _together(self, synchronisation: Synchronisation) -> None:
        """Note the tasks whose jobs of each cycle are to start, or end, within a tolerance of each other."""
        found: dict[str, tuple[Anchor, ...]] = {}
        inner: list[Draft] = []
        for path in synchronisation.events:
            occurrences = self._occurrences(path)
            if len(occurrences) != 1 or occurrences[0].observable.what == "activated":
                self._lost(synchronisation.place, f"{path} is no start or end of just one task")
                return
            (one,) = occurrences
            inner += [one.draft] * (len(one.anchors) > 1)
            anchors = {*one.anchors, *found.get(one.draft.name, ())}
            found[one.draft.name] = tuple(anchor for anchor in (Anchor.START, Anchor.END) if anchor in anchors)
        place, tolerance = synchronisation.place, synchronisation.tolerance
        whole = [task for task, anchors in found.items() if len(anchors) > 1]
        why = ""
        if len(found) == 1:
            why = f'all its events are of the task "{next(iter(found))}"'
        elif len({self._drafts[task].period for task in found}) > 1:
            why = f"its tasks recur at different periods: {listed(sorted(found))}"
        elif whole and not tolerance:
            why = f"its events are apart within jobs of {listed(whole)}"
        if why:
            self._lost(place, why)
            return
        for task in whole:  # as long as all the events may be apart
            name = unique_name(legal(f"{place.name}@{task}"), self._names)
            self._result.chains.append(Chain(name=name, tasks=(task,), max_latency=tolerance, origin=place.origin))
        report_inner(place, inner, self._findings)
        self._result.together.append((synchronisation, found))
        self._result.used += [place, *(self._observables[p].place for p in synchronisation.events)]

    def _let(self, let: LetGroup, limits: Sequence[Limit]) -> None:
        """Give the tasks of a group the length of its LET interval as their logical execution time."""
        lengths = {limit.maximum for limit in limits}
        paths = {member.path for member in let.members}
        tasks = [d for d in self._drafts.values() if any(not paths.isdisjoint(paths_of(m)) for m in d.members)]
        partly = [d.name for d in tasks if any(paths.isdisjoint(paths_of(member)) for member in d.members)]
        if len(lengths) != 1 or not tasks or partly:
            why = "no task executes in it" if not tasks else "the length of its interval is not stated"
            why = f"{listed(partly)} executes more than what is in it" if partly else why
            self._lost(let.place, f"its LET interval is not read: {why}")
            return
        for draft in tasks:
            length = next(iter(lengths))
            self._result.lets[draft.name] = min(length, self._result.lets.get(draft.name, length))
        self._result.used.append(let.place)

    def _lost(self, place: Place, why: str) -> None:
        message = f"is not imported: {why}"
        help = "state it in the overlay (deadline, precedence, chains)"
        place.report(self._findings, codes.TIMING_LOST, message, help=help)
