"""The table object, from which every back-end is written: whole bursts for every unit, direction, table and window."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from itertools import compress, count, pairwise
from math import ceil
from operator import ne
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Findings, about
from halpipe.core.quantities import format_bandwidth, format_size
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean, few
from halpipe.exporters.regulator.codes import (
    ABOVE_RESOURCE,
    DOES_NOT_FIT,
    NO_MANAGER,
    NO_UNIT,
    OVER_CAPACITY,
    OVERSHOOT_TOO_LOW,
    UNKNOWN_UNIT,
    UNSAFE_DEFAULTS,
)
from halpipe.exporters.regulator.frames import MODE, Frame, Framer, Grid, Row, grid_of
from halpipe.exporters.regulator.platform import DIRECTIONS, READ, WRITE, Platform
from halpipe.exporters.regulator.rounding import (
    Overload,
    controlled,
    controlled_seams,
    overload,
    promises,
    totals,
    whole,
)
from halpipe.exporters.regulator.windows import check_windows
from halpipe.exporters.regulator.words import CONTROLLED, WHOLE

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from halpipe.exporters.regulator.rounding import Bursts, Promise
    from halpipe.exporters.regulator.writing import Backend
    from halpipe.models import Schedule, TaskModel

MAX_TABLES = 255
ZERO = Fraction(0)


@record
class Entry:
    """Budgets from a window on, until the next entry, in whole bursts."""

    window: int
    read: int
    write: int


@record
class RegulatedUnit:
    """A unit with its regulator: `default` and `overshoot` in bytes per window for each direction."""

    index: int
    name: str
    manager: int
    default: Mapping[str, int]
    overshoot: Mapping[str, int]


@dataclass(frozen=True)
class Table:
    """The budgets of one mode or transition: `bursts` of every row and window, by the rule `rounding`."""

    index: int
    frame: Frame
    windows: int
    successor: int
    rounding: str
    bursts: Bursts
    promised: Mapping[Row, Promise]

    @property
    def name(self) -> str:
        """The name of the mode, or ``a->b``."""
        return self.frame.name

    def row(self, row: Row) -> list[int]:
        """Return the bursts of a row for every window."""
        return self.bursts.get(row) or [0] * self.windows

    @cached_property
    def totals(self) -> list[int]:
        """Bursts of all rows together, window by window."""
        return totals(self.bursts, self.windows)

    def entries(self, unit: str) -> list[Entry]:
        """Return the budgets of a unit, run-length over windows."""
        if unit not in self._entries:
            read, write = self.row(Row(unit, READ)), self.row(Row(unit, WRITE))
            changes = sorted({0, *run_starts(read), *run_starts(write)})
            self._entries[unit] = [Entry(k, read[k], write[k]) for k in changes]
        return self._entries[unit]

    @cached_property
    def _entries(self) -> dict[str, list[Entry]]:
        return {}


def run_starts(values: Sequence[int]) -> Iterator[int]:
    """Yield the positions, after the first, at which a value differs from the one before."""
    return compress(count(1), map(ne, values[1:], values))


@record
class Switch:
    """Table that software requests to go from one mode to another: a transition table, or the mode's own."""

    source: str
    target: str
    request: int


@dataclass(frozen=True)
class Tables:
    """Everything that a back-end writes: see the module."""

    model: str
    platform: Platform
    backend: str
    resource: str
    grid: Grid
    units: tuple[RegulatedUnit, ...]
    tables: tuple[Table, ...]
    switches: tuple[Switch, ...]

    @property
    def bursts(self) -> Fraction:
        """Bursts per window that a bound of 1 promises."""
        return self.platform.promise / self.platform.burst

    @property
    def reserve(self) -> int:
        """Bytes per window that are kept for overshoot, over all units and directions."""
        return sum(sum(unit.overshoot.values()) for unit in self.units)

    @property
    def room(self) -> int:
        """Whole bursts that may be granted in a window."""
        return room(self.platform, self.reserve)

    @property
    def rows(self) -> list[Row]:
        """Every row that has a budget somewhere, units in order."""
        used = {row for table in self.tables for row, bursts in table.bursts.items() if any(bursts)}
        return [row for unit in self.units for d in DIRECTIONS if (row := Row(unit.name, d)) in used]


def room(platform: Platform, reserve: int) -> int:
    """Return the whole bursts that may be granted in a window when `reserve` bytes of it are kept."""
    return (platform.window_capacity - reserve) // platform.burst


class TableBuilder:
    """Builds the table object of a verified schedule, collecting everything that does not work out."""

    def __init__(self, model: TaskModel, schedule: Schedule, platform: Platform, backend: Backend) -> None:
        self.model = model
        self.schedule = schedule
        self.platform = platform
        self.backend = backend
        self.findings = Findings()
        self.resource = platform.regulated(model)

    def build(self, rule: str) -> Tables:
        """Return the tables, rounded by `rule` (or by what fits); raise `HalpipeError` with all that is wrong."""
        self.findings.extend(check_windows(self.schedule, self.platform))
        self.findings.stop_on_errors()
        grid = grid_of(self.model, self.schedule, self.platform.window)
        every = self.backend.name == "table" and self.platform.settings["table"]["switches"] == "all"
        framer = Framer(self.model, self.schedule, self.resource, grid, self.platform.unspecified, every=every)
        frames = framer.frames()
        self._check_limits(frames)
        used = {phase.row for frame in frames for phase in frame.phases if phase.bound}
        units = self._units({phase.row.unit for frame in frames for phase in frame.phases}, used)
        self.findings.stop_on_errors()
        carrying = len(used) if self.backend.device.carries else 0
        tables = self._tables(frames, units, grid, rule, carrying)
        self.findings.stop_on_errors()
        return Tables(
            model=self.model.name,
            platform=self.platform,
            backend=self.backend.name,
            resource=self.resource,
            grid=grid,
            units=units,
            tables=tables,
            switches=self._switches(tables),
        )

    def _check_limits(self, frames: list[Frame]) -> None:
        if len(frames) > MAX_TABLES:
            message = f"{len(frames)} modes and transitions need a table; table numbers have 8 bits"
            help = "list fewer transitions in the model, or export single modes with --mode"
            self.findings.add(DOES_NOT_FIT(message, at=self.schedule.at, path=about(model=self.model.name), help=help))
        stated = next((r.bandwidth for r in self.model.resources if r.name == self.resource), None)
        guaranteed = self.platform.guaranteed
        if stated is not None and guaranteed > stated:
            message = (
                f"{format_bandwidth(guaranteed)} are guaranteed, the model's resource has {format_bandwidth(stated)}"
            )
            help = f"guarantee at most {format_bandwidth(stated)}, or correct the model"
            path = about(resource=self.resource)
            self.findings.add(ABOVE_RESOURCE(message, at=self.platform.at, path=path, help=help))

    # ---- units

    def _units(self, named: set[str], used: set[Row]) -> tuple[RegulatedUnit, ...]:
        platform, names = self.platform, [unit.name for unit in self.model.units]
        for name, port in platform.units.items():
            if name not in names:
                help = did_you_mean(name, names, "remove it, or correct its name")
                message = f'model "{self.model.name}" has no such unit'
                self.findings.add(UNKNOWN_UNIT(message, at=port.at, path=about(unit=name), help=help))
        for name in names:
            if name not in platform.units and name in named:
                message = (
                    f'the schedule lets it use "{self.resource}", but platform "{platform.name}" has no manager for it'
                )
                free = next(n for n in count() if all(n != u.manager for u in platform.units.values()))
                help = f'add "{name}: {{manager: {free}}}" to the units of the platform'
                self.findings.add(NO_MANAGER(message, at=platform.at, path=about(unit=name), help=help))
        known = [name for name in names if name in platform.units]
        if not known:
            message, path = f'platform "{platform.name}" has no unit of model "{self.model.name}"', "platform units"
            self.findings.add(NO_UNIT(message, at=platform.at, path=path, help=f"add {few(names)} to its units"))
        overshoot = self._overshoot()
        rows = [Row(name, direction) for name in known for direction in DIRECTIONS]
        active = {row for row in rows if self._is_reserved(row, used)}
        reserved = {row: overshoot if row in active else 0 for row in rows}
        defaults = self._defaults(used, reserved)
        return tuple(
            RegulatedUnit(
                index=index,
                name=name,
                manager=platform.units[name].manager,
                default={d: defaults[Row(name, d)] for d in DIRECTIONS},
                overshoot={d: reserved[Row(name, d)] for d in DIRECTIONS},
            )
            for index, name in enumerate(known)
        )

    def _is_reserved(self, row: Row, used: set[Row]) -> bool:
        rule = self.backend.device.reserves
        is_used = row in used or bool(self.platform.units[row.unit].default[row.direction])
        return is_used or rule == "all" or (rule == "units" and any(Row(row.unit, d) in used for d in DIRECTIONS))

    def _overshoot(self) -> int:
        """Return what is reserved for each row: overshoot, and what an idle row may do for lack of a budget of 0."""
        known = self.backend.overshoot(self.platform)
        stated = self.platform.overshoot
        if stated is not None and stated < known:
            message = f"{format_size(stated)} are stated, but {self.backend.name} lets {format_size(known)} pass"
            help = f'write "overshoot: {format_size(known)}", or remove the key'
            self.findings.add(OVERSHOOT_TOO_LOW(message, at=self.platform.at, path="platform overshoot", help=help))
        return reserve_of(self.platform, self.backend)

    def _defaults(self, used: set[Row], reserved: Mapping[Row, int]) -> dict[Row, int]:
        """Return the safe budgets before regulation starts: those stated, else equal shares of the rest, or none."""
        platform = self.platform
        stated = {row: platform.units[row.unit].default[row.direction] for row in reserved}
        free = platform.window_capacity - sum(reserved.values()) - sum(v or 0 for v in stated.values())
        open_rows = [row for row, value in stated.items() if value is None and row in used]
        grain = 1 if self.backend.device.rates else platform.burst
        share = free // (grain * max(1, len(open_rows))) * grain
        defaults = {row: (share if row in used else 0) if value is None else value for row, value in stated.items()}
        path = "platform units"
        if free < 0:
            message = f"defaults and overshoot sum to {platform.window_capacity - free} bytes per window"
            help = f"lower the defaults; a window carries {platform.window_capacity} bytes"
            self.findings.add(UNSAFE_DEFAULTS(message, at=platform.at, path=path, help=help))
        for row, value in defaults.items():
            if value % grain or (row in used and value < grain and free >= 0):
                least = max(1, -(-value // grain)) * grain
                message = (
                    f"default for {row.direction}s is {value} bytes per window, which is not whole bursts from 1 on"
                )
                help = f"state {least} bytes (and use a longer window where that is too much)"
                at = platform.units[row.unit].at
                self.findings.add(UNSAFE_DEFAULTS(message, at=at, path=about(unit=row.unit), help=help))
        return defaults

    # ---- tables

    def _tables(
        self, frames: list[Frame], units: tuple[RegulatedUnit, ...], grid: Grid, rule: str, carrying: int
    ) -> tuple[Table, ...]:
        bursts = self.platform.promise / self.platform.burst
        free = room(self.platform, sum(sum(unit.overshoot.values()) for unit in units))
        index = {frame.name: number for number, frame in enumerate(frames)}
        successors = [n if frame.kind == MODE else index[frame.target] for n, frame in enumerate(frames)]
        promised = [promises(frame, grid.window, bursts) for frame in frames]
        plans = [_Plan(frame.span // grid.window, p, rule, free) for frame, p in zip(frames, promised, strict=True)]
        if carrying:
            _settle(plans, self._leads(index, successors))
        tables = []
        for number, (frame, plan) in enumerate(zip(frames, plans, strict=True)):
            found = plan.found
            if isinstance(found, Overload) and self.backend.device.rates:  # which checks the sums of its rates
                plan.rounding, found = WHOLE, whole(plan.promised)
            if isinstance(found, Overload):
                self.findings.add(self._over_capacity(frame, found, plan.rounding, plan.promised, units, carrying))
                continue
            tables.append(
                Table(number, frame, plan.windows, successors[number], plan.rounding, found, promised[number])
            )
        return tuple(tables)

    def _leads(self, index: Mapping[str, int], successors: Sequence[int]) -> list[set[int]]:
        """Return for every table those after which it may begin."""
        before = [{n for n, successor in enumerate(successors) if successor == number} for number in index.values()]
        for t in self.schedule.transitions:
            request = index.get(t.name, index[t.target])
            before[request].add(index[t.source])
        return before

    def _over_capacity(
        self,
        frame: Frame,
        found: Overload,
        rounding: str,
        promised: Mapping[Row, Promise],
        units: tuple[RegulatedUnit, ...],
        carrying: int,
    ) -> Diagnostic:
        """Explain with the numbers, and name the bandwidths with which it would fit."""
        p = self.platform
        reserve = sum(sum(unit.overshoot.values()) for unit in units)
        free = found.room
        kept = f", of which {reserve} bytes are reserved for overshoot" if reserve else ""
        kept += "; a burst shown in the window before may pass in it" if carrying else ""
        message = (
            f"window {found.window} needs {found.needed} bursts of {p.burst} bytes, there is room for {free} "
            f"(capacity {p.window_capacity} bytes{kept})"
        )
        needed = found.needed  # in the worst window where whole, in the first that overflows where controlled
        lower = 0
        if rounding == CONTROLLED:
            needed = max(needed, ceil(max(_fluid(promised))) + carrying)
            lower = max(0, free - carrying) * p.guaranteed // (needed - carrying)
        lone = max(max(bursts) for bursts in whole(promised).values())
        capacity = -(-(needed * p.burst + reserve) * p.clock // p.cycles)
        choices = [f'"capacity: {format_bandwidth(capacity)}"'] if capacity <= p.bus * p.clock else []
        choices += [f'"guaranteed: {format_bandwidth(lower)}"'] if lower else []
        choices += ["scheduling with --quantise"] if lone <= free - carrying else []
        help = f"any of these helps: {', '.join(choices)}" if choices else "use a longer window"
        return OVER_CAPACITY(message, at=frame.at, path=frame.path, help=help)

    def _switches(self, tables: tuple[Table, ...]) -> tuple[Switch, ...]:
        index = {table.name: table.index for table in tables}
        return tuple(Switch(t.source, t.target, index.get(t.name, index[t.target])) for t in self.schedule.transitions)


@dataclass(slots=True)
class _Plan:
    """The bursts of a table while they are sought: `before` are the rows that may carry one into the first window.

    None: nothing is ever carried over.
    """

    windows: int
    promised: Mapping[Row, Promise]
    rule: str
    free: int
    before: frozenset[Row] | None = None
    rounding: str = ""
    found: Bursts | Overload = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.round()

    def round(self) -> None:
        """Round by the rule, or by what fits."""
        if self.rule != CONTROLLED:
            bursts = whole(self.promised)
            excess = overload(bursts, self.windows, self.free, self.before)
            if excess is None or self.rule == WHOLE:
                self.rounding, self.found = WHOLE, excess or bursts
                return
        self.rounding = CONTROLLED
        if self.before is None:
            self.found = controlled(self.promised, self.windows, self.free)
        else:
            self.found = controlled_seams(self.promised, self.windows, self.free, self.before)

    def last(self) -> set[Row]:
        """Return the rows that have bursts in the last window."""
        return set() if isinstance(self.found, Overload) else {row for row, n in self.found.items() if n and n[-1]}


def _settle(plans: list[_Plan], leads: list[set[int]]) -> None:
    """Round until every table has room for what the tables that lead to it may carry into its first window."""
    known = [frozenset[Row]()] * len(plans)
    for plan in plans:
        plan.before = frozenset()
        plan.round()
    stale = True
    while stale:
        stale = False
        for n, (plan, before) in enumerate(zip(plans, leads, strict=True)):
            carried = frozenset[Row]().union(*(plans[each].last() for each in before))
            if not isinstance(plan.found, Overload) and not carried <= known[n]:
                plan.before = known[n] = carried | known[n]
                plan.round()
                stale = True


def reserve_of(platform: Platform, backend: Backend) -> int:
    """Return the bytes per window to keep for one direction of a unit: overshoot, and bursts that cannot be denied."""
    overshoot = backend.overshoot(platform) if platform.overshoot is None else platform.overshoot
    return overshoot + backend.device.least * platform.burst


def _fluid(promised: Mapping[Row, Promise]) -> list[Fraction]:
    """Return the promise of all rows together, window by window."""
    rows = (
        [Fraction(b - a, p.denominator) if a != b else ZERO for a, b in pairwise(p.numerators)]
        for p in promised.values()
    )
    return [sum(row, ZERO) for row in zip(*rows, strict=True)]
