"""Reader of tables.json and platform.yaml of a bundle, strictly by their documented forms.

Read here on its own (docs/reference/regulator-platform.md), and not through the exporter.
"""

from __future__ import annotations

from dataclasses import field, replace
from fractions import Fraction
from typing import TYPE_CHECKING, TypeVar

from halpipe.core.diagnostics import Diagnostic, Findings, HalpipeError
from halpipe.core.durations import Duration
from halpipe.core.quantities import parse_bandwidth, parse_frequency, parse_rational, parse_size
from halpipe.core.records import record
from halpipe.core.settings import Fields, Words
from halpipe.deploy.regulator.codes import UNUSABLE_TABLES, WRONG_FACTS
from halpipe.devices import DEVICES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from halpipe.core.bundles import Bundle


T = TypeVar("T")
D = TypeVar("D")

TABLES = "tables.json"
DIRECTIONS = ("read", "write")
MAX_WORD = 2**32 - 1
MAX_WINDOWS = 2**22


@record(kw_only=True)
class Platform:
    """The facts that every figure follows from: Hz, bytes, cycles, bytes per second; settings as they are written.

    `units` are the keys of each unit, `settings` those of each back-end with their defaults.
    """

    name: str
    resource: str
    clock_hz: int
    bus_bytes: int
    burst_bytes: int
    window_cycles: int
    window_extra: Fraction
    guaranteed: int
    capacity: int
    unspecified: str
    peak: int | None = None
    overshoot: int | None = None
    units: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    settings: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    @property
    def window_ns(self) -> Fraction:
        """The length of a window in nanoseconds, exact."""
        return (self.window_cycles + self.window_extra) * 10**9 / self.clock_hz

    @property
    def promise_bytes(self) -> Fraction:
        """Return the bytes that a bound of 1 promises in one window."""
        return self.guaranteed * (self.window_cycles + self.window_extra) / self.clock_hz

    @property
    def capacity_bytes(self) -> int:
        """Return the whole bytes that all units together may get in one window, the shorter where they differ."""
        return self.capacity * self.window_cycles // self.clock_hz

    @property
    def table_depth(self) -> int:
        """The entries that the memory of a unit holds."""
        return self.number("table", "depth")

    def number(self, backend: str, key: str) -> int:
        """Return a setting that is a whole number."""
        return int(self.settings[backend][key])


@record(kw_only=True)
class Unit:
    """A regulated unit: its place in the files, its bus manager, default budgets and reserve by direction."""

    index: int
    name: str
    manager: int
    default: Mapping[str, int]
    overshoot: Mapping[str, int]


@record
class Entry:
    """Budgets in bytes from a window on, until the next entry."""

    window: int
    read: int
    write: int

    def budget(self, direction: str) -> int:
        """Return the budget of one direction."""
        return self.read if direction == "read" else self.write


@record(kw_only=True)
class Table:
    """The budgets of a mode's hyperperiod, or of a switch from `source` to `mode`."""

    index: int
    name: str
    mode: str
    source: str
    windows: int
    successor: int
    rounding: str
    cycles: int
    length_ns: Fraction
    entries: Mapping[str, tuple[Entry, ...]]

    @property
    def is_transition(self) -> bool:
        """Whether this is the table of a switch."""
        return bool(self.source)

    def budgets(self, unit: str, direction: str) -> list[int]:
        """Return the budget of every window."""
        entries = self.entries[unit]
        ends = [*(entry.window for entry in entries[1:]), self.windows]
        return [
            e.budget(direction) for e, end in zip(entries, ends, strict=True) for _ in range(end - e.window)
        ]  # fmt: skip


@record
class Switch:
    """Table that software requests to go from one mode to another."""

    source: str
    target: str
    request: int


@record(kw_only=True)
class Tables:
    """The table object; `stated` are the figures of its platform and those derived from them, as they are written."""

    backend: str
    schedule_sha256: str
    model_sha256: str
    platform: Platform
    stated: Mapping[str, str]
    units: tuple[Unit, ...]
    tables: tuple[Table, ...]
    switches: tuple[Switch, ...]

    def rows(self) -> Iterator[tuple[Unit, str]]:
        """Yield every unit with each direction."""
        for unit in self.units:
            for direction in DIRECTIONS:
                yield unit, direction

    def before(self, table: Table) -> list[Table]:
        """Return the tables after whose end `table` may begin: those that it follows, and those that ask for it."""
        modes = {t.mode: t for t in self.tables if not t.is_transition}
        asking = [modes[s.source] for s in self.switches if s.request == table.index and s.source in modes]
        return [t for t in self.tables if t.successor == table.index or t in asking]

    def is_used(self, unit: Unit, direction: str) -> bool:
        """Return whether a row has a budget in any table."""
        return any(entry.budget(direction) for table in self.tables for entry in table.entries[unit.name])


def read_tables(bundle: Bundle) -> Tables:
    """Return the table object of a bundle; raise `HalpipeError` where it is not in its form."""
    if TABLES not in bundle.files:
        raise HalpipeError(UNUSABLE_TABLES("is not in the bundle", at=bundle.at(TABLES), help=_HELP))
    findings, at = Findings(), bundle.at(TABLES)
    top = Fields.sealed(bundle.files[TABLES], str(at.file), findings, UNUSABLE_TABLES, _HELP)
    findings.stop_on_errors()
    platform = read_platform(bundle)
    try:
        tables = _tables(top, platform)
    except ValueError as failure:  # may follow from values that are missing or wrong
        findings.stop_on_errors()
        raise HalpipeError(UNUSABLE_TABLES(str(failure), at=at, help=_HELP)) from None
    findings.stop_on_errors()
    return tables


_HELP = "export the bundle again with `halpipe export regulator`"


def _tables(root: Fields, platform: Platform) -> Tables:
    root.number("halpipe-regulator", 1, 1)
    stated = _texts(root.part("platform")) | {key: root.text(key) for key in DERIVED}
    platform = replace(
        platform, name=platform.name or stated.get("name", ""), resource=platform.resource or stated.get("resource", "")
    )
    units = [_unit(item) for item in root.items("units")]
    names = [unit.name for unit in units]
    if not units or len(set(names)) != len(names) or [unit.index for unit in units] != list(range(len(units))):
        raise ValueError("units must be there, be different, and be in the order of their index, from 0 on")
    tables = [_table(item, names, platform.burst_bytes) for item in root.items("tables")]
    if not tables or [table.index for table in tables] != list(range(len(tables))):
        raise ValueError("tables must be there, in the order of their index, from 0 on")
    return Tables(
        backend=root.required("backend", Words(*DEVICES)),
        schedule_sha256=root.text("schedule_sha256"),
        model_sha256=root.text("model_sha256"),
        platform=platform,
        stated=stated,
        units=tuple(units),
        tables=tuple(tables),
        switches=tuple(Switch(s.text("from"), s.text("to"), _word(s, "request")) for s in root.items("switches")),
    )


def _word(f: Fields, key: str) -> int:
    return f.number(key, 0, MAX_WORD)


def _by_direction(f: Fields) -> dict[str, int]:
    return {direction: _word(f, direction) for direction in DIRECTIONS}


def _unit(f: Fields) -> Unit:
    return Unit(
        index=_word(f, "index"),
        name=f.text("unit"),
        manager=_word(f, "manager"),
        default=_by_direction(f.part("default")),
        overshoot=_by_direction(f.part("overshoot")),
    )


def _table(f: Fields, units: list[str], burst: int) -> Table:
    name, entries = f.text("name"), f.part("entries")
    moves = f.required("kind", Words("mode", "transition")) == "transition"
    windows = f.number("windows", 1, MAX_WINDOWS)
    if sorted(entries) != sorted(units):
        raise ValueError(f'table "{name}" must have entries for every unit and no other')
    return Table(
        index=_word(f, "index"),
        name=name,
        mode=f.text("to" if moves else "mode"),
        source=f.text("from") if moves else "",
        windows=windows,
        successor=_word(f, "successor"),
        rounding=f.required("rounding", Words("whole", "controlled")),
        cycles=_word(f, "cycles") if moves else 0,
        length_ns=f.required("length_ns", parse_rational) if moves else Fraction(0),
        entries={
            unit: _entries(list(entries.items(unit)), f'"{name}", unit "{unit}"', windows, burst) for unit in units
        },
    )


def _entries(items: list[Fields], path: str, windows: int, burst: int) -> tuple[Entry, ...]:
    entries = tuple(Entry(*(_word(e, key) for key in ("window", "read_bytes", "write_bytes"))) for e in items)
    starts = [entry.window for entry in entries]
    if starts[:1] != [0] or starts != sorted(set(starts)) or starts[-1] >= windows:
        raise ValueError(f"{path}: entries must begin with window 0, ascend, and stay below {windows}")
    for item, entry in zip(items, entries, strict=True):
        for direction in DIRECTIONS:
            if _word(item, f"{direction}_bursts") * burst != entry.budget(direction):
                raise ValueError(f"{path}, window {entry.window}: {direction} bursts of {burst} B are not its bytes")
    return entries


PLATFORM = "platform.yaml"
_STATED = "export the bundle again; tables.json is made from platform.yaml"


def read_platform(bundle: Bundle) -> Platform:
    """Return the facts of a bundle; raise `HalpipeError` where the file is not in its form."""
    if PLATFORM not in bundle.files:
        raise HalpipeError(UNUSABLE_TABLES("is not in the bundle", at=bundle.at(PLATFORM), help=_STATED))
    findings, at = Findings(), bundle.at(PLATFORM)
    platform = _platform(Fields.sealed(bundle.files[PLATFORM], str(at.file), findings, UNUSABLE_TABLES, _STATED))
    findings.stop_on_errors()
    return platform


def _platform(top: Fields) -> Platform:
    clock, guaranteed = top.required("clock", parse_frequency), top.required("guaranteed", parse_bandwidth)
    top.stop_on_errors()
    cycles = top.required("window", lambda text: _cycles(text, clock))
    top.stop_on_errors()

    def stated(key: str, read: Callable[[str], T], default: D) -> T | D:
        return top.required(key, read) if key in top else default

    return Platform(
        clock_hz=clock,
        bus_bytes=top.required("bus", _bus),
        burst_bytes=top.required("burst", parse_size),
        window_cycles=int(cycles),
        window_extra=cycles - int(cycles),
        guaranteed=guaranteed,
        capacity=stated("capacity", parse_bandwidth, guaranteed),
        peak=stated("peak", parse_bandwidth, None),
        unspecified=stated("unspecified", str, "read"),
        resource=stated("resource", str, ""),
        name=stated("name", str, ""),
        overshoot=stated("overshoot", parse_size, None),
        units={name: _texts(unit) for name, unit, _ in top.entries("units")},
        settings={
            name: device.defaults | (_texts(top.part(name)) if name in top else {}) for name, device in DEVICES.items()
        },
    )


def _texts(f: Fields) -> dict[str, str]:
    return {key: f.text(key) for key in f}


def _cycles(text: str, clock: int) -> Fraction:
    window = text.strip()
    return Fraction(int(window)) if window.isdigit() else Duration.parse(window).in_unit("s") * clock


def _bus(text: str) -> int:
    bus = text.strip()
    return int(parse_rational(bus.removesuffix("bit")) / 8) if bus.endswith("bit") else parse_size(bus)


# ---------------------------------------------------------------------------------------------- tables.json


FACTS = (
    *("name", "resource", "clock_hz", "bus_bytes", "burst_bytes", "window_cycles", "window_extra"),
    *("guaranteed", "capacity", "unspecified", "table_depth"),
)
DERIVED = ("window_ns", "promise_bytes", "capacity_bytes")


def compare_facts(bundle: Bundle, tables: Tables) -> Iterator[Diagnostic]:
    """Yield every figure of a unit in tables.json that platform.yaml does not state so."""
    p = tables.platform
    pairs: list[tuple[str, object, object]] = []
    for unit in tables.units:
        known = p.units.get(unit.name, {})
        pairs.append((f'manager of unit "{unit.name}"', str(unit.manager), known.get("manager")))
        for direction in DIRECTIONS:
            stated = known.get(f"default-{direction}")
            if stated is not None:
                pairs.append((f'{direction} default of "{unit.name}"', unit.default[direction], parse_size(stated)))
            kept, expected = unit.overshoot[direction], _reserve(tables, unit, direction)
            pairs.append((f'{direction} overshoot of "{unit.name}"', kept, expected))
    for what, have, want in pairs:
        if have != want:
            text = f"{what} is {have}, platform.yaml gives {want}"
            yield WRONG_FACTS(text, at=bundle.at("tables.json"), help=_STATED)


def _reserve(tables: Tables, unit: Unit, direction: str) -> int:
    """Return what must be kept for a row: what passes above a budget, and what the back-end cannot deny."""
    p = tables.platform
    known = {"axi-realm": p.burst_bytes, "qos400": p.number("qos400", "burstiness") * p.burst_bytes}
    each = known.get(tables.backend, 0) if p.overshoot is None else p.overshoot
    each += DEVICES[tables.backend].least * p.burst_bytes
    used = {d: tables.is_used(unit, d) for d in DIRECTIONS}
    is_kept = used[direction] or unit.default[direction] > 0
    rule = DEVICES[tables.backend].reserves
    is_kept |= rule == "all" or (rule == "units" and any(used.values()))
    return each if is_kept else 0
