"""The platform: what the regulators of a system are like, and what memory surely serves. Read from YAML, exact."""

from __future__ import annotations

import re
from fractions import Fraction
from pathlib import PurePath
from typing import TYPE_CHECKING, TypeVar

from halpipe.core.diagnostics import NOWHERE, Findings, HalpipeError, Location, sort_diagnostics
from halpipe.core.durations import Duration, seconds
from halpipe.core.files import YamlMap, parse_yaml, read_bytes
from halpipe.core.quantities import (
    format_bandwidth,
    format_size,
    parse_bandwidth,
    parse_frequency,
    parse_rational,
    parse_size,
    quoted,
    whole,
)
from halpipe.core.records import record
from halpipe.core.settings import Fields, Words
from halpipe.core.suggest import did_you_mean
from halpipe.devices import DEVICES, MOST, Setting
from halpipe.exporters.regulator.codes import (
    NO_RESOURCE,
    NOT_A_PLATFORM,
    NUMBERS_CONTRADICT,
    SHARED_MANAGER,
)
from halpipe.exporters.regulator.words import BACKENDS
from halpipe.models import ResourceKind, TaskModel

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping


T = TypeVar("T", int, str)

VERSION = "1"
LEAST_CYCLES = 4
"""Cycles of the shortest window that a regulator can play."""

READ, WRITE = "read", "write"
DIRECTIONS = (READ, WRITE)

MAX_BEATS = 256
MAX_BURST = 4096
"""AXI: a burst has at most 256 beats and does not cross a 4 KiB boundary."""

_TOP = (
    "halpipe-regulator", "name", "resource", "clock", "bus", "burst", "window", "guaranteed", "capacity",
    "peak", "unspecified", "backend", "overshoot", "units", *BACKENDS,
)  # fmt: skip
_UNIT = ("manager", "default-read", "default-write", "port", "core", "group")


@record
class UnitPort:
    """Port of a unit to memory: its `manager` (bus port), default budgets in bytes per window (None: equal shares).

    `port` names it for QoS-400, `core` for MemGuard, `group` for resctrl.
    """

    unit: str
    manager: int
    default: Mapping[str, int | None]
    port: str = ""
    core: int | None = None
    group: str = ""
    at: Location = NOWHERE


@record(kw_only=True)
class Platform:
    """A platform file: clock in Hz, window in cycles of it, sizes in bytes, bandwidths in bytes per second.

    A window has `cycles`, and one more so often that they are `extra` more on average: 0 where the clock divides it.

    `guaranteed` is what a bound of 1 promises; `capacity` is what memory surely serves, of which the rest is room for
    `overshoot`: bytes per window that a regulator lets pass above a budget (None: what the back-end is known for).
    `stated_peak` is the device's own maximum, of which resctrl takes parts (None: not stated).
    """

    name: str
    resource: str
    clock: int
    bus: int
    burst: int
    cycles: int
    extra: Fraction
    guaranteed: int
    capacity: int
    stated_peak: int | None
    unspecified: str
    backend: str
    overshoot: int | None
    units: Mapping[str, UnitPort]
    settings: Mapping[str, Mapping[str, str]]
    source: bytes
    at: Location = NOWHERE

    @property
    def peak(self) -> int:
        """Bytes per second that the device has at most; the capacity where no peak is stated."""
        return self.capacity if self.stated_peak is None else self.stated_peak

    @property
    def window(self) -> Duration:
        """The length of a window."""
        return seconds((self.cycles + self.extra) / self.clock)

    @property
    def cycle(self) -> Duration:
        """The length of a cycle."""
        return seconds(Fraction(1, self.clock))

    @property
    def cycles_text(self) -> str:
        """The cycles of a window for people: ``1000 cycles``, ``1999 or 2000 cycles``."""
        return f"{self.cycles} or {self.cycles + 1} cycles" if self.extra else f"{self.cycles} cycles"

    @property
    def least_cycles(self) -> int:
        """Cycles of the shortest window that a regulator can play and that carries a burst."""
        return max(LEAST_CYCLES, -(-self.burst * self.clock // self.capacity))

    @property
    def promise(self) -> Fraction:
        """Bytes per window that a bound of 1 promises, exact."""
        return self.guaranteed * (self.cycles + self.extra) / self.clock

    @property
    def window_capacity(self) -> int:
        """Whole bytes that memory surely serves in a window, the shorter where their cycles differ."""
        return self.capacity * self.cycles // self.clock

    @property
    def base(self) -> int:
        """Address of the registers of the table-driven unit; 0 where a runtime leaves the regulators alone."""
        return int(self.settings["table"]["base"] or "0", 16) if self.backend == "table" else 0

    def lead(self, timebase: int) -> int:
        """Return the ticks from START to the first table: a window and a cycle, rounded down."""
        return int((self.window + self.cycle).in_unit("s") * timebase)

    def regulated(self, model: TaskModel) -> str:
        """Return the name of the resource of `model` that is regulated; raise `HalpipeError` if it is not clear."""
        names = [resource.name for resource in model.resources if resource.kind is not ResourceKind.LOCK]
        if self.resource in names:
            return self.resource
        if not self.resource and len(names) == 1:
            return names[0]
        if self.resource:
            message = f'model "{model.name}" has no resource "{self.resource}"'
            help = did_you_mean(self.resource, names, _one_of(names))
        else:
            message = f'model "{model.name}" has {len(names)} resources, so that the platform must name one'
            help = _one_of(names)
        raise HalpipeError(NO_RESOURCE(message, at=self.at, path="platform resource", help=help))


def _one_of(names: list[str]) -> str:
    return (
        f'write "resource: {names[0]}"; the model has: {", ".join(names)}' if names else "add a resource to the model"
    )


def read_platform(path: str) -> Platform:
    """Read a platform file; raise `HalpipeError` with everything that is wrong in it."""
    source = read_bytes(path)
    document = parse_yaml(source, path)
    if not isinstance(document, YamlMap) or document.get("halpipe-regulator") != VERSION:
        help = 'begin it with "halpipe-regulator: 1"'
        raise HalpipeError(NOT_A_PLATFORM("is no regulator platform of version 1", at=Location(path, 1), help=help))
    findings = Findings()
    platform = _Reader(Fields(path, findings, document, "platform", _TOP), path, source).platform()
    if platform is None or findings.has_errors:
        raise HalpipeError(*sort_diagnostics(findings.items))
    return platform


class _Reader:
    """Reads the file in two steps: every value on its own, then what they must be to each other."""

    def __init__(self, top: Fields, path: str, source: bytes) -> None:
        self.top = top
        self.path = path
        self.source = source

    def platform(self) -> Platform | None:
        top = self.top
        if not top.require("clock", "bus", "burst", "window", "guaranteed", "units"):
            return None
        clock, window = top.value("clock", parse_frequency, None), top.value("window", _window, None)
        bus, burst = top.value("bus", _bus, None), top.value("burst", _positive_size, None)
        guaranteed = top.value("guaranteed", parse_bandwidth, None)
        capacity = top.value("capacity", parse_bandwidth, guaranteed)
        settings = {name: self._settings(name) for name in BACKENDS}
        backend = top.value("backend", Words(*BACKENDS), BACKENDS[0])
        units = self._units(int(settings[backend].get("managers", MOST + 1)))
        name, resource = top.value("name", _name, PurePath(self.path).stem), top.value("resource", str, "")
        peak, overshoot = top.value("peak", parse_bandwidth, None), top.value("overshoot", parse_size, None)
        unspecified = top.value("unspecified", Words(*DIRECTIONS), READ)
        if clock is None or window is None or bus is None or burst is None or guaranteed is None or capacity is None:
            return None
        cycles = window.in_unit("s") * clock if isinstance(window, Duration) else Fraction(window)
        found = Platform(
            name=name,
            resource=resource,
            clock=clock,
            bus=bus,
            burst=burst,
            cycles=int(cycles),
            extra=cycles - int(cycles),
            guaranteed=guaranteed,
            capacity=capacity,
            stated_peak=peak,
            unspecified=unspecified,
            backend=backend,
            overshoot=overshoot,
            units=units,
            settings=settings,
            source=self.source,
            at=top.at(),
        )
        self._compare(found)
        return found

    def _units(self, managers: int) -> dict[str, UnitPort]:
        """Return the units by name; there are so many managers that they may have."""
        units: dict[str, UnitPort] = {}
        owner: dict[int, str] = {}
        second: list[tuple[Fields, int]] = []
        for name, f, at in self.top.entries("units", _UNIT, "unit"):
            manager = f.required("manager", _INDEX)
            if manager is not None and owner.setdefault(manager, name) != name:
                second.append((f, manager))
            units[name] = UnitPort(
                unit=name,
                manager=manager,
                default={d: f.value(f"default-{d}", parse_size, None) for d in DIRECTIONS},
                port=f.value("port", _name, ""),
                core=f.value("core", _INDEX, None),
                group=f.value("group", _name, ""),
                at=at,
            )
        taken = set(owner)
        for f, manager in second:
            text = f'manager {manager} is the one of unit "{owner[manager]}", too'
            f.complain(SHARED_MANAGER, text, "manager", help=free_help("manager", taken, range(managers)))
        return units

    def _settings(self, backend: str) -> dict[str, str]:
        known = DEVICES[backend].settings
        f = self.top.section(backend, tuple(known), f"platform {backend}")
        if f is None:
            return DEVICES[backend].defaults
        return {key: f.value(key, _reader(setting), setting.default) for key, setting in known.items()}

    # ---- what the numbers must be to each other

    def _compare(self, p: Platform) -> None:
        if p.burst % p.bus:
            below = p.burst // p.bus * p.bus
            nearest = " or ".join(format_size(size) for size in (below, below + p.bus) if size)
            self._contradict("burst", f"{p.burst} bytes are not whole beats of {p.bus} bytes", f"use {nearest}")
        most = min(MAX_BURST, MAX_BEATS * p.bus)
        if p.burst > most:
            text = f"{format_size(p.burst)} are more than an AXI burst may have"
            self._contradict("burst", text, f"use at most {format_size(most)}")
        peak = p.bus * p.clock
        for key, rate in (("guaranteed", p.guaranteed), ("capacity", p.capacity)):
            if rate > peak:
                text = f"{format_bandwidth(rate)} are more than the bus carries: {p.bus} bytes x {p.clock} Hz"
                self._contradict(key, f"{text} = {format_bandwidth(peak)}", f"state at most {format_bandwidth(peak)}")
        if p.capacity < min(p.guaranteed, peak):  # what is guaranteed above the peak comes down to it
            text = f"{format_bandwidth(p.capacity)} are less than the {format_bandwidth(p.guaranteed)} guaranteed"
            self._contradict("capacity", text, f"state at least {format_bandwidth(min(p.guaranteed, peak))}")
        if p.peak < p.capacity:
            text = f"{format_bandwidth(p.peak)} are less than the capacity of {format_bandwidth(p.capacity)}"
            self._contradict("peak", text, f"state at least {format_bandwidth(p.capacity)}")
        fault = ""
        if not p.cycles or p.extra.denominator >= 2**32:
            fault = f"{p.window} is no cycle, or too fine a part of one"
        elif p.burst > p.window_capacity:
            fault = f"{p.cycles} cycles carry {p.window_capacity} bytes, less than one burst of {p.burst}"
        if fault:
            near = max(p.least_cycles, round(p.cycles + p.extra))
            self._contradict("window", fault, f"use at least {near} cycles ({seconds(Fraction(near, p.clock))})")
        if p.cycles >= 2**32 or p.window_capacity >= 2**32:
            self._contradict("window", "cycles and bytes of a window must fit into 32 bits", "use a shorter window")

    def _contradict(self, key: str, message: str, help: str) -> None:
        self.top.complain(NUMBERS_CONTRADICT, message, key if key in self.top else "", help=help)


def free_help(what: str, taken: set[T], choices: Iterable[T]) -> str:
    """Return the remedy for a unit whose `what` another one has; a choice that it names is taken then."""
    merge = f"model what shares a {what} as one unit"
    free = next((choice for choice in choices if choice not in taken), None)
    if free is None:
        return f"{merge}; no {what} is free"
    taken.add(free)
    return f'state "{what}: {free}", which is free, or {merge}'


# ---------------------------------------------------------------------------------------------- single values


def _window(text: str) -> int | Duration:
    """Read cycles, or a duration, which need not be whole cycles."""
    if text.strip().isascii() and text.strip().isdigit():
        return whole(0, what="number of cycles")(text)
    return Duration.parse(text)


def _bus(text: str) -> int:
    """Read the width of the bus, as ``128bit`` or ``16B``, into bytes: a power of two up to 128 (AXI)."""
    bits = text.strip().removesuffix("bit")
    size = Fraction(parse_rational(bits), 8) if bits != text.strip() else Fraction(parse_size(text))
    if size not in {1, 2, 4, 8, 16, 32, 64, 128}:
        raise ValueError(f"{quoted(text)} is no width of a bus; write 32bit, 64bit, 128bit, ... or 16B")
    return size.numerator


def _positive_size(text: str) -> int:
    size = parse_size(text)
    if not size:
        raise ValueError(f"{quoted(text)} is nothing; write a size above zero")
    return size


_INDEX = whole(0, MOST)


def _name(text: str) -> str:
    """Read a name that may stand in file names, scripts and C."""
    if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}", text):
        raise ValueError(f"{quoted(text)} is no plain name; use letters, digits, _ . and -")
    return text


def _address(text: str) -> str:
    if not re.fullmatch(r"0x[0-9a-fA-F]{1,16}", text):
        raise ValueError(f"{quoted(text)} is no address; write it as 0xa0000000")
    if int(text, 16) % 4:
        raise ValueError(f"{quoted(text)} is no address of registers; use a multiple of 4")
    return text.lower()


def _period(text: str) -> str:
    """Read a period of whole microseconds; return their number."""
    period = Duration.parse(text).in_unit("us")
    if period.denominator != 1 or period <= 0:
        raise ValueError(f"{quoted(text)} is not whole microseconds above zero; write it as 1ms")
    return str(period.numerator)


def _ratio(text: str) -> str:
    """Read a number from 0 to 1."""
    if not 0 <= parse_rational(text) <= 1:
        raise ValueError(f"{quoted(text)} is out of range; write a number from 0 to 1, as 0.5 or 1/3")
    return text


def levels_of(text: str) -> dict[int, int]:
    """Read measured bandwidths by value, as ``10=4GB/s 20=6.1GB/s``; both ascend."""
    pairs = [word.partition("=") for word in text.split()]
    found = {_INDEX(value): parse_bandwidth(rate) for value, _, rate in pairs}
    if len(found) != len(pairs) or list(found) != sorted(found) or list(found.values()) != sorted(found.values()):
        raise ValueError(f"{quoted(text)} does not ascend; write each value once, as 10=4GB/s 20=6.1GB/s")
    return found


def _levels(text: str) -> str:
    levels_of(text)
    return " ".join(text.split())


def _size_text(text: str) -> str:
    _positive_size(text)
    return text


def _reader(setting: Setting) -> Callable[[str], str]:
    """Return the reader of a setting's kind; it keeps values as texts."""
    if setting.kind == "number":
        read = whole(setting.least, setting.most)
        return lambda text: str(read(text))
    return Words(*setting.words) if setting.kind == "word" else _KINDS[setting.kind]


_KINDS: Mapping[str, Callable[[str], str]] = {
    "address": _address,
    "frequency": lambda text: f"{parse_frequency(text)}Hz",
    "size": _size_text,
    "period": _period,
    "ratio": _ratio,
    "numbers": lambda text: " ".join(str(_INDEX(word)) for word in text.split()),
    "levels": _levels,
}
