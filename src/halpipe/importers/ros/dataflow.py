"""Precedence and chains from writers and readers of topics: loops of data are cut, the rest orders tasks.

Vertices of the flow graph are callbacks, topics and the memories of nodes whose inner data flow is not known. They
are ranked in the order in which data spreads from the sources (`activation`); a topic comes right after the first
callback that publishes it, a memory right after the first callback that publishes from it. So a second publisher of
a topic is data flow, but only the first one, which triggers the readers, becomes their predecessor.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from itertools import groupby
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from halpipe.core.diagnostics import Diagnostic, Findings, named
from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.core.suggest import few
from halpipe.importers.ros import codes
from halpipe.importers.ros.graph import Certainty, Kind, Publication, Step
from halpipe.models import Chain, Origin

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Hashable, Iterator, Mapping, Sequence

    from halpipe.importers.common.base import Coverage
    from halpipe.importers.common.names import Names
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
    of_node = grouped((callback.node, callback.name) for callback in wiring.graph.callbacks)
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
    doubtful = [each for each in wiring.graph.publications if each.certainty is Certainty.ASSUMED]
    unknown = grouped((each.node, each) for each in doubtful if wiring.readers(each.topic))
    for node, publications in unknown.items():
        topics = few([publication.topic for publication in publications])
        chosen = [wiring.callbacks[name] for name in dict.fromkeys(n for p in publications for n in p.callbacks)]
        assumed = ", ".join(f'{_KINDS.get(one.kind, "callback")} "{one.name}"' for one in chosen)
        message = f"the file does not say which callback publishes {topics}; assumed: {assumed}"
        help = "name the callback under callback_names of the publication, or import a trace, which shows it"
        findings.add(codes.UNKNOWN_PUBLISHER(message, at=publications[0].at, path=named("node", node), help=help))


V = TypeVar("V", bound="Hashable")

_MOST_LOOKS = 5_000_000
"""Edges looked at, per loop, to undo cuts and to name cycles; beyond, cuts stay and their cycles are not named."""


@record
class Loop(Generic[V]):
    """A strongly connected part: its vertices in order, and every edge cut with a shortest cycle through it.

    A cycle is written from the head of the cut edge to its tail; it is empty where the search would take too long.
    """

    vertices: tuple[V, ...]
    cuts: dict[tuple[V, V], tuple[V, ...]]


def cut_loops(
    successors: Mapping[V, Sequence[V]], rank: Callable[[V], Any], dear: Callable[[V, V], bool]
) -> list[Loop[V]]:
    """Return the loops of a graph with edges whose removal leaves no cycle.

    Every edge that does not lead upward in `rank` is cut; then cuts are undone one by one as far as no cycle
    returns, `dear` edges first. No cut that remains could be undone alone.
    """
    loops = []
    for part in components(successors):
        vertices = sorted(part, key=rank)
        members = set(part)
        inside = {vertex: [v for v in successors.get(vertex, ()) if v in members] for vertex in vertices}
        position = {vertex: index for index, vertex in enumerate(vertices)}
        backward = [(u, v) for u in vertices for v in inside[u] if position[v] <= position[u]]
        forward = {u: [v for v in inside[u] if position[v] > position[u]] for u in vertices}
        cuts = _undo(backward, forward, dear)
        named = _MOST_LOOKS // sum(map(len, inside.values()))
        cycles = {(u, v): tuple(_path(v, u, inside) or ()) for u, v in cuts[:named]}
        loops.append(Loop(tuple(vertices), {edge: cycles.get(edge, ()) for edge in cuts}))
    return sorted(loops, key=lambda loop: rank(loop.vertices[0]))


def _undo(cuts: Sequence[tuple[V, V]], kept: dict[V, list[V]], dear: Callable[[V, V], bool]) -> list[tuple[V, V]]:
    """Put edges back into `kept` while it stays acyclic; return those that must stay cut."""
    edges = sum(map(len, kept.values())) + len(cuts)
    left = _MOST_LOOKS
    remaining = []
    for u, v in sorted(cuts, key=lambda edge: not dear(*edge)):
        left -= edges
        if left < 0 or u == v or _path(v, u, kept) is not None:
            remaining.append((u, v))
        else:
            kept[u].append(v)
    return remaining


def _path(start: V, goal: V, successors: Mapping[V, Sequence[V]]) -> list[V] | None:
    """Return a shortest path, both ends included, or None."""
    before: dict[V, V] = {start: start}
    queue = deque([start])
    while queue:
        vertex = queue.popleft()
        if vertex == goal:
            path = [vertex]
            while vertex != start:
                vertex = before[vertex]
                path.append(vertex)
            return path[::-1]
        for follower in successors.get(vertex, ()):
            if follower not in before:
                before[follower] = vertex
                queue.append(follower)
    return None


def components(successors: Mapping[V, Sequence[V]]) -> list[list[V]]:
    """Return the strongly connected components that hold a cycle (Kosaraju's algorithm, without recursion)."""
    finished: list[V] = []
    seen: set[V] = set()
    for root in successors:
        _walk(root, successors, seen, finished)
    predecessors = grouped((follower, vertex) for vertex, followers in successors.items() for follower in followers)
    found = []
    seen = set()
    for root in reversed(finished):
        part: list[V] = []
        _walk(root, predecessors, seen, part)
        if len(part) > 1 or (part and root in successors.get(root, ())):
            found.append(part)
    return found


def _walk(root: V, successors: Mapping[V, Sequence[V]], seen: set[V], finished: list[V]) -> None:
    """Append what `root` reaches and was not yet seen, each vertex after its followers."""
    if root in seen:
        return
    seen.add(root)
    stack: list[tuple[V, Iterator[V]]] = [(root, iter(successors.get(root, ())))]
    while stack:
        vertex, rest = stack[-1]
        follower = next((v for v in rest if v not in seen), None)
        if follower is None:
            finished.append(vertex)
            stack.pop()
        else:
            seen.add(follower)
            stack.append((follower, iter(successors.get(follower, ()))))


_MOST_CUTS = 8
_LONGEST_RING = 50


class Vertex(NamedTuple):
    """A vertex of the flow graph; `kind` is callback, memory (named after its node) or topic."""

    kind: str
    name: str


def report_loops(
    loops: Sequence[Loop[Vertex]], wiring: Wiring, lost: Collection[tuple[str, str]], findings: Findings
) -> None:
    """Report every loop that passes through a topic; loops inside a node are the node's own affair.

    `lost` holds the (topic, reader) pairs whose precedence the cuts cost.
    """
    for loop in loops:
        if any(vertex.kind == "topic" for vertex in loop.vertices):
            findings.add(_report(loop, wiring, lost))


def _report(loop: Loop[Vertex], wiring: Wiring, lost: Collection[tuple[str, str]]) -> Diagnostic:
    nodes = list(dict.fromkeys(_nodes(loop.vertices, wiring)))
    costs = [edge for edge in loop.cuts if (edge[0].name, edge[1].name) in lost]
    rings = {edge: _ring(loop.cuts[edge], wiring) for edge in [*costs, *loop.cuts]}
    places = []
    for edge in [edge for edge in rings if len(nodes) == 1 or len(rings[edge]) != 1] or rings:
        cycle = f" ({_shortened(rings[edge] + rings[edge][:1], ' -> ')})" if rings[edge] else ""
        places.append(_place(edge, wiring) + cycle)
    if len(places) > _MOST_CUTS:
        places[_MOST_CUTS:] = [f"at {len(places) - _MOST_CUTS} more places"]
    what = f"{len(nodes)} nodes feed each other" if len(nodes) > 1 else "a node feeds itself"
    effect = f"precedence constraints lost: {len(costs)}" if costs else "no precedence constraint is lost"
    first = next(vertex for vertex in loop.vertices if vertex.kind == "callback")
    message = f"{what}: {_shortened(nodes, ', ')}; cut {'; cut '.join(places)}; {effect}"
    help = "state the precedence that you want under precedence: in an overlay if the loop is cut at the wrong place"
    return codes.FEEDBACK(message, at=wiring.callbacks[first.name].at, path=named("node", nodes[0]), help=help)


def _shortened(names: list[str], separator: str) -> str:
    """Join names, leaving out the middle of a long list."""
    if len(names) > _LONGEST_RING:
        names = [*names[: _LONGEST_RING // 2], "...", *names[-_LONGEST_RING // 2 :]]
    return separator.join(names)


def _nodes(vertices: Sequence[Vertex], wiring: Wiring) -> list[str]:
    """Return the ROS nodes that vertices belong to; topics belong to none."""
    return [_node(vertex, wiring) for vertex in vertices if vertex.kind != "topic"]


def _node(vertex: Vertex, wiring: Wiring) -> str:
    return wiring.callbacks[vertex.name].node if vertex.kind == "callback" else vertex.name


def _ring(cycle: Sequence[Vertex], wiring: Wiring) -> list[str]:
    """Return the nodes of a cycle in order, each stay in a node once."""
    ring = [node for node, _ in groupby(_nodes(cycle, wiring))]
    return ring[:-1] if len(ring) > 1 and ring[0] == ring[-1] else ring


def _place(edge: tuple[Vertex, Vertex], wiring: Wiring) -> str:
    tail, head = edge
    if tail.kind == "topic":
        return f'where "{_node(head, wiring)}" reads "{tail.name}"'
    if head.kind == "topic":
        return f'where "{_node(tail, wiring)}" publishes "{head.name}", which another publisher triggers'
    node = _node(tail, wiring)
    return f'inside "{node}", where "{tail.name.removeprefix(node + "/")}" stores what comes in for the next round'


def chains_of(
    wiring: Wiring,
    activations: Activations,
    task_names: Mapping[str, str],
    names: Names,
    findings: Findings,
    coverage: Coverage,
) -> tuple[Chain, ...]:
    """Return a chain for every path whose nodes are tasks; its ends may be sources or sinks without one."""
    chains: list[Chain] = []
    first: dict[tuple[str, ...], str] = {}
    for path in wiring.graph.paths:
        sequence = [name for step in path.steps for name in _callbacks(step, wiring, activations)]
        problem, tasks = _tasks(sequence, task_names)
        if not problem and tasks in first:
            problem = f'has the same tasks as path "{first[tasks]}"'
        elif problem:
            help = "give its callbacks periods, or write the chain in the overlay"
            where = named("path", path.name)
            findings.report(codes.PATH_IGNORED, f"is no chain: {problem}", at=path.at, path=where, help=help)
        if problem:
            coverage.ignored("path", path.name, problem, path.at)
            continue
        first[tasks] = path.name
        coverage.mapped("path")
        name = names.unique(path.name or "path", "path", path.at)
        chains.append(Chain(name=name, tasks=tasks, origin=Origin(path.at.file, path.at.line, path.name)))
    return tuple(chains)


def _callbacks(step: Step, wiring: Wiring, activations: Activations) -> list[str]:
    """Return the callbacks that a message passes in a node: the one that reads it and the one that publishes.

    A reader that is stated to publish the topic itself does so; otherwise it leaves the message for the publisher.
    """
    reading = [
        callback.name
        for callback in map(wiring.callbacks.__getitem__, wiring.readers(step.subscribed or ""))
        if callback.node == step.node
    ]
    publishing = [
        name
        for publication in wiring.publications.get(step.published or "", ())
        if publication.node == step.node
        for name in publication.callbacks
    ]
    publishing = [name for name in publishing if name in reading] or sorted(
        publishing, key=lambda name: activations.of[name].order if name in activations.of else len(wiring.callbacks)
    )
    sides = [side[0] for side in (reading, publishing) if side]
    return list(dict.fromkeys(sides)) or [step.node]


def _tasks(sequence: list[str], task_names: Mapping[str, str]) -> tuple[str, tuple[str, ...]]:
    """Return the tasks of a sequence of callbacks, or what prevents a chain."""
    tasks = [task_names.get(name, "") for name in sequence]
    while tasks and not tasks[0]:
        tasks.pop(0)
        sequence = sequence[1:]
    while tasks and not tasks[-1]:
        tasks.pop()
    if "" in tasks:
        return f'"{sequence[tasks.index("")]}" on it is not a task', ()
    repeated = next((task for task in tasks if tasks.count(task) > 1), None)
    if repeated:
        return f'it passes through "{repeated}" more than once', ()
    if len(tasks) < 2:
        return f"{len(tasks)} of its nodes are tasks, a chain needs two", ()
    return "", tuple(tasks)
