"""All files as one forest of items: every element with its class, its place, its references and its quantities.

References are ``encoded+name?type=Class`` (several, blank-separated), opaque ids (ITEA), or child elements with an
``href`` (to other files, whatever their name). All are looked up in all files together. Quantities are a number, an
integer or a Java double (``2.0``, ``1.0E8``), and a unit; one that is left out has the default of older versions.
"""

from __future__ import annotations

import re
from fractions import Fraction
from typing import TYPE_CHECKING, NoReturn
from urllib.parse import unquote_plus

from halpipe.core.diagnostics import Code, Findings, HalpipeError, Location, Path, Severity, Subject, named
from halpipe.core.durations import Duration
from halpipe.core.files import TOO_MUCH
from halpipe.core.quantities import quoted
from halpipe.core.suggest import did_you_mean, few
from halpipe.importers.amalthea import codes
from halpipe.models import Origin
from halpipe.schemas import line_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lxml import etree

    from halpipe.importers.amalthea.documents import Document

_NUMBER = re.compile(r"[+-]?(?:[0-9]{1,60}(?:\.[0-9]{0,60})?|\.[0-9]{1,60})(?:[eE](?P<exp>[+-]?[0-9]{1,3}))?")
_MAX_EXPONENT = 60

TIME_NS = {unit: Fraction(10) ** power for unit, power in (("s", 9), ("ms", 6), ("us", 3), ("ns", 0), ("ps", -3))}
HERTZ = {"Hz": 1, "kHz": 10**3, "MHz": 10**6, "GHz": 10**9}
_DECIMAL = {"": 1, "k": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}
_BINARY = {"Ki": 2**10, "Mi": 2**20, "Gi": 2**30, "Ti": 2**40}
_PREFIXES = _DECIMAL | _BINARY
BYTES = {f"{prefix}B": Fraction(size) for prefix, size in _PREFIXES.items()}
BYTES |= {f"{prefix}bit": Fraction(size, 8) for prefix, size in _PREFIXES.items()}
RATES = {f"{unit}PerSecond": size for unit, size in BYTES.items()}


def parse_number(text: str) -> Fraction | None:
    """Read an integer or a double exactly, never through a binary float; None if it is none, or INF or NaN."""
    match = _NUMBER.fullmatch(text.strip())
    return None if match is None or abs(int(match["exp"] or 0)) > _MAX_EXPONENT else Fraction(match[0])


PREFIX = "halpipe:"
ROLE = "role"
"""Tells whether a mode label selects the mode of the system or the version of a task."""


def text_of(item: Item, key: str) -> str | None:
    """Return the text of a property of halpipe, None when absent."""
    for found in item.all("customProperties"):
        if found.get("key") == PREFIX + key:
            value = found.one("value")
            found.use_all()
            return "" if value is None else value.get("value")
    return None


_XSI_TYPE = "{http://www.w3.org/2001/XMLSchema-instance}type"
_XMI_ID = "{http://www.omg.org/XMI}id"

# Classes of elements that need no xsi:type, since their place says it: its name in the singular, or another.
_REGULAR = """
stimuliModel eventModel constraintsModel propertyConstraintsModel mappingModel componentsModel configModel
measurementModel tasks runnables labels modeLabels modes processPrototypes processChains caches coreTypes cores
microcontrollers operatingSystems taskSchedulers interruptControllers eventChains runnableSequencingConstraints
dataAgeConstraints schedulerAllocation coreAllocation taskAllocation runnableAllocation memoryMapping tags
semaphores channels sections osOverheads osDataConsistency dataStability nonAtomicDataCoherency schedulerDefinitions
schedulingParameterDefinitions physicalSectionMapping physicalSectionConstraints dataCoherencyGroups
dataStabilityGroups namespaces coreClassifiers memoryClassifiers
"""
_NAMED = """
commonElements=CommonElements swModel=SWModel hwModel=HWModel osModel=OSModel isrs=ISR literals=ModeLiteral
structures=HwStructure featureCategories=HwFeatureCategory features=HwFeature ecus=ECU quartzes=Quartz memories=Memory
scheduler=TaskScheduler isrAllocation=ISRAllocation customProperties=CustomProperty customEntities=CustomEntity
apiOverhead=OsAPIOverhead isrCategory1Overhead=OsISROverhead isrCategory2Overhead=OsISROverhead
connections=HwConnection internalConnections=HwConnection ports=HwPort accessElements=HwAccessElement
eventsToTrace=EventConfig
"""
_CLASSES = {tag: tag[0].upper() + tag[1:].removesuffix("s") for tag in _REGULAR.split()}
_CLASSES |= dict(pair.split("=") for pair in _NAMED.split())
_QUALIFIED = ("HwFeature", "HwPort", "ModeLiteral")  # referred to as owner/name
_ALIASES = {"Periodic": "PeriodicStimulus", "Core": "ProcessingUnit", "Mode": "EnumMode"}
_TOO_LONG_NS = 10**39
_UNIQUE = ("Task", "ISR", "Runnable", "Label", "ProcessingUnit", "Core", "Memory", "ModeLabel", "EventChain")


class Item:
    """One element: `kind` is its class, `tag` the feature of its owner that holds it."""

    __slots__ = ("children", "element", "file", "is_used", "kind", "owner", "tag")

    def __init__(self, element: etree._Element, tag: str, file: str, owner: Item | None) -> None:
        self.element = element
        self.tag = tag
        self.file = file
        self.owner = owner
        self.children: list[Item] = []
        self.is_used = False
        stated = element.get(_XSI_TYPE)
        self.kind = stated.rpartition(":")[2] if stated else _CLASSES.get(tag, tag)
        if not stated and tag == "events" and owner is not None and owner.kind == "SWModel":
            self.kind = "OsEvent"

    @property
    def name(self) -> str:
        """The name as written."""
        return self.element.get("name") or ""

    @property
    def at(self) -> Location:
        """Place of the element."""
        return Location(self.file, line_of(self.element))

    @property
    def origin(self) -> Origin:
        """Place of the element, with its name."""
        return Origin(self.file, self.at.line, self.name)

    @property
    def path(self) -> str:
        """Name of the element in messages."""
        owner = self.owner
        while not self.name and owner is not None and not owner.name:
            owner = owner.owner
        if self.name or owner is None:
            return named(self.kind, self.name) if self.name else self.kind
        return Path(f'{self.kind} in {owner.kind} "{owner.name}"', (Subject(owner.kind, owner.name),))

    def get(self, attribute: str) -> str:
        """Return the text of an attribute, empty when absent."""
        return self.element.get(attribute) or ""

    def all(self, *tags: str) -> Iterator[Item]:
        """Yield the children of the given tags, in order."""
        return (child for child in self.children if child.tag in tags)

    def one(self, *tags: str) -> Item | None:
        """Return the first child of the given tags."""
        return next(self.all(*tags), None)

    def use(self) -> None:
        """Note that the element, and with it whatever holds it, shapes the model."""
        item: Item | None = self
        while item is not None and not item.is_used:
            item.is_used = True
            item = item.owner

    def use_all(self) -> None:
        """Note that the element shapes the model with everything in it."""
        self.use()
        for inner in self.walk():
            inner.is_used = True

    def walk(self) -> Iterator[Item]:
        """Yield the element and all within, in document order."""
        rest = [self]
        while rest:
            item = rest.pop()
            yield item
            rest.extend(reversed(item.children))

    def within(self, kind: str) -> bool:
        """Return whether the element stands in one of a class."""
        owner = self.owner
        while owner is not None and owner.kind != kind:
            owner = owner.owner
        return owner is not None


class Forest:
    """The items of all files; `findings` collects what is wrong with them as it is noticed."""

    def __init__(self, documents: Sequence[Document], findings: Findings) -> None:
        self.findings = findings
        self.roots: list[Item] = []
        self._kinds: dict[str, list[Item]] = {}
        self._by_id: dict[str, Item] = {}
        self._by_name: dict[tuple[str, str], Item] = {}
        self._names: dict[str, list[str]] = {}
        self._dangling: set[tuple[str, str]] = set()
        self.combinations = 0
        """Of activations, by the constraints that connect tasks with several."""
        self.reported: set[Item] = set()
        """The items that a warning of their own names."""
        for document in documents:
            self._enter(document)
        self._report_repeated()

    def _enter(self, document: Document) -> None:
        tag = str(document.root.tag).rpartition("}")[2]
        root = Item(document.root, tag, document.name, None)
        self.roots.append(root)
        rest = [root]
        while rest:
            item = rest.pop()
            self._index(item)
            for element in item.element.iterchildren("{*}*"):
                item.children.append(Item(element, str(element.tag).rpartition("}")[2], document.name, item))
            rest.extend(reversed(item.children))

    def _index(self, item: Item) -> None:
        self._kinds.setdefault(item.kind, []).append(item)
        if (id := item.element.get(_XMI_ID)) is not None:
            self._by_id.setdefault(id, item)
        if item.name:
            kind = _ALIASES.get(item.kind, item.kind)
            self._by_name.setdefault((item.name, kind), item)
            if item.kind in _QUALIFIED and item.owner is not None:
                self._by_name.setdefault((f"{item.owner.name}/{item.name}", kind), item)

    def _report_repeated(self) -> None:
        for item in self.kinds(*_UNIQUE):
            first = self._by_name.get((item.name, _ALIASES.get(item.kind, item.kind)), item)
            if first is item or self._by_id.get(item.get(_XMI_ID)) is item:
                continue
            code, text, help = codes.REPEATED, f"has the name of another, at line {first.at.line}", "rename one of them"
            if first.file != item.file:
                code, text = codes.DUPLICATE, f"is also defined at {first.at}"
                help = "import the files of one model only"
            self.findings.add(code(text, at=item.at, path=item.path, help=help))

    # -------------------------------------------------------------------------------------------- items

    def kinds(self, *kinds: str) -> list[Item]:
        """Return the items of some classes, class by class, in document order."""
        return [item for kind in kinds for item in self._kinds.get(kind, ())]

    def within(self, model: str, *tags: str) -> list[Item]:
        """Return the elements of some tags directly in a model such as ``SWModel``, in document order."""
        return [child for item in self.kinds(model) for child in item.all(*tags)]

    # --------------------------------------------------------------------------------------- references

    def refs(self, item: Item, feature: str) -> list[Item]:
        """Return what a feature refers to; what cannot be found is reported once and left out."""
        tokens = [(token, item) for token in item.get(feature).split()]
        tokens += [(child.get("href").rpartition("#")[2], child) for child in item.all(feature) if child.get("href")]
        found = []
        for token, holder in tokens:
            target = self._find(token)
            if target is None:
                self._report_dangling(token, feature, item, holder)
            else:
                found.append(target)
        return found

    def ref(self, item: Item, feature: str) -> Item | None:
        """Return what a feature with one value refers to."""
        return next(iter(self.refs(item, feature)), None)

    def _find(self, token: str) -> Item | None:
        if token in self._by_id:
            return self._by_id[token]
        if "?type=" not in token:
            token = unquote_plus(token) if "%3Ftype%3D" in token else token
        if token in self._by_id:
            return self._by_id[token]
        encoded, _, kind = token.rpartition("?type=")
        return self._by_name.get((unquote_plus(encoded), _ALIASES.get(kind, kind)))

    def _names_of(self, kind: str) -> list[str]:
        """Return the names of a kind; they are sorted by kinds once, when all are known."""
        if not self._names:
            for name, known in self._by_name:
                self._names.setdefault(known, []).append(name)
        return self._names.get(kind, [])

    def _report_dangling(self, token: str, feature: str, item: Item, holder: Item) -> None:
        if (token, feature) in self._dangling:
            return
        self._dangling.add((token, feature))
        encoded, _, kind = token.rpartition("?type=")
        name = unquote_plus(encoded)
        known = self._names_of(_ALIASES.get(kind, kind))
        otherwise = "name all files of the model, or the directory that holds them"
        what = f'{kind} "{name}"' if encoded else quoted(token)
        help = did_you_mean(name, known, otherwise)
        self.findings.add(
            codes.DANGLING(f"{feature} refers to {what}, which is not there", at=holder.at, path=item.path, help=help)
        )

    # --------------------------------------------------------------------------------------- quantities

    def number(self, item: Item, attribute: str) -> Fraction | None:
        """Return a number; None when absent. What is none, or is negative, is an error."""
        text = item.element.get(attribute)
        if text is None:
            return None
        value = parse_number(text)
        if value is None or value < 0:
            what = "is negative" if value is not None else "is not a number"
            self._bad(item, f"{attribute}={quoted(text)} {what}", "write it as 12 or 1.5")
            return None
        return value

    def _quantity(self, item: Item | None, units: Mapping[str, Fraction | int], default: str) -> Fraction | None:
        """Return ``value`` times ``unit``: an absent value is 0, as APP4MC omits it, an absent unit the `default`."""
        if item is None:
            return None
        value = self.number(item, "value") if item.element.get("value") is not None else Fraction(0)
        unit = item.get("unit") or default
        if unit not in units:
            stated = f"unit={quoted(unit)} is unknown" if unit else "has no unit"
            self._bad(item, stated, did_you_mean(unit, units, "use one of " + ", ".join(units)))
            return None
        return None if value is None else value * units[unit]

    def time(self, item: Item | None) -> Duration | None:
        """Return a time."""
        value = self._quantity(item, TIME_NS, "" if item and item.element.get("value", "0") != "0" else "ns")
        if item is not None and value is not None and value >= _TOO_LONG_NS:
            self._bad(item, "is longer than a task model can state", "state a time below 1E30 s")
            return None
        return None if value is None else Duration(value)

    def hertz(self, item: Item | None) -> Fraction | None:
        """Return a frequency; Hz where older versions state no unit."""
        return self._quantity(item, HERTZ, "Hz")

    def size(self, item: Item | None) -> Fraction | None:
        """Return a size in bytes; until 0.7.0 sizes are ``numberBits``."""
        if item is not None and item.element.get("numberBits") is not None:
            bits = self.number(item, "numberBits")
            return None if bits is None else bits / 8
        return self._quantity(item, BYTES, "bit")

    def rate(self, item: Item | None) -> Fraction | None:
        """Return a data rate in bytes per second."""
        return self._quantity(item, RATES, "")

    def _bad(self, item: Item, message: str, help: str) -> None:
        self.findings.add(codes.BAD_VALUE(message, at=item.at, path=item.path, help=help))

    def refuse(self, message: str, item: Item, help: str, code: Code = TOO_MUCH) -> NoReturn:
        """Stop at what would take too long, with all that was found so far."""
        raise HalpipeError(*self.findings.items, code(message, at=item.at, path=item.path, help=help))

    def report(self, code: Code, message: str, item: Item, help: str) -> None:
        """Collect a finding about one item."""
        self._note([item], code)
        self.findings.add(code(message, at=item.at, path=item.path, help=help))

    def _note(self, items: Sequence[Item], code: Code) -> None:
        if code.severity is Severity.WARNING:
            self.reported.update(items)

    def report_each(self, code: Code, what: str, items: Sequence[Item], help: str) -> None:
        """Collect one finding about several items: how many, which, and where the first stands."""
        if items:
            self._note(items, code)
            names = few([item.name or item.path for item in items], quote="")
            self.findings.add(code(f"{len(items)} {what}: {names}", at=items[0].at, help=help))
