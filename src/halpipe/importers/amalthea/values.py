"""Execution demand of an element of an activity graph: one number of a distribution, in cycles of a kind of unit."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fractions import Fraction

    from halpipe.importers.amalthea.hardware import Pu
    from halpipe.importers.amalthea.xmi import Forest, Item

TIMED = ("Ticks", "RunnableInstructions", "InstructionsDeviation", "InstructionsConstant", "ExecutionNeed")
_BOUNDS = {"upper": "upperBound", "lower": "lowerBound"}


def cycles(forest: Forest, item: Item, unit: Pu, statistic: str) -> Fraction | None:
    """Return the cycles that ticks, instructions or an execution need take on a kind of unit; None if not stated."""
    if item.kind == "Ticks":
        return _of(forest, _entry(forest, item, unit), statistic)
    if item.kind == "ExecutionNeed":
        return _need(forest, item, unit, statistic)
    value = item if item.kind.startswith("Instructions") else _entry(forest, item, unit)
    instructions = _of(forest, value, statistic)
    return None if instructions is None else instructions / unit.ipc


def _entry(forest: Forest, item: Item, unit: Pu) -> Item | None:
    """Return the value for a kind of unit: its own, else the default."""
    for entry in item.all("extended"):
        if unit.type is not None and forest.ref(entry, "key") is unit.type:
            return entry.one("value")
    return item.one("default")


def _need(forest: Forest, item: Item, unit: Pu, statistic: str) -> Fraction | None:
    """Return needs of features, such as instructions, over what a cycle of the unit gives of them."""
    total = None
    for entry in item.all("needs", "default"):
        amount = _of(forest, entry.one("value"), statistic)
        if amount is None:
            return None
        total = (total or 0) + amount / unit.needs.get(entry.get("key"), unit.ipc)
    return total


def most(forest: Forest, value: Item) -> Fraction | None:
    """Return a constant, or the upper bound of a distribution, None if it has none."""
    return _of(forest, value, "upper")


def _of(forest: Forest, value: Item | None, statistic: str) -> Fraction | None:
    """Return one number of a constant or distribution, None if it is not bounded.

    Where the average is asked for and not stated, it is the middle of the bounds.
    """
    if value is None:
        return None
    if value.get("value"):
        return forest.number(value, "value")
    if statistic == "average":
        return _average(forest, value)
    return _bound(forest, value, _BOUNDS[statistic])


def _bound(forest: Forest, value: Item, name: str) -> Fraction | None:
    if value.get(name):
        return forest.number(value, name)
    if value.get("value"):  # LongObject of older versions
        return forest.number(value, "value")
    entries = [_bound(forest, entry, name) for entry in value.all("entries")]  # a histogram
    known = [entry for entry in entries if entry is not None]
    if known:
        return max(known) if name == "upperBound" else min(known)
    inner = value.one(name) or value.one("deviation")
    return None if inner is None else _bound(forest, inner, name)


def _average(forest: Forest, value: Item) -> Fraction | None:
    for name in ("average", "mean"):
        if value.get(name):
            return forest.number(value, name)
    deviation = value.one("deviation")
    if deviation is not None:
        return _average(forest, deviation)
    distribution = value.one("distribution")
    mean = None if distribution is None else distribution.one("mean")
    if mean is not None:
        return forest.number(mean, "value")
    low, high = _bound(forest, value, "lowerBound"), _bound(forest, value, "upperBound")
    return None if low is None or high is None else (low + high) / 2
