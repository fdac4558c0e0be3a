"""Cutting loops: what remains is acyclic, and no cut was needless."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from halpipe.importers.ros.dataflow import components, cut_loops


@st.composite
def digraphs(draw):
    size = draw(st.integers(1, 9))
    vertex = st.integers(0, size - 1)
    arcs = draw(st.lists(st.tuples(vertex, vertex), max_size=30, unique=True))
    return {v: [head for tail, head in arcs if tail == v] for v in range(size)}


def reaches(successors, start, goal):
    seen, todo = set(), [start]
    while todo:
        vertex = todo.pop()
        if vertex == goal:
            return True
        if vertex not in seen:
            seen.add(vertex)
            todo.extend(successors[vertex])
    return False


def without(successors, cuts):
    return {v: [w for w in followers if (v, w) not in cuts] for v, followers in successors.items()}


@given(digraphs())
def test_components_are_the_mutually_reachable_vertices(successors):
    parts = {frozenset(part) for part in components(successors)}
    for vertex in successors:
        peers = {w for w in successors if reaches(successors, vertex, w) and reaches(successors, w, vertex)}
        is_on_cycle = any(reaches(successors, w, vertex) for w in successors[vertex])
        assert (frozenset(peers) in parts) == is_on_cycle


@given(digraphs(), st.sets(st.tuples(st.integers(0, 8), st.integers(0, 8))))
def test_cuts_break_every_cycle_and_each_is_needed(successors, dear):
    loops = cut_loops(successors, lambda vertex: vertex, lambda u, v: (u, v) in dear)
    cuts = {edge for loop in loops for edge in loop.cuts}
    rest = without(successors, cuts)
    assert components(rest) == []
    for u, v in cuts:
        assert u == v or reaches(rest, v, u)


@given(digraphs())
def test_every_cut_names_a_cycle_of_the_graph(successors):
    for loop in cut_loops(successors, lambda vertex: vertex, lambda *_: False):
        for (u, v), cycle in loop.cuts.items():
            assert (cycle[0], cycle[-1]) == (v, u)
            assert all(head in successors[tail] for tail, head in pairwise(cycle))
            assert v in successors[u]


def test_the_edge_against_the_order_is_cut():
    (loop,) = cut_loops({"c": ["a"], "a": ["b"], "b": ["c"]}, lambda vertex: vertex, lambda *_: False)
    assert loop.cuts == {("c", "a"): ("a", "b", "c")}


def test_dear_edges_are_kept_where_another_cut_does():
    successors = {1: [2], 2: [3, 1], 3: [2]}
    kept_dear = cut_loops(successors, lambda vertex: -vertex, lambda u, v: (u, v) == (2, 1))
    assert (2, 1) not in kept_dear[0].cuts
    assert components(without(successors, kept_dear[0].cuts)) == []
