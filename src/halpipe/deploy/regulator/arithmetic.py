"""The exact check of the tables: all they should be follows from model, schedule and the platform's facts."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Code, Diagnostic, about
from halpipe.core.files import sha256
from halpipe.core.quantities import format_rational
from halpipe.core.records import record
from halpipe.deploy.regulator import codes, promise
from halpipe.deploy.regulator.reading import DERIVED, FACTS, TABLES, Table, Tables, Unit
from halpipe.devices import DEVICES

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.deploy.base import Target
    from halpipe.deploy.regulator.promise import Phase, Row, Timeline
    from halpipe.models import ModeSchedule, TransitionTable

_AGAIN = "export the bundle again; if it stays so, the exporter is wrong: report it"


@record
class Planned:
    """A table that the schedule demands, as it is in the bundle, and what it should promise."""

    table: Table
    timeline: Timeline
    cycles: int
    length_ns: Fraction


@dataclass(slots=True)
class Arithmetic:
    """One check: the bundle's parts, the figures counted on the way, and the findings one after the other."""

    target: Target
    tables: Tables
    windows: int = 0
    budgets: int = 0
    planned: list[Planned] = field(default_factory=list)

    def findings(self) -> Iterator[Diagnostic]:
        """Yield everything that is wrong with the tables."""
        yield from self._hashes()
        yield from self._facts()
        yield from self._units()
        yield from self._defaults()
        planned = self.planned
        yield from self._modes(planned)
        yield from self._transitions(planned)
        yield from self._surplus(planned)
        yield from self._successors()
        for plan in planned:
            yield from self._length(plan)
            if promise.windows_of(plan.timeline, self.tables.platform) == plan.table.windows:
                yield from self._budgets(plan)
        for table in () if self.tables.backend in RATES else self.tables.tables:
            yield from self._capacity(table)

    def _found(self, code: Code, message: str, path: str = "", help: str = _AGAIN) -> Diagnostic:
        return code(message, at=self.target.bundle.at(TABLES), path=path, help=help)

    # -------------------------------------------------------------------------------------------- facts

    def _hashes(self) -> Iterator[Diagnostic]:
        stated = {"schedule.xml": self.tables.schedule_sha256, "model.xml": self.tables.model_sha256}
        for name, hash in stated.items():
            found = sha256(self.target.bundle.files[name])
            if hash != found:
                text = f"the tables are of {name} {hash[:16]}..., here is {found[:16]}..."
                yield self._found(codes.OTHER_SCHEDULE, text)

    def _facts(self) -> Iterator[Diagnostic]:
        platform, tables = self.tables.platform, self.tables
        for name in (*FACTS, *DERIVED):
            fact = getattr(platform, name)
            have, want = tables.stated.get(name), fact if isinstance(fact, str) else format_rational(Fraction(fact))
            if have != want:
                yield self._found(codes.WRONG_FACTS, f"{name} is {have}, platform.yaml gives {want}")
        limit = platform.window_cycles * platform.bus_bytes
        if platform.capacity_bytes > limit:
            text = f"a capacity of {platform.capacity_bytes} B in a window is more than the bus carries, {limit} B"
            help = "correct bandwidth, bus width or clock in the platform file"
            yield self._found(codes.WRONG_FACTS, text, help=help)
        if platform.resource not in {resource.name for resource in self.target.model.resources}:
            yield self._found(codes.WRONG_FACTS, f'the model has no resource "{platform.resource}"')
        managers: dict[int, str] = {}
        for unit in tables.units:
            if managers.setdefault(unit.manager, unit.name) != unit.name:
                text = f'has manager {unit.manager}, which is that of "{managers[unit.manager]}"'
                yield self._found(codes.WRONG_FACTS, text, about(unit=unit.name), "give each unit a manager of its own")

    def _units(self) -> Iterator[Diagnostic]:
        regulated = {unit.name for unit in self.tables.units}
        schedule = self.target.schedule
        jobs = schedule.all_jobs()
        used = {phase.row[0] for phase in promise.phases_of(self.target.model, self.tables.platform, jobs)}
        for name in sorted(used - regulated):
            text = f'uses "{self.tables.platform.resource}" and has no tables'
            yield self._found(codes.UNREGULATED_UNIT, text, about(unit=name), "give it a manager in the platform file")

    def _defaults(self) -> Iterator[Diagnostic]:
        platform, total = self.tables.platform, 0
        for unit, direction in self.tables.rows():
            budget = unit.default[direction]
            used = self.tables.is_used(unit, direction)
            total += budget + (unit.overshoot[direction] if used or budget else 0)
            path = f'unit "{unit.name}", {direction} default'
            if self.tables.backend in RATES:
                continue  # no bursts are counted
            if budget % platform.burst_bytes:
                text = f"{budget} B are not whole bursts of {platform.burst_bytes} B"
                yield self._found(codes.UNSAFE_DEFAULT, text, path)
            if used and budget < platform.burst_bytes:
                text = f"{budget} B do not let one burst of {platform.burst_bytes} B pass"
                yield self._found(codes.UNSAFE_DEFAULT, text, path)
        if total > platform.capacity_bytes:
            capacity = platform.capacity_bytes
            text = f"the defaults and their overshoot are {total} B in a window, the capacity is {capacity} B"
            yield self._found(codes.UNSAFE_DEFAULT, text, "defaults")

    # -------------------------------------------------------------------------------------------- which tables

    def _modes(self, planned: list[Planned]) -> Iterator[Diagnostic]:
        """Find the table of every mode; a bundle with one table and no switches may be made for that mode alone."""
        present = [table.mode for table in self.tables.tables if not table.is_transition]
        alone = len(self.tables.tables) == 1 and not self.tables.switches and len(present) == 1
        for mode in self.target.schedule.modes:
            if mode.name not in present:
                if not alone:
                    yield self._found(codes.WRONG_TABLE, "has no table", about(mode=mode.name))
                continue
            timeline = promise.mode_timeline(self.target.model, self.tables.platform, mode)
            planned.append(Planned(self._mode_table(mode.name), timeline, 0, promise.ZERO))

    def _mode_table(self, mode: str) -> Table:
        return next(table for table in self.tables.tables if table.mode == mode and not table.is_transition)

    def _transitions(self, planned: list[Planned]) -> Iterator[Diagnostic]:
        present = {table.mode for table in self.tables.tables if not table.is_transition}
        asked = {(switch.source, switch.target): switch.request for switch in self.tables.switches}
        listed = []
        for transition in self.target.schedule.transitions:
            pair = (transition.source, transition.target)
            if not present.issuperset(pair):
                continue
            listed.append(pair)
            plan, needed = self._plan(transition)
            path = f"switch {pair[0]}->{pair[1]}"
            if needed and plan is None:
                yield self._found(codes.WRONG_TABLE, "has no table, and needs one", path)
                continue
            if plan is not None:
                planned.append(plan)
            expected = plan.table.index if plan is not None else self._mode_table(pair[1]).index
            if asked.get(pair) != expected:
                said = f"requests table {asked[pair]}" if pair in asked else "requests no table"
                yield self._found(codes.WRONG_SWITCH, f"{said}, it must be {expected}", path)
        for pair in sorted(asked.keys() - set(listed)):
            yield self._found(codes.WRONG_SWITCH, "is not in the schedule", f"switch {pair[0]}->{pair[1]}")
        if len(asked) != len(self.tables.switches):
            yield self._found(codes.WRONG_SWITCH, "a switch is listed twice", "switches")

    def _plan(self, transition: TransitionTable) -> tuple[Planned | None, bool]:
        """Return the table of a switch, if it is there, and whether the switch needs one."""
        schedule = self.target.schedule
        source, target = schedule.mode(transition.source), schedule.mode(transition.target)
        pair = (transition.source, transition.target)
        found = [t for t in self.tables.tables if t.is_transition and (t.source, t.mode) == pair]
        timeline, cycles = self._line(source, transition, target)
        if not found:
            return None, timeline.span > 0
        if not timeline.span:  # a table that is there for its number: one cycle of the mode after
            timeline, cycles = self._line(source, transition, target, 1)
        return Planned(found[0], timeline, cycles, transition.length.fraction), True

    def _line(
        self, source: ModeSchedule, table: TransitionTable, target: ModeSchedule, least: int = 0
    ) -> tuple[Timeline, int]:
        return promise.transition_timeline(self.target.model, self.tables.platform, source, table, target, least)

    def _surplus(self, planned: Sequence[Planned]) -> Iterator[Diagnostic]:
        wanted = {plan.table.index for plan in planned}
        for table in self.tables.tables:
            if table.index not in wanted:
                yield self._found(codes.WRONG_TABLE, "belongs to no mode or switch, or is there twice", _path(table))

    def _successors(self) -> Iterator[Diagnostic]:
        modes = {table.mode: table.index for table in self.tables.tables if not table.is_transition}
        for table in self.tables.tables:
            expected = modes.get(table.mode)
            if expected is not None and table.successor != expected:
                text = f"is followed by table {table.successor}, it must be {expected}"
                yield self._found(codes.WRONG_SUCCESSOR, text, _path(table))
        if len(self.tables.tables) > MAX_TABLES:
            text = f"{len(self.tables.tables)} tables, at most {MAX_TABLES} can be told apart"
            yield self._found(codes.TOO_DEEP, text, "tables", "export fewer modes or switches")

    def _length(self, plan: Planned) -> Iterator[Diagnostic]:
        table = plan.table
        windows = promise.windows_of(plan.timeline, self.tables.platform)
        if windows != table.windows:
            text = f"has {table.windows} windows, the schedule has {windows}"
            yield self._found(codes.WRONG_TABLE, text, _path(table))
        if table.cycles != plan.cycles or table.length_ns != plan.length_ns:
            text = (
                f"states {table.length_ns} ns and {table.cycles} cycles, it must be {plan.length_ns} and {plan.cycles}"
            )
            yield self._found(codes.WRONG_TABLE, text, _path(table))

    # -------------------------------------------------------------------------------------------- budgets

    def _budgets(self, plan: Planned) -> Iterator[Diagnostic]:
        rows = plan.timeline.by_row()
        burst = self.tables.platform.burst_bytes
        for unit, direction in self.tables.rows():
            row = (unit.name, direction)
            granted = [budget // burst for budget in plan.table.budgets(*row)]
            self.budgets += len(granted)
            check = self._whole if plan.table.rounding == "whole" else self._controlled
            yield from check(plan, row, rows.get(row, []), granted)

    def _whole(self, plan: Planned, row: Row, phases: Sequence[Phase], granted: list[int]) -> Iterator[Diagnostic]:
        expected = promise.whole_bursts(plan.timeline, self.tables.platform, phases, len(granted))
        wrong = [window for window, bursts in enumerate(granted) if bursts != expected[window]]
        if wrong:
            first = wrong[0]
            text = f"{granted[first]} bursts in window {first}, promised are {expected[first]}{_more(wrong)}"
            yield self._found(codes.WRONG_BUDGET, text, _path(plan.table, row))

    def _controlled(self, plan: Planned, row: Row, phases: Sequence[Phase], granted: list[int]) -> Iterator[Diagnostic]:
        volumes, scale = promise.promised_bursts(plan.timeline, self.tables.platform, phases, len(granted))
        total, wrong = 0, []
        for window, bursts in enumerate(granted):
            total += bursts
            if not volumes[window + 1] // scale <= total <= -(-volumes[window + 1] // scale):
                wrong.append((window, total))
        if wrong:
            window, total = wrong[0]
            promised = Fraction(volumes[window + 1], scale)
            text = f"{total} bursts until the end of window {window}, promised are {promised}{_more(wrong)}"
            yield self._found(codes.NOT_KEPT_UP, text, _path(plan.table, row))

    def _capacity(self, table: Table) -> Iterator[Diagnostic]:
        """Check the sums; they change only where some unit's entry begins."""
        self.windows += table.windows
        reserve = sum(sum(unit.overshoot.values()) for unit in self.tables.units)
        changes: dict[int, int] = {}
        for unit, direction in self.tables.rows():
            before = 0
            for window, budget in self._charged(table, unit, direction):
                changes[window] = changes.get(window, 0) + budget - before
                before = budget
        total, over = 0, []
        for window in sorted(changes):
            total += changes[window]
            if total + reserve > self.tables.platform.capacity_bytes:
                over.append((window, total))
        if over:
            window, total = over[0]
            capacity = self.tables.platform.capacity_bytes
            text = (
                f"{total} B and {reserve} B of overshoot in window {window}, the capacity is {capacity} B{_more(over)}"
            )
            yield self._found(codes.OVER_CAPACITY, text, _path(table))

    def _charged(self, table: Table, unit: Unit, direction: str) -> Iterator[tuple[int, int]]:
        """Yield what a row may use from which window on.

        The unit in Verilog cannot withdraw a burst that it has shown: one of the window before may be taken in a window
        without a budget. Window 0 follows the last one of each table that may come before; not that of the defaults,
        since a window without any budget lies between.
        """
        entries = table.entries[unit.name]
        if self.tables.backend != "table":
            yield from ((entry.window, entry.budget(direction)) for entry in entries)
            return
        burst = self.tables.platform.burst_bytes
        had = any(t.entries[unit.name][-1].budget(direction) for t in self.tables.before(table))
        ends = [*(entry.window for entry in entries[1:]), table.windows]
        for entry, end in zip(entries, ends, strict=True):
            budget = entry.budget(direction)
            yield entry.window, budget or (burst if had else 0)
            if had and not budget and entry.window + 1 < end:
                yield entry.window + 1, 0
            had = budget > 0


MAX_TABLES = 255
RATES = tuple(device.name for device in DEVICES.values() if device.rates)
"""Back-ends that hold one rate per unit, and no budgets per window: their sums are those of what they are set to."""


def _path(table: Table, row: Row | None = None) -> str:
    return f'table "{table.name}"' + (f', unit "{row[0]}", {row[1]}' if row else "")


def _more(wrong: Sequence[object]) -> str:
    return f", and {len(wrong) - 1} more" if len(wrong) > 1 else ""
