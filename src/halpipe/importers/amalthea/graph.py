"""Activity graphs of tasks and runnables: totals of cycles and accesses, for one mode and kind of unit.

The same graph is a ``callGraph`` with ``graphEntries`` and ``calls`` and flat ``runnableItems`` until 0.9.4, a
``callGraph`` with ``items`` in 0.9.5 and an ``activityGraph`` from 0.9.7.
"""

from __future__ import annotations

from dataclasses import field, replace
from fractions import Fraction
from math import ceil
from typing import TYPE_CHECKING, Any, NoReturn

from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.modes import Conditions, SystemMode

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from halpipe.importers.amalthea.hardware import Pu
    from halpipe.importers.amalthea.xmi import Forest, Item

TIMED = ("Ticks", "RunnableInstructions", "InstructionsDeviation", "InstructionsConstant", "ExecutionNeed")


def cycles(forest: Forest, item: Item, unit: Pu) -> Fraction | None:
    """Return the most cycles that ticks, instructions or an execution need take on a kind of unit; None: not stated."""
    if item.kind == "Ticks":
        return most(forest, _entry(forest, item, unit))
    if item.kind == "ExecutionNeed":
        return _need(forest, item, unit)
    instructions = most(forest, item if item.kind.startswith("Instructions") else _entry(forest, item, unit))
    return None if instructions is None else instructions / unit.ipc


def _entry(forest: Forest, item: Item, unit: Pu) -> Item | None:
    """Return the value for a kind of unit: its own, else the default."""
    for entry in item.all("extended"):
        if unit.type is not None and forest.ref(entry, "key") is unit.type:
            return entry.one("value")
    return item.one("default")


def _need(forest: Forest, item: Item, unit: Pu) -> Fraction | None:
    """Return needs of features, such as instructions, over what a cycle of the unit gives of them."""
    total = None
    for entry in item.all("needs", "default"):
        amount = most(forest, entry.one("value"))
        if amount is None:
            return None
        total = (total or 0) + amount / unit.needs.get(entry.get("key"), unit.ipc)
    return total


def most(forest: Forest, value: Item | None) -> Fraction | None:
    """Return a constant, or the upper bound of a distribution, None if it has none."""
    if value is None:
        return None
    for name in ("value", "upperBound"):
        if value.get(name):
            return forest.number(value, name)
    bars = [most(forest, bar) for bar in value.all("entries")]  # of a histogram
    known = [bar for bar in bars if bar is not None]
    return max(known) if known else most(forest, value.one("upperBound", "deviation"))


_STEPS = ("graphEntries", "items", "calls", "runnableItems")
_GRAPHS = ("activityGraph", "callGraph")
GROUPS = ("Group", "CallSequence", "WhileLoop")
SWITCHES = ("ModeSwitch", "Switch", "RunnableModeSwitch", "ProbabilitySwitch", "RunnableProbabilitySwitch")
CALLS = {"RunnableCall": "runnable", "TaskRunnableCall": "runnable", "SynchronousServerCall": "serverRunnable"}
_POINTS = ("SchedulePoint", "ModeLabelAssignment")
_INSTANTS = (*_POINTS, "InterProcessTrigger", "InterProcessActivation", "CustomEventTrigger", "SetEvent", "ClearEvent")
_MOST_LEVELS = 100


def steps(item: Item) -> list[Item]:
    """Return what a task, runnable, group or branch does, in order."""
    found = []
    for child in item.children:
        if child.tag in _GRAPHS:
            found += steps(child)
        elif child.tag in _STEPS:
            found.append(child)
    return found


def branches(switch: Item) -> list[Item]:
    """Return the entries of a switch, the default entry last."""
    return [*switch.all("entries"), *switch.all("defaultEntry")]


def candidates(switch: Item, conditions: Conditions) -> list[Item]:
    """Return the branches that a switch may take in a mode: up to the first whose condition surely holds."""
    found = []
    for entry in switch.all("entries"):
        holds = None if "Probability" in switch.kind else conditions.branch(switch, entry)
        if holds is not False:
            found.append(entry)
        if holds:
            return found
    return [*found, *switch.all("defaultEntry")]


def everything(forest: Forest, found: Iterable[Item]) -> Iterator[Item]:
    """Yield some steps and all within them, in order: in groups, in branches and in the runnables that they call."""
    seen: set[Item] = set()
    rest = list(reversed(list(found)))
    while rest:
        step = rest.pop()
        yield step
        inner: list[Item] = []
        if step.kind in SWITCHES:
            inner = [item for entry in branches(step) for item in steps(entry)]
        elif step.kind in CALLS:
            called = forest.ref(step, CALLS[step.kind])
            if called is not None and called not in seen:
                seen.add(called)
                inner = steps(called)
        else:
            inner = steps(step)
        rest += reversed(inner)


def is_at_edge(forest: Forest, found: list[Item], runnable: Item, *, end: bool) -> bool:
    """Return whether a runnable begins, or ends, what some steps do, if only in one of their branches."""
    seen: set[Item] = set()
    rest = [found]
    while rest:
        timed = [step for step in rest.pop() if step.kind not in _INSTANTS]
        if not timed:
            continue
        step = timed[-1 if end else 0]
        if step.kind in SWITCHES:
            rest += [steps(entry) for entry in branches(step)]
            continue
        called = forest.ref(step, CALLS[step.kind]) if step.kind in CALLS else step
        if called is runnable:
            return True
        if called is not None and called not in seen:
            seen.add(called)
            rest.append(steps(called))
    return False


def is_uninterrupted(step: Item) -> bool:
    """Return whether a step is a group that must not be interrupted."""
    return step.kind in GROUPS and step.get("interruptible") == "false"


@record
class Amount:
    """Sum of some steps: cycles of the unit, and the number of reads and writes of each label.

    `is_timed`: at least one of them states a time; `is_known`: none states a time without an upper bound;
    `is_possible`: none states a time for other kinds of units only.
    """

    cycles: Fraction = Fraction(0)
    is_timed: bool = False
    is_known: bool = True
    is_possible: bool = True
    reads: dict[Item, Fraction] = field(default_factory=dict)
    writes: dict[Item, Fraction] = field(default_factory=dict)

    @property
    def is_empty(self) -> bool:
        """Whether the steps do nothing that the model knows of."""
        return not (self.is_timed or self.reads or self.writes)


_NOTHING = Amount()
Span = tuple[Fraction, Fraction]


def call_count(forest: Forest, step: Item) -> Fraction:
    """Return how often a call is made at most."""
    return _count(forest, step, "statistic")


def _count(forest: Forest, step: Item, *spellings: str) -> Fraction:
    """Return how often a step is made at most: once, unless it states a number or its bounds.

    A single number is an average, so that one between two whole numbers is the next.
    """
    found = step.one("statistic")
    stated = None if found is None else found.one(*spellings)
    if stated is None:
        return Fraction(1)
    number = forest.number(stated, "value")
    if number is None:
        number = forest.number(stated, "max")
    return Fraction(1 if number is None else ceil(number))


def _repeated(amount: Amount, count: Fraction) -> Amount:
    """Return what some steps come to that are made so often."""
    if count == 1:
        return amount
    reads, writes = ({label: n * count for label, n in found.items()} for found in (amount.reads, amount.writes))
    return replace(amount, cycles=amount.cycles * count, reads=reads, writes=writes)


def _joined(join: Callable[[Iterable[Any]], Any], amounts: Sequence[Amount]) -> Amount:
    """Return what steps come to one after another, by `sum`, or several branches at most, by `max`."""
    reads = grouped(read for amount in amounts for read in amount.reads.items())
    writes = grouped(written for amount in amounts for written in amount.writes.items())
    return Amount(
        join((Fraction(0), *(amount.cycles for amount in amounts))),
        any(amount.is_timed for amount in amounts),
        all(amount.is_known for amount in amounts),
        all(amount.is_possible for amount in amounts),
        {label: join(counts) for label, counts in reads.items()},
        {label: join(counts) for label, counts in writes.items()},
    )


class Evaluator:
    """Adds up graphs; remembers what runnables come to, and which branches and loops it met."""

    def __init__(self, forest: Forest) -> None:
        self._forest = forest
        self._conditions: dict[str, Conditions] = {}
        self._known: dict[tuple[Item, str, Item], Amount] = {}
        self._spans: dict[tuple[Item, Item, str, Item, bool], Span | None] = {}
        self._calling: dict[Item, None] = {}
        self._depth = 0
        self.branched: dict[Item, None] = {}
        self.loops: dict[Item, None] = {}
        self.accesses: dict[Item, Item] = {}

    def conditions(self, mode: SystemMode) -> Conditions:
        """Return the conditions of a mode."""
        return self._conditions.setdefault(mode.name, Conditions(self._forest, mode))

    def is_whole(self, step: Item) -> bool:
        """Return whether some of a step must not be interrupted."""
        return any(is_uninterrupted(inner) for inner in everything(self._forest, [step]))

    def amount(self, found: Sequence[Item], mode: SystemMode, unit: Pu) -> Amount:
        """Return what steps come to in a mode on a kind of unit."""
        self._depth += 1
        total = _joined(sum, [self._step(step, mode, unit) for step in found])
        self._depth -= 1
        return total

    def span(self, found: Sequence[Item], wanted: Item, mode: SystemMode, unit: Pu, *, after: bool) -> Span | None:
        """Return the cycles from the begin of some steps to the first and last `wanted` step; None if it is not there.

        With `after`, to its end.
        """
        at, spans = Fraction(0), []
        for step in found:
            length = self.amount([step], mode, unit).cycles
            inner = self._span_in(step, wanted, mode, unit, length, after=after)
            if inner is not None:
                spans.append((at + inner[0], at + inner[1]))
            at += length
        return (spans[0][0], spans[-1][1]) if spans else None

    def _span_in(
        self, step: Item, wanted: Item, mode: SystemMode, unit: Pu, length: Fraction, *, after: bool
    ) -> Span | None:
        is_repeated = step.kind == "WhileLoop" or step.one("statistic") is not None
        if step is wanted:
            found: Span | None = (length, length) if after else (Fraction(0), Fraction(0))
        elif step.kind in SWITCHES:
            ways = [
                self.span(steps(e), wanted, mode, unit, after=after) for e in candidates(step, self.conditions(mode))
            ]
            known = [way for way in ways if way is not None]
            found = (min(low for low, _ in known), max(high for _, high in known)) if known else None
        elif step.kind in CALLS:
            called = self._forest.ref(step, CALLS[step.kind])
            found = None if called is None else self._span_of(called, wanted, mode, unit, after=after)
        else:
            found = self.span(steps(step), wanted, mode, unit, after=after)
        return (Fraction(0), length) if found and is_repeated else found

    def _span_of(self, called: Item, wanted: Item, mode: SystemMode, unit: Pu, *, after: bool) -> Span | None:
        key = called, wanted, mode.name, unit.item, after
        if key not in self._spans:
            allowed = self.conditions(mode).allows(called)
            self._spans[key] = self.span(steps(called), wanted, mode, unit, after=after) if allowed else None
        return self._spans[key]

    def _step(self, step: Item, mode: SystemMode, unit: Pu) -> Amount:
        if step.kind in TIMED:
            return self._time(step, unit)
        if step.kind == "LabelAccess":
            return self._access(step)
        if step.kind in CALLS:
            called = self._forest.ref(step, CALLS[step.kind])
            step.use()
            if called is None:
                return _NOTHING
            return _repeated(self._call(called, mode, unit), call_count(self._forest, step))
        if step.kind in SWITCHES:
            return self._switch(step, mode, unit)
        if step.kind in GROUPS:
            step.use()
            if step.kind == "WhileLoop":
                self.loops[step] = None
            if self._depth > _MOST_LEVELS:
                self._stop(step)
            return self.amount(steps(step), mode, unit)
        if step.kind in _POINTS:
            step.use()
        return _NOTHING

    def _time(self, step: Item, unit: Pu) -> Amount:
        value = cycles(self._forest, step, unit)
        if value is None:
            others = any(step.all("extended")) and step.one("default") is None
            return Amount(is_timed=True, is_known=False, is_possible=not others)
        step.use_all()
        return Amount(cycles=value, is_timed=True)

    def _access(self, step: Item) -> Amount:
        label = self._forest.ref(step, "data")
        if label is None:
            return _NOTHING
        self.accesses[step] = label
        writes = step.get("access") == "write"  # what is not stated is a read, as in ITEA
        count = {label: _count(self._forest, step, "value", "write" if writes else "read")}
        return Amount(writes=count) if writes else Amount(reads=count)

    def _call(self, runnable: Item, mode: SystemMode, unit: Pu) -> Amount:
        key = (runnable, mode.name, unit.item)
        if key in self._known:
            return self._known[key]
        if runnable in self._calling or self._depth > _MOST_LEVELS:
            self._stop(runnable)
        runnable.use()
        self._calling[runnable] = None
        allowed = self.conditions(mode).allows(runnable)
        amount = self.amount(steps(runnable), mode, unit) if allowed else _NOTHING
        del self._calling[runnable]
        self._known[key] = amount
        return amount

    def _stop(self, item: Item) -> NoReturn:
        calls = list(self._calling)
        cycle = calls[calls.index(item) :] if item in self._calling else calls[-3:]
        names = " -> ".join(called.name for called in (*cycle, item))
        what = "calls itself" if item in self._calling else f"stands below more than {_MOST_LEVELS} calls and groups"
        help = "remove one of the calls"
        self._forest.refuse(f"{what}: {names}", item, help, codes.RECURSION)

    def _switch(self, switch: Item, mode: SystemMode, unit: Pu) -> Amount:
        switch.use()
        if self._depth > _MOST_LEVELS:
            self._stop(switch)
        found = candidates(switch, self.conditions(mode))
        if len(found) > 1:
            self.branched[switch] = None
        for entry in found:
            entry.use()
        return _joined(max, [self.amount(steps(entry), mode, unit) for entry in found])
