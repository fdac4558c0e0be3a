"""All files as one tree of elements by AUTOSAR path: split elements merged, references resolved, every line kept.

An element with a SHORT-NAME is a `Node`; its path is the chain of short names from the root. Elements of the same
path and tag in several places are one node with several parts (AUTOSAR: splitable elements).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import field
from functools import lru_cache
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Code, Findings, Location, named
from halpipe.core.records import record
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.bases import Bases
from halpipe.importers.arxml.files.sniff import NAMED, Document
from halpipe.importers.arxml.files.variants import Choice, apply_variant, conditional
from halpipe.importers.arxml.files.words import NS, compiled, listed, parse_double

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterable, Iterator, Sequence

    from lxml import etree


_NAMED = [NS + tag for tag in NAMED]
_conditions = compiled("ancestor-or-self::*/ar:VARIATION-POINT[ar:SW-SYSCOND or ar:POST-BUILD-VARIANT-CONDITIONS]")
# A reference may name any class that its target is derived from instead of the target's own.
_BASE_CLASSES = frozenset(
    {
        "ABSTRACT-EVENT",
        "ABSTRACT-PROVIDED-PORT-PROTOTYPE",
        "ABSTRACT-REQUIRED-PORT-PROTOTYPE",
        "AR-ELEMENT",
        "ATOMIC-SW-COMPONENT-TYPE",
        "ATP-FEATURE",
        "ATP-PROTOTYPE",
        "ATP-TYPE",
        "BSW-EVENT",
        "BSW-MODULE-ENTITY",
        "EXECUTABLE-ENTITY",
        "IDENTIFIABLE",
        "INTERNAL-BEHAVIOR",
        "PACKAGEABLE-ELEMENT",
        "PORT-PROTOTYPE",
        "REFERRABLE",
        "RTE-EVENT",
        "SW-COMPONENT-TYPE",
    }
)


@record
class Stated:
    """A value as the file writes it, where it stands, and the element that states it, if that is known."""

    text: str
    at: Location
    element: etree._Element | None = field(default=None, compare=False)


@record
class Ref:
    """A reference: absolute target path, the stated kind of target, and the element that it is, with its file.

    `relative` is what the file writes in place of the path, with its base, where that is not the path itself.
    """

    path: str
    dest: str
    element: etree._Element
    file: str
    relative: str = ""

    @property
    def at(self) -> Location:
        """Place in the file."""
        return place(self.element, self.file)

    @property
    def name(self) -> str:
        """The short name of the target."""
        return self.path.rpartition("/")[2]

    @property
    def stated(self) -> Stated:
        """The target as a value."""
        return Stated(self.path, self.at, self.element)


@record
class Part:
    """One place where a node is written down."""

    element: etree._Element
    file: str

    def find(self, path: str) -> etree._Element | None:
        """Return the first element at a relative path."""
        return self.element.find(qualified(path))


class Node:
    """An element with a short name: its path, its tag, where its parts are written, and the nodes inside it."""

    __slots__ = ("children", "name", "parent", "parts", "path", "tag")

    def __init__(self, path: str, tag: str, name: str, parent: Node | None) -> None:
        self.path = path
        self.tag = tag
        self.name = name
        self.parent = parent
        self.parts: list[Part] = []
        self.children: dict[tuple[str, str], Node] = {}

    @property
    def at(self) -> Location:
        """Place of the first part."""
        return place(self.parts[0].element, self.parts[0].file) if self.parts else Location()

    @property
    def stated(self) -> Stated:
        """The name as a value."""
        return Stated(self.name, self.at, self.parts[0].element)

    def report(self, findings: Findings, code: Code, message: str, help: str = "") -> None:
        """Report something of the element."""
        findings.report(code, message, at=self.at, path=named(self.tag, self.path), help=help)

    def inside(self, *tags: str) -> Iterator[Node]:
        """Yield the direct children, of the given tags if any are given, in document order."""
        for child in self.children.values():
            if not tags or child.tag in tags:
                yield child

    def elements(self, path: str) -> list[tuple[etree._Element, str]]:
        """Return the elements at a relative path such as ``A/B`` in every part, with their file."""
        find = _finder(path)
        return [(element, part.file) for part in self.parts for element in find(part.element)]


def place(element: etree._Element, file: str) -> Location:
    """Return where an element stands."""
    return Location(file, element.sourceline or 0)


def local(element: etree._Element) -> str:
    """Return the tag of an AUTOSAR element without its namespace."""
    tag: str = element.tag
    return tag.removeprefix(NS)


@lru_cache(maxsize=256)
def qualified(path: str) -> str:
    """Return a relative path with the namespace at every step, as lxml wants it."""
    return "/".join(step if step in ("*", ".") else NS + step for step in path.split("/"))


@lru_cache(maxsize=256)
def _finder(path: str) -> Callable[[etree._Element], list[etree._Element]]:
    """Return a relative path as a compiled query, which is twice as fast as the search of ElementTree."""
    if "/" not in path and path not in ("*", "."):
        return lambda element: list(element.iterchildren(NS + path))
    steps = (step if step in ("*", ".") else f"ar:{step}" for step in path.split("/"))
    return compiled("/".join(steps))


class Tree:
    """The merged elements of all documents; `findings` collects what is wrong with them as it is noticed.

    `removed` are the elements that are not in the chosen variant. Of a large input, `dropped` counts the elements that
    were not kept, by kind, and `symbols` has the values of their parameters by name.
    """

    def __init__(self, documents: Sequence[Document], findings: Findings, choice: Choice | None = None) -> None:
        self.findings = findings
        self._bases = Bases(documents, findings)
        self._is_whole = choice is None or not choice.is_made
        self.removed = apply_variant(documents, choice, self._bases, findings) if choice and choice.is_made else []
        self._absent = frozenset(removed.path for removed in self.removed)
        self.root = Node("", "", "", None)
        self._by_path: dict[str, tuple[Node, ...]] = {}
        self._by_name: dict[str, list[str]] | None = None
        self._tags: set[str] = set()
        self._occurs: dict[str, bool] = {}
        self._folded: dict[str, str] | None = None
        self.nameless: list[tuple[str, Location]] = []
        self._by_tag: dict[str, list[Node]] = {}
        self._ranks = {document.name: document.rank for document in documents}
        self.dropped: Counter[str] = Counter()
        self.symbols: dict[str, list[Stated]] = {}
        for document in documents:
            self._tags.update(document.tags)
            self.dropped += document.dropped
            for name, values in document.symbols.items():
                found = [Stated(value, Location(document.name, line)) for value, line in values.items()]
                self.symbols.setdefault(name, []).extend(found)
            self._add(document)
        if self._is_whole:
            for document in documents:
                self._report_variants(document)

    # ------------------------------------------------------------------------------------------- building

    def _add(self, document: Document) -> None:
        owners: dict[etree._Element, Node] = {document.root: self.root}
        for short_name in document.root.iter(NS + "SHORT-NAME"):
            element = short_name.getparent()
            if element is None or element in owners:
                continue
            name = "".join((short_name.text or "").split())
            if not name:
                self._report_nameless(element, "has an empty SHORT-NAME", place(short_name, document.name))
                continue
            ancestor = element.getparent()
            while ancestor is not None and ancestor not in owners:
                ancestor = ancestor.getparent()
            owner = owners[ancestor] if ancestor is not None else self.root
            owners[element] = self._enter(owner, local(element), name, Part(element, document.name))
        for element in document.root.iter(*_NAMED):
            if element not in owners and element.find(NS + "SHORT-NAME") is None:
                self._report_nameless(element, "has no SHORT-NAME", place(element, document.name))

    def _report_nameless(self, element: etree._Element, message: str, at: Location) -> None:
        self.nameless.append((local(element), at))
        self.findings.report(codes.MALFORMED, message, at=at, path=local(element), help="give it a name")

    def _enter(self, owner: Node, tag: str, name: str, part: Part) -> Node:
        node = owner.children.get((tag, name))
        if node is None:
            node = Node(f"{owner.path}/{name}", tag, name, owner)
            owner.children[tag, name] = node
            self._by_path[node.path] = (*self._by_path.get(node.path, ()), node)
            self._by_tag.setdefault(tag, []).append(node)
        node.parts.append(part)
        return node

    def _report_variants(self, document: Document) -> None:
        found = conditional(document)
        known = [node.name for node in self.tagged("PREDEFINED-VARIANT")]
        if found:
            self.findings.report(
                codes.VARIANT,
                f"has {len(found)} elements that depend on a variant, and are imported unconditionally: "
                f"{listed([name for name, _ in found])}",
                at=found[0][1],
                help=f"choose --variant {' or '.join(known[:5])}" if known else "choose values with --condition",
            )

    # -------------------------------------------------------------------------------------------- reading

    def nodes(self) -> Iterator[Node]:
        """Yield every node, in order of first appearance of its path."""
        for nodes in self._by_path.values():
            yield from nodes

    def tagged(self, *tags: str) -> list[Node]:
        """Return every node of the given tags, tag by tag, in order of first appearance."""
        return [node for tag in tags for node in self._by_tag.get(tag, [])]

    def is_absent(self, path: str) -> bool:
        """Whether an element, or one that holds it, is not in the chosen variant."""
        while path and self._absent:
            if path in self._absent:
                return True
            path = path.rpartition("/")[0]
        return False

    def nodes_at(self, path: str) -> Sequence[Node]:
        """Return the elements of a path."""
        return self._by_path.get(path, ())

    def has(self, path: str, tag: str) -> bool:
        """Whether a file defines an element of a tag at a path."""
        return any(node.tag == tag for node in self._by_path.get(path, ()))

    def elements(self, node: Node, path: str) -> Sequence[tuple[etree._Element, str]]:
        """Return the elements of a node at a path; nothing is looked for that occurs in no document."""
        occurs = self._occurs.get(path)
        if occurs is None:
            steps = (step for step in path.split("/") if step not in ("*", "."))
            occurs = self._occurs[path] = all(NS + step in self._tags for step in steps)
        return node.elements(path) if occurs else ()

    def text(self, node: Node, path: str) -> Stated | None:
        """Return the text at a relative path; see `agreed`."""
        found = (Stated((e.text or "").strip(), place(e, file), e) for e, file in self.elements(node, path))
        return self.agreed(node, path, found)

    def agreed(self, node: Node, what: str, values: Iterable[Stated]) -> Stated | None:
        """Return the value that parts of a node state, None if there is none, or an empty one; report a conflict."""
        first: Stated | None = None
        for found in values:
            if first is None:
                first = found
            elif not _same_value(first.text, found.text):
                self._report_conflict(node, what, first, found)
        return first if first is not None and first.text else None

    def ref(self, node: Node, path: str) -> Ref | None:
        """Return the only reference at a relative path; report a conflict if two parts state it differently."""
        found = self.refs(node, path)
        self.agreed(node, path, (ref.stated for ref in found))
        return found[0] if found else None

    def refs(self, node: Node, path: str) -> list[Ref]:
        """Return the references at a relative path in document order, each target once."""
        unique: dict[str, Ref] = {}
        for element, file in self.elements(node, path):
            found = self.reference(node, element, file)
            if found is not None:
                unique.setdefault(found.path, found)
        return list(unique.values())

    def reference(self, node: Node, element: etree._Element, file: str) -> Ref | None:
        """Read a reference element, completing a relative path by its reference base; None if it is empty."""
        path, relative = self._bases.absolute(element, node.path)
        return Ref(path, element.get("DEST") or "", element, file, relative) if path else None

    def instance(self, node: Node, iref: etree._Element, file: str) -> tuple[list[Ref], Ref | None]:
        """Read an instance reference: the references to its contexts, outermost first, and to its target."""
        refs = [ref for child in iref.iterchildren("*") if (ref := self.reference(node, child, file))]
        target = next((ref for ref in refs if local(ref.element).startswith("TARGET-")), None)
        return [ref for ref in refs if local(ref.element).startswith("CONTEXT-")], target

    def target(self, node: Node, path: str, tags: Container[str] | None = None, kind: str = "") -> Node | None:
        """Return the node that the only reference at a relative path names; see `find` and `ref`."""
        ref = self.ref(node, path)
        return self.find(ref, f'{kind or node.tag} "{node.path}"', tags) if ref else None

    def path_at(self, node: Node, path: str, tags: Container[str] | None = None, kind: str = "") -> str | None:
        """Return the path of the node that the only reference at a relative path names; see `target`."""
        found = self.target(node, path, tags, kind)
        return found.path if found else None

    def targets(self, node: Node, path: str, tags: Container[str] | None = None) -> list[Node]:
        """Return the nodes that the references at a relative path name; see `find` and `refs`."""
        what = f'{node.tag} "{node.path}"'
        found = [self.find(ref, what, tags) for ref in self.refs(node, path)]
        return [target for target in found if target is not None]

    def find(self, ref: Ref, what: str, tags: Container[str] | None = None) -> Node | None:
        """Return the node that `ref` names, of one of `tags`; report a missing target or a wrong DEST.

        `what` names the referring element in messages.
        """
        candidates = self._by_path.get(ref.path) or self._in_other_case(ref, what)
        fitting = [node for node in candidates if tags is None or node.tag in tags]
        if not fitting:
            if not self.is_absent(ref.path):
                self._report_dangling(ref, what, candidates, tags)
            return None
        node = next((node for node in fitting if node.tag == ref.dest), fitting[0])
        if ref.dest and ref.dest != node.tag and ref.dest not in _BASE_CLASSES:
            message = f'{ref.path} is a {node.tag}, but DEST says "{ref.dest}"'
            help = f'write DEST="{node.tag}"'
            self.findings.report(codes.WRONG_DEST, message, at=ref.at, path=what, help=help)
        return node

    def _in_other_case(self, ref: Ref, what: str) -> tuple[Node, ...]:
        """Return the nodes of a path that differs in case only, which AUTOSAR forbids to be another element's."""
        if self._folded is None:
            self._folded = {path.casefold(): path for path in self._by_path}
        path = self._folded.get(ref.path.casefold())
        if path is None:
            return ()
        self.findings.report(
            codes.WRONG_CASE, f"refers to {ref.path}, taken for {path}", at=ref.at, path=what, help=f"write {path}"
        )
        return self._by_path[path]

    # ------------------------------------------------------------------------------------------ reporting

    def _report_dangling(self, ref: Ref, what: str, candidates: Sequence[Node], tags: Container[str] | None) -> None:
        written = f"{ref.relative}, which is {ref.path}" if ref.relative else ref.path
        if candidates:
            message = f"refers to {written}, a {candidates[0].tag}"
            help = "refer to the right kind of element"
        else:
            elsewhere = self._alike(ref, tags)
            message = f"refers to {written}, which no file defines"
            help = f"did you mean {elsewhere}?" if elsewhere else "add the file that defines it to the import"
        self.findings.report(codes.DANGLING, message, at=ref.at, path=what, help=help)

    def _alike(self, ref: Ref, tags: Container[str] | None) -> str:
        """Return the first path of an element that has the name and the kind of what a reference should lead to."""
        if self._by_name is None:
            self._by_name = {}
            for path in self._by_path:
                self._by_name.setdefault(path.rpartition("/")[2], []).append(path)
        for path in self._by_name.get(ref.name, []):
            for node in self._by_path[path]:
                if node.tag == ref.dest or (tags is not None and node.tag in tags):
                    return path
        return ""

    def _report_conflict(self, node: Node, what: str, first: Stated, second: Stated) -> None:
        """Report that two parts of a node state `what` differently: as variants of it, or as a contradiction."""
        message = f'{what} is "{second.text}" here, but "{first.text}" at {first.at}'
        elements = (stated.element for stated in (first, second) if stated.element is not None)
        if self._is_whole and any(map(_conditions, elements)):
            help = "choose a variant; otherwise the first of the two counts"
            self.findings.report(codes.VARIANT, message, at=second.at, path=node.path, help=help)
            return
        is_copy = self._ranks.get(first.at.file, 0) < self._ranks.get(second.at.file, 0)
        code = codes.OTHER_COPY if is_copy else codes.CONFLICT
        help = "generate the file again" if is_copy else "import one of the two, or make them agree"
        self.findings.report(code, f"{message}{', which counts' * is_copy}", at=second.at, path=node.path, help=help)


def _same_value(first: str, second: str) -> bool:
    if first == second:
        return True
    number = parse_double(first)
    return number is not None and number == parse_double(second)
