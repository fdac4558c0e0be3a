"""Reads tables.json and platform.yaml of a bundle by their documented forms, and refuses what is not in them.

Read here on its own (docs/reference/regulator-platform.md), and not through the exporter.
"""

from __future__ import annotations

import re
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.core.files import parse_yaml
from halpipe.core.objects import parse_json
from halpipe.core.quantities import parse_bandwidth, parse_rational, parse_size
from halpipe.core.records import record
from halpipe.deploy.regulator.codes import UNUSABLE_TABLES, WRONG_FACTS
from halpipe.devices import DEVICES

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from halpipe.core.bundles import Bundle
    from halpipe.core.diagnostics import Diagnostic
    from halpipe.core.objects import JsonObject


TABLES = "tables.json"
DIRECTIONS = ("read", "write")
MAX_WORD = 2**32 - 1
MAX_WINDOWS = 2**22


@record(kw_only=True)
class Platform:
    """The facts that every figure follows from; bandwidths in bytes per second, exact."""

    name: str
    resource: str
    clock_hz: int
    bus_bytes: int
    burst_bytes: int
    window_cycles: int
    window_extra: Fraction
    guaranteed: Fraction
    capacity: Fraction
    unspecified: str
    table_depth: int

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
        return int(self.capacity * self.window_cycles / self.clock_hz)


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
    """The table object; what is derived stands beside the facts as it was stated."""

    backend: str
    schedule_sha256: str
    model_sha256: str
    platform: Platform
    window_ns: Fraction
    promise_bytes: Fraction
    capacity_bytes: int
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

    def complain(path: str, message: str) -> None:
        raise ValueError(f"{path or 'the file'}: {message}")

    try:
        return _tables(parse_json(bundle.files[TABLES], complain))
    except ValueError as failure:
        raise HalpipeError(UNUSABLE_TABLES(str(failure), at=bundle.at(TABLES), help=_HELP)) from None


_HELP = "export the bundle again with `halpipe export regulator`"


def _tables(root: JsonObject) -> Tables:
    if _word(root, "halpipe-regulator", 1) != 1:
        raise ValueError('"halpipe-regulator" must be 1, the version of this form')
    platform = _platform(root.object("platform"))
    units = [_unit(item) for item in root.objects("units")]
    names = [unit.name for unit in units]
    if not units or len(set(names)) != len(names) or [unit.index for unit in units] != list(range(len(units))):
        raise ValueError("units must be there, be different, and be in the order of their index, from 0 on")
    tables = [_table(item, names, platform.burst_bytes) for item in root.objects("tables")]
    if not tables or [table.index for table in tables] != list(range(len(tables))):
        raise ValueError("tables must be there, in the order of their index, from 0 on")
    backend = root.text("backend")
    if backend not in DEVICES:
        raise ValueError(f'there is no back-end "{backend[:40]}"')
    return Tables(
        backend=backend,
        schedule_sha256=root.text("schedule_sha256"),
        model_sha256=root.text("model_sha256"),
        platform=platform,
        window_ns=root.rational("window_ns"),
        promise_bytes=root.rational("promise_bytes"),
        capacity_bytes=_word(root, "capacity_bytes"),
        units=tuple(units),
        tables=tuple(tables),
        switches=tuple(Switch(s.text("from"), s.text("to"), _word(s, "request")) for s in root.objects("switches")),
    )


def _word(data: JsonObject, key: str, least: int = 0) -> int:
    return data.number(key, least, MAX_WORD)


def _platform(data: JsonObject) -> Platform:
    unspecified = data.text("unspecified")
    if unspecified not in DIRECTIONS:
        raise ValueError(f'platform: "unspecified" is {unspecified!r}, neither read nor write')
    return Platform(
        name=data.text("name"),
        resource=data.text("resource"),
        clock_hz=_word(data, "clock_hz", 1),
        bus_bytes=_word(data, "bus_bytes", 1),
        burst_bytes=_word(data, "burst_bytes", 1),
        window_cycles=_word(data, "window_cycles", 1),
        window_extra=_part(data),
        guaranteed=data.rational("guaranteed"),
        capacity=data.rational("capacity"),
        unspecified=unspecified,
        table_depth=_word(data, "table_depth", 1),
    )


def _part(data: JsonObject) -> Fraction:
    extra = data.rational("window_extra")
    if not 0 <= extra < 1 or extra.denominator > MAX_WORD:
        raise ValueError(f'{data.path}: "window_extra" must be a part of a cycle, below 1')
    return extra


def _unit(data: JsonObject) -> Unit:
    default, overshoot = data.object("default"), data.object("overshoot")
    return Unit(
        index=_word(data, "index"),
        name=data.text("unit"),
        manager=_word(data, "manager"),
        default={direction: _word(default, direction) for direction in DIRECTIONS},
        overshoot={direction: _word(overshoot, direction) for direction in DIRECTIONS},
    )


def _table(data: JsonObject, units: list[str], burst: int) -> Table:
    kind, name, rounding = data.text("kind"), data.text("name"), data.text("rounding")
    if kind not in ("mode", "transition") or rounding not in ("whole", "controlled"):
        raise ValueError(f"{data.path} has the kind {kind!r} and the rounding {rounding!r}")
    moves = kind == "transition"
    windows = _word(data, "windows", 1)
    if windows > MAX_WINDOWS:
        raise ValueError(f'table "{name}" has {windows} windows; more than {MAX_WINDOWS} are not checked')
    entries = data.object("entries")
    if sorted(entries.names()) != sorted(units):
        raise ValueError(f'table "{name}" must have entries for every unit and no other')
    return Table(
        index=_word(data, "index"),
        name=name,
        mode=data.text("to" if moves else "mode"),
        source=data.text("from") if moves else "",
        windows=windows,
        successor=_word(data, "successor"),
        rounding=rounding,
        cycles=_word(data, "cycles") if moves else 0,
        length_ns=data.rational("length_ns") if moves else Fraction(0),
        entries={unit: _entries(entries.objects(unit), f'"{name}", unit "{unit}"', windows, burst) for unit in units},
    )


def _entries(items: list[JsonObject], path: str, windows: int, burst: int) -> tuple[Entry, ...]:
    entries = tuple(
        Entry(
            _word(e, "window"),
            _word(e, "read_bytes"),
            _word(e, "write_bytes"),
        )
        for e in items
    )
    starts = [entry.window for entry in entries]
    if starts[:1] != [0] or starts != sorted(set(starts)) or starts[-1] >= windows:
        raise ValueError(f"{path}: entries must begin with window 0, ascend, and stay below {windows}")
    for item, entry in zip(items, entries, strict=True):
        for direction in DIRECTIONS:
            if _word(item, f"{direction}_bursts") * burst != entry.budget(direction):
                raise ValueError(f"{path}, window {entry.window}: {direction} bursts of {burst} B are not its bytes")
    return entries


PLATFORM = "platform.yaml"
_HERTZ = {"Hz": 1, "kHz": 10**3, "MHz": 10**6, "GHz": 10**9}
_STATED = "export the bundle again; tables.json is made from platform.yaml"


@record(kw_only=True)
class Facts:
    """A platform: Hz, bytes, cycles, bytes per second; keys of units and settings of back-ends as they are written."""

    clock: int
    bus: int
    burst: int
    cycles: int
    extra: Fraction
    guaranteed: int
    capacity: int
    peak: int | None
    unspecified: str
    resource: str
    name: str
    overshoot: int | None
    units: Mapping[str, Mapping[str, str]]
    settings: Mapping[str, Mapping[str, str]]

    @property
    def seconds(self) -> Fraction:
        """The length of a window."""
        return (self.cycles + self.extra) / self.clock

    def number(self, backend: str, key: str) -> int:
        """Return a setting that is a whole number."""
        return int(self.settings[backend][key])


def read_facts(bundle: Bundle) -> Facts:
    """Return the facts; raise `HalpipeError` where the file is not in its form."""
    if PLATFORM not in bundle.files:
        raise HalpipeError(UNUSABLE_TABLES("is not in the bundle", at=bundle.at(PLATFORM), help=_STATED))
    document = parse_yaml(bundle.files[PLATFORM], str(bundle.at(PLATFORM).file))
    try:
        return _facts(document)
    except (ValueError, KeyError, TypeError, AttributeError, ZeroDivisionError) as failure:
        text = f"is no platform: {failure}"
        raise HalpipeError(UNUSABLE_TABLES(text, at=bundle.at(PLATFORM), help=_STATED)) from None


def _facts(document: Any) -> Facts:
    clock = _frequency(document["clock"])
    window = document["window"].strip()
    cycles = Fraction(int(window)) if window.isdigit() else Duration.parse(window).in_unit("s") * clock
    bus = document["bus"].strip()
    guaranteed = parse_bandwidth(document["guaranteed"])
    return Facts(
        clock=clock,
        bus=int(parse_rational(bus.removesuffix("bit")) / 8) if bus.endswith("bit") else parse_size(bus),
        burst=parse_size(document["burst"]),
        cycles=int(cycles),
        extra=cycles - int(cycles),
        guaranteed=guaranteed,
        capacity=parse_bandwidth(document["capacity"]) if "capacity" in document else guaranteed,
        peak=parse_bandwidth(document["peak"]) if "peak" in document else None,
        unspecified=document.get("unspecified", "read"),
        resource=document.get("resource", ""),
        name=document.get("name", ""),
        overshoot=parse_size(document["overshoot"]) if "overshoot" in document else None,
        units={name: dict(unit or {}) for name, unit in document["units"].items()},
        settings={name: {**device.defaults, **(document.get(name) or {})} for name, device in DEVICES.items()},
    )


def _frequency(text: str) -> int:
    match = re.fullmatch(r"\s*([0-9.]+)\s*(Hz|kHz|MHz|GHz)\s*", text)
    if match is None:
        raise ValueError(f"{text!r} is no frequency")
    return int(Fraction(match[1]) * _HERTZ[match[2]])


def setting_frequency(facts: Facts, backend: str) -> int:
    """Return the clock that a back-end has of its own, in Hz."""
    return _frequency(facts.settings[backend]["clock"])


# ---------------------------------------------------------------------------------------------- tables.json


def compare_facts(bundle: Bundle, tables: Tables, facts: Facts) -> Iterator[Diagnostic]:
    """Yield every figure of tables.json that platform.yaml does not state so."""
    p = tables.platform
    pairs: list[tuple[str, object, object]] = [
        ("clock_hz", p.clock_hz, facts.clock),
        ("bus_bytes", p.bus_bytes, facts.bus),
        ("burst_bytes", p.burst_bytes, facts.burst),
        ("window_cycles", p.window_cycles, facts.cycles),
        ("window_extra", p.window_extra, facts.extra),
        ("guaranteed", p.guaranteed, facts.guaranteed),
        ("capacity", p.capacity, facts.capacity),
        ("unspecified", p.unspecified, facts.unspecified),
        ("table_depth", p.table_depth, facts.number("table", "depth")),
        ("resource", p.resource, facts.resource or p.resource),
        ("name", p.name, facts.name or p.name),
    ]
    for unit in tables.units:
        known = facts.units.get(unit.name, {})
        pairs.append((f'manager of unit "{unit.name}"', str(unit.manager), known.get("manager")))
        for direction in DIRECTIONS:
            stated = known.get(f"default-{direction}")
            if stated is not None:
                pairs.append((f'{direction} default of "{unit.name}"', unit.default[direction], parse_size(stated)))
            kept, expected = unit.overshoot[direction], _reserve(tables, facts, unit, direction)
            pairs.append((f'{direction} overshoot of "{unit.name}"', kept, expected))
    for what, have, want in pairs:
        if have != want:
            text = f"{what} is {have}, platform.yaml gives {want}"
            yield WRONG_FACTS(text, at=bundle.at("tables.json"), help=_STATED)


def _reserve(tables: Tables, facts: Facts, unit: Unit, direction: str) -> int:
    """Return what must be kept for a row: what passes above a budget, and what the back-end cannot deny."""
    known = {"axi-realm": facts.burst, "qos400": facts.number("qos400", "burstiness") * facts.burst}
    each = known.get(tables.backend, 0) if facts.overshoot is None else facts.overshoot
    each += DEVICES[tables.backend].least * facts.burst
    used = {d: tables.is_used(unit, d) for d in DIRECTIONS}
    is_kept = used[direction] or unit.default[direction] > 0
    rule = DEVICES[tables.backend].reserves
    is_kept |= rule == "all" or (rule == "units" and any(used.values()))
    return each if is_kept else 0
