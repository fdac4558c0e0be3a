"""Definitions of modules (ECUC-MODULE-DEF): ECU configurations completed by them, and checked as in a configurator.

A module is found by the path of its definition, or by the standard module that a definition refines. What is checked:
names, multiplicities, ranges, words of enumerations, and what references lead to, as far as it is in the file.
Published information is a part of the module, not of its configuration.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, Location, error, named, warning
from halpipe.core.files import find_inputs, parse_xml, read_bytes

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from lxml import etree

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.exporters.arxml.document import Box

NO_DEFINITIONS = error(
    "HAL0870",
    "No definitions of the modules to be written",
    "`--ecuc-definitions` names ARXML files (in EB tresos: .bmd), or folders of them, with the ECUC-MODULE-DEFs of Os, "
    "Rte and EcuC that a vendor ships with its tools.",
)
AGAINST_DEFINITION = warning(
    "HAL0871",
    "Configuration does not fit the definition of its module",
    "A definition says which containers and parameters a module may and must have, how many of each, and what values. "
    "The vendor's configurator refuses what does not fit, or drops it.",
)

_NS = "{http://autosar.org/schema/r4.0}"
_CONTAINER_DEFS = ("ECUC-PARAM-CONF-CONTAINER-DEF", "ECUC-CHOICE-CONTAINER-DEF")
_GROUPS = ("CONTAINERS", "SUB-CONTAINERS", "CHOICES", "PARAMETERS", "REFERENCES")
_MODULE, _CONTAINER = "ECUC-MODULE-CONFIGURATION-VALUES", "ECUC-CONTAINER-VALUE"
_FLAGS = ("true", "false", "1", "0")
_NUMERICAL = ("BOOLEAN", "FLOAT", "INTEGER")
_NUMBER = re.compile(r"[+-]?[0-9]{1,40}(\.[0-9]{0,40})?([eE][+-]?[0-9]{1,3})?")


@dataclass(slots=True)
class Definition:
    """Definition of a module, container, parameter or reference; `upper` None is any number, `inside` goes by name.

    `path` is that of a module, `default` the value that the vendor proposes (empty: none).
    """

    name: str
    tag: str
    lower: int = 1
    upper: int | None = 1
    least: Fraction | None = None
    most: Fraction | None = None
    words: tuple[str, ...] = ()
    target: str = ""
    path: str = ""
    default: str = ""
    is_published: bool = False
    inside: dict[str, Definition] = field(default_factory=dict)


class Definitions:
    """The definitions of modules, by their paths and by the standard modules that they refine."""

    def __init__(self, modules: dict[str, Definition]) -> None:
        self._modules = modules

    def of(self, path: str) -> Definition | None:
        """Return the definition of a module: that of its path, else the only one of its name."""
        name = path.rpartition("/")[2]
        alike = [d for known, d in self._modules.items() if known.rpartition("/")[2] == name]
        return self._modules.get(path) or (alike[0] if alike else None)

    def has(self, path: str, *, otherwise: bool) -> bool:
        """Return whether a module defines what a path, which begins with it, leads to; `otherwise` if it is unknown."""
        module, *steps = path.split("/")
        known = self.of(module)
        if known is None:
            return otherwise
        for step in steps:
            known = known.inside.get(step) if known is not None else None
        return known is not None and known.upper != 0


def complete(box: Box, definition: Definition) -> bool:
    """Add to a container what it must have, as far as the vendor proposes values; return whether it has all then.

    A container of which only the tool, or the user, knows some part is left out as a whole.
    """
    is_whole = True
    for inner in box.inside.values():
        if inner.kind in definition.inside:
            complete(inner, definition.inside[inner.kind])
    stated = {inner.kind for inner in box.inside.values()}
    stated |= {*(name for _, _, name, _ in box.values), *(reference.name for reference in box.refs)}
    for part in definition.inside.values():
        if not part.lower or part.is_published or part.name in stated:
            continue
        if part.default:
            kind = part.tag.removeprefix("ECUC-").removesuffix("-PARAM-DEF")
            box.values.append(("NUMERICAL" if kind in _NUMERICAL else "TEXTUAL", kind, part.name, part.default))
        elif part.tag != _CONTAINER_DEFS[0] or part.name in box.inside:
            is_whole = False
        elif not complete(box.new(part.name, part.name), part):
            del box.inside[part.name]
            is_whole = False
    return is_whole


def read_definitions(paths: Sequence[str]) -> Definitions:
    """Read the modules that files define; raise `HalpipeError` if files are given, but define none."""
    found: dict[str, Definition] = {}
    for name in find_inputs(paths, (".arxml", ".bmd")):
        found |= _modules_of(parse_xml(read_bytes(name), name, long_texts=True))
    if paths and not found:
        raise HalpipeError(NO_DEFINITIONS("no file of it defines a module", at=Location(paths[0])))
    return Definitions(found)


def _modules_of(root: etree._Element) -> dict[str, Definition]:
    found: dict[str, Definition] = {}
    for element in root.iter(_NS + "ECUC-MODULE-DEF"):
        definition = _read(element)
        definition.path = _path(element)
        found[definition.path] = definition
        refined = "".join((element.findtext(_NS + "REFINED-MODULE-DEF-REF") or "").split())
        if refined:
            found.setdefault(refined, definition)
    return found


def _number(text: str) -> Fraction | None:
    """Return a number as definitions write it, None for none, or one without a limit."""
    return Fraction(text) if _NUMBER.fullmatch(text) else None


def _path(element: etree._Element) -> str:
    names = [(e.findtext(_NS + "SHORT-NAME") or "").strip() for e in (element, *element.iterancestors())]
    return "/" + "/".join(name for name in reversed(names) if name)


def _read(element: etree._Element) -> Definition:
    def text(tag: str) -> str:
        return "".join((element.findtext(_NS + tag) or "").split())

    upper = _number(text("UPPER-MULTIPLICITY"))
    is_any = text("UPPER-MULTIPLICITY-INFINITE") in ("true", "1") or text("UPPER-MULTIPLICITY") == "*"
    lower = _number(text("LOWER-MULTIPLICITY"))
    literals = element.iterfind(f"{_NS}LITERALS/*/{_NS}SHORT-NAME")
    definition = Definition(
        name=text("SHORT-NAME"),
        tag=str(element.tag).removeprefix(_NS),
        lower=1 if lower is None else int(lower),
        upper=None if is_any else 1 if upper is None else int(upper),
        least=_number(text("MIN")),
        most=_number(text("MAX")),
        words=tuple((literal.text or "").strip() for literal in literals),
        target=text("DESTINATION-REF").rpartition("/")[2],
        default=(element.findtext(_NS + "DEFAULT-VALUE") or "").strip(),
    )
    for group in _GROUPS:
        for child in element.iterfind(f"{_NS}{group}/*"):
            inner = _read(child)
            definition.inside[inner.name] = inner
    classes = [e.text for e in element.iterfind(f"{_NS}IMPLEMENTATION-CONFIG-CLASSES/*/{_NS}CONFIG-CLASS")]
    parts = definition.inside.values()
    definition.is_published = "PUBLISHED-INFORMATION" in classes or (bool(parts) and all(p.is_published for p in parts))
    return definition


# ---------------------------------------------------------------------------------------------------------- checks


def check(document: bytes, definitions: Definitions, *, is_part: bool = False) -> list[Diagnostic]:
    """Return what of a document does not fit the definitions; of a part, only containers that it adds are complete."""
    return list(_Check(parse_xml(document, "export", long_texts=True), definitions, is_part=is_part).run())


class _Check:
    def __init__(self, root: etree._Element, definitions: Definitions, *, is_part: bool) -> None:
        self._root = root
        self._definitions = definitions
        self._is_part = is_part
        self._kinds = {_path(c): _name_of(c) for c in root.iter(_NS + _CONTAINER)}

    def run(self) -> Iterator[Diagnostic]:
        for module in self._root.iter(_NS + _MODULE):
            path = "".join((module.findtext(_NS + "DEFINITION-REF") or "").split())
            definition = self._definitions.of(path)
            if definition is None:
                yield _told(module, f"no definition of {path} is known")
                continue
            yield from self._inside(module, definition, "CONTAINERS", is_whole=not self._is_part)

    def _inside(
        self, element: etree._Element, definition: Definition, group: str, *, is_whole: bool
    ) -> Iterator[Diagnostic]:
        parts = [
            *element.iterfind(f"{_NS}{group}/{_NS}{_CONTAINER}"),
            *element.iterfind(f"{_NS}PARAMETER-VALUES/*"),
            *element.iterfind(f"{_NS}REFERENCE-VALUES/*"),
        ]
        counts = Counter(map(_name_of, parts))
        for name, count in counts.items():
            known = definition.inside.get(name)
            if known is None:
                yield _told(element, f"{definition.name} has no {name}")
            elif known.upper is not None and count > known.upper:
                yield _told(element, f"has {count} {name}, of which there may be {known.upper}")
        yield from _missing(element, definition, counts) if is_whole else ()
        for part in parts:
            known = definition.inside.get(_name_of(part))
            if known is not None and known.tag in _CONTAINER_DEFS:
                yield from self._inside(part, known, "SUB-CONTAINERS", is_whole=is_whole or _is_added(part))
            elif known is not None:
                yield from self._value(element, part, known)

    def _value(self, element: etree._Element, part: etree._Element, known: Definition) -> Iterator[Diagnostic]:
        text = (part.findtext(_NS + "VALUE") or "").strip()
        if known.words and text not in known.words:
            yield _told(element, f'{known.name} is "{text}", not one of {", ".join(known.words)}')
        elif known.tag in ("ECUC-INTEGER-PARAM-DEF", "ECUC-FLOAT-PARAM-DEF"):
            number = _number(text)
            low = known.least is not None and number is not None and number < known.least
            high = known.most is not None and number is not None and number > known.most
            if number is None or low or high:
                yield _told(element, f"{known.name} is {text}, outside of {known.least or 0} to {known.most}")
        elif known.tag == "ECUC-BOOLEAN-PARAM-DEF" and text not in _FLAGS:
            yield _told(element, f'{known.name} is "{text}", neither true nor false')
        target = "".join((part.findtext(_NS + "VALUE-REF") or "").split())
        kind = self._kinds.get(target)
        if kind is not None and known.target and kind != known.target:
            yield _told(element, f"{known.name} leads to {target}, which is no {known.target}")


def _missing(element: etree._Element, definition: Definition, counts: Counter[str]) -> Iterator[Diagnostic]:
    if definition.tag == "ECUC-CHOICE-CONTAINER-DEF":
        if sum(counts.values()) != 1:
            yield _told(element, f"has {sum(counts.values())} of its choices, not 1")
        return
    for name, known in definition.inside.items():
        if counts[name] < known.lower and not known.is_published:
            yield _told(element, f"has {counts[name]} {name}, of which there must be {known.lower}")


def _is_added(container: etree._Element) -> bool:
    """Whether an export put a container on top of a project."""
    return any((data.get("GID") or "") == "halpipe:delta" for data in container.iterfind(f"{_NS}ADMIN-DATA//{_NS}SDG"))


def _name_of(element: etree._Element) -> str:
    return "".join((element.findtext(_NS + "DEFINITION-REF") or "").split()).rpartition("/")[2]


def _told(element: etree._Element, message: str) -> Diagnostic:
    help = "choose the options of the export for the vendor's tools, or complete the configuration by hand"
    return AGAINST_DEFINITION(message, path=named(str(element.tag).removeprefix(_NS), _path(element)), help=help)
