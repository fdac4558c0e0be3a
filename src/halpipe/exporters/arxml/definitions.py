"""Definitions of modules (ECUC-MODULE-DEF): ECU configurations completed by them, and checked as in a configurator.

A module is found by the path of its definition, or by the standard module that a definition refines. What is checked:
names, multiplicities, ranges, words of enumerations, and what references lead to, as far as it is in the file.
Published information is a part of the module, not of its configuration. Configurations beside the definitions (a
vendor's preconfiguration, the user's project) state what must be there and no definition proposes.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Findings, HalpipeError, Location, error, named, warning
from halpipe.core.files import find_inputs, parse_xml, read_bytes
from halpipe.exporters.arxml.document import CONTAINER, MODULE, Box, Reference
from halpipe.exporters.arxml.software import ShortNames

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from lxml import etree


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
NO_VALUE = error(
    "HAL1491",
    "Mandatory part of a configuration has no value",
    "A definition demands a parameter, reference or container and proposes no value for it: only the controller, the "
    "vendor's preconfiguration or the project decides it, and nothing is invented. A configuration of the module "
    "(ECUC-MODULE-CONFIGURATION-VALUES) among the files of `--ecuc-definitions` states it. Only what must be there is "
    "taken from such a configuration.",
)
CONTRADICTION = error(
    "HAL1492",
    "Configurations state different values of a parameter",
    "Several configurations of a module are among the files of `--ecuc-definitions`, as the preconfigurations of "
    "several controllers are, and a parameter or reference that must be there once differs between them.",
)

_NS = "{http://autosar.org/schema/r4.0}"
_CONTAINER_DEFS = ("ECUC-PARAM-CONF-CONTAINER-DEF", "ECUC-CHOICE-CONTAINER-DEF")
_GROUPS = ("CONTAINERS", "SUB-CONTAINERS", "CHOICES", "PARAMETERS", "REFERENCES")
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
    """The definitions of modules by path, also of the standard modules that they refine, and configurations."""

    def __init__(self, modules: dict[str, Definition], configurations: Sequence[etree._Element]) -> None:
        self._modules = modules
        self._configurations = configurations

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

    def complete(self, box: Box, findings: Findings) -> None:
        """Add to the configuration of a module what it must have, as files state it or the vendor proposes it.

        A container of which some part is unknown is left out as a whole.
        """
        definition = self.of(box.definition)
        if definition is None:
            return
        holder = box.path.rpartition("/")[0]
        moved = {_path(element): f"{holder}/{_name_of(element)}" for element in self._configurations}
        stated = [e for e in self._configurations if self.of(_text(e, "DEFINITION-REF")) is definition]
        for path in _Completion(moved, findings).run(box, definition, stated):
            help = f"state it in a configuration by {box.definition}, in an ARXML file that --ecuc-definitions names"
            findings.report(NO_VALUE, f"nothing states {path}", path=named(MODULE, box.path), help=help)


class _Completion:
    """Completes containers of an export; `moved` are the modules of an export by the paths of their configurations."""

    def __init__(self, moved: dict[str, str], findings: Findings) -> None:
        self._moved = moved
        self._findings = findings

    def run(self, box: Box, definition: Definition, stated: Sequence[etree._Element]) -> list[str]:
        """Complete a container with its counterparts in configurations; return the definitions of what it lacks."""
        lacking = []
        for inner in box.inside.values():
            known = definition.inside.get(inner.kind)
            if known is not None:
                alike = _containers(stated, inner.kind)
                name = next(iter(alike), "") if known.upper == 1 else inner.path.rpartition("/")[2]
                lacking += self.run(inner, known, alike.get(name, ()))
        present = {inner.kind for inner in box.inside.values()}
        present |= {*(name for _, _, name, _ in box.values), *(reference.name for reference in box.refs)}
        for part in definition.inside.values():
            if part.lower and not part.is_published and part.name not in present:
                lacking += self._add(box, part, stated)
        return lacking

    def _add(self, box: Box, part: Definition, stated: Sequence[etree._Element]) -> list[str]:
        """Add what must be in a container, and is not; return what is unknown of it, then it stays out as a whole."""
        if part.tag not in _CONTAINER_DEFS:
            return [] if self._add_values(box, part, stated) else [f"{box.definition}/{part.name}"]
        if part.tag != _CONTAINER_DEFS[0]:
            return [f"{box.definition}/{part.name}"]
        lacking = []
        for name, alike in (_containers(stated, part.name) or {ShortNames(*box.inside)(part.name): []}).items():
            if name in box.inside:
                lacking.append(f'{box.definition}/{part.name} under a name that is free, unlike "{name}"')
                continue
            missing = self.run(box.new(name, part.name), part, alike)
            if missing:
                del box.inside[name]
            lacking += missing
        return lacking

    def _add_values(self, box: Box, part: Definition, stated: Sequence[etree._Element]) -> bool:
        kind = part.tag.removeprefix("ECUC-").removesuffix("-PARAM-DEF")
        found: dict[object, tuple[str, etree._Element]] = {}
        for element in stated:
            for value in (*element.iterfind(f"{_NS}PARAMETER-VALUES/*"), *element.iterfind(f"{_NS}REFERENCE-VALUES/*")):
                text = _text(value, "VALUE-REF") or (value.findtext(_NS + "VALUE") or "").strip()
                if text and _name_of(value) == part.name:
                    found.setdefault(_meaning(kind, text), (text, value))
        if part.upper == 1 and len(found) > 1:
            places = [f'"{text}" ({v.getroottree().docinfo.URL}:{v.sourceline})' for text, v in found.values()]
            message, help = f"{part.name} is {', '.join(places)}", "give --ecuc-definitions the files of one controller"
            self._findings.report(CONTRADICTION, message, path=named(CONTAINER, box.path), help=help)
        form = "NUMERICAL" if kind in _NUMERICAL else "TEXTUAL"
        for text, value in found.values():
            target = value.find(_NS + "VALUE-REF")
            if target is None:
                box.values.append((form, kind, part.name, text))
            else:
                moved = self._target(text)
                dest = CONTAINER if moved != text else target.get("DEST", CONTAINER)
                box.refs.append(Reference(part.name, moved, part.tag, dest))
        if part.default and not found:
            box.values.append((form, kind, part.name, part.default))
        return bool(found or part.default)

    def _target(self, path: str) -> str:
        """Return where the target of a configuration's reference is in the export."""
        for known, moved in self._moved.items():
            if path.startswith(f"{known}/"):
                return moved + path.removeprefix(known)
        return path


def _meaning(kind: str, text: str) -> object:
    """Return what is equal for equal values: tools write 1 and true, 8 and 8.0."""
    number = _number({"true": "1", "false": "0"}.get(text, text))
    return number if kind in _NUMERICAL and number is not None else text


def _containers(stated: Sequence[etree._Element], kind: str) -> dict[str, list[etree._Element]]:
    """Return the containers of a definition in configurations, by short name."""
    found: dict[str, list[etree._Element]] = {}
    for element in stated:
        for group in ("CONTAINERS", "SUB-CONTAINERS"):
            for inner in element.iterfind(f"{_NS}{group}/{_NS}{CONTAINER}"):
                if _name_of(inner) == kind:
                    found.setdefault(_text(inner, "SHORT-NAME"), []).append(inner)
    return found


def read_definitions(paths: Sequence[str]) -> Definitions:
    """Read definitions and configurations of modules; raise `HalpipeError` if files are given, but define none."""
    found: dict[str, Definition] = {}
    configurations: list[etree._Element] = []
    for name in find_inputs(paths, (".arxml", ".bmd")):
        root = parse_xml(read_bytes(name), name, long_texts=True)
        found |= _modules_of(root)
        root.getroottree().docinfo.URL = name
        configurations += root.iter(_NS + MODULE)
    if paths and not found:
        raise HalpipeError(NO_DEFINITIONS("no file of it defines a module", at=Location(paths[0])))
    return Definitions(found, configurations)


def _modules_of(root: etree._Element) -> dict[str, Definition]:
    found: dict[str, Definition] = {}
    for element in root.iter(_NS + "ECUC-MODULE-DEF"):
        definition = _read(element)
        definition.path = _path(element)
        found[definition.path] = definition
        refined = _text(element, "REFINED-MODULE-DEF-REF")
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
    upper = _number(_text(element, "UPPER-MULTIPLICITY"))
    is_any = (
        _text(element, "UPPER-MULTIPLICITY-INFINITE") in ("true", "1") or _text(element, "UPPER-MULTIPLICITY") == "*"
    )
    lower = _number(_text(element, "LOWER-MULTIPLICITY"))
    literals = element.iterfind(f"{_NS}LITERALS/*/{_NS}SHORT-NAME")
    definition = Definition(
        name=_text(element, "SHORT-NAME"),
        tag=str(element.tag).removeprefix(_NS),
        lower=1 if lower is None else int(lower),
        upper=None if is_any else 1 if upper is None else int(upper),
        least=_number(_text(element, "MIN")),
        most=_number(_text(element, "MAX")),
        words=tuple((literal.text or "").strip() for literal in literals),
        target=_text(element, "DESTINATION-REF").rpartition("/")[2],
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
        self._modules = [_path(module) for module in root.iter(_NS + MODULE)]
        self._kinds = {_path(c): _name_of(c) for c in root.iter(_NS + CONTAINER)}

    def run(self) -> Iterator[Diagnostic]:
        for module in self._root.iter(_NS + MODULE):
            path = _text(module, "DEFINITION-REF")
            definition = self._definitions.of(path)
            if definition is None:
                yield _misfit(module, f"no definition of {path} is known")
                continue
            yield from self._inside(module, definition, "CONTAINERS", is_whole=not self._is_part)

    def _inside(
        self, element: etree._Element, definition: Definition, group: str, *, is_whole: bool
    ) -> Iterator[Diagnostic]:
        parts = [
            *element.iterfind(f"{_NS}{group}/{_NS}{CONTAINER}"),
            *element.iterfind(f"{_NS}PARAMETER-VALUES/*"),
            *element.iterfind(f"{_NS}REFERENCE-VALUES/*"),
        ]
        counts = Counter(map(_name_of, parts))
        for name, count in counts.items():
            known = definition.inside.get(name)
            if known is None:
                yield _misfit(element, f"{definition.name} has no {name}")
            elif known.upper is not None and count > known.upper:
                yield _misfit(element, f"has {count} {name}, of which there may be {known.upper}")
        if is_whole:
            yield from self._missing(element, definition, counts)
        for part in parts:
            known = definition.inside.get(_name_of(part))
            if known is not None and known.tag in _CONTAINER_DEFS:
                yield from self._inside(part, known, "SUB-CONTAINERS", is_whole=is_whole or _is_added(part))
            elif known is not None:
                yield from self._value(element, part, known)

    def _missing(self, element: etree._Element, definition: Definition, counts: Counter[str]) -> Iterator[Diagnostic]:
        if definition.tag == "ECUC-CHOICE-CONTAINER-DEF":
            if sum(counts.values()) != 1:
                yield _misfit(element, f"has {sum(counts.values())} of its choices, not 1")
            return
        for name, known in definition.inside.items():
            if counts[name] < known.lower and not known.is_published:
                yield _misfit(element, f"has {counts[name]} {name}, of which there must be {known.lower}")

    def _value(self, element: etree._Element, part: etree._Element, known: Definition) -> Iterator[Diagnostic]:
        text = (part.findtext(_NS + "VALUE") or "").strip()
        if known.words and text not in known.words:
            yield _misfit(element, f'{known.name} is "{text}", not one of {", ".join(known.words)}')
        elif known.tag in ("ECUC-INTEGER-PARAM-DEF", "ECUC-FLOAT-PARAM-DEF"):
            number = _number(text)
            low = known.least is not None and number is not None and number < known.least
            high = known.most is not None and number is not None and number > known.most
            if number is None or low or high:
                yield _misfit(element, f"{known.name} is {text}, outside of {known.least or 0} to {known.most}")
        elif known.tag == "ECUC-BOOLEAN-PARAM-DEF" and text not in _FLAGS:
            yield _misfit(element, f'{known.name} is "{text}", neither true nor false')
        target = _text(part, "VALUE-REF")
        kind = self._kinds.get(target)
        if kind is not None and known.target and kind != known.target:
            yield _misfit(element, f"{known.name} leads to {target}, which is no {known.target}")
        elif kind is None and not self._is_part and any(target.startswith(f"{path}/") for path in self._modules):
            yield _misfit(element, f"{known.name} leads to {target}, which is not in the configuration")


def _is_added(container: etree._Element) -> bool:
    """Whether an export put a container on top of a project."""
    return any((data.get("GID") or "") == "halpipe:delta" for data in container.iterfind(f"{_NS}ADMIN-DATA//{_NS}SDG"))


def _name_of(element: etree._Element) -> str:
    return _text(element, "DEFINITION-REF").rpartition("/")[2]


def _text(element: etree._Element, tag: str) -> str:
    """Return the text of a child without blanks, empty for none."""
    return "".join((element.findtext(_NS + tag) or "").split())


def _misfit(element: etree._Element, message: str) -> Diagnostic:
    help = "choose the options of the export for the vendor's tools, or complete the configuration by hand"
    return AGAINST_DEFINITION(message, path=named(str(element.tag).removeprefix(_NS), _path(element)), help=help)
