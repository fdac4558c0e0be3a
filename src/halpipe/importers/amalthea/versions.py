"""Versions of tasks: one for each kind of unit that may run the task, and for each amount of work that modes choose."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, seconds
from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.hardware import Pu
from halpipe.importers.amalthea.memory import length_of, placed
from halpipe.importers.amalthea.names import legal
from halpipe.models import WHOLE, Access, AccessKind, Version

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from fractions import Fraction

    from halpipe.core.durations import Duration
    from halpipe.importers.amalthea.graph import Amount, Evaluator
    from halpipe.importers.amalthea.locks import Locks
    from halpipe.importers.amalthea.memory import Memories
    from halpipe.importers.amalthea.modes import SystemMode
    from halpipe.importers.amalthea.parts import Draft, Trigger
    from halpipe.importers.amalthea.splitting import Splitter
    from halpipe.importers.amalthea.xmi import Forest, Item
    from halpipe.models import Split

UNIT = "core0"
VERSION = "default"


@dataclass(slots=True)
class Versions:
    """The versions of one task, and the names of those available in each mode."""

    items: list[Version] = field(default_factory=list)
    by_mode: dict[str, list[str]] = field(default_factory=dict)


class VersionMaker:
    """Makes versions; remembers what to report of all tasks together."""

    def __init__(
        self,
        forest: Forest,
        evaluator: Evaluator,
        memories: Memories,
        units: Mapping[Item, str],
        *,
        modes: Sequence[SystemMode],
        memory: str,
        splitter: Splitter,
        locks: Locks,
    ) -> None:
        self._forest = forest
        self._evaluator = evaluator
        self._memories = memories
        self._units = units
        self._modes = modes
        self._memory = memory
        self._splitter = splitter
        self._locks = locks
        self.too_long: dict[Item, None] = {}
        self.impossible: dict[Item, None] = {}
        self.candidates: dict[Draft, Sequence[Pu]] = {}

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
        base = _unique(legal(group[0].type.name) if group[0].type else VERSION, result.items)
        for (wcet, accesses, split), modes in works.items():
            name = base if len(works) == 1 else _unique(f"{base}:{modes[0]}", result.items)
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

    def earliest(self, trigger: Trigger) -> Duration:
        """Return the least execution time of a source before the step that triggers, over modes and units."""
        before = trigger.source.part.steps[: trigger.source.part.steps.index(trigger.top)] if trigger.top else []
        times = [ZERO] if not self._units or not before else []
        for unit in self.candidates.get(trigger.source, ()) if before else ():
            for mode in self._modes:
                amount = self._evaluator.amount(before, mode, unit)
                times.append(seconds(amount.cycles / unit.frequency) if unit.frequency and amount.is_known else ZERO)
        return min(times, default=ZERO)

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


def _groups(units: Sequence[Pu]) -> list[list[Pu]]:
    """Group units of one type and frequency, between which a task makes no difference."""
    groups: dict[tuple[Item | None, Fraction | None, tuple[object, ...]], list[Pu]] = {}
    for unit in units:
        paths = tuple((memory, path) for memory, path in unit.paths.items())
        groups.setdefault((unit.type, unit.frequency, paths), []).append(unit)
    return list(groups.values())


def _unique(name: str, versions: Sequence[Version]) -> str:
    taken = {version.name for version in versions}
    chosen, number = name, 2
    while chosen in taken:
        chosen, number = f"{name}~{number}", number + 1
    return chosen
