"""Accounts for every element that was not dropped: what shaped the model, and why the others did not."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.importers.ros import codes
from halpipe.importers.ros.drops import is_plumbing
from halpipe.importers.ros.feedback import few
from halpipe.importers.ros.sources.graph import Kind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.core.diagnostics import Findings
    from halpipe.importers.common.base import Coverage
    from halpipe.importers.ros.activation import Activations, Wiring
    from halpipe.importers.ros.dataflow import DataFlow
    from halpipe.importers.ros.sources.graph import Callback, Publication, Rate


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
