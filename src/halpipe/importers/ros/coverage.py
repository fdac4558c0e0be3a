"""Account of every element of a graph: what is dropped, what shaped the model, and why the others did not."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import NOWHERE, Diagnostic, Findings, Location
from halpipe.core.suggest import few
from halpipe.importers.ros import codes
from halpipe.importers.ros.graph import Callback, Kind, Publication, Rate, RosGraph, Subscription

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from halpipe.importers.common.base import Coverage
    from halpipe.importers.overlay import OverlayUse
    from halpipe.importers.ros.activation import Activations, Wiring
    from halpipe.importers.ros.dataflow import DataFlow

_TOOLS = re.compile(
    r"/(.*/)?((rqt|rviz|_ros2cli|rosbag2_recorder|caret_trace_)[^/]*(/.*)?|launch_ros_[0-9]+"
    r"|transform_listener_impl_\w+)|/rosout"
)
_PLUMBING = re.compile(r"/(rosout(_agg)?|parameter_events|clock|statistics)|/(.*/)?(tf(_static)?|bond|_action(/.*)?)")


def is_plumbing(topic: str) -> bool:
    """Return whether a topic is plumbing of ROS."""
    return _PLUMBING.fullmatch(topic) is not None


def prune(graph: RosGraph, overlay: OverlayUse | None, task_names: Mapping[str, str], coverage: Coverage) -> RosGraph:
    """Return `graph` without the nodes, callbacks and topics that the infrastructure or the overlay drops."""

    @cache  # each name once, so that the overlay knows which of its entries matched
    def reason(kind: str, name: str) -> str:
        """Return why the node, topic or callback goes, or nothing if it stays."""
        names = {name, task_names.get(name, name)} if kind == "callback" else {name}
        if overlay is not None and True in {overlay.drops(alias) for alias in names}:
            return "dropped by the overlay"
        if kind == "node" and _TOOLS.fullmatch(name):
            return "is a tool, not part of the application"
        return "is plumbing of ROS, not application data" if kind == "topic" and is_plumbing(name) else ""

    def stays(kind: str, name: str, why: str, at: Location = NOWHERE) -> bool:
        if why:
            coverage.ignored(kind, name, why, at)
        return not why

    def of_topic(entry: Publication | Subscription) -> str:
        return reason("topic", entry.topic) or reason("node", entry.node)

    def of_callback(callback: Callback) -> str:
        of_node, own = reason("node", callback.node), reason("callback", callback.name)
        return f"node {of_node}" if of_node else own

    def read(topics: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(topic for topic in topics if not reason("topic", topic))

    nodes = tuple(node for node in graph.nodes if stays("node", node.name, reason("node", node.name), node.at))
    kept = (  # a callback that stands for its node was accounted for with it
        one
        for one in graph.callbacks
        if (not of_callback(one) if one.kind is Kind.NODE else stays(one.kind, one.name, of_callback(one), one.at))
    )
    callbacks = tuple(replace(one, inputs=read(one.inputs), polled=read(one.polled)) for one in kept)
    names = {callback.name for callback in callbacks}
    publications = tuple(
        replace(one, callbacks=tuple(name for name in one.callbacks if name in names))
        for one in graph.publications
        if stays("publisher", f"{one.node} {one.topic}", of_topic(one), one.at)
    )
    subscriptions = tuple(
        one for one in graph.subscriptions if stays("subscription", f"{one.node} {one.topic}", of_topic(one), one.at)
    )
    return replace(
        graph,
        nodes=nodes,
        callbacks=callbacks,
        publications=publications,
        subscriptions=subscriptions,
        flows=tuple(flow for flow in graph.flows if flow.writer in names and flow.reader in names),
        topics=tuple(topic for topic in graph.topics if stays("topic", topic, reason("topic", topic))),
    )


class Account:
    """Account for every element that was not dropped; `triggers` are the topics of each callback before any drop."""

    def __init__(
        self, triggers: Mapping[str, tuple[str, ...]], wiring: Wiring, activations: Activations, flow: DataFlow
    ) -> None:
        self.triggers, self.wiring, self.activations, self.flow = triggers, wiring, activations, flow
        self.graph, self.active = wiring.graph, activations.of

    def write(self, rates: list[Rate], findings: Findings, coverage: Coverage) -> None:
        """Account for nodes, callbacks, publications, subscriptions, topics and recorded topics."""
        for kind, name, reason, at in self._entries(rates):
            if reason:
                coverage.ignored(kind, name, reason, at)
            else:
                coverage.mapped(kind)
        if without := [callback for callback in self.graph.callbacks if callback.name not in self.active]:
            findings.add(self._without_period(without))

    def _entries(self, rates: list[Rate]) -> Iterator[tuple[str, str, str, Location]]:
        """Yield kind, name and place of each element, and why it did not shape the model: empty if it did."""
        wiring, active = self.wiring, self.active
        with_tasks = {callback.node for callback in self.graph.callbacks if callback.name in active}
        with_callbacks = {callback.node for callback in self.graph.callbacks}
        seeded = self.activations.seeded_topics
        sources = {p.node for p in self.graph.publications if not p.callbacks and p.topic in seeded}
        for node in self.graph.nodes:
            reason = "nothing in it has a period" if node.name in with_callbacks else "has no callback"
            yield "node", node.name, "" if node.name in with_tasks | sources else reason, node.at
        for callback in self.graph.callbacks:
            if callback.kind is not Kind.NODE:
                reason = "" if callback.name in active else self._why_no_period(callback)
                yield callback.kind.value, callback.name, reason, callback.at
        used = {(edge.publisher, edge.topic) for edge in self.flow.edges}
        for one in self.graph.publications:
            is_source = not one.callbacks and one.topic in seeded
            is_used = is_source or any((name, one.topic) in used for name in one.callbacks)
            yield "publisher", f"{one.node} {one.topic}", "" if is_used else self._why_unused(one), one.at
        for read in self.graph.subscriptions:
            reason = "its callback is not a task" if read.callback else "no callback is known to read it"
            yield "subscription", f"{read.node} {read.topic}", "" if read.callback in active else reason, read.at
        ordered = {edge.topic for edge in self.flow.edges} | set(seeded)
        for topic in self.graph.topics:
            yield "topic", topic, "" if topic in ordered else "orders no two tasks", NOWHERE
        for rate in rates:
            is_known = rate.topic in wiring.publications or rate.topic in wiring.triggered
            reason = "its period is known without it" if is_known else "no node of the graph uses it"
            yield "bag_topic", rate.topic, "" if rate in self.activations.used_rates else reason, rate.at

    def _without_period(self, without: list[Callback]) -> Diagnostic:
        dropped = dict.fromkeys(topic for callback in without for topic in self._dropped_inputs(callback))
        data = [topic for topic in dropped if not is_plumbing(topic)]
        topics = few([*self._roots(without), *data]) or "the topics that trigger them"
        more = "; it then stays where only a glob drops it" if data else ", or add a rosbag2 metadata.yaml"
        text = f"{len(without)} without a period are not tasks: {few([callback.name for callback in without])}; "
        text += f"for the first, {self._why_no_period(without[0])}"
        help = f"state the period of {topics} under sources: in an overlay{more}"
        return codes.NO_PERIOD(text, at=without[0].at, help=help)

    def _roots(self, without: list[Callback]) -> list[str]:
        """Return topics with no publisher that anything triggers, so that their period has to come from outside."""
        wiring = self.wiring
        topics = dict.fromkeys(topic for callback in without for topic in callback.inputs)
        publishers = {topic: [n for p in wiring.publications.get(topic, ()) for n in p.callbacks] for topic in topics}
        return [topic for topic in topics if not any(wiring.callbacks[name].inputs for name in publishers[topic])]

    def _dropped_inputs(self, callback: Callback) -> list[str]:
        return [topic for topic in self.triggers[callback.name] if topic not in callback.inputs]

    def _why_no_period(self, callback: Callback) -> str:
        if callback.kind is Kind.SERVICE:
            return "a service is called on demand"
        if not callback.inputs:
            dropped = self._dropped_inputs(callback)
            return f'the topic that triggers it is left out, "{dropped[0]}"' if dropped else "nothing triggers it"
        return f'no publisher of topic "{callback.inputs[0]}" has a period'

    def _why_unused(self, publication: Publication) -> str:
        readers = self.wiring.readers(publication.topic)
        if not readers:
            return "the topic has no reader"
        if not any(reader in self.active for reader in readers):
            return "no task reads the topic"
        if not any(name in self.active for name in publication.callbacks):
            return "no task publishes it"
        if any(edge.topic == publication.topic for edge in self.flow.lost):
            return "cut, since data flows in a loop"
        return "another publisher triggers the readers, or only the publisher itself reads it"
