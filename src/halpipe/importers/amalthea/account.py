"""Coverage of an import: each element and attribute is read, harmless by a listed reason, or reported.

The lists stand in `meaning.yaml`. An element or attribute in none of them is reported where it occurs, so a kind of a
later release warns. The page "AMALTHEA: what is read" is generated from the lists. Kinds are classes; elements without
a class of their own have their tag, which starts with a small letter. APP4MC writes ``_undefined_`` for a value that is
not stated.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe.core.files import parse_yaml
from halpipe.core.records import record
from halpipe.core.suggest import few
from halpipe.importers.amalthea import codes

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from halpipe.importers.amalthea.hardware import Memories
    from halpipe.importers.amalthea.parts import Drafts
    from halpipe.importers.amalthea.xmi import Forest, Item
    from halpipe.importers.common.base import Coverage

_MEANING = Path(__file__).with_name("meaning.yaml")
_LISTS: dict[str, Any] = parse_yaml(_MEANING.read_bytes(), _MEANING.name)


def _expanded(features: str) -> str:
    groups = _LISTS["groups"]
    return " ".join(groups[word[1:]] if word.startswith("$") else word for word in features.split())


READ: dict[str, str] = {kinds: _expanded(features) for kinds, features in _LISTS["read"].items()}
"""The features that the import reads, by the kinds that have them."""
HARMLESS: dict[str, str] = _LISTS["harmless"]
"""Kinds and features without influence on what a target may do, by the reason; ``*`` stands for every kind."""
UNREACHED: dict[str, str] = _LISTS["unreached"]
"""Kinds that are harmless where the import does not reach them, by the reason."""
_CONTAINERS = frozenset(_LISTS["containers"].split())
"""Kinds that only hold others; these are looked at even where none of them is used."""
_PARTS = frozenset(_LISTS["parts"].split())
_PART_ENDINGS = ("Distribution", "Histogram", "Boundaries", "Statistics", "Constant", "Object", "Estimators")


def is_part(kind: str) -> bool:
    """Return whether elements of a kind are values of the element that holds them, and counted with it."""
    is_value = kind.endswith(_PART_ENDINGS) and not kind.startswith("Instructions")
    return kind[:1].islower() or kind in _PARTS or is_value


_UNSTATED = ("", "_undefined_")


@record
class Rules:
    """The lists by single kinds and features."""

    read: Mapping[str, Mapping[str, tuple[str, ...]]]
    harmless: Mapping[str, str]
    unreached: Mapping[str, str]

    def reads(self, kind: str, feature: str, value: str = "") -> bool:
        """Return whether the import reads a feature of a kind, with a value that it understands."""
        values = self.read.get(kind, {}).get(feature)
        return values is not None and (not values or value in values)

    def reason(self, kind: str, feature: str = "") -> str:
        """Return why a kind or a feature of it is harmless; empty if it is not on the list."""
        if not feature:
            return self.harmless.get(kind, "")
        return self.harmless.get(f"{kind}.{feature}") or self.harmless.get(f"*.{feature}", "")


def _rules() -> Rules:
    read: dict[str, dict[str, tuple[str, ...]]] = {}
    for kinds, features in READ.items():
        parted = (feature.partition("=") for feature in features.split())
        found = {name: tuple(values.split("|")) if values else () for name, _, values in parted}
        for kind in kinds.split():
            read.setdefault(kind, {}).update(found)
    harmless, unreached = (
        {word: reason for reason, words in lists.items() for word in words.split()} for lists in (HARMLESS, UNREACHED)
    )
    return Rules(read, harmless, unreached)


RULES = _rules()


_STATED = "has a warning of its own"
_UNKNOWN = "is not read, and not known to be harmless"
_HELP = "remove it, or state in an overlay what matters of it for the schedule"


def account(
    forest: Forest, drafts: Drafts, memories: Memories, accesses: Mapping[Item, Item], coverage: Coverage
) -> None:
    """Account for every element of all files; `accesses` are those that tasks make, with their labels."""
    for access, label in accesses.items():
        if label.is_used:
            access.use_all()
    accounting = _Accounting(forest, drafts, memories, coverage)
    accounting.made = {*accesses, *accesses.values()}
    for root in forest.roots:
        coverage.mapped("file")
        accounting.visit(root)
    accounting.report()


class _Accounting:
    def __init__(self, forest: Forest, drafts: Drafts, memories: Memories, coverage: Coverage) -> None:
        self.forest = forest
        self.coverage = coverage
        self.reasons = {**drafts.without, **dict.fromkeys(memories.unplaced, "is mapped to no memory")}
        self.kinds: defaultdict[str, list[Item]] = defaultdict(list)
        self.features: defaultdict[tuple[str, str, str], list[Item]] = defaultdict(list)
        tasks = forest.within("SWModel", "tasks", "isrs")
        self.made: set[Item] = set()
        """Accesses and labels that are looked into although no phase of a memory comes of them."""
        self.active = {stimulus for task in tasks for stimulus in forest.refs(task, "stimuli")}

    def visit(self, root: Item) -> None:
        """Account for an element and all within it."""
        rest = [root]
        while rest:
            item = rest.pop()
            if item is not root:
                reason = self.reason(item)
                if reason and item in self.made:
                    self.coverage.ignored(item.kind, item.name or item.path, reason, item.at)
                elif reason:
                    self.ignore(item, reason)
                    continue
                else:
                    self.count(item)
            self.attributes(item)
            for child in reversed(item.children):
                if reason := RULES.reason(item.kind, child.tag):
                    self.ignore(child, reason)
                elif RULES.reads(item.kind, child.tag):
                    rest.append(child)
                else:
                    self.unknown(child)

    def reason(self, item: Item) -> str:
        """Return why an element and all within it is ignored, empty if it is looked into."""
        if harmless := RULES.reason(item.kind):
            return harmless if not item.is_used else ""
        if item.is_used or item.kind in _CONTAINERS or not _is_entity(item):
            return ""
        if reason := self.reasons.get(item) or self.unreached(item):
            return reason
        if item in self.forest.reported:
            return _STATED
        self.kinds[item.kind].append(item)
        return _UNKNOWN

    def unreached(self, item: Item) -> str:
        """Return why an element that is not used decides nothing; empty if it may."""
        if item in self.active:
            return ""
        if item.kind == "HwAccessElement":
            memory = self.forest.ref(item, "destination")
            return "" if memory is not None and memory.is_used else "no access takes its way"
        return RULES.unreached.get(item.kind, "")

    def attributes(self, item: Item) -> None:
        """Note the attributes that are neither read nor harmless."""
        for name, value in item.element.attrib.items():
            kind, feature, stated = item.kind, str(name), str(value)
            if feature.startswith("{") or stated in _UNSTATED or RULES.reason(kind, feature):
                continue
            if not RULES.reads(kind, feature, stated):
                shown = str(value) if name in RULES.read.get(item.kind, {}) else ""
                self.features[item.kind, str(name), shown].append(item)

    def unknown(self, item: Item) -> None:
        if item in self.forest.reported:
            self.ignore(item, _STATED)
            return
        self.kinds[item.kind].append(item)
        self.ignore(item, _UNKNOWN)

    def count(self, item: Item) -> None:
        if _is_entity(item):
            if item.is_used:
                self.coverage.mapped(item.kind)
            else:
                self.coverage.ignored(item.kind, item.name or item.path, "holds nothing of influence", item.at)

    def ignore(self, item: Item, reason: str) -> None:
        for inner in item.walk():
            if _is_entity(inner):
                self.coverage.ignored(inner.kind, inner.name or inner.path, reason, inner.at)

    def report(self) -> None:
        """Report what may decide times, by kind and by attribute."""
        for kind, items in self.kinds.items():
            message = f"{_times(len(items), kind)} not imported: {_places(items)}"
            self.forest.findings.add(codes.NOT_READ(message, at=items[0].at, help=_HELP))
        for (kind, name, value), items in self.features.items():
            stated = f'{name}="{value}"' if value else name
            message = f"{stated} of {_times(len(items), kind)} not imported: {_places(items)}"
            self.forest.findings.add(codes.NOT_READ(message, at=items[0].at, help=_HELP))


def _is_entity(item: Item) -> bool:
    """Return whether an element counts on its own; values and references count with what holds them."""
    return not is_part(item.kind) and not (item.get("href") and not item.children)


def _times(count: int, kind: str) -> str:
    return f"{kind} is" if count == 1 else f"{count} of {kind} are"


def _places(items: Sequence[Item]) -> str:
    return few([f"{item.name or item.path} (line {item.at.line})" for item in items], "")
