"""Meaning of a DOT graph: rqt_graph's views, told by shape and label (never by id), or a hand-written task graph.

rqt_graph draws nodes as ellipses and topics as boxes (box3d for groups), or in its "nodes only" view puts the topic
on the edge. Edges carry the QoS settings as tooltip, and with ROS 1 statistics the rate. Any other DOT graph is a
task graph: each vertex a node, which publishes one topic of its own name (or the label of the edge).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, Location, named
from halpipe.core.durations import Duration, seconds
from halpipe.importers.ros import codes
from halpipe.importers.ros.names import printable
from halpipe.importers.ros.sources.dot import Digraph, Edge, Vertex, parse, unescape
from halpipe.importers.ros.sources.graph import Callback, Kind, Node, Publication, Rate, RosGraph, Subscription

if TYPE_CHECKING:
    from collections.abc import Iterable

_BOXES = ("box", "box3d", "rect", "rectangle")
_RATE = re.compile(r"(?<![\w.])([0-9]{1,9}(?:\.[0-9]{1,9})?) ?Hz\b")
_FRAMES = re.compile(r"\s*Broadcaster: .*Average rate: ", re.DOTALL)
_DEADLINE = re.compile(r"deadline: ?([0-9]{1,19}) ?ns")
NO_DEADLINE = seconds(365 * 24 * 3600)
"""Middlewares state an infinite deadline as one of several values of centuries."""

STATISTICS = "topic statistics"
DEADLINE = "QoS deadline"


@dataclass(slots=True)
class _Links:
    """Who publishes and reads what, gathered from the edges; keys are (node, topic), values the first line."""

    publishes: dict[tuple[str, str], int] = field(default_factory=dict)
    subscribes: dict[tuple[str, str], int] = field(default_factory=dict)
    rates: dict[Rate, None] = field(default_factory=dict)


def read_dot(text: str, file: str, findings: Findings) -> RosGraph:
    """Read a DOT file into a graph; findings name duplicate nodes, `HalpipeError` is raised for broken syntax."""
    digraph = parse(text, file)
    _refuse_frames(digraph, file)
    labels = {id: _label(vertex) for id, vertex in digraph.vertices.items()}
    topics = _topics(digraph, labels)
    _check_unique(digraph.vertices, labels, topics, file, findings)
    links = _Links()
    for edge in digraph.edges:
        _link(edge, labels, topics, file, links)
    nodes = [v for v in digraph.vertices.values() if v.id not in topics]
    return RosGraph(
        file=file,
        nodes=tuple(Node(name=labels[v.id], at=Location(file, v.line)) for v in nodes),
        callbacks=tuple(_callbacks(((labels[v.id], v.line) for v in nodes), links, file)),
        publications=tuple(
            Publication(node=node, topic=topic, callbacks=(node,), at=Location(file, line))
            for (node, topic), line in links.publishes.items()
        ),
        subscriptions=tuple(
            Subscription(node=node, topic=topic, callback=node, at=Location(file, line))
            for (node, topic), line in links.subscribes.items()
        ),
        rates=tuple(links.rates),
        topics=tuple(dict.fromkeys(labels[id] for id in topics)),
    )


def _refuse_frames(digraph: Digraph, file: str) -> None:
    """Raise `HalpipeError` for a tree of coordinate frames, by the labels of edges that view_frames of tf2 writes."""
    for edge in digraph.edges:
        if _FRAMES.match(edge.attributes.get("label", "")):
            text = f'edge "{edge.tail}" -> "{edge.head}" joins coordinate frames: view_frames of tf2 draws no nodes'
            help = "save the graph of nodes and topics in rqt_graph instead"
            raise HalpipeError(codes.UNRECOGNISED(text, at=Location(file, edge.line), help=help))


def _label(vertex: Vertex) -> str:
    shown = unescape(vertex.attributes.get("label", r"\N"), vertex.id)
    return printable(shown) or printable(vertex.id) or "_"


def _topics(digraph: Digraph, labels: dict[str, str]) -> dict[str, None]:
    """Return the ids of vertices that are topics: boxes with ROS names, if every edge joins a node and a topic."""
    boxes = {
        id: None
        for id, vertex in digraph.vertices.items()
        if vertex.attributes.get("shape") in _BOXES and labels[id].startswith("/")
    }
    bipartite = all((edge.tail in boxes) != (edge.head in boxes) for edge in digraph.edges)
    return boxes if bipartite else {}


def _check_unique(
    vertices: dict[str, Vertex], labels: dict[str, str], topics: dict[str, None], file: str, findings: Findings
) -> None:
    first: dict[str, int] = {}
    for id, vertex in vertices.items():
        name = labels[id]
        if id in topics:
            continue
        if name in first:
            findings.add(
                codes.DUPLICATE(
                    f"is drawn twice, first on line {first[name]}",
                    at=Location(file, vertex.line),
                    path=named("node", name),
                    help="give the nodes different names",
                )
            )
        first.setdefault(name, vertex.line)


def _link(edge: Edge, labels: dict[str, str], topics: dict[str, None], file: str, links: _Links) -> None:
    tail, head = labels[edge.tail], labels[edge.head]
    if edge.head in topics:
        topic = head
        links.publishes.setdefault((tail, topic), edge.line)
    elif edge.tail in topics:
        topic = tail
        links.subscribes.setdefault((head, topic), edge.line)
    else:
        label = printable(unescape(edge.attributes.get("label", "")).strip().split("\n")[0])
        topic = label if label and not _RATE.search(label) else tail
        links.publishes.setdefault((tail, topic), edge.line)
        links.subscribes.setdefault((head, topic), edge.line)
    at = Location(file, edge.line)
    rate = _RATE.search(unescape(edge.attributes.get("label", "")))
    if rate and Fraction(rate[1]) > 0:
        links.rates[Rate(topic=topic, period=seconds(1 / Fraction(rate[1])), source=STATISTICS, at=at)] = None
    for found in _DEADLINE.finditer(edge.attributes.get("edgetooltip", "")):
        deadline = Duration(int(found[1]))
        if deadline and deadline < NO_DEADLINE:
            links.rates[Rate(topic=topic, period=deadline, source=DEADLINE, at=at)] = None


def _callbacks(nodes: Iterable[tuple[str, int]], links: _Links, file: str) -> list[Callback]:
    inputs: dict[str, list[str]] = {}
    for node, topic in links.subscribes:
        inputs.setdefault(node, []).append(topic)
    return [
        Callback(name=name, node=name, kind=Kind.NODE, inputs=tuple(inputs.get(name, ())), at=Location(file, line))
        for name, line in nodes
    ]
