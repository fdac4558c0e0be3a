"""The DOT language: what the tokenizer and the parser make of a file."""

import shutil
import string
import subprocess
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import TOO_MUCH
from halpipe.importers.ros import codes, dot
from profiles import examples


def edges(text):
    return [(edge.tail, edge.head) for edge in dot.parse(text, "g.dot").edges]


def error_of(text):
    with pytest.raises(HalpipeError) as caught:
        dot.parse(text, "g.dot")
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code == codes.NOT_DOT.id
    return diagnostic


def test_chains_and_blocks_of_edges():
    assert edges("digraph { a -> b -> c; {d e} -> f }") == [("a", "b"), ("b", "c"), ("d", "f"), ("e", "f")]


def test_strict_names_ports_and_separators():
    assert edges('strict digraph "my graph" { a:out:n -> "b c":in, } '.replace(",", "")) == [("a", "b c")]


def test_comments_of_all_kinds():
    assert edges("# first\ndigraph { // line\n /* block\n * more */ a -> b\n# last\n}") == [("a", "b")]


def test_defaults_hold_inside_their_block_only():
    graph = dot.parse("digraph { {node [shape=box]; a} b [shape=circle]; c }", "g.dot")
    assert [v.attributes.get("shape") for v in graph.vertices.values()] == ["box", "circle", None]


def test_edge_defaults_and_several_attribute_lists():
    (edge,) = dot.parse("digraph { edge [weight=8]; a -> b [label=x; color=red][penwidth=2] }", "g.dot").edges
    assert edge.attributes == {"weight": "8", "label": "x", "color": "red", "penwidth": "2"}


@pytest.mark.parametrize(
    ("text", "pairs"),
    [
        ("a -> b [dir=back]", [("b", "a")]),
        ("a -> b [dir=both]", [("a", "b"), ("b", "a")]),
        ('a -> b [dir="forward"] b -> c [dir=""]', [("a", "b"), ("b", "c")]),
        ("edge [dir=back] a -> b -> c; c -> d [dir=forward]", [("b", "a"), ("c", "b"), ("c", "d")]),
        ("{edge [dir=back] a -> b} c -> {d e}", [("b", "a"), ("c", "d"), ("c", "e")]),
        ("{a b} -> c [dir=back]", [("c", "a"), ("c", "b")]),
    ],
)
def test_edges_point_where_dir_says(text, pairs):
    assert edges(f"digraph {{ {text} }}") == pairs


def test_both_ways_count_twice(monkeypatch):
    monkeypatch.setattr(dot, "MAX_ELEMENTS", 3)
    assert len(edges("digraph { a -> b }")) == 1
    with pytest.raises(HalpipeError) as caught:
        edges("digraph { a -> b [dir=both] }")
    assert caught.value.diagnostics[0].code == TOO_MUCH.id


@pytest.mark.parametrize("stated", ["none", "forwards"])
def test_edges_without_a_direction_are_refused(stated):
    diagnostic = error_of(f"digraph {{\n edge [dir={stated}]\n a -> b\n}}")
    assert (diagnostic.at.line, diagnostic.help) == (3, "write dir=forward, dir=back or dir=both")
    assert f"dir={stated}" in diagnostic.message


def test_quoted_text_keeps_escapes_until_shown_and_can_be_joined():
    graph = dot.parse('digraph { a [label="one\\n" + "\\N \\"two\\"\\\n!"] }', "g.dot")
    assert dot.unescape(graph.vertices["a"].attributes["label"], "a") == 'one\na "two"!'


def test_html_labels_and_keywords_in_any_case():
    graph = dot.parse("DiGraph { Node [shape=box]; a [label=<<b>x</b>>] }", "g.dot")
    assert graph.vertices["a"].attributes == {"shape": "box", "label": "<b>x</b>"}


def test_lines_count_through_multi_line_values():
    graph = dot.parse('digraph {\n a [x="1\n2"]\n b\n}', "g.dot")
    assert [v.line for v in graph.vertices.values()] == [2, 4]


@pytest.mark.parametrize(
    ("text", "line", "part"),
    [
        ("digraph {\n a -> \n}", 3, 'expected a name, found "}"'),
        ("digraph {\n a", 2, "found the end of the file"),
        ('digraph {\n a [label="x]\n}', 2, "a quote is never closed"),
        ("digraph {\n\n a [label=<x]}", 3, "HTML label is never closed"),
        ("digraph { a ? b }", 1, "unexpected '?'"),
        ("graph {\n a -- b }", 1, "undirected"),
        ("digraph {\n a -- b }", 2, '"--" in a digraph'),
        ("strict a", 1, 'expected digraph, found "a"'),
        ("digraph " + "{" * 200, 1, "nests deeper than 100"),
        ('digraph { a -> "b" + ', 1, "expected a name"),
        ("digraph { a -> b }\n\ndigraph { b -> c }", 3, "holds more than one graph"),
        ("digraph { a -> b } }", 1, "holds more than one graph"),
    ],
)
def test_errors_name_the_line(text, line, part):
    diagnostic = error_of(text)
    assert diagnostic.at.line == line
    assert part in diagnostic.message


def test_edges_between_blocks_are_bounded():
    block = "{" + " ".join(f"a{i}" for i in range(1100)) + "}"
    with pytest.raises(HalpipeError, match="has 1211100 vertices and edges; at most 100000 are read"):
        dot.parse(f"digraph {{ {block} -> {block} }}", "g.dot")


@pytest.mark.parametrize(
    ("limit", "text"), [("MAX_ELEMENTS", "digraph { a -> b; c }"), ("MAX_TOKENS", "digraph { a; }")]
)
def test_what_is_just_within_the_limits_is_read(monkeypatch, limit, text):
    least = {"MAX_ELEMENTS": 4, "MAX_TOKENS": 5}[limit]
    monkeypatch.setattr(dot, limit, least)
    assert dot.parse(text, "g.dot").vertices
    monkeypatch.setattr(dot, limit, least - 1)
    with pytest.raises(HalpipeError) as refused:
        dot.parse(text, "g.dot")
    (found,) = refused.value.diagnostics
    assert (found.code, found.at.line) == (TOO_MUCH.id, 1)


@given(st.text(string.printable, max_size=80))
def test_any_text_is_parsed_or_refused(text):
    try:
        graph = dot.parse("digraph {" + text, "g.dot")
    except HalpipeError as failure:
        found = {diagnostic.code for diagnostic in failure.diagnostics}
    else:
        found = {vertex in graph.vertices for edge in graph.edges for vertex in (edge.tail, edge.head)}
    assert found <= {codes.NOT_DOT.id, True}


names = st.text(st.characters(blacklist_categories=("Cs",), blacklist_characters="\\"), min_size=1, max_size=8)


@given(st.lists(st.tuples(names, names), max_size=12))
def test_quoted_edges_come_back(pairs):
    quoted = [tuple('"' + name.replace('"', '\\"') + '"' for name in pair) for pair in pairs]
    graph = dot.parse("digraph {" + "".join(f"{a} -> {b};" for a, b in quoted) + "}", "g.dot")
    assert [(dot.unescape(e.tail), dot.unescape(e.head)) for e in graph.edges] == pairs


def test_a_named_block_that_is_opened_again_goes_on():
    assert edges("digraph { subgraph s {a} subgraph s {b} -> c }") == [("a", "c"), ("b", "c")]
    assert edges("digraph { subgraph s {} -> subgraph s {a} }") == [("a", "a")]
    assert edges("digraph { {subgraph s {a}} subgraph s {b} -> c }") == [("b", "c")]  # that of another block
    graph = dot.parse("digraph { subgraph s {node [x=1]} node [x=2; y=3] subgraph s {a} b }", "g.dot")
    assert [v.attributes for v in graph.vertices.values()] == [{"x": "1", "y": "3"}, {"x": "2", "y": "3"}]


def test_vertices_may_be_listed():
    assert edges("digraph { a, b:p -> c, d }") == [("a", "c"), ("a", "d"), ("b", "c"), ("b", "d")]
    graph = dot.parse("digraph { a, b [x=1] }", "g.dot")
    assert [v.attributes for v in graph.vertices.values()] == [{"x": "1"}, {"x": "1"}]


def test_attributes_behind_a_block_are_those_of_no_vertex():
    graph = dot.parse("digraph { {a} [x=1] a [y=2] }", "g.dot")
    assert graph.vertices["a"].attributes == {"y": "2"}


def test_a_name_is_the_same_over_two_lines():
    assert edges('digraph { "a\\\nb" -> ab -> "c\\"d" }') == [("ab", "ab"), ("ab", 'c"d')]


NAMES = st.sampled_from(
    ["a", "b", "c", '"a"', '"x y"', '"q\\"t"', "_u", "12", "-1.5", '"a\\\nb"', "ab", '"a" + "b"', "é"]
)
STATED = [
    "label=x",
    "shape=box",
    "color = red",
    "dir=back",
    "dir=both",
    "dir=forward",
    'label="x\\ny"',
    "label=<<b>h</b>>",
]
LISTS = st.lists(st.sampled_from(STATED), min_size=1, max_size=3).map(lambda stated: f" [{', '.join(stated)}]")
ENDS = st.sampled_from([" ", "; ", "\n", "\n# line\n", " /* c */ ", "// d\n"])


def _statements(inner):
    blocks = st.builds("{}{{{}}}".format, st.sampled_from(["", "subgraph ", "subgraph s ", "subgraph t "]), inner)
    ports = st.sampled_from(["", "", "", ":p", ":p:n", ':"p q":_'])
    lists = st.lists(st.builds(str.__add__, NAMES, ports), min_size=1, max_size=2).map(", ".join)
    chains = st.lists(lists | blocks, min_size=1, max_size=3).map(" -> ".join)
    others = st.builds(str.__add__, st.sampled_from(["node", "edge", "graph"]), LISTS) | st.just("rankdir = LR")
    stated = st.builds(str.__add__, chains, st.just("") | LISTS) | others
    return st.lists(st.builds(str.__add__, stated, ENDS), max_size=5).map("".join)


BODIES = st.recursive(_statements(st.just("")), _statements, max_leaves=12)
SHOWN = r"""N{printf("%s\001%s\002", $.name, aget($, "label"))}
E{printf("%s\001%s\001%s\002", $.tail.name, $.head.name, aget($, "dir"))}"""


@pytest.mark.skipif(not shutil.which("gvpr"), reason="graphviz is not installed")
@examples(60)
@given(BODIES)
def test_graphs_are_those_that_graphviz_reads(body):
    text = f"digraph {{{body}}}"
    shown = subprocess.run(["gvpr", SHOWN], input=text.encode(), capture_output=True, check=True).stdout.decode()
    rows = [row.split("\1") for row in shown.split("\2")[:-1]]
    labels = {row[0]: row[1] for row in rows if len(row) == 2}
    pairs = Counter()
    for tail, head, way in (row for row in rows if len(row) == 3):
        pairs[tail, head] += way in ("", "forward", "both")
        pairs[head, tail] += way in ("back", "both")
    graph = dot.parse(text, "g.dot")
    own = {id: vertex.attributes.get("label", "") for id, vertex in graph.vertices.items()}
    assert {id: label or labels[id].replace("\\N", "") for id, label in own.items()} == {
        id: label.replace("\\N", "") for id, label in labels.items()
    }
    assert Counter((edge.tail, edge.head) for edge in graph.edges) == +pairs
