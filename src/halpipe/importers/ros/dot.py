"""Reader of DOT graphs: rqt_graph's views, known by shape and label (never by id), or a hand-written task graph.

rqt_graph draws nodes as ellipses and topics as boxes (box3d for groups), or in its "nodes only" view puts the topic
on the edge. Edges carry the QoS settings as tooltip, and with ROS 1 statistics the rate. Any other DOT graph is a
task graph: each vertex a node, which publishes one topic of its own name (or the label of the edge).

The language is read by a tokenizer and a recursive descent parser after https://graphviz.org/doc/info/lang.html.
Ports and the look of things are skipped, but for `dir`, which turns the arrow of an edge. Depth, words, vertices and
edges are bounded.
"""

from __future__ import annotations

import re
from collections import ChainMap
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import pairwise, product
from typing import TYPE_CHECKING, Literal, NoReturn

from halpipe.core.diagnostics import Findings, HalpipeError, Location, named
from halpipe.core.durations import Duration, seconds
from halpipe.core.files import refuse_more_than
from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.importers.ros import codes
from halpipe.importers.ros.graph import Callback, Kind, Node, Publication, Rate, RosGraph, Subscription, printable

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, MutableMapping


_BOXES = ("box", "box3d", "rect", "rectangle")
_RATE = re.compile(r"(?<![\w.,+-])([0-9]{1,9}(?:\.[0-9]{1,9})?) ?Hz\b")
_FRAMES = re.compile(r"\s*Broadcaster: .*Average rate: ", re.DOTALL)
_DEADLINE = re.compile(r"deadline: ?([0-9]{1,19}) ?ns")
NO_DEADLINE = seconds(365 * 24 * 3600)
"""Middlewares state an infinite deadline as one of several values of centuries."""

STATISTICS = "topic statistics"
DEADLINE = "QoS deadline"


@dataclass(slots=True)
class _Links:
    """Publishers and readers, gathered from the edges; keys are (node, topic), values the first line."""

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
    """Return the ids of topics: boxes with the name or link of a topic, if every edge joins a node and a topic."""
    boxes = {
        id: None
        for id, vertex in digraph.vertices.items()
        if vertex.attributes.get("shape") in _BOXES
        and (labels[id].startswith("/") or vertex.attributes.get("URL", "").startswith("topic_"))
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
            message = f"is drawn twice, first on line {first[name]}"
            help = "give the nodes different names"
            findings.add(codes.DUPLICATE(message, at=Location(file, vertex.line), path=named("node", name), help=help))
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
    inputs = grouped(links.subscribes)
    return [
        Callback(name=name, node=name, kind=Kind.NODE, inputs=tuple(inputs.get(name, ())), at=Location(file, line))
        for name, line in nodes
    ]


_MAX_DEPTH = 100
MAX_ELEMENTS = 100_000
"""Vertices and edges of a graph together."""

MAX_TOKENS = 600_000
_TOKEN = re.compile(
    r"""(?P<space>\s+|//[^\n]*|/\*.*?\*/|(?<![^\n])\#[^\n]*)
      | (?P<quoted>"[^"\\]*+(?:\\.[^"\\]*+)*+")
      | (?P<arrow>->|--)
      | (?P<sign>[{}\[\];,=:+])
      | (?P<word>-?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)|[A-Za-z_\x80-\U0010ffff][A-Za-z0-9_\x80-\U0010ffff]*)
      | (?P<html><)""",
    re.VERBOSE | re.DOTALL,
)
_ESCAPE = re.compile(r"\\(\r?\n|.)", re.DOTALL)
_WAYS: dict[str, tuple[Literal[1, -1], ...]] = {"": (1,), "forward": (1,), "back": (-1,), "both": (1, -1)}
_KEYWORDS = ("graph", "node", "edge", "subgraph", "digraph", "strict")


@dataclass(slots=True)
class Token:
    """A token; `kind` is word, quoted, html, arrow, sign or end."""

    kind: str
    text: str
    line: int

    def is_sign(self, sign: str) -> bool:
        """Return whether this is the punctuation `sign`, unquoted."""
        return self.kind == "sign" and self.text == sign


@dataclass(slots=True)
class Vertex:
    """A vertex by its id, with its attributes, defaults included."""

    id: str
    line: int
    attributes: dict[str, str] = field(default_factory=dict)


@record
class Edge:
    """A directed edge between vertex ids."""

    tail: str
    head: str
    line: int
    attributes: Mapping[str, str]


@dataclass(slots=True)
class Digraph:
    """A parsed file; both in the order in which they first appear."""

    vertices: dict[str, Vertex] = field(default_factory=dict)
    edges: list[Edge] = field(default_factory=list)


@dataclass(slots=True)
class _Scope:
    """Default attributes in force, those of the blocks around included, and the vertices named inside a block."""

    node: ChainMap[str, str] = field(default_factory=ChainMap)
    edge: ChainMap[str, str] = field(default_factory=ChainMap)
    members: dict[str, None] = field(default_factory=dict)
    blocks: dict[str, _Scope] = field(default_factory=dict)
    """The named blocks inside: one that is opened again continues."""


def parse(text: str, file: str) -> Digraph:
    """Parse a DOT file; raise `HalpipeError` with the line where the grammar is left, or a second graph begins."""
    return _Parser(tokenize(text.removeprefix("\ufeff"), file), file).parse()


def unescape(text: str, id: str = "") -> str:
    r"""Return a label as shown: ``\n``, ``\l``, ``\r`` break lines, ``\N`` is the vertex id."""

    def replace(match: re.Match[str]) -> str:
        character = match[1]
        if character in ("n", "l", "r"):
            return "\n"
        return id if character == "N" else character

    return _ESCAPE.sub(replace, text)


def _joined(escape: re.Match[str]) -> str:
    """Return a quote for one with a backslash, and nothing for a line end with one."""
    return '"' if escape[1] == '"' else "" if escape[1].endswith("\n") else escape[0]


def tokenize(text: str, file: str) -> list[Token]:
    """Split into tokens; the text of a quoted string is without its quotes, other escapes are kept."""
    tokens: list[Token] = []
    position, line = 0, 1
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            what = "a quote is never closed" if text[position] == '"' else f"unexpected {text[position]!r}"
            raise _malformed(file, line, what)
        kind, raw = match.lastgroup or "", match[0]
        if kind == "html":
            raw = _html(text, position, file, line)
            tokens.append(Token("html", raw[1:-1], line))
        elif kind == "quoted":
            tokens.append(Token("quoted", _ESCAPE.sub(_joined, raw[1:-1]), line))
        elif kind != "space":
            tokens.append(Token(kind, raw, line))
        refuse_more_than(MAX_TOKENS, len(tokens), "words and signs", Location(file, line))
        position += len(raw)
        line += raw.count("\n")
    tokens.append(Token("end", "the end of the file", line))
    return tokens


def _html(text: str, start: int, file: str, line: int) -> str:
    depth = 0
    for match in re.compile("[<>]").finditer(text, start):
        depth += 1 if match[0] == "<" else -1
        if depth == 0:
            return text[start : match.end()]
    raise _malformed(file, line, "an HTML label is never closed")


def _malformed(file: str, line: int, what: str, help: str = "repair the DOT file or save it again") -> HalpipeError:
    return HalpipeError(codes.NOT_DOT(what, at=Location(file, line), help=help))


class _Parser:
    def __init__(self, tokens: list[Token], file: str) -> None:
        self._tokens = tokens
        self._next = 0
        self._file = file
        self._graph = Digraph()

    def parse(self) -> Digraph:
        self._keyword("strict")
        token = self._peek()
        if self._keyword("graph"):
            raise _malformed(self._file, token.line, "is an undirected graph: it does not say which way data flows")
        if not self._keyword("digraph"):
            self._fail("digraph")
        if self._is_name():
            self._take()
        self._block(_Scope(), 0)
        if self._peek().kind != "end":
            raise _malformed(
                self._file, self._peek().line, "holds more than one graph", "save each in a file of its own"
            )
        return self._graph

    # ------------------------------------------------------------------------------------------ statements

    def _block(self, scope: _Scope, depth: int) -> None:
        if depth > _MAX_DEPTH:
            raise _malformed(self._file, self._peek().line, f"nests deeper than {_MAX_DEPTH} blocks")
        if not self._sign("{"):
            self._fail('"{"')
        while not self._sign("}"):
            if not self._sign(";"):
                self._statement(scope, depth)

    def _statement(self, scope: _Scope, depth: int) -> None:
        if self._keyword("graph"):
            self._attributes({})
        elif self._keyword("node"):
            self._attributes(scope.node)
        elif self._keyword("edge"):
            self._attributes(scope.edge)
        elif self._is_name() and self._tokens[self._next + 1].is_sign("="):
            self._next += 2
            self._name()
        else:
            self._chain(scope, depth)

    def _chain(self, scope: _Scope, depth: int) -> None:
        """Read vertices, a block, or a chain of edges between vertices and blocks."""
        line, are_vertices = self._peek().line, self._is_name()
        operands = [self._operand(scope, depth)]
        while self._peek().kind == "arrow":
            if self._take().text == "--":
                raise _malformed(self._file, line, 'has "--" in a digraph; directed edges are written "->"')
            operands.append(self._operand(scope, depth))
        if len(operands) == 1:
            stated = self._attributes({})
            for id in operands[0] if are_vertices else ():
                self._graph.vertices[id].attributes.update(stated)
            return
        attributes = self._attributes(dict(scope.edge))
        for tails, heads in pairwise(operands):
            ways = self._ways(attributes.get("dir", ""), line)
            more = len(tails) * len(heads) * len(ways)
            self._bound(len(self._graph.vertices) + len(self._graph.edges) + more, line)
            for tail, head in product(tails, heads):
                self._graph.edges.extend(Edge(*(tail, head)[::way], line, attributes) for way in ways)

    def _ways(self, stated: str, line: int) -> tuple[Literal[1, -1], ...]:
        """Return which ways an edge with this `dir` points: 1 from tail to head, -1 from head to tail."""
        if stated in _WAYS:
            return _WAYS[stated]
        shown = f"dir={printable(stated[:40])}"
        what = f"an edge with {shown}: it does not say which way data flows"
        raise _malformed(self._file, line, what, "write dir=forward, dir=back or dir=both")

    def _operand(self, scope: _Scope, depth: int) -> Collection[str]:
        """Read vertices or a block and return the ids it stands for; a block that is opened again gets more."""
        if self._keyword("subgraph") or self._peek().is_sign("{"):
            inner = _Scope(scope.node.new_child(), scope.edge.new_child())
            if self._is_name():
                inner = scope.blocks.setdefault(self._name(), inner)
            self._block(inner, depth + 1)
            scope.members.update(inner.members)
            return inner.members
        found = list[str]()
        while not found or self._sign(","):
            token = self._peek()
            id = self._name()
            while self._sign(":"):
                self._name()
            if id not in self._graph.vertices:
                self._bound(len(self._graph.vertices) + len(self._graph.edges) + 1, token.line)
                self._graph.vertices[id] = Vertex(id, token.line, dict(scope.node))
            scope.members[id] = None
            found.append(id)
        return found

    def _attributes(self, into: MutableMapping[str, str]) -> MutableMapping[str, str]:
        while self._sign("["):
            while not self._sign("]"):
                key = self._name()
                into[key] = self._name() if self._sign("=") else "true"
                if not self._sign(","):
                    self._sign(";")
        return into

    def _bound(self, count: int, line: int) -> None:
        refuse_more_than(MAX_ELEMENTS, count, "vertices and edges", Location(self._file, line))

    # ---------------------------------------------------------------------------------------------- tokens

    def _peek(self) -> Token:
        return self._tokens[self._next]

    def _take(self) -> Token:
        token = self._tokens[self._next]
        self._next += token.kind != "end"
        return token

    def _sign(self, sign: str) -> bool:
        found = self._peek().is_sign(sign)
        self._next += found
        return found

    def _keyword(self, keyword: str) -> bool:
        token = self._peek()
        found = token.kind == "word" and token.text.lower() == keyword
        self._next += found
        return found

    def _is_name(self) -> bool:
        token = self._peek()
        return token.kind in ("quoted", "html") or (token.kind == "word" and token.text.lower() not in _KEYWORDS)

    def _name(self) -> str:
        if not self._is_name():
            self._fail("a name")
        parts = [self._take().text]
        while self._sign("+"):
            parts.append(self._take().text)
        return "".join(parts)

    def _fail(self, expected: str) -> NoReturn:
        token = self._peek()
        found = token.text if token.kind == "end" else f'"{token.text[:40]}"'
        raise _malformed(self._file, token.line, f"expected {expected}, found {found}")
