"""Precedence from writers and readers of topics: loops of data are cut, the rest orders tasks.

Vertices of the flow graph are callbacks, topics and the memories of nodes whose inner data flow is not known. They
are ranked in the order in which data spreads from the sources (`activation`); a topic comes right after the first
callback that publishes it, a memory right after the first callback that publishes from it. So a second publisher of
a topic is data flow, but only the first one, which triggers the readers, becomes their predecessor.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import named
from halpipe.core.records import record
from halpipe.importers.ros import codes
from halpipe.importers.ros.feedback import Vertex, few, report_loops
from halpipe.importers.ros.loops import cut_loops
from halpipe.importers.ros.sources.graph import Certainty, Kind, Publication

if TYPE_CHECKING:
    from halpipe.core.diagnostics import Findings
    from halpipe.importers.ros.activation import Activations, Wiring


_KINDS = {Kind.TIMER: "timer", Kind.SUBSCRIPTION: "subscription callback"}


@record
class Edge:
    """`reader` runs after `publisher`, whose `topic` it reads."""

    publisher: str
    reader: str
    topic: str


@dataclass(slots=True)
class DataFlow:
    """Precedence between active callbacks, free of cycles; `lost` are the ones that loops cost."""

    edges: list[Edge] = field(default_factory=list)
    lost: list[Edge] = field(default_factory=list)


def order_by_data(wiring: Wiring, activations: Activations, findings: Findings) -> DataFlow:
    """Derive the precedence between active callbacks and report every loop of data."""
    ranks = _ranks(wiring, activations)
    successors = _flow_graph(wiring)
    wanted = _wanted(wiring, activations, ranks)

    def is_precedence(tail: Vertex, head: Vertex) -> bool:
        return tail.kind == "topic" and (tail.name, head.name) in wanted

    loops = cut_loops(successors, lambda vertex: ranks[vertex], is_precedence)
    cut = {edge for loop in loops for edge in loop.cuts}
    flow = DataFlow()
    for (topic, reader), publisher in wanted.items():
        edge = Edge(publisher, reader, topic)
        is_cut = (Vertex("topic", topic), Vertex("callback", reader)) in cut
        (flow.lost if is_cut else flow.edges).append(edge)
    lost = {(edge.topic, edge.reader) for edge in flow.lost}
    report_loops(loops, wiring, lost, findings)
    return flow


def uses_memory(publication: Publication) -> bool:
    """Return whether it is open which callback's data a publication carries."""
    return publication.certainty is Certainty.ASSUMED or len(publication.callbacks) > 1


def _wanted(
    wiring: Wiring, activations: Activations, ranks: dict[Vertex, tuple[int, int]]
) -> dict[tuple[str, str], str]:
    """Return for every (topic, reader) the publisher that comes first, where both are active and differ."""
    wanted: dict[tuple[str, str], str] = {}
    for topic in wiring.all_topics:
        publishers = [
            name for p in wiring.publications.get(topic, ()) for name in p.callbacks if name in activations.of
        ]
        if not publishers:
            continue
        first = min(publishers, key=lambda name: ranks[Vertex("callback", name)])
        for reader in wiring.readers(topic):
            if reader in activations.of and reader != first:
                wanted[topic, reader] = first
    return wanted


def _ranks(wiring: Wiring, activations: Activations) -> dict[Vertex, tuple[int, int]]:
    """Rank callbacks by activation, inactive ones last; memories and topics right after their first writer."""
    ranks: dict[Vertex, tuple[int, int]] = {}
    last = len(activations.of)
    for index, name in enumerate(wiring.callbacks):
        active = activations.of.get(name)
        ranks[Vertex("callback", name)] = (active.order if active else last + index, 0)
    end = (last + len(wiring.callbacks), 0)
    for publication in wiring.graph.publications:
        order = min((ranks[Vertex("callback", name)] for name in publication.callbacks), default=end)[0]
        places = [(Vertex("topic", publication.topic), 2)]
        if uses_memory(publication):
            places.append((Vertex("memory", publication.node), 1))
        for vertex, level in places:
            ranks[vertex] = min(ranks.get(vertex, end), (order, level))
    for topic in wiring.all_topics:
        ranks.setdefault(Vertex("topic", topic), end)
    return ranks


def _flow_graph(wiring: Wiring) -> dict[Vertex, list[Vertex]]:
    arcs: dict[Vertex, dict[Vertex, None]] = {Vertex("callback", name): {} for name in wiring.callbacks}
    of_node: dict[str, list[str]] = {}
    for callback in wiring.graph.callbacks:
        of_node.setdefault(callback.node, []).append(callback.name)
    for publication in wiring.graph.publications:
        writers = [Vertex("callback", name) for name in publication.callbacks]
        if uses_memory(publication):
            memory = Vertex("memory", publication.node)
            assumed = publication.certainty is Certainty.ASSUMED
            storing = of_node.get(publication.node, []) if assumed else publication.callbacks
            for name in storing:
                arcs[Vertex("callback", name)][memory] = None
            arcs.setdefault(memory, {})
            writers = [memory]
        for writer in writers:
            arcs[writer][Vertex("topic", publication.topic)] = None
    for topic in wiring.all_topics:
        arcs[Vertex("topic", topic)] = {Vertex("callback", reader): None for reader in wiring.readers(topic)}
    for flow in wiring.graph.flows:
        arcs[Vertex("callback", flow.writer)][Vertex("callback", flow.reader)] = None
    return {vertex: list(followers) for vertex, followers in arcs.items()}


def report_unknown_publishers(wiring: Wiring, findings: Findings) -> None:
    """Warn, once per node, of topics that are read and whose publishing callback had to be assumed."""
    unknown: dict[str, list[Publication]] = {}
    for publication in wiring.graph.publications:
        if publication.certainty is Certainty.ASSUMED and wiring.readers(publication.topic):
            unknown.setdefault(publication.node, []).append(publication)
    for node, publications in unknown.items():
        topics = few([publication.topic for publication in publications])
        chosen = [wiring.callbacks[name] for name in dict.fromkeys(n for p in publications for n in p.callbacks)]
        assumed = ", ".join(f'{_KINDS.get(one.kind, "callback")} "{one.name}"' for one in chosen)
        findings.add(
            codes.UNKNOWN_PUBLISHER(
                f"the file does not say which callback publishes {topics}; assumed: {assumed}",
                at=publications[0].at,
                path=named("node", node),
                help="name the callback under callback_names of the publication, or import a trace, which shows it",
            )
        )
