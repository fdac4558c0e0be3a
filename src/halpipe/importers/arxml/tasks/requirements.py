"""Requirements of tasks: deadlines, distances between their instants, chains with their limits.

A latency from the beginning to the end of one runnable is a deadline. Any other chain is a cause-effect chain of the
tasks that its events belong to."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import groupby
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.words import legal_name, listed, unique_name
from halpipe.models import Anchor, Chain, Match

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.core.diagnostics import Findings
    from halpipe.core.durations import Duration
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
    from halpipe.importers.arxml.tasks.activation import Activation, Draft
    from halpipe.importers.arxml.tasks.dataflow import Actor, DataFlow

_MOST_STEPS = 10_000
"""Events along a chain and its segments."""
_BEGINNINGS = ("activated", "started")
# The instants of jobs that timing description events are, at the beginning and at the end of a chain.
_BEGIN = {
    "activated": Anchor.RELEASE,
    "started": Anchor.START,
    "received": Anchor.START,
    "terminated": Anchor.END,
    "sent": Anchor.END,
}
_END = _BEGIN | {"activated": Anchor.START}


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


@dataclass(slots=True)
class Requirements:
    """Requirements on tasks, by name, and the elements that they were read from.

    `together` are tasks with the instant of each that are to be within a tolerance of each other.
    """

    deadlines: dict[str, Duration] = field(default_factory=dict)
    lets: dict[str, Duration] = field(default_factory=dict)
    spacings: list[Spacing] = field(default_factory=list)
    together: list[tuple[Synchronisation, dict[str, Anchor]]] = field(default_factory=list)
    chains: list[Chain] = field(default_factory=list)
    used: list[Place] = field(default_factory=list)


@record
class _Occurrence:
    """An observable event of one task, in one component instance."""

    observable: Observable
    task: str
    context: tuple[str, ...]


def paths_of(member: Activation) -> set[str]:
    """Return the runnable and the event of an activation."""
    return {member.place.path, *([member.event.place.path] if member.event else [])}


def find_requirements(system: System, drafts: Sequence[Draft], dataflow: DataFlow, findings: Findings) -> Requirements:
    """Apply the constraints of the timing extension to tasks; report those that are about no task, or several."""
    return _Finder(system, drafts, dataflow, findings).find()


class _Finder:
    def __init__(self, system: System, drafts: Sequence[Draft], dataflow: DataFlow, findings: Findings) -> None:
        self._findings = findings
        self._dataflow = dataflow
        self._system = system
        self._observables = {observable.place.path: observable for observable in system.timing.observables}
        self._chains = {chain.place.path: chain for chain in system.timing.chains}
        self._tasks: dict[str, list[tuple[str, tuple[str, ...]]]] = {}
        self._by_actor: dict[Actor, list[str]] = {}
        self._drafts = {draft.name: draft for draft in drafts}
        self._slower: set[tuple[str, str]] = set()
        for draft in drafts:
            for member in draft.members:
                self._tasks.setdefault(member.place.path, []).append((draft.name, member.context))
                self._by_actor.setdefault(member.actor, []).append(draft.name)
                if member.called_every is not None:
                    self._slower |= {(draft.name, member.place.path), (draft.name, "")}
        self._result = Requirements()
        self._names: set[str] = set()

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
        found = self._tasks.get(observable.subject, []) if not observable.port else self._at_port(observable)
        return [
            _Occurrence(observable, task, context)
            for task, context in dict.fromkeys(found)
            if observable.prototype is None or observable.prototype in context
        ]

    def _at_port(self, observable: Observable) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Yield the tasks of the runnables that write (or read) a data element at a port of their component."""
        for instance in self._system.instances:
            for runnable in instance.component.runnables:
                items = runnable.writes if observable.what == "sent" else runnable.reads
                events = [e.data for e in instance.component.events if e.runnable == runnable.place.path and e.data]
                accessed = [*items, *(events if observable.what == "received" else [])]
                if any(i.port == observable.port and i.element == observable.subject for i in accessed):
                    for task in self._by_actor.get((instance.context, runnable.place.path), ()):
                        yield task, instance.context

    def _is_slower(self, occurrence: _Occurrence) -> bool:
        """Whether an event may occur less often than jobs of its task."""
        observable = occurrence.observable
        return (occurrence.task, "" if observable.port else observable.subject) in self._slower

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
        slower = next((o for way in ways for o in way if self._is_slower(o)), None)
        if slower is not None:
            for limit in limits:
                self._lost(limit.place, f'"{slower.task}" is activated more often than what it limits is called')
            return
        for way in ways:
            tasks = tuple(task for task, _ in groupby(occurrence.task for occurrence in way))
            first, last = way[0].observable.what, way[-1].observable.what
            if len(tasks) > 1 or first not in _BEGINNINGS or last != "terminated":
                self._cause_effect(chain, limits, tasks, way, is_one_of_several=len(ways) > 1)
                continue
            for limit in limits:
                known = self._result.deadlines.get(tasks[0])
                self._result.deadlines[tasks[0]] = limit.maximum if known is None else min(known, limit.maximum)
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
                alike = [c for c in same if c.task == way[-1].task] or same
                if len({c.task for c in alike}) != 1:
                    return None
                way.append(alike[0])
            ways.append(way)
        return ways

    def _cause_effect(
        self,
        chain: EventChain,
        limits: list[Limit],
        tasks: tuple[str, ...],
        way: Sequence[_Occurrence],
        *,
        is_one_of_several: bool,
    ) -> None:
        """Make a chain: its latency is limited from event to event, but what comes at a port may just miss a job."""
        label = f"@{way[0].context[-1].rpartition('/')[2]}" if is_one_of_several else ""
        begin, end = _BEGIN[way[0].observable.what], _END[way[-1].observable.what]
        if len(tasks) == 1 and (begin, end) == (Anchor.END, Anchor.START):
            for limit in limits:
                self._lost(limit.place, "it ends before it begins")
            return
        ages = [limit.maximum for limit in limits if limit.is_age]
        reactions = [limit.maximum for limit in limits if not limit.is_age]
        is_from_outside = way[0].observable.what == "received"
        most = min(reactions, default=None)
        self._result.chains.append(
            Chain(
                name=unique_name(legal_name(chain.place.name + label), self._names),
                tasks=tasks,
                max_latency=None if is_from_outside else most,
                max_reaction=most if is_from_outside else None,
                max_age=min(ages, default=None),
                anchor=None if begin is Anchor.START else begin,
                to=None if end is Anchor.END else end,
                origin=chain.place.origin,
            )
        )

    def _age(self, limit: Limit) -> None:
        """Make chains of an AGE-CONSTRAINT: from every task that sends the data to the task that reads it."""
        found = False
        for reader in self._occurrences(limit.scope):
            observable = reader.observable
            item = (reader.context, observable.port), observable.subject.rpartition("/")[2]
            for sender in self._dataflow.senders.get(item, ()):
                for task in self._by_actor.get(sender, ()):
                    if task == reader.task:
                        continue
                    found = True
                    self._result.chains.append(
                        Chain(
                            name=unique_name(legal_name(limit.place.name), self._names),
                            tasks=(task, reader.task),
                            max_age=limit.maximum,
                            origin=limit.place.origin,
                        )
                    )
        if found:
            self._result.used += [limit.place, self._observables[limit.scope].place]
        else:
            self._lost(limit.place, "no task sends the data that it limits the age of")

    # --------------------------------------------------------------------------------------- distances

    def _distance(self, distance: Distance) -> None:
        sources, targets = self._occurrences(distance.source), self._occurrences(distance.target)
        if not sources or not targets:
            self._lost(distance.place, "its events belong to no task")
            return
        if any(target.observable.what not in _BEGINNINGS for target in targets):
            self._lost(distance.place, "it ends elsewhere than at the beginning of a runnable")
            return
        pairs = [(s, t) for t in targets for s in [s for s in sources if s.context == t.context] or sources]
        for source, target in pairs:
            if source.task == target.task:
                self._lost(distance.place, f'both events are of the task "{source.task}"')
            else:
                is_start = source.observable.what in _BEGINNINGS
                anchor = Anchor.START if is_start else Anchor.END
                self._result.spacings.append(
                    Spacing(source.task, target.task, distance.minimum, distance.maximum, anchor, distance.place)
                )
        self._result.used += [self._observables[path].place for path in (distance.source, distance.target)]

    def _together(self, synchronisation: Synchronisation) -> None:
        """Note the tasks whose jobs of each cycle are to start, or end, within a tolerance of each other."""
        found: dict[str, Anchor] = {}
        for path in synchronisation.events:
            occurrences = self._occurrences(path)
            if len(occurrences) != 1 or _BEGIN[occurrences[0].observable.what] is Anchor.RELEASE:
                self._lost(synchronisation.place, f"{path} is no start or end of just one task")
                return
            (one,) = occurrences
            if found.setdefault(one.task, _BEGIN[one.observable.what]) is not _BEGIN[one.observable.what]:
                self._lost(synchronisation.place, f'it names the start and the end of "{one.task}"')
                return
        if len(found) == 1:
            self._lost(synchronisation.place, f'all its events are of the task "{next(iter(found))}"')
            return
        if len({self._drafts[task].period for task in found}) > 1:
            self._lost(synchronisation.place, f"its tasks recur at different periods: {listed(sorted(found))}")
            return
        self._result.together.append((synchronisation, found))
        self._result.used += [synchronisation.place, *(self._observables[p].place for p in synchronisation.events)]

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
        place.report(
            self._findings,
            codes.TIMING_LOST,
            f"is not imported: {why}",
            help="state it in the overlay (deadline, precedence, chains)",
        )
