"""Cuts cycles out of a directed graph along an order of its vertices. Pure graph theory."""

from __future__ import annotations

from collections import defaultdict, deque
from typing import TYPE_CHECKING, Generic, TypeVar

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
    from typing import Any

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
    predecessors: dict[V, list[V]] = defaultdict(list)
    for vertex, followers in successors.items():
        for follower in followers:
            predecessors[follower].append(vertex)
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
