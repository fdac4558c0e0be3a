"""Account of every element of a graph: what is dropped, what shaped the model, and why the others did not."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.importers.ros import codes
from halpipe.importers.ros.graph import Callback, Kind, RosGraph, few

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from halpipe.core.diagnostics import Findings
    from halpipe.importers.common.base import Coverage, Supplement
    from halpipe.importers.ros.activation import Activations, Wiring
    from halpipe.importers.ros.dataflow import DataFlow
    from halpipe.importers.ros.graph import Callback, Publication, Rate


_TOOLS = re.compile(
    r"/(rqt|rviz|_ros2cli|rosbag2_recorder)[^/]*(/.*)?|(.*/)?(launch_ros_[0-9]+|transform_listener_impl_\w+)|/rosout"
)
_PLUMBING = re.compile(r"/(rosout(_agg)?|parameter_events|tf(_static)?|clock|bond|statistics)|/(.*/)?_action(/.*)?")


def is_plumbing(topic: str) -> bool:
    """Return whether a topic is plumbing of ROS."""
    return _PLUMBING.fullmatch(topic) is not None


@dataclass(slots=True)
class _Rules:
    """Decides by name; every name is asked once, so that the overlay knows which of its entries matched."""

    overlay: Supplement | None
    task_names: Mapping[str, str]
    _reasons: dict[tuple[str, str], str] = field(default_factory=dict)

    def reason(self, kind: str, name: str) -> str:
        """Return why the node, topic or callback goes, or nothing if it stays."""
        key = (kind, name)
        if key not in self._reasons:
            self._reasons[key] = self._decide(kind, name)
        return self._reasons[key]

    def _decide(self, kind: str, name: str) -> str:
        asked = {name, self.task_names.get(name, name)} if kind == "callback" else {name}
        if self.overlay is not None and True in {self.overlay.drops(alias) for alias in asked}:
            return "dropped by the overlay"
        if kind == "node" and _TOOLS.fullmatch(name):
            return "is a tool, not part of the application"
        if kind == "topic" and is_plumbing(name):
            return "is plumbing of ROS, not application data"
        return ""


def prune(graph: RosGraph, overlay: Supplement | None, task_names: Mapping[str, str], coverage: Coverage) -> RosGraph:
    """Return `graph` without the nodes, callbacks and topics that are dropped."""
    rules = _Rules(overlay, task_names)
    kept_nodes = []
    for node in graph.nodes:
        if reason := rules.reason("node", node.name):
            coverage.ignored("node", node.name, reason, node.at)
        else:
            kept_nodes.append(node)
    callbacks = list(_kept_callbacks(graph.callbacks, rules, coverage))
    names = {callback.name for callback in callbacks}
    publications = []
    for publication in graph.publications:
        reason = rules.reason("topic", publication.topic) or rules.reason("node", publication.node)
        if reason:
            coverage.ignored("publisher", f"{publication.node} {publication.topic}", reason, publication.at)
        else:
            able = tuple(name for name in publication.callbacks if name in names)
            publications.append(replace(publication, callbacks=able))
    subscriptions = []
    for subscription in graph.subscriptions:
        reason = rules.reason("topic", subscription.topic) or rules.reason("node", subscription.node)
        if reason:
            coverage.ignored("subscription", f"{subscription.node} {subscription.topic}", reason, subscription.at)
        else:
            subscriptions.append(subscription)
    return replace(
        graph,
        nodes=tuple(kept_nodes),
        callbacks=tuple(callbacks),
        publications=tuple(publications),
        subscriptions=tuple(subscriptions),
        flows=tuple(flow for flow in graph.flows if flow.writer in names and flow.reader in names),
        topics=tuple(_kept_topics(graph.topics, rules, coverage)),
    )


def _kept_callbacks(callbacks: Iterable[Callback], rules: _Rules, coverage: Coverage) -> Iterable[Callback]:
    for callback in callbacks:
        of_node, own = rules.reason("node", callback.node), rules.reason("callback", callback.name)
        reason = of_node or own
        if reason:
            if callback.kind is not Kind.NODE:
                coverage.ignored(
                    callback.kind.value, callback.name, f"node {of_node}" if of_node else reason, callback.at
                )
            continue
        yield replace(
            callback,
            inputs=tuple(topic for topic in callback.inputs if not rules.reason("topic", topic)),
            polled=tuple(topic for topic in callback.polled if not rules.reason("topic", topic)),
        )


def _kept_topics(topics: Iterable[str], rules: _Rules, coverage: Coverage) -> Iterable[str]:
    for topic in topics:
        if reason := rules.reason("topic", topic):
            coverage.ignored("topic", topic, reason)
        else:
            yield topic


@record
class Result:
    """Findings of an import, for its coverage report; `triggers` are the topics of each callback before any drop."""

    triggers: Mapping[str, tuple[str, ...]]
    wiring: Wiring
    activations: Activations
    flow: DataFlow


def account(result: Result, rates: list[Rate], findings: Findings, coverage: Coverage) -> None:
    """Account for nodes, callbacks, publications, subscriptions, topics and recorded topics."""
    _nodes(result, coverage)
    _callbacks(result, findings, coverage)
    _publications(result, coverage)
    _subscriptions(result, coverage)
    _topics(result, coverage)
    for rate in rates:
        if rate in result.activations.used_rates:
            coverage.mapped("bag_topic")
        else:
            known = rate.topic in result.wiring.publications or rate.topic in result.wiring.triggered
            reason = "its period is known without it" if known else "no node of the graph uses it"
            coverage.ignored("bag_topic", rate.topic, reason, rate.at)


def _nodes(result: Result, coverage: Coverage) -> None:
    wiring, active = result.wiring, result.activations
    with_tasks = {callback.node for callback in wiring.graph.callbacks if callback.name in active.of}
    with_callbacks = {callback.node for callback in wiring.graph.callbacks}
    sources = {p.node for p in wiring.graph.publications if not p.callbacks and p.topic in active.seeded_topics}
    for node in wiring.graph.nodes:
        if node.name in with_tasks or node.name in sources:
            coverage.mapped("node")
        else:
            reason = "nothing in it has a period" if node.name in with_callbacks else "has no callback"
            coverage.ignored("node", node.name, reason, node.at)


def _callbacks(result: Result, findings: Findings, coverage: Coverage) -> None:
    without = []
    for callback in result.wiring.graph.callbacks:
        if callback.name in result.activations.of:
            if callback.kind is not Kind.NODE:
                coverage.mapped(callback.kind.value)
            continue
        without.append(callback)
        if callback.kind is not Kind.NODE:
            coverage.ignored(callback.kind.value, callback.name, _why_no_period(callback, result), callback.at)
    if without:
        _report_without_period(without, result, findings)


def _report_without_period(without: list[Callback], result: Result, findings: Findings) -> None:
    dropped = _dropped_data(result, without)
    topics = few([*_roots(result, without), *dropped]) or "the topics that trigger them"
    more = "; it then stays where only a glob drops it" if dropped else ", or add a rosbag2 metadata.yaml"
    findings.add(
        codes.NO_PERIOD(
            f"{len(without)} without a period are not tasks: {few([callback.name for callback in without])}; "
            f"for the first, {_why_no_period(without[0], result)}",
            at=without[0].at,
            help=f"state the period of {topics} under sources: in an overlay{more}",
        )
    )


def _roots(result: Result, without: list[Callback]) -> list[str]:
    """Return topics with no publisher that anything triggers, so that their period has to come from outside."""
    wiring = result.wiring
    topics = dict.fromkeys(topic for callback in without for topic in callback.inputs)
    publishers = {topic: [n for p in wiring.publications.get(topic, ()) for n in p.callbacks] for topic in topics}
    return [topic for topic in topics if not any(wiring.callbacks[name].inputs for name in publishers[topic])]


def _dropped_data(result: Result, without: list[Callback]) -> list[str]:
    """Return the topics that would trigger the callbacks, had they not been dropped."""
    topics = dict.fromkeys(topic for callback in without for topic in _dropped_inputs(callback, result))
    return [topic for topic in topics if not is_plumbing(topic)]


def _dropped_inputs(callback: Callback, result: Result) -> list[str]:
    return [topic for topic in result.triggers[callback.name] if topic not in callback.inputs]


def _why_no_period(callback: Callback, result: Result) -> str:
    if callback.kind is Kind.SERVICE:
        return "a service is called on demand"
    if not callback.inputs:
        dropped = _dropped_inputs(callback, result)
        return f'the topic that triggers it is left out, "{dropped[0]}"' if dropped else "nothing triggers it"
    return f'no publisher of topic "{callback.inputs[0]}" has a period'


def _publications(result: Result, coverage: Coverage) -> None:
    used = {(edge.publisher, edge.topic) for edge in result.flow.edges}
    for publication in result.wiring.graph.publications:
        seeded = not publication.callbacks and publication.topic in result.activations.seeded_topics
        if seeded or any((name, publication.topic) in used for name in publication.callbacks):
            coverage.mapped("publisher")
        else:
            name = f"{publication.node} {publication.topic}"
            coverage.ignored("publisher", name, _why_unused(publication, result), publication.at)


def _why_unused(publication: Publication, result: Result) -> str:
    readers = result.wiring.readers(publication.topic)
    if not readers:
        return "the topic has no reader"
    if not any(reader in result.activations.of for reader in readers):
        return "no task reads the topic"
    if not any(name in result.activations.of for name in publication.callbacks):
        return "no task publishes it"
    if any(edge.topic == publication.topic for edge in result.flow.lost):
        return "cut, since data flows in a loop"
    return "another publisher triggers the readers, or only the publisher itself reads it"


def _subscriptions(result: Result, coverage: Coverage) -> None:
    for subscription in result.wiring.graph.subscriptions:
        if subscription.callback in result.activations.of:
            coverage.mapped("subscription")
        else:
            reason = "its callback is not a task" if subscription.callback else "no callback is known to read it"
            name = f"{subscription.node} {subscription.topic}"
            coverage.ignored("subscription", name, reason, subscription.at)


def _topics(result: Result, coverage: Coverage) -> None:
    used = {edge.topic for edge in result.flow.edges} | set(result.activations.seeded_topics)
    for topic in result.wiring.graph.topics:
        if topic in used:
            coverage.mapped("topic")
        else:
            coverage.ignored("topic", topic, "orders no two tasks")
