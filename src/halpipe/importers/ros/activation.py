"""Activation of callbacks: which run, how often, and their triggers.

Periods start at timers and at topics whose period the overlay or, failing that, a recording, statistics or a QoS
deadline states. They spread along publications, shortest first (Dijkstra's algorithm, where the distance is the
period and then the number of hops): a callback with several sources takes the shortest period.
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, named
from halpipe.core.records import record
from halpipe.importers.ros import codes
from halpipe.importers.ros.dot import DEADLINE, STATISTICS
from halpipe.importers.ros.graph import (
    MEASURED,
    STATED,
    Callback,
    Certainty,
    Kind,
    Publication,
    RosGraph,
    snap,
    snapped,
)
from halpipe.importers.ros.rosbag import ROSBAG
from halpipe.importers.ros.traced import TRACE

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from halpipe.core.durations import Duration
    from halpipe.importers.overlay import OverlayUse
    from halpipe.importers.ros.graph import Rate, Tolerance

_PRIORITY = (TRACE, ROSBAG, STATISTICS, DEADLINE)


@record
class Activation:
    """Activation of a callback: `order` counts from 0 in the order in which data spreads; `cause` is for people."""

    period: Duration
    order: int
    cause: str


@dataclass(slots=True)
class Wiring:
    """A graph with its topics indexed: publications, readers triggered by them and readers that only poll."""

    graph: RosGraph
    callbacks: dict[str, Callback] = field(default_factory=dict)
    publications: dict[str, list[Publication]] = field(default_factory=lambda: defaultdict(list))
    topics_of: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    triggered: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    polling: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))

    def __post_init__(self) -> None:
        for callback in self.graph.callbacks:
            self.callbacks[callback.name] = callback
            for topic in callback.inputs:
                self.triggered[topic].append(callback.name)
            for topic in callback.polled:
                self.polling[topic].append(callback.name)
        for publication in self.graph.publications:
            self.publications[publication.topic].append(publication)
            for name in publication.callbacks:
                self.topics_of[name].append(publication.topic)

    def readers(self, topic: str) -> list[str]:
        """Return the callbacks that read `topic`."""
        return self.triggered.get(topic, []) + self.polling.get(topic, [])

    @property
    def all_topics(self) -> list[str]:
        """Every topic read or published, in order of appearance."""
        return list(dict.fromkeys([*self.graph.topics, *self.publications, *self.triggered, *self.polling]))


@dataclass(slots=True)
class _Seeds:
    """Sources of periods: callbacks, and topics with the words that say who stated the period."""

    callbacks: dict[str, tuple[Duration, str]] = field(default_factory=dict)
    topics: dict[str, tuple[Duration, str]] = field(default_factory=dict)


@record
class Activations:
    """The result: active callbacks, topics whose period came from outside of the graph, and the rates used for it."""

    of: dict[str, Activation]
    seeded_topics: frozenset[str]
    used_rates: frozenset[Rate]


def activate(
    wiring: Wiring,
    rates: Iterable[Rate],
    overlay: OverlayUse | None,
    task_names: Mapping[str, str],
    findings: Findings,
) -> Activations:
    """Find the period of every callback that has one; report differing sources and rounded rates."""
    seeds = _Seeds()
    for callback in wiring.graph.callbacks:
        if callback.period is not None:
            seeds.callbacks[callback.name] = (callback.period, "its timer")
    if overlay is not None:
        _seed_from_overlay(wiring, overlay, task_names, seeds)
    active = _settle(wiring, seeds)
    best = _best_rates(rates, findings)
    used = set()
    for sources_only in (True, False):
        for topic, rate in best.items():
            if _lacks_period(wiring, topic, active, sources_only) and topic not in seeds.topics:
                period = snapped(
                    rate.period, _tolerance(rate), rate.at, named("topic", topic), findings, f" of the {rate.source}"
                )
                seeds.topics[topic] = (period, f'topic "{topic}", from a {rate.source}')
                used.add(rate)
        active = _settle(wiring, seeds)
    _report_several(wiring, seeds, active, findings)
    return Activations(active, frozenset(seeds.topics), frozenset(used))


def settled(wiring: Wiring, activations: Activations) -> Wiring:
    """Return the wiring in which each publication whose callback is assumed has one: the first that is active.

    That is the one whose messages trigger the readers first. Precedence and chains both take it from here.
    """
    order = {name: active.order for name, active in activations.of.items()}
    publications = tuple(
        replace(p, callbacks=(min(p.callbacks, key=lambda name: order.get(name, len(order))),))
        if p.certainty is Certainty.ASSUMED and p.callbacks
        else p
        for p in wiring.graph.publications
    )
    return Wiring(replace(wiring.graph, publications=publications))


def _seed_from_overlay(wiring: Wiring, overlay: OverlayUse, task_names: Mapping[str, str], seeds: _Seeds) -> None:
    """Take the periods that the overlay states of topics, and of callbacks without a timer."""
    for topic in wiring.all_topics:
        if (period := overlay.source_period(topic)) is not None:
            seeds.topics[topic] = (period, f'topic "{topic}", from the overlay')
    for callback in wiring.graph.callbacks:
        period = overlay.task_period(task_names[callback.name])
        if callback.name not in seeds.callbacks and period is not None:
            seeds.callbacks[callback.name] = (period, "the overlay")


def _settle(wiring: Wiring, seeds: _Seeds) -> dict[str, Activation]:
    """Spread the seeds, let the publishers of seeded topics run at their topic's period, and spread again."""
    active = _spread(wiring, seeds)
    found: dict[str, tuple[Duration, str]] = {}
    for topic, (period, cause) in seeds.topics.items():
        for publication in wiring.publications.get(topic, ()):
            name = publication.callbacks[0] if len(publication.callbacks) == 1 else None
            if name and name not in active and (name not in found or period < found[name][0]):
                found[name] = (period, f"publishing {cause}")
    if not found:
        return active
    seeds.callbacks.update(found)
    return _spread(wiring, seeds)


def _spread(wiring: Wiring, seeds: _Seeds) -> dict[str, Activation]:
    position = {name: index for index, name in enumerate(wiring.callbacks)}
    heap: list[tuple[Duration, int, int, str, str]] = []
    for name, (period, cause) in seeds.callbacks.items():
        heap.append((period, 0, position[name], name, cause))
    for topic, (period, cause) in seeds.topics.items():
        heap.extend((period, 1, position[name], name, cause) for name in wiring.triggered.get(topic, ()))
    heapq.heapify(heap)
    active: dict[str, Activation] = {}
    spread = set(seeds.topics)
    while heap:
        period, hops, _, name, cause = heapq.heappop(heap)
        if name in active:
            continue
        active[name] = Activation(period, len(active), cause)
        for topic in wiring.topics_of.get(name, ()):
            if topic not in spread:
                spread.add(topic)
                for reader in wiring.triggered.get(topic, ()):
                    heapq.heappush(heap, (period, hops + 1, position[reader], reader, f'topic "{topic}"'))
    return active


def _lacks_period(wiring: Wiring, topic: str, active: dict[str, Activation], sources_only: bool) -> bool:
    """Return whether nothing active publishes `topic`, which something reads or publishes."""
    publications = wiring.publications.get(topic, [])
    if not publications and topic not in wiring.triggered:
        return False
    publishers = [name for publication in publications for name in publication.callbacks]
    if any(name in active for name in publishers):
        return False
    return not sources_only or not any(wiring.callbacks[name].inputs for name in publishers)


# ---------------------------------------------------------------------------------------------------- rates


def _best_rates(rates: Iterable[Rate], findings: Findings) -> dict[str, Rate]:
    """Return one rate per topic: recordings before statistics before deadlines, then the shortest period."""
    ranked = sorted(rates, key=lambda rate: (_PRIORITY.index(rate.source), rate.period))
    best: dict[str, Rate] = {}
    for rate in ranked:
        first = best.setdefault(rate.topic, rate)
        here, before = (snap(one.period, _tolerance(one)) for one in (rate, first))
        if rate.source == first.source == ROSBAG and here != before:
            text, help = (
                f"period {here} here, {before} in {first.at.file}",
                "state the period under sources: in the overlay",
            )
            findings.add(codes.BAG_CONFLICT(text, at=rate.at, path=named("topic", rate.topic), help=help))
    return best


def _tolerance(rate: Rate) -> Tolerance:
    return STATED if rate.source == DEADLINE else MEASURED


def _report_several(wiring: Wiring, seeds: _Seeds, active: dict[str, Activation], findings: Findings) -> None:
    sources = {topic: _sources(wiring, topic, seeds, active) for topic in wiring.triggered}
    for callback in wiring.graph.callbacks:
        if callback.kind is Kind.TIMER or callback.name not in active:
            continue
        met: dict[Duration, str] = {}
        for topic in callback.inputs:
            for period, source in sources[topic].items():
                met.setdefault(period, source)
        if len(met) > 1:
            listed = ", ".join(f"{met[period]} ({period})" for period in sorted(met))
            message = f"is triggered by {listed}; it takes the shortest period"
            help = "drop one of the sources in the overlay if it is not a trigger"
            at, path = callback.at, named("node" if callback.kind is Kind.NODE else "callback", callback.name)
            findings.add(codes.SEVERAL_PERIODS(message, at=at, path=path, help=help))


def _sources(wiring: Wiring, topic: str, seeds: _Seeds, active: dict[str, Activation]) -> dict[Duration, str]:
    """Return the differing periods at which `topic` arrives, each with one publisher of it."""
    if topic in seeds.topics:
        return {seeds.topics[topic][0]: f'topic "{topic}"'}
    found: dict[Duration, str] = {}
    for publication in wiring.publications.get(topic, ()):
        periods = [active[name].period for name in publication.callbacks if name in active]
        if periods:
            found.setdefault(min(periods), f'topic "{topic}" from "{publication.node}"')
    return found
