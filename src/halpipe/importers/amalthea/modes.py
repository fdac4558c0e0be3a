"""The modes of the system, and what conditions on mode labels come to in each.

A mode label is a variable of an enumeration. One that nothing in the model writes is chosen from outside: its literals
are the modes of the system. One that runnables or stimuli write is data: its branches are not known in advance.
"""

from __future__ import annotations

from dataclasses import field
from itertools import product
from math import prod
from typing import TYPE_CHECKING
from urllib.parse import unquote_plus

from halpipe.core.records import record
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.xmi import ROLE, Forest, Item, text_of
from halpipe.importers.common.names import Names

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping


DEFAULT = "default"
_MOST_MODES = 64
_CONDITION_LISTS = ("condition", "executionCondition", "enablingModeValueList", "disablingModeValueList")
_WRITES = ("set", "write", "increment", "decrement")
_CONJUNCTIONS = ("ConditionConjunction", "ModeConditionConjunction", "ModeValueConjunction")
_COMPARED_LABELS = ("label1", "label2")


@record
class SystemMode:
    """One mode: its name, the literal that each label of the system has in it, and the first of them."""

    name: str
    literals: Mapping[Item, str] = field(default_factory=dict)
    origin: Item | None = None


def read_modes(forest: Forest) -> tuple[SystemMode, ...]:
    """Return the modes; a single one called ``default`` where no label is chosen from outside."""
    labels = _system_labels(forest)
    enumerations = [_literals(forest, label) for label in labels]
    count = prod(map(len, enumerations))
    if count > _MOST_MODES:
        help = "merge mode labels, or state modes in an overlay"
        forest.report_each(codes.TOO_MANY_MODES, f"mode labels make {count} combinations", labels, help)
        count = 0
    if not labels or not count:
        return (SystemMode(DEFAULT),)
    names = Names(forest.findings, codes.RENAMED)
    return tuple(
        SystemMode(
            names.unique("+".join(literal.name for literal in chosen), "mode", chosen[0].at),
            {label: literal.name for label, literal in zip(labels, chosen, strict=True)},
            chosen[0],
        )
        for chosen in product(*enumerations)
    )


def _system_labels(forest: Forest) -> list[Item]:
    written = {label for item in _writers(forest) for label in _labels(forest, item)}
    tested = [label for item in _conditions(forest) for label in _labels(forest, item)]
    roles = {label: text_of(label, ROLE) for label in forest.kinds("ModeLabel")}
    candidates = [label for label, role in roles.items() if role == "mode"] + tested
    return [
        label
        for label in dict.fromkeys(candidates)
        if label in roles and roles[label] != "version" and label not in written and _literals(forest, label)
    ]


def _writers(forest: Forest) -> list[Item]:
    accesses = [item for item in forest.kinds("ModeLabelAccess") if item.get("access") in _WRITES]
    assignments = [entry for found in forest.kinds("setModeValueList") for entry in found.all("entries")]
    return accesses + assignments + forest.kinds("ModeLabelAssignment")


def _conditions(forest: Forest) -> list[Item]:
    found = [inner for item in forest.kinds(*_CONDITION_LISTS) for inner in item.walk()]
    return found + [item for item in forest.kinds("ModeSwitch", "RunnableModeSwitch") if item.get("valueProvider")]


def _labels(forest: Forest, item: Item) -> list[Item]:
    """Return the mode labels that an access, an assignment or a comparison names."""
    features = (
        ("data",) if item.kind == "ModeLabelAccess" else ("label", "valueProvider", "globalLabel", *_COMPARED_LABELS)
    )
    return [label for feature in features for label in forest.refs(item, feature)]


def _enumeration(forest: Forest, label: Item) -> Item:
    """Return the enumeration of a label; until 0.9.3 only the literal of its initial value tells it."""
    mode = forest.ref(label, "mode")
    if mode is None and "?type=" in label.get("initialValue"):
        literal = forest.ref(label, "initialValue")
        mode = None if literal is None else literal.owner
    return mode or label


def _literals(forest: Forest, label: Item) -> list[Item]:
    return list(_enumeration(forest, label).all("literals"))


# -------------------------------------------------------------------------------------------- conditions


class Conditions:
    """Value of conditions in one mode: True, False, or None where it depends on data."""

    def __init__(self, forest: Forest, mode: SystemMode) -> None:
        self._forest = forest
        self._mode = mode

    def holds(self, disjunction: Item | None) -> bool | None:
        """Evaluate a condition; an empty one holds if anything does, which is not known."""
        if disjunction is None:
            return None
        return _any(self._entry(entry) for entry in disjunction.all("entries"))

    def allows(self, item: Item) -> bool:
        """Return whether a stimulus or runnable may act in the mode: its conditions are not known to be false."""
        enabled = (item.one("executionCondition"), item.one("enablingModeValueList"))
        disabled = self.holds(item.one("disablingModeValueList"))
        return all(self.holds(condition) is not False for condition in enabled) and disabled is not True

    def branch(self, switch: Item, entry: Item) -> bool | None:
        """Return whether an entry of a switch is taken, if that is known."""
        if entry.get("values"):  # until 0.8.0
            label = self._forest.ref(switch, "valueProvider")
            chosen = [literal.name for literal in self._forest.refs(entry, "values")]
            return self._compare(label, lambda value: value in chosen)
        return self.holds(entry.one("condition"))

    def _entry(self, entry: Item) -> bool | None:
        if entry.kind in _CONJUNCTIONS:
            return _all(self._comparison(inner) for inner in entry.all("entries"))
        return self._comparison(entry)

    def _comparison(self, item: Item) -> bool | None:
        relation = item.get("relation") or "EQUAL"
        if relation not in ("EQUAL", "NOT_EQUAL"):
            return None
        labels = _labels(self._forest, item)
        if not labels:
            return None
        wanted = self._value(item) if len(labels) == 1 else self._mode.literals.get(labels[1])
        equal = None if wanted is None else self._compare(labels[0], lambda value: value == wanted)
        return equal if equal is None or relation == "EQUAL" else not equal

    def _compare(self, label: Item | None, test: Callable[[str], bool]) -> bool | None:
        if label is None or label not in self._mode.literals:
            return None
        return test(self._mode.literals[label])

    def _value(self, item: Item) -> str:
        """Return the literal compared with; until 0.9.3 it is a reference."""
        stated = item.get("value")
        if stated and "?type=" not in stated:
            return stated
        literal = self._forest.ref(item, "value")
        return literal.name if literal is not None else unquote_plus(stated.rpartition("?")[0])


def _any(values: Iterable[bool | None]) -> bool | None:
    found = list(values)
    return True if True in found else None if None in found or not found else False


def _all(values: Iterable[bool | None]) -> bool | None:
    found = list(values)
    return False if False in found else None if None in found or not found else True
