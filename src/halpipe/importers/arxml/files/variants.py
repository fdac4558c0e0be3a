"""One variant of a product line: elements whose conditions do not hold are taken out, and formulas become values.

An element with a VARIATION-POINT exists if its SW-SYSCOND is not 0 and each of its POST-BUILD-VARIANT-CONDITIONs is
the value of its criterion; so does what is in it. BINDING-TIME says when that is decided, not whether.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, Location
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.formulas import FormulaError, UnsetError, evaluate, is_true
from halpipe.importers.arxml.files.words import NS, parse_number, path_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from fractions import Fraction

    from lxml import etree

    from halpipe.importers.arxml.files.bases import Bases
    from halpipe.importers.arxml.files.formulas import Value
    from halpipe.importers.arxml.files.sniff import Document

_SETS = {
    "SW-SYSTEMCONSTANT-VALUE-SET": ("SW-SYSTEMCONST-VALUE", "SW-SYSTEMCONST-REF"),
    "POST-BUILD-VARIANT-CRITERION-VALUE-SET": ("POST-BUILD-VARIANT-CRITERION-VALUE", "VARIANT-CRITERION-REF"),
}
_CONSTANTS = ("SW-SYSTEMCONST", "POST-BUILD-VARIANT-CRITERION")
_REFS = ("SYSC-REF", "SYSC-STRING-REF")
_MAX_ROUNDS = 40
_PATHS = ("EVALUATED-VARIANT-REF", "INCLUDED-VARIANT-REF", "MATCHING-CRITERION-REF", "SW-SYSTEMCONST-REF")
_CONDITIONS = (NS + "SW-SYSCOND", NS + "POST-BUILD-VARIANT-CONDITION")


@record
class Choice:
    """Choice of the user: the name of a variant, and ``NAME=VALUE`` of constants and criteria; nothing by default."""

    variant: str = ""
    conditions: tuple[str, ...] = ()

    @property
    def is_made(self) -> bool:
        """Whether variation points are to be evaluated."""
        return bool(self.variant or self.conditions)


@record
class Removed:
    """An element that is not in the variant: its tag, its path, and where it stands."""

    tag: str
    path: str
    at: Location


def apply_variant(documents: Sequence[Document], choice: Choice, bases: Bases, findings: Findings) -> list[Removed]:
    """Take out of the documents what is not in the chosen variant; return it.

    Raise `HalpipeError` for an unknown variant, and with every condition that cannot be decided.
    """
    tags = (*_REFS, *_PATHS, "VARIANT-CRITERION-REF", *(f"{tag}-REF" for tag in _SETS))
    for document in documents:
        for ref in document.root.iter(*(NS + tag for tag in tags)):
            ref.text = bases.absolute(ref)[0]
    values = _Chooser(documents, findings).values(choice)
    findings.stop_on_errors()
    removed = [found for document in documents for found in _prune(document, values, findings)]
    findings.stop_on_errors()
    return removed


def conditional(document: Document) -> list[tuple[str, Location]]:
    """Return what depends on a variation point, or is a formula, by name and place."""
    found = []
    for point in document.root.iter(NS + "VARIATION-POINT"):
        holder = point.getparent()
        if holder is not None and next(point.iter(*_CONDITIONS), None) is not None:
            found.append((_name(holder), Location(document.name, point.sourceline or 0)))
    for element in _formulas(document.root):
        found.append((_name(element), Location(document.name, element.sourceline or 0)))
    return found


def _name(element: etree._Element) -> str:
    """Return what an element is called: the last step of its path, or its definition, or the tag."""
    stated = element.findtext(NS + "SHORT-NAME") or (element.findtext(NS + "DEFINITION-REF") or "").rpartition("/")[2]
    if stated:
        return stated.strip()
    holder = element.getparent()
    tag: str = element.tag
    return tag.removeprefix(NS) if holder is None else f"{_name(holder)}/{tag.removeprefix(NS)}"


class _Chooser:
    """Finds the value sets of a variant, and the constants of conditions."""

    def __init__(self, documents: Sequence[Document], findings: Findings) -> None:
        self._findings = findings
        self._by_path: dict[str, list[tuple[etree._Element, Location]]] = {}
        self._formulas: list[tuple[str, etree._Element, Location]] = []
        tags = ("PREDEFINED-VARIANT", "EVALUATED-VARIANT-SET", *_SETS, *_CONSTANTS)
        for document in documents:
            for element in document.root.iter(*(NS + tag for tag in tags)):
                at = Location(document.name, element.sourceline or 0)
                self._by_path.setdefault(path_of(element), []).append((element, at))
        self._values: dict[str, Value] = {}
        self._sources: dict[str, str] = {}

    def values(self, choice: Choice) -> dict[str, Value]:
        """Return the values that a choice gives constants and criteria, by path."""
        if choice.variant:
            self._add_variant(choice.variant)
        for condition in choice.conditions:
            self._add_condition(condition)
        self._evaluate()
        return self._values

    def _evaluate(self) -> None:
        """Evaluate the formulas that value sets state as values, those first whose constants are known."""
        for _ in range(_MAX_ROUNDS):
            formulas, self._formulas = self._formulas, []
            for path, element, at in formulas:
                try:
                    self._set(path, evaluate(element, self._values.get), at)
                except UnsetError:
                    self._formulas.append((path, element, at))
                except FormulaError as failure:
                    _report_formula(failure, path, at, self._findings)

    def _tagged(self, *tags: str) -> list[str]:
        wanted = [NS + tag for tag in tags]
        return [path for path, parts in self._by_path.items() if parts[0][0].tag in wanted]

    def _named(self, name: str, *tags: str) -> list[str]:
        return [path for path in self._tagged(*tags) if name in (path, path.rpartition("/")[2])]

    def _add_variant(self, name: str) -> None:
        found = self._named(name, "PREDEFINED-VARIANT")
        for path in self._named(name, "EVALUATED-VARIANT-SET") if not found else ():
            refs = (r for element, _ in self._by_path[path] for r in element.iter(NS + "EVALUATED-VARIANT-REF"))
            found += dict.fromkeys(ref.text or "" for ref in refs)
        if len(found) != 1:
            known = sorted(
                path.rpartition("/")[2] for path in self._tagged("PREDEFINED-VARIANT", "EVALUATED-VARIANT-SET")
            )
            among = f"the variants are {', '.join(known) or 'none'}"
            several = f'"{name}" could be {", ".join(found)}' if found else f'there is no variant "{name}"'
            at = self._by_path[found[0]][0][1] if found and found[0] in self._by_path else Location()
            help = "name one of them by its path" if found else did_you_mean(name, known, among)
            self._findings.report(codes.UNKNOWN_VARIANT, several, at=at, help=help)
            return
        included = [found[0]]
        for path in included:
            included += [inner for inner in dict.fromkeys(self._include(path)) if inner not in included]

    def _include(self, path: str) -> list[str]:
        """Take a value set; return the value sets and the variants that a predefined variant includes."""
        if path not in self._by_path:
            message = f"{path} is in no file"
            self._findings.report(codes.UNKNOWN_VARIANT, message, help="add the file that defines it to the import")
            return []
        found: list[str] = []
        for element, at in self._by_path[path]:
            tag = str(element.tag).removeprefix(NS)
            if tag in _SETS:
                self._take(element, at, *_SETS[tag])
            else:
                refs = [r for kind in ("INCLUDED-VARIANT", *_SETS) for r in element.iter(f"{NS}{kind}-REF")]
                found += [ref.text or "" for ref in refs]
        return found

    def _take(self, element: etree._Element, at: Location, tag: str, ref_tag: str) -> None:
        for entry in element.iter(NS + tag):
            path, value = entry.findtext(NS + ref_tag) or "", entry.find(NS + "VALUE")
            place = Location(at.file, entry.sourceline or 0)
            stated = "" if value is None else (value.text or "").strip()
            number = parse_number(stated)
            if value is not None and len(value):
                self._formulas.append((path, value, place))
            else:
                self._set(path, stated if number is None else number, place)

    def _add_condition(self, text: str) -> None:
        name, sign, stated = text.partition("=")
        found = self._named(name.strip(), *_CONSTANTS)
        number = parse_number(stated)
        if not sign or len(found) != 1:
            known = sorted(path.rpartition("/")[2] for path in self._tagged(*_CONSTANTS))
            what = f'"{text}" is no NAME=VALUE' if not sign else f'there is no constant or criterion "{name}"'
            if len(found) > 1:
                what = f'"{name}" could be {", ".join(found)}'
            help = did_you_mean(name, known, f"known are {', '.join(known) or 'none'}")
            self._findings.report(codes.UNKNOWN_VARIANT, what, help=help, path=f"--condition {text}")
            return
        self._set(found[0], stated.strip() if number is None else number, Location(), f"--condition {text}")

    def _set(self, path: str, value: Value, at: Location, source: str = "") -> None:
        known = self._values.setdefault(path, value)
        where = self._sources.setdefault(path, source or str(at))
        if known != value:
            message = f"is {value} here, but {known} at {where}"
            help = "take one of the two value sets out of the variant"
            self._findings.report(codes.TWO_VALUES, message, at=at, path=path, help=help)


# ------------------------------------------------------------------------------------------------------- removal


def _prune(document: Document, values: Mapping[str, Value], findings: Findings) -> Iterator[Removed]:
    """Remove what does not exist, outermost first, and put the values of formulas in their place."""
    for point in list(document.root.iter(NS + "VARIATION-POINT")):
        holder = point.getparent()
        outer = holder.getparent() if holder is not None else None
        if holder is None or outer is None or all(ancestor is not document.root for ancestor in holder.iterancestors()):
            continue
        if not _exists(point, values, document.name, findings):
            for short_name in holder.iter(NS + "SHORT-NAME"):
                element = short_name.getparent()
                assert element is not None
                at = Location(document.name, element.sourceline or 0)
                yield Removed(str(element.tag).removeprefix(NS), path_of(element), at)
            outer.remove(holder)
    for element in _formulas(document.root):
        value = _value(element, values, document.name, findings)
        for child in list(element):
            element.remove(child)
        if value is not None:
            element.text = value if isinstance(value, str) else _decimal(value)


def _decimal(value: Fraction) -> str:
    """Return an exact value as a number of AUTOSAR: a decimal if there is one, else its 30 first digits."""
    digits = 0
    while value.denominator != 1 and digits < 30:
        value, digits = value * 10, digits + 1
    return f"{value.numerator // value.denominator}E-{digits}" if digits else str(value.numerator)


def _formulas(root: etree._Element) -> list[etree._Element]:
    """Return the elements whose value is a formula, other than conditions."""
    found: dict[etree._Element, None] = {}
    for ref in root.iter(*(NS + tag for tag in _REFS)):
        holder = ref.getparent()
        if holder is not None and holder.tag != NS + "SW-SYSCOND":
            found[holder] = None
    return list(found)


def _exists(point: etree._Element, values: Mapping[str, Value], file: str, findings: Findings) -> bool:
    for condition in point.iter(NS + "SW-SYSCOND"):
        value = _value(condition, values, file, findings)
        if value is not None and not is_true(value):
            return False
    for condition in point.iter(NS + "POST-BUILD-VARIANT-CONDITION"):
        path = condition.findtext(NS + "MATCHING-CRITERION-REF") or ""
        wanted = condition.find(NS + "VALUE")
        stated = values.get(path)
        if stated is None:
            _report_unset(path, Location(file, condition.sourceline or 0), findings)
        elif wanted is not None and _value(wanted, values, file, findings) != stated:
            return False
    return True


def _value(element: etree._Element, values: Mapping[str, Value], file: str, findings: Findings) -> Value | None:
    at = Location(file, element.sourceline or 0)
    try:
        return evaluate(element, values.get)
    except UnsetError as unset:
        _report_unset(str(unset), at, findings)
    except FormulaError as failure:
        _report_formula(failure, path_of(element), at, findings)
    return None


def _report_formula(failure: FormulaError, path: str, at: Location, findings: Findings) -> None:
    findings.report(codes.BAD_FORMULA, str(failure), at=at, path=path, help="correct the formula in its source")


def _report_unset(path: str, at: Location, findings: Findings) -> None:
    name = path.rpartition("/")[2]
    message = f"{path} has no value"
    help = f"choose a variant that sets it, or add --condition {name}=VALUE"
    findings.report(codes.UNSET_CONSTANT, message, at=at, path=path, help=help)
