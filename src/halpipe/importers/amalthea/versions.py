"""Versions of tasks: one for each kind of unit that may run the task, and for each amount of work that modes choose.

Semaphores are locks of a version (MODEL 10.5), at positions in cycles of stated execution time. Where a branch or loop
decides when a semaphore is held, the whole branch or loop holds it. Preemption points follow from the `preemption`
attribute and the ends of the runnables that a task calls.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration, seconds
from halpipe.core.records import record
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.graph import CALLS, GROUPS, SWITCHES, Amount, Evaluator, everything, steps
from halpipe.importers.amalthea.hardware import Memories, Phase, Pu, length_of, placed
from halpipe.importers.common.names import Names, legal, unique_name
from halpipe.importers.common.pieces import cuts
from halpipe.models import WHOLE, Access, AccessKind, Anchor, Split, Version

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from fractions import Fraction

    from halpipe.importers.amalthea.modes import SystemMode
    from halpipe.importers.amalthea.parts import Draft, Trigger
    from halpipe.importers.amalthea.xmi import Forest, Item

_ACCESS = "SemaphoreAccess"
_MOST_STEPS = 10_000
"""Steps with semaphores that are followed one by one; what comes after them holds its semaphores as a whole."""


@record
class Held:
    """A semaphore that is held from `begin` to `end`, in cycles."""

    semaphore: Item
    begin: Fraction
    end: Fraction


class Locks:
    """Finds what versions hold; reports semaphores that several jobs may hold, and those that a job does not return."""

    def __init__(self, forest: Forest, evaluator: Evaluator, taken: Sequence[str]) -> None:
        self._forest = forest
        self._evaluator = evaluator
        self._names = Names(forest.findings, codes.RENAMED, taken)
        self.names: dict[Item, str] = {}
        self._shared: dict[Item, None] = {}
        self._unpaired: dict[Item, None] = {}

    def name(self, semaphore: Item) -> str:
        """Return the name of a semaphore as a resource."""
        if semaphore not in self.names:
            self.names[semaphore] = self._names.unique(semaphore.name, "semaphore", semaphore.at)
        return self.names[semaphore]

    def held(self, draft: Draft, mode: SystemMode, unit: Pu) -> list[Held]:
        """Return what a job of a draft holds, each semaphore once for each time."""
        walk = _Walk(self._forest, self._evaluator, mode, unit)
        walk.through(draft.part.steps)
        for step, semaphore in walk.open.values():
            self._unpaired[step] = None
            walk.found.append(Held(semaphore, walk.begins[semaphore], walk.at))
        for step in walk.unpaired:
            self._unpaired[step] = None
        return self._merged([held for held in walk.found if self._is_lock(held.semaphore)])

    def _is_lock(self, semaphore: Item) -> bool:
        most = self._forest.number(semaphore, "maxValue")
        if most is not None and most > 1:
            self._shared[semaphore] = None
            return False
        return True

    def _merged(self, found: Sequence[Held]) -> list[Held]:
        kept: list[Held] = []
        for held in sorted(found, key=lambda h: (self.name(h.semaphore), h.begin, h.end)):
            held.semaphore.use()
            last = kept[-1] if kept else None
            if last is not None and last.semaphore is held.semaphore and held.begin <= last.end:
                kept[-1] = Held(held.semaphore, last.begin, max(last.end, held.end))
            elif held.begin < held.end:
                kept.append(held)
        return kept

    def report(self) -> None:
        """Report what a lock does not say."""
        help = "state in an overlay which tasks exclude each other"
        what = "semaphores may be held several times, so they exclude nothing"
        self._forest.report_each(codes.NOT_READ, what, list(self._shared), help)
        help = "request and release a semaphore in one task, between its waits"
        what = "requests and releases of semaphores have no counterpart in their job"
        self._forest.report_each(codes.NOT_READ, what, list(self._unpaired), help)


class _Walk:
    """One way through a job: the position, and what is held there."""

    def __init__(self, forest: Forest, evaluator: Evaluator, mode: SystemMode, unit: Pu) -> None:
        self._forest = forest
        self._evaluator = evaluator
        self._mode = mode
        self._unit = unit
        self.at = evaluator.amount((), mode, unit).cycles
        self.begins: dict[Item, Fraction] = {}
        self.open: dict[Item, tuple[Item, Item]] = {}
        self.found: list[Held] = []
        self.unpaired: list[Item] = []
        self._left = _MOST_STEPS

    def through(self, found: Sequence[Item]) -> None:
        for step in found:
            self._left -= 1
            if step.kind == _ACCESS:
                self._access(step)
            elif not any(inner.kind == _ACCESS for inner in everything(self._forest, [step])):
                self.at += self._evaluator.amount([step], self._mode, self._unit).cycles
            elif self._left <= 0:
                self._whole(step)
            elif step.kind in GROUPS and step.kind != "WhileLoop":
                self.through(steps(step))
            elif step.kind in CALLS and step.one("statistic") is None:
                called = self._forest.ref(step, CALLS[step.kind])
                if called is not None and self._evaluator.conditions(self._mode).allows(called):
                    self.through(steps(called))
            else:
                self._whole(step)

    def _access(self, step: Item) -> None:
        semaphore = self._forest.ref(step, "semaphore")
        if semaphore is None:
            return
        step.use_all()
        if step.get("access") != "release":
            self.begins.setdefault(semaphore, self.at)
            self.open.setdefault(semaphore, (step, semaphore))
        elif semaphore in self.open:
            del self.open[semaphore]
            self.found.append(Held(semaphore, self.begins.pop(semaphore), self.at))
        else:
            self.unpaired.append(step)

    def _whole(self, step: Item) -> None:
        begin = self.at
        self.at += self._evaluator.amount([step], self._mode, self._unit).cycles
        for inner in everything(self._forest, [step]):
            semaphore = self._forest.ref(inner, "semaphore") if inner.kind == _ACCESS else None
            if semaphore is not None:
                inner.use_all()
                self.found.append(Held(semaphore, begin, self.at))


PREEMPTIVE, COOPERATIVE = "preemptive", "cooperative"
WHOLE_RUNS = ("non_preemptive", "nonpreemptive")


def preemption_of(task: Item) -> str:
    """Return what a task states of its preemption, empty if nothing that is known."""
    stated = task.get("preemption")
    return stated if stated in (PREEMPTIVE, COOPERATIVE, *WHOLE_RUNS) else ""


class Splitter:
    """Finds split points; `longest` is the piece that is left of a runnable that may be preempted anywhere (0: all)."""

    def __init__(self, evaluator: Evaluator, longest: Duration, *, added: bool) -> None:
        self._evaluator = evaluator
        self._longest = longest
        self._added = added
        self.cut: dict[Item, None] = {}
        """The tasks that are cut within runnables."""

    def split(
        self,
        draft: Draft,
        mode: SystemMode,
        unit: Pu,
        phases: Sequence[Phase],
        accesses: Sequence[Access],
        wcet: Duration,
    ) -> Split:
        """Return where jobs of a draft may be interrupted: between its runnables, never inside an access phase.

        A task that is preemptive is also cut inside runnables of more than the longest piece.
        """
        preemption = preemption_of(draft.task)
        if preemption not in (PREEMPTIVE, COOPERATIVE):
            return WHOLE
        longest = self._longest if preemption == PREEMPTIVE else ZERO
        reads = sum((phase.length for phase in phases if phase.kind is AccessKind.READ), ZERO)
        bounds = list(self._bounds(draft, mode, unit, reads if self._added else ZERO))
        if bounds and not self._added:
            begin, end, is_whole = bounds[-1]
            bounds[-1] = (begin, max(wcet, end), is_whole)  # accesses may take longer than what is stated
        points: set[Duration] = set()
        for begin, end, is_whole in bounds:
            points.add(end)
            inner = set(cuts(ZERO if is_whole else longest, begin, end, draft.task.name, draft.task.at))
            if any(_is_allowed(point, wcet, accesses) for point in inner):
                self.cut[draft.task] = None
            points |= inner
        kept = sorted(point for point in points if _is_allowed(point, wcet, accesses))
        return Split(points=tuple(kept)) if kept else WHOLE

    def _bounds(
        self, draft: Draft, mode: SystemMode, unit: Pu, at: Duration
    ) -> Iterator[tuple[Duration, Duration, bool]]:
        """Yield begin and end of every runnable, each with what stands before it outside of runnables.

        Groups that may not be interrupted count as one runnable, and are whole; so is a runnable that contains one.
        """
        assert unit.frequency
        begin, is_whole = at, False
        for step in draft.part.steps:
            at += seconds(self._evaluator.amount([step], mode, unit).cycles / unit.frequency)
            is_whole = is_whole or self._evaluator.is_whole(step)
            if step.kind in CALLS or step.kind in SWITCHES or step.kind in GROUPS or step.kind == "SchedulePoint":
                if at > begin:
                    yield begin, at, is_whole
                begin, is_whole = at, False
        if at > begin:
            yield begin, at, is_whole


def _is_allowed(point: Duration, wcet: Duration, accesses: Sequence[Access]) -> bool:
    return ZERO < point < wcet and not any(access.start < point < access.end for access in accesses)


Instant = tuple[Anchor, Duration | None]
"""An instant of a job, and the execution time to it for a point."""

UNIT = "core0"
VERSION = "default"


@dataclass(slots=True)
class Versions:
    """The versions of one task, and the names of those available in each mode."""

    items: list[Version] = field(default_factory=list)
    by_mode: dict[str, list[str]] = field(default_factory=dict)


@dataclass(slots=True)
class VersionMaker:
    """Makes versions; remembers what to report of all tasks together."""

    _forest: Forest
    _evaluator: Evaluator
    _memories: Memories
    _units: Mapping[Item, str]
    _modes: Sequence[SystemMode]
    _memory: str
    _splitter: Splitter
    _locks: Locks
    too_long: dict[Item, None] = field(default_factory=dict)
    impossible: dict[Item, None] = field(default_factory=dict)
    candidates: dict[Draft, Sequence[Pu]] = field(default_factory=dict)

    def make(self, draft: Draft, candidates: Sequence[Pu]) -> Versions:
        """Return the versions of a draft on the units that may run it."""
        self.candidates[draft] = candidates
        modes = [mode for mode in self._modes if mode.name in draft.modes]
        result = Versions(by_mode={mode.name: [] for mode in modes})
        works = []
        if not candidates:  # nothing is timed, but what the steps state is looked at
            for mode in modes:
                self._evaluator.amount(draft.part.steps, mode, Pu(draft.task, None, None))
        for group in _groups(candidates):
            amounts = {mode.name: self._evaluator.amount(draft.part.steps, mode, group[0]) for mode in modes}
            works.append((group, amounts))
        runs = [m.name for m in modes if any(not a[m.name].is_empty for _, a in works)] or [m.name for m in modes]
        is_timed = any(amount.is_timed for _, amounts in works for amount in amounts.values())
        if not is_timed:
            self._unstated(result, [unit for group, _ in works for unit in group], runs)
            return result
        for group, amounts in works:
            self._of_group(draft, group, {name: amounts[name] for name in runs}, result)
        if not result.items:
            self.impossible[draft.task] = None
            self._unstated(result, candidates, runs)
        return result

    def _unstated(self, result: Versions, units: Sequence[Pu], runs: Sequence[str]) -> None:
        """Make one version without a WCET."""
        names = tuple(self._units[unit.item] for unit in units) or (UNIT,)
        result.items.append(Version(name=VERSION, units=names))
        for name in runs:
            result.by_mode[name].append(VERSION)

    def _of_group(self, draft: Draft, group: Sequence[Pu], amounts: Mapping[str, Amount], result: Versions) -> None:
        """Make the versions on one kind of unit: one, or several where modes choose different work."""
        works: dict[tuple[Duration | None, tuple[Access, ...], Split], list[str]] = {}
        for chosen in self._modes:
            amount = amounts.get(chosen.name)
            if amount is not None and amount.is_possible:
                works.setdefault(self._work(draft, amount, group[0], chosen), []).append(chosen.name)
        taken = {version.name: 1 for version in result.items}
        base = unique_name(legal(group[0].type.name) if group[0].type else VERSION, dict(taken))
        for (wcet, accesses, split), modes in works.items():
            name = base if len(works) == 1 else unique_name(f"{base}:{modes[0]}", taken)
            result.items.append(
                Version(
                    name=name,
                    wcet=wcet,
                    units=tuple(self._units[unit.item] for unit in group),
                    accesses=accesses,
                    split=split,
                )
            )
            for mode in modes:
                result.by_mode[mode].append(name)

    def _work(
        self, draft: Draft, amount: Amount, unit: Pu, mode: SystemMode
    ) -> tuple[Duration | None, tuple[Access, ...], Split]:
        """Return the WCET of some work on a unit, its access phases, and where it may be interrupted."""
        if not unit.frequency or not amount.is_known:
            return None, (), WHOLE
        stated = seconds(amount.cycles / unit.frequency)
        phases = () if self._memory == "none" else tuple(self._memories.phases(amount, unit))
        accesses = length_of(phases)
        if self._memory != "added" and accesses > stated:
            self.too_long[draft.task] = None
        wcet = stated + accesses if self._memory == "added" else max(stated, accesses)
        laid = placed(phases, wcet)
        reads = length_of(p for p in phases if p.kind is AccessKind.READ) if self._memory == "added" else ZERO
        held = [
            Access(
                resource=self._locks.name(lock.semaphore),
                start=reads + seconds(lock.begin / unit.frequency),
                end=reads + seconds(lock.end / unit.frequency),
            )
            for lock in self._locks.held(draft, mode, unit)
        ]
        return wcet, (*laid, *held), self._splitter.split(draft, mode, unit, phases, laid, wcet)

    def alone(self, draft: Draft) -> Callable[[Version], Version]:
        """Return what lets jobs of a version hold the lock of their task from start to end."""
        lock = self._locks.name(draft.task)

        def held(version: Version) -> Version:
            if version.wcet is None:
                return version
            whole = Access(resource=lock, start=ZERO, end=version.wcet)
            return replace(version, accesses=(*version.accesses, whole))

        return held

    def instants(self, trigger: Trigger) -> tuple[Instant, Instant]:
        """Return the first and the last instant at which a step of a source may trigger, over modes and units.

        Where the execution time before the step is not known, these are the start and the end of the job.
        """
        source = trigger.source
        spans = [span for unit in self.candidates.get(source, ()) for span in self._spans(trigger, unit)]
        if not spans or None in spans:
            return (Anchor.START, None), (Anchor.END, None)
        known = [span for span in spans if span is not None]
        if all(low == whole for low, _, whole in known):
            return (Anchor.END, None), (Anchor.END, None)
        low, high = min(low for low, _, _ in known), max(high for _, high, _ in known)
        shortest = min(whole for _, _, whole in known)
        is_stated = self._memory != "added" and source.task not in self.too_long
        return _point(low), _point(high) if high < shortest and is_stated else (Anchor.END, None)

    def _spans(self, trigger: Trigger, unit: Pu) -> Iterator[tuple[Duration, Duration, Duration] | None]:
        """Yield for each mode the least and most time to the trigger, and that of the whole job; None: not known."""
        after = trigger.cause.get("eventType") == "terminate"
        found, amount = trigger.source.part.steps, self._evaluator.amount
        for mode in self._modes:
            if mode.name not in trigger.modes or trigger.step is None or trigger.top is None:
                continue
            before, whole = amount(found[: found.index(trigger.top)], mode, unit), amount(found, mode, unit)
            span = self._evaluator.span([trigger.top], trigger.step, mode, unit, after=after)
            if span is None or not unit.frequency or not whole.is_known:
                yield None
            else:
                low, high = (seconds((before.cycles + cycles) / unit.frequency) for cycles in span)
                yield low, high, seconds(whole.cycles / unit.frequency)

    def report(self) -> None:
        """Report what concerns all tasks."""
        self._locks.report()
        help = "state where it may be interrupted in an overlay, or the longest piece with --pieces"
        cut = list(self._splitter.cut)
        self._forest.report_each(codes.CUT_RUNNABLES, "preemptive tasks are cut within runnables", cut, help)
        help = "state their units or their ticks for those units, or WCETs in an overlay"
        message = "tasks state times for other kinds of units only than they are bound to"
        self._forest.report_each(codes.IMPOSSIBLE_UNIT, message, list(self.impossible), help)
        help = "use --memory added, if the ticks do not contain the accesses"
        message = "tasks access memory for longer than the time they state"
        self._forest.report_each(codes.TOO_LONG_ACCESSES, message, list(self.too_long), help)


def _point(time: Duration) -> Instant:
    return (Anchor.POINT, time) if time else (Anchor.START, None)


def _groups(units: Sequence[Pu]) -> list[list[Pu]]:
    """Group units of one type and frequency, between which a task makes no difference."""
    groups: dict[tuple[Item | None, Fraction | None, tuple[object, ...]], list[Pu]] = {}
    for unit in units:
        paths = tuple((memory, path) for memory, path in unit.paths.items())
        groups.setdefault((unit.type, unit.frequency, paths), []).append(unit)
    return list(groups.values())
