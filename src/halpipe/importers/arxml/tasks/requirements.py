"""Order and requirements of tasks: precedence without cycles, deadlines, distances, chains with their limits.

A latency from the beginning to the end of one runnable is a deadline. Any other chain is a cause-effect chain of the
tasks that its events belong to."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from fractions import Fraction
from graphlib import CycleError, TopologicalSorter
from itertools import groupby
from math import gcd
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import named
from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.words import legal_name, listed, unique_name
from halpipe.importers.arxml.tasks.activation import position_of
from halpipe.importers.arxml.tasks.periods import senders_of
from halpipe.models import Anchor, Chain, Match

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from halpipe.core.diagnostics import Findings
    from halpipe.core.durations import Duration
    from halpipe.importers.arxml.system.values import (
        Distance,
        EventChain,
        LetGroup,
        Limit,
        Observable,
        Order,
        Ordered,
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


def _paths(member: Activation) -> set[str]:
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
        tasks = [d for d in self._drafts.values() if any(not paths.isdisjoint(_paths(m)) for m in d.members)]
        partly = [d.name for d in tasks if any(paths.isdisjoint(_paths(member)) for member in d.members)]
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


@record
class Edge:
    """`first` before `second` (task names), because of the element at `cause`.

    `spacing` states the window where an offset constraint does; `also` are elements that state the same order.
    """

    first: str
    second: str
    cause: Place
    spacing: Spacing | None = None
    also: tuple[Place, ...] = ()

    @property
    def anchor(self) -> Anchor:
        """Instant of the first task from which the window counts."""
        return self.spacing.anchor if self.spacing else Anchor.END


def find_edges(
    system: System, drafts: Sequence[Draft], dataflow: DataFlow, required: Requirements, findings: Findings
) -> list[Edge]:
    """Return the precedence between tasks, strongest source first, each pair once, free of cycles."""
    edges = [
        *(Edge(spacing.first, spacing.second, spacing.cause, spacing) for spacing in required.spacings),
        *_from_constraints(system, drafts, findings),
        *_from_positions(drafts, findings),
        *_from_received_data(drafts, dataflow),
    ]
    alike: dict[tuple[str, str], list[Edge]] = {}
    for edge in edges:
        if edge.first == edge.second:
            required.used.append(edge.cause)
        else:
            alike.setdefault((edge.first, edge.second), []).append(edge)
    kept = without_cycles([e for found in alike.values() for e in _joined(found)], findings)
    return [*kept, *_synchronised(required.together, kept, drafts, findings)]


def _synchronised(
    together: Sequence[tuple[Synchronisation, Mapping[str, Anchor]]],
    edges: Sequence[Edge],
    drafts: Sequence[Draft],
    findings: Findings,
) -> Iterator[Edge]:
    """Let all others follow the first of some tasks within the tolerance, in the order that the edges have.

    The constraint does not state who is first; a window does, which demands more than the constraint.
    """
    sorter: TopologicalSorter[str] = TopologicalSorter({draft.name: () for draft in drafts})
    for edge in edges:
        sorter.add(edge.second, edge.first)
    rank = {name: number for number, name in enumerate(sorter.static_order())}
    for cause, instants in together:
        first, *others = sorted(instants, key=rank.__getitem__)
        for other in others:
            window = Spacing(
                first,
                other,
                ZERO,
                cause.tolerance,
                instants[first],
                cause.place,
                instants[other],
                Match.CYCLE,
            )
            yield Edge(first, other, cause.place, window)
        cause.place.report(
            findings,
            codes.SYNCHRONISED,
            f'{listed(others)} follow "{first}" within {cause.tolerance}',
            help="state another order in the overlay (precedence), if this one cannot be kept",
        )


def _joined(alike: list[Edge]) -> Iterator[Edge]:
    """Yield every window between two tasks, or the strongest order if no window is stated; others are noted in it."""
    windows = [edge for edge in alike if edge.spacing] or alike[:1]
    also = tuple(dict.fromkeys(edge.cause for edge in alike if edge not in windows))
    yield replace(windows[0], also=also)
    yield from windows[1:]


# ------------------------------------------------------------------------------------------------- sources


def _from_constraints(system: System, drafts: Sequence[Draft], findings: Findings) -> Iterator[Edge]:
    """Execution order constraints; two runnables of one component type are ordered within each instance only."""
    by_path: dict[str, list[tuple[Draft, Activation]]] = {}
    for draft in drafts:
        for member in draft.members:
            for path in _paths(member):
                by_path.setdefault(path, []).append((draft, member))
    _report_lost(system, by_path.keys(), findings)
    for order in system.orders:
        same_type = order.first.path.rpartition("/")[0] == order.second.path.rpartition("/")[0]
        is_named = bool(order.first.prototype or order.second.prototype)
        for draft, first in _in_context(by_path, order.first):
            for other, second in _in_context(by_path, order.second):
                is_meant = is_named or not same_type or first.context == second.context
                if is_meant and (draft is not other or _is_kept_inside(order, draft, first, second, findings)):
                    yield Edge(draft.name, other.name, order.place)


def _is_kept_inside(order: Order, draft: Draft, first: Activation, second: Activation, findings: Findings) -> bool:
    """Whether the positions in one OsTask state an order, too; report one that they contradict, or leave open."""
    one, other = position_of(first), position_of(second)
    if one is not None and other is not None and one < other:
        return True
    order.place.report(
        findings,
        codes.ORDER_LOST,
        f'orders "{first.name}" before "{second.name}", which "{draft.name}" runs '
        + ("in no stated order" if one is None or other is None or one == other else "the other way round"),
        help="correct RtePositionInTask, or the constraint",
    )
    return False


def _in_context(by_path: dict[str, list[tuple[Draft, Activation]]], end: Ordered) -> Iterator[tuple[Draft, Activation]]:
    """Yield the tasks of what an order names, with the activations; those of the named prototype if it names one."""
    for draft, member in by_path.get(end.path, ()):
        if end.prototype is None or end.prototype in member.context:
            yield draft, member


def _report_lost(system: System, known: Collection[str], findings: Findings) -> None:
    """Report, once per constraint, what it orders that is no task."""
    lost: dict[Place, dict[str, None]] = {}
    for order in system.orders:
        for path in (order.first.path, order.second.path):
            if path not in known:
                lost.setdefault(order.place, {})[path] = None
    for place, paths in lost.items():
        place.report(
            findings,
            codes.ORDER_LOST,
            f"orders what is no periodic task: {listed(list(paths))}",
            help="give it a period in the overlay (sources) if the order matters",
        )


def _from_positions(drafts: Sequence[Draft], findings: Findings) -> Iterator[Edge]:
    """RtePositionInTask orders what one OsTask runs; equal positions are not ordered.

    What is released together runs in this order, also across periods: each position follows the last one before it,
    and the last one with its own period and offset.
    """
    hosted: dict[str, list[Draft]] = {}
    for draft in drafts:
        if draft.os_task is not None:
            hosted.setdefault(draft.os_task.place.path, []).append(draft)
    for found in hosted.values():
        slots: dict[int, list[Draft]] = {}
        for draft in found:
            if draft.position is not None:
                slots.setdefault(draft.position, []).append(draft)
        _report_positions(found, slots, findings)
        yield from _in_turn(slots)


def _in_turn(slots: dict[int, list[Draft]]) -> Iterator[Edge]:
    last_of_rate: dict[tuple[Duration | None, Duration | None], list[Draft]] = {}
    last: list[Draft] = []
    for position in sorted(slots):
        for second in slots[position]:
            before = {id(first): first for first in (*last, *last_of_rate.get((second.period, second.offset), ()))}
            for first in before.values():
                if _meet(first, second):
                    mapping = second.members[0].mapping
                    assert mapping is not None
                    yield Edge(first.name, second.name, mapping.place)
        last = slots[position]
        rates: dict[tuple[Duration | None, Duration | None], list[Draft]] = {}
        for draft in last:
            rates.setdefault((draft.period, draft.offset), []).append(draft)
        last_of_rate |= rates


def _meet(first: Draft, second: Draft) -> bool:
    """Whether releases of two tasks coincide, which they do iff their offsets agree modulo the common divisor."""
    if first.period is None or second.period is None:
        return first.period == second.period
    one, other = first.period.fraction, second.period.fraction
    common = Fraction(
        gcd(one.numerator * other.denominator, other.numerator * one.denominator), one.denominator * other.denominator
    )
    return ((first.offset or ZERO).fraction - (second.offset or ZERO).fraction) % common == 0


def _report_positions(found: Sequence[Draft], slots: dict[int, list[Draft]], findings: Findings) -> None:
    """Report what one OsTask runs in an order that no input states."""
    unordered = [draft for draft in found if draft.position is None]
    groups = [*slots.values(), [*unordered, *found[:1]] if unordered else []]
    for group in groups:
        names = list(dict.fromkeys(draft.name for draft in group))
        if len(names) > 1 and group[0].os_task is not None:
            findings.report(
                codes.SAME_POSITION,
                f"runs in no stated order: {listed(names)}",
                at=group[0].place.at,
                path=named("OsTask", group[0].os_task.place.path),
            )


def _from_received_data(drafts: Sequence[Draft], dataflow: DataFlow) -> Iterator[Edge]:
    """A task that data starts comes after the tasks of the same period that send the data."""
    senders: dict[tuple[Actor, Duration | None], list[Draft]] = {}
    for draft in drafts:
        for member in draft.members:
            senders.setdefault((member.actor, draft.period), []).append(draft)
    for draft in drafts:
        for member in draft.members:
            if member.event is None:
                continue
            for actor in senders_of(member, dataflow):
                for sender in senders.get((actor, draft.period), ()):
                    yield Edge(sender.name, draft.name, member.event.place)


# -------------------------------------------------------------------------------------------------- cycles


def without_cycles(edges: list[Edge], findings: Findings) -> list[Edge]:
    """Keep edges in order of strength, leaving out and reporting every one that would close a cycle."""
    if _is_acyclic(edges):
        return edges
    kept: list[Edge] = []
    successors: dict[str, list[str]] = {}
    for edge in edges:
        way = _way(successors, edge.second, edge.first)
        if way:
            edge.cause.report(
                findings,
                codes.CYCLE,
                f'the order "{edge.first}" before "{edge.second}" is left out, because it contradicts '
                + " before ".join(f'"{name}"' for name in way),
                help="correct one of them in the source, or state the order in the overlay (precedence)",
            )
            continue
        kept.append(edge)
        successors.setdefault(edge.first, []).append(edge.second)
    return kept


def _is_acyclic(edges: list[Edge]) -> bool:
    sorter: TopologicalSorter[str] = TopologicalSorter()
    for edge in edges:
        sorter.add(edge.second, edge.first)
    try:
        sorter.prepare()
    except CycleError:
        return False
    return True


def _way(successors: dict[str, list[str]], start: str, end: str) -> list[str]:
    """Return a shortest way from `start` to `end`, empty if there is none."""
    came_from = {start: ""}
    todo = [start]
    for name in todo:
        if name == end:
            way = [end]
            while came_from[way[-1]]:
                way.append(came_from[way[-1]])
            return way[::-1]
        for following in successors.get(name, ()):
            if following not in came_from:
                came_from[following] = name
                todo.append(following)
    return []
