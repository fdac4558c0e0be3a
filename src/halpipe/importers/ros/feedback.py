"""The report of loops of data: which nodes feed each other, and where the model cuts the loop."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from halpipe.core.diagnostics import named
from halpipe.importers.ros import codes

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from halpipe.core.diagnostics import Diagnostic, Findings
    from halpipe.importers.ros.activation import Wiring
    from halpipe.importers.ros.loops import Loop

_MOST_NAMES = 5
_MOST_CUTS = 8
_LONGEST_RING = 50


class Vertex(NamedTuple):
    """A vertex of the flow graph; `kind` is callback, memory (named after its node) or topic."""

    kind: str
    name: str


def few(names: Sequence[str]) -> str:
    """List names in quotes, the first five of them."""
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return ", ".join(f'"{name}"' for name in names[:_MOST_NAMES]) + more


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
    places = []
    for edge in costs + [edge for edge in loop.cuts if edge not in costs]:
        ring = _ring(loop.cuts[edge], wiring)
        if len(nodes) == 1 or len(ring) != 1:
            cycle = f" ({_shortened(ring + ring[:1], ' -> ')})" if ring else ""
            places.append(_place(edge, wiring) + cycle)
    if len(places) > _MOST_CUTS:
        places[_MOST_CUTS:] = [f"at {len(places) - _MOST_CUTS} more places"]
    what = f"{len(nodes)} nodes feed each other" if len(nodes) > 1 else "a node feeds itself"
    effect = f"precedence constraints lost: {len(costs)}" if costs else "no precedence constraint is lost"
    first = next(vertex for vertex in loop.vertices if vertex.kind == "callback")
    return codes.FEEDBACK(
        f"{what}: {_shortened(nodes, ', ')}; cut {'; cut '.join(places)}; {effect}",
        at=wiring.callbacks[first.name].at,
        path=named("node", nodes[0]),
        help="state the precedence that you want under precedence: in an overlay if the loop is cut at the wrong place",
    )


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
    ring: list[str] = []
    for node in _nodes(cycle, wiring):
        if not ring or ring[-1] != node:
            ring.append(node)
    return ring[:-1] if len(ring) > 1 and ring[0] == ring[-1] else ring


def _place(edge: tuple[Vertex, Vertex], wiring: Wiring) -> str:
    tail, head = edge
    if tail.kind == "topic":
        return f'where "{_node(head, wiring)}" reads "{tail.name}"'
    if head.kind == "topic":
        return f'where "{_node(tail, wiring)}" publishes "{head.name}", which another publisher triggers'
    node = _node(tail, wiring)
    return f'inside "{node}", where "{tail.name.removeprefix(node + "/")}" stores what comes in for the next round'
