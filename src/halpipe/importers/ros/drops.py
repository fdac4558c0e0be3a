"""Leaves out what belongs to the infrastructure or to the user's `drop` list, accounting for each element."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from halpipe.importers.ros.sources.graph import Callback, Kind, RosGraph

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from halpipe.importers.common.base import Coverage, Supplement

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
