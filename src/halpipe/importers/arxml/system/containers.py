"""Containers of the ECU configuration of Os, Rte and EcuC, with their parameters and references by name.

Containers and parameters are known by the short names of their definitions, which vendors keep. Special data groups of
halpipe (``ADMIN-DATA/SDGS/SDG``) mark the containers that an export put on top of a project."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from halpipe.core.diagnostics import Location, named
from halpipe.core.durations import Duration, seconds
from halpipe.core.records import record
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.codes import EDITED
from halpipe.importers.arxml.files.tree import Node, Ref, Stated, Tree, place, qualified
from halpipe.importers.arxml.files.words import NS, child_text, module_with, parse_number, steps_of
from halpipe.importers.arxml.system.values import Place

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from fractions import Fraction

    from lxml import etree


T = TypeVar("T")
_PREFIX = "halpipe:"
BLANKS = " \t\r\n"  # those of XML, which tools put round values


@record
class Data:
    """A special data group: values by their GID, references by the class of their target, inner groups."""

    tree: Tree
    node: Node
    element: etree._Element
    file: str

    @property
    def at(self) -> Location:
        """Place of the group."""
        return place(self.element, self.file)

    def text(self, key: str) -> str | None:
        """Return the first value of `key`, as it stands there, None if there is none."""
        return next((sd.text or "" for sd in self.element.iterchildren(NS + "SD") if sd.get("GID") == key), None)

    def value(self, key: str, read: Callable[[str], T]) -> T | None:
        """Return the first value of `key` as `read` understands it; None if absent, or bad and reported."""
        text = self.text(key)
        if text is None:
            return None
        try:
            return read(text.strip(BLANKS))
        except ValueError as failure:
            edited(self, f'"{key}" is unusable: {failure}')
            return None

    def target(self, tag: str) -> str | None:
        """Return the path of the first existing element of a class that the group refers to; report what dangles."""
        what = f'special data of "{self.node.path}"'
        refs = (self.tree.reference(self.node, e, self.file) for e in self.element.iterchildren(NS + "SDX-REF"))
        found = (self.tree.find(ref, what, (tag,)) for ref in refs if ref is not None and ref.dest == tag)
        return next((node.path for node in found if node is not None), None)

    def groups(self, kind: str) -> Iterator[Data]:
        """Yield the groups of a kind inside this one."""
        for element in self.element.iterchildren(NS + "SDG"):
            if element.get("GID") == _PREFIX + kind:
                yield Data(self.tree, self.node, element, self.file)


def each_data(tree: Tree, node: Node, kind: str) -> Iterator[Data]:
    """Yield the special data of a kind that an element has."""
    for element, file in tree.elements(node, "ADMIN-DATA/SDGS/SDG"):
        if element.get("GID") == _PREFIX + kind:
            yield Data(tree, node, element, file)


def data_of(tree: Tree, node: Node, kind: str) -> Data | None:
    """Return the first special data of a kind that an element has."""
    return next(each_data(tree, node, kind), None)


def edited(data: Data, message: str) -> None:
    """Report special data that cannot be read."""
    help = "export the model again"
    path = named(data.node.tag, data.node.path)
    data.tree.findings.report(EDITED, message, at=data.at, path=path, help=help)


_CONTAINER = "ECUC-CONTAINER-VALUE"
_MODULE = "ECUC-MODULE-CONFIGURATION-VALUES"
# Ends of the definitions of which a container has one at most, and would have one read: variants may name them apart.
_SINGLE = ("Autostart", "TimingProtection")
_VALUES = tuple(map(qualified, ("VALUE-REF", "VALUE-IREF/TARGET-REF")))


class Container:
    """An ECU configuration container: the short name of its definition, its parameters and references by theirs."""

    def __init__(self, tree: Tree, node: Node, kind: str) -> None:
        self.node = node
        self.kind = kind
        self._tree = tree
        self._parameters: dict[str, list[Stated]] | None = None
        self._references: dict[str, list[Ref]] | None = None

    def data(self) -> list[Data]:
        """Return the special data of a container that halpipe put on top of a project."""
        return list(each_data(self._tree, self.node, "delta"))

    @property
    def place(self) -> Place:
        """Place of the container, with the name of its definition as its kind."""
        return Place(self.node.path, self.kind, self.node.at)

    def value(self, name: str) -> Stated | None:
        """Return the parameter `name`; report a conflict if two parts of the container state it differently."""
        if self._parameters is None:
            self._parameters = {}
            for key, element, file in _by_definition(self.node, "PARAMETER-VALUES/*"):
                found = Stated(child_text(element, "VALUE").strip(), place(element, file), element)
                self._parameters.setdefault(key, []).append(found)
        return self._tree.agreed(self.node, name, self._parameters.get(name, ()))

    def number(self, name: str) -> Fraction | None:
        """Return the parameter `name` as an exact number; report it if it is none."""
        stated = self.value(name)
        if stated is None:
            return None
        number = parse_number(stated.text)
        if number is None or number < 0:
            message = f'{name} "{stated.text}" is no non-negative number'
            help = "write a number such as 20, 0x14 or 2.5E-8"
            at, path = stated.at, named(self.kind, self.node.path)
            self._tree.findings.report(codes.BAD_NUMBER, message, at=at, path=path, help=help)
            return None
        return number

    def time(self, name: str) -> Duration | None:
        """Return the parameter `name`, in seconds, as a time; None if it is 0, too."""
        number = self.number(name)
        return seconds(number) if number else None

    def refs(self, *names: str) -> list[Ref]:
        """Return the targets of the references called one of `names`."""
        if self._references is None:
            self._references = {}
            for key, element, file in _by_definition(self.node, "REFERENCE-VALUES/*"):
                for value in (element.find(path) for path in _VALUES):
                    ref = self._tree.reference(self.node, value, file) if value is not None else None
                    if ref is not None:
                        self._references.setdefault(key, []).append(ref)
        return list({ref.path: ref for name in names for ref in self._references.get(name, ())}.values())

    def stated(self, *names: str) -> list[Stated]:
        """Return the paths of the existing targets of references with their places; report those that dangle."""
        what = f'{self.kind} "{self.node.path}"'
        found = ((self._tree.find(ref, what), ref) for ref in self.refs(*names))
        return [Stated(node.path, ref.at, ref.element) for node, ref in found if node is not None]

    def targets(self, *names: str) -> list[str]:
        """Return the paths of the existing targets of references; report those that dangle."""
        return [target.text for target in self.stated(*names)]

    def target(self, *names: str) -> str | None:
        """Return the path of the existing target of a reference; report a conflict if there are several."""
        found = self._tree.agreed(self.node, names[0], self.stated(*names))
        return found.text if found else None


def _by_definition(node: Node, path: str) -> Iterator[tuple[str, etree._Element, str]]:
    """Yield the values of a container with the short names of their definitions, and their files."""
    for element, file in node.elements(path):
        yield steps_of(child_text(element, "DEFINITION-REF"))[-1], element, file


class Containers:
    """Every container of the modules Os, Rte and EcuC, by path; of `modules` only, if given (paths).

    `kinds` has the short names of the definitions of all of them.
    """

    def __init__(self, tree: Tree, modules: frozenset[str] | None = None) -> None:
        self.tree = tree
        self.by_path: dict[str, Container] = {}
        self.added: dict[str, Container] = {}
        self._waits: dict[str, frozenset[str]] | None = None
        self.kinds: dict[str, str] = {}
        standard = standard_modules(tree)
        alternatives: dict[tuple[Node, str], list[Stated]] = {}
        for node in tree.tagged(_CONTAINER):
            holder = node.parent.path if node.parent is not None else ""
            if holder not in self.kinds and holder not in standard:
                continue
            definition = tree.text(node, "DEFINITION-REF")
            kind = self.kinds[node.path] = steps_of(definition.text if definition else "")[-1]
            if holder in self.by_path or (holder in standard and (modules is None or holder in modules)):
                container = self.by_path[node.path] = Container(tree, node, kind)
                if container.data():
                    self.added[node.path] = container
                elif kind.endswith(_SINGLE) and node.parent is not None:
                    alternatives.setdefault((node.parent, kind), []).append(node.stated)
        for (owner, what), found in alternatives.items():
            tree.agreed(owner, what, found)

    def of(self, *kinds: str) -> list[Container]:
        """Return the project's own containers of the given definitions, in document order.

        What an export put on top of the project plays a schedule; it is no source of that schedule's model.
        """
        return [c for path, c in self.by_path.items() if c.kind in kinds and path not in self.added]

    @property
    def waits(self) -> dict[str, frozenset[str]]:
        """The OsEvents (paths) that each OsTask waits for."""
        if self._waits is None:
            tasks = self.of("OsTask")
            self._waits = {c.node.path: frozenset(r.path for r in c.refs("OsTaskEventRef")) for c in tasks}
        return self._waits

    def own(self, path: str | None) -> str | None:
        """Return the path of a container unless an export put it on top of the project."""
        return None if path in self.added else path

    def beside(self, container: Container, kind: str) -> list[Container]:
        """Return the containers of a definition in the module configuration that holds `container`."""
        inside = (self.by_path.get(node.path) for node in _module_of(container.node).inside(_CONTAINER))
        return [found for found in inside if found is not None and found.kind == kind]

    def below(self, container: Container) -> Iterator[Container]:
        """Yield the container and everything inside it."""
        yield container
        for node in container.node.inside(_CONTAINER):
            if node.path in self.by_path:
                yield from self.below(self.by_path[node.path])


def _module_of(node: Node) -> Node:
    """Return the module configuration that holds a container."""
    while node.parent is not None and node.tag != _MODULE:
        node = node.parent
    return node


def standard_modules(tree: Tree) -> dict[str, str]:
    """Return which standard module each module configuration (path) is of.

    One that is of a standard module by its containers only does not count beside one that is by its definition: it
    adds to that what a vendor's tool, or a simulator, needs.
    """
    found: dict[str, str] = {}
    others: list[tuple[Node, str]] = []
    for node in tree.tagged(_MODULE):
        definition = _first_definition(node)
        inside = (steps_of(_first_definition(container))[-1] for container in node.inside(_CONTAINER))
        module = module_with(definition, ()) or module_with("", inside)
        if module and module == module_with(definition, ()):
            found[node.path] = module
        elif module:
            others.append((node, module))
    taken = {(path.rpartition("/")[0], module) for path, module in found.items()}
    others = [(node, module) for node, module in others if (node.path.rpartition("/")[0], module) not in taken]
    return found | {node.path: module for node, module in others}


def _first_definition(node: Node) -> str:
    """Return the definition that the first part of a node states; contradictions count only where it is used."""
    return next((element.text or "" for element, _ in node.elements("DEFINITION-REF")), "")


def symbolic_values(tree: Tree) -> dict[str, list[Stated]]:
    """Return the values of every numerical ECU configuration parameter by the short name of its definition.

    Some BSW module descriptions state a period as the name of the parameter that holds it.
    """
    found = {name: list(texts) for name, texts in tree.symbols.items()}
    for node in tree.tagged(_CONTAINER):
        for name, element, file in _by_definition(node, "PARAMETER-VALUES/*"):
            if name and (text := child_text(element, "VALUE").strip()):
                found.setdefault(name, []).append(Stated(text, place(element, file)))
    return found
