"""The description of a target (target.json of a bundle): where everything lies. See docs/reference/riscv-bundle.md."""

from __future__ import annotations

import re
from dataclasses import field
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeVar

from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.core.durations import ZERO, Duration
from halpipe.core.quantities import parse_address, parse_rational, quoted
from halpipe.core.records import record
from halpipe.core.settings import Fields
from halpipe.deploy.riscv.codes import BROKEN_TARGET

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from halpipe.core.bundles import Bundle

T = TypeVar("T")

NAME = "target.json"
MAX_MEMORY = 1 << 31
MAX_UNITS = 64
CONTROL_SIZE = 18 * 8
DECISION = 2
"""Ticks before the end of a hyperperiod at which the mailbox is read."""

MAILBOX = 256
MEMORIES = ("ispm", "dspm", "main")
CLASSES = ("load", "load-byte", "multiply", "multiply-word", "divide", "taken", "mispredicted")
"""Instructions of jobs that take other times than simple ones."""


@record
class Area:
    """Bytes at an address."""

    base: int
    size: int

    @property
    def end(self) -> int:
        """The first address behind it."""
        return self.base + self.size


@record
class UnitSite:
    """An application core: its hart, its two scratchpads, and the mailbox through which it is given work.

    From `reserved` to the end of its data scratchpad it belongs to its monitor.
    """

    name: str
    hart: int
    ispm: Area
    dspm: Area
    mailbox: int
    reserved: int


@record
class DmaSite:
    """The DMA engine; `bandwidth` into each memory in bytes per second, `latency` before the first byte arrives.

    `bus` is what all channels move together at most, None where they do not stand in each other's way.
    Kind ``copy`` is none: the management core copies.
    """

    kind: str
    base: int
    stride: int
    channels: int
    bandwidth: dict[str, int]
    latency: Duration
    bus: int | None = None


@record
class Watchdog:
    """A timer that resets the board where nothing writes `value` to `address` within `timeout`."""

    address: int
    value: int
    timeout: Duration


@record
class Ring:
    """A ring of records in main memory."""

    base: int
    capacity: int
    record: int


@record
class TableSite:
    """A table of the runtime: a mode or a transition; `length` in ticks, `lateness` as the export computed it."""

    name: str
    length: int
    lateness: Duration


@record
class Turn:
    """Time of the copies of a task with a LET: `length` ticks, from `after` its release or release + LET on.

    `buffers` are the task's own, by the names of those that they are copied from or to.
    """

    task: str
    kind: str
    after: int
    length: int
    buffers: dict[str, Area]


@record
class ImageSite:
    """The image of a version on a unit: the file, the functions called one after the other, what is loaded to where."""

    task: str
    version: str
    unit: str
    file: str
    entries: tuple[int, ...]
    load: tuple[tuple[int, int, int], ...]
    symbols: dict[str, Area]
    bss: Area


@record
class Site:
    """All of it; `clock` and `timebase` (ticks of mtime) in Hz.

    `service` is reserved for each operation of the management core. `cpi` are the cycles of an instruction of a job, or
    of the management core; those of a job that are of other `classes` take others, and
    `latency` is what each access of the management core takes beyond that. Copies of logical execution times take their
    `turns` on a channel, `copying`, of their own.
    """

    profile: str
    clock: int
    timebase: int
    main: Area
    clint: int
    uart: int
    dma: DmaSite
    finisher: int | None
    stack: int
    entry: int
    units: tuple[UnitSite, ...]
    channels: dict[str, int]
    control: int
    trace: Ring
    faults: Ring
    tables: tuple[TableSite, ...]
    buffers: dict[str, Area]
    images: tuple[ImageSite, ...]
    qemu: tuple[str, ...]
    service: Duration = ZERO
    cpi: Fraction = Fraction(1)
    management_cpi: Fraction = Fraction(1)
    classes: dict[str, Fraction] = field(default_factory=dict)
    latency: Duration = ZERO
    scratchpad: Area | None = None  # the scratchpad of hart 0, for the runtime
    watchdog: Watchdog | None = None
    copying: int = 0
    turns: tuple[Turn, ...] = ()

    @property
    def tick(self) -> Duration:
        """The resolution of mtime."""
        return Duration(Fraction(10**9, self.timebase))

    def unit(self, name: str) -> UnitSite:
        """Return the unit called `name`; raise ``KeyError`` if there is none."""
        return {unit.name: unit for unit in self.units}[name]

    def unit_of(self, hart: int) -> UnitSite:
        """Return the unit that is `hart`; raise ``KeyError`` if there is none."""
        return {unit.hart: unit for unit in self.units}[hart]


def read_site(bundle: Bundle) -> Site:
    """Read target.json of a bundle; raise `HalpipeError` with everything in it that cannot be used."""
    at = bundle.at(NAME)
    help = "export the bundle again with this version of halpipe"
    if NAME not in bundle.files:
        raise HalpipeError(BROKEN_TARGET(f"the bundle has no {NAME}", at=at, help=help))
    findings = Findings()
    top = Fields.sealed(bundle.files[NAME], str(at.file), findings, BROKEN_TARGET, help)
    findings.stop_on_errors()
    site = _site(top)
    findings.stop_on_errors()
    _derived(top, site)
    findings.extend(BROKEN_TARGET(message, at=at, path=path, help=help) for path, message in _contradictions(site))
    findings.stop_on_errors()
    return site


def _derived(top: Fields, site: Site) -> None:
    """Complain of numbers that only repeat others: where they differ, a reader of target.json is misled."""
    names = [table.text("name") for table in top.items("tables")]
    for place, table in enumerate(top.items("tables")):
        ends = [names[table.number(key, 0, len(names) - 1)] for key in ("from", "to") if key in table]
        if "->".join(ends or [names[table.number("mode", place, place)]]) != names[place]:
            table.complain(BROKEN_TARGET, f'"from" and "to" are those of {"->".join(ends)}', "from")
    for unit, found in zip(top.items("units"), site.units, strict=True):
        if _at(unit, "monitor") != found.ispm.base:
            unit.complain(BROKEN_TARGET, f"is not {found.ispm.base:#x}, the begin of its ispm", "monitor")
    for key, ticks in (("decision", DECISION), ("margin", -(-2 * site.timebase // 10**6))):
        top.number(key, ticks, ticks)


_ADDRESS = re.compile(r"0[xX][0-9a-fA-F]{1,14}")


def _address(text: str) -> int:
    if _ADDRESS.fullmatch(text) is None:
        raise ValueError(f"{quoted(text)} is no address")
    return int(text, 16)


def _times(text: str) -> Fraction:
    number = parse_rational(text)
    if not 1 <= number <= 1000:
        raise ValueError(f"{quoted(text)} is no number from 1 to 1000")
    return number


def _at(f: Fields, key: str = "base") -> int:
    return f.required(key, _address)


def _area(f: Fields, base: str = "base") -> Area:
    return Area(_at(f, base), f.number("size", 0, MAX_MEMORY))


def _duration(f: Fields, key: str) -> Duration:
    return f.required(key, Duration.parse)


def _site(top: Fields) -> Site:
    top.number("halpipe-target", 2, 2)
    cpi = each(top, "cpi", ("jobs", "management", *CLASSES), lambda f, key: f.required(key, _times))
    return Site(
        profile=top.text("profile"),
        clock=top.number("clock", 1, 10**12),
        timebase=top.number("timebase", 1, 10**12),
        main=_area(top.part("main")),
        clint=_at(top.part("clint")),
        uart=_at(top.part("uart")),
        dma=_dma(top.part("dma")),
        finisher=_at(top, "finisher") if top.text("finisher") else None,
        stack=top.number("stack", 16, MAX_MEMORY),
        entry=_at(top, "entry"),
        units=tuple(_unit(unit) for unit in top.items("units")),
        channels={r.text("name"): r.number("channel", 0, 15) for r in top.items("resources")},
        control=_at(top, "control"),
        trace=_ring(top.part("trace"), 48),
        faults=_ring(top.part("faults"), 64),
        tables=tuple(
            TableSite(table.text("name"), table.number("length"), _duration(table, "lateness"))
            for table in top.items("tables")
        ),
        buffers=_buffers(top),
        images=tuple(_image(image) for image in top.items("images")),
        qemu=tuple(word.value for word in top.texts("qemu", str)),
        service=_duration(top, "service"),
        cpi=cpi["jobs"],
        management_cpi=cpi["management"],
        classes={name: cpi[name] for name in CLASSES},
        latency=_duration(top, "latency"),
        watchdog=watchdog_of(top.part("watchdog")) if "watchdog" in top else None,
        scratchpad=_area(top.part("scratchpad")) if "scratchpad" in top else None,
        **(_copies(top.part("copies")) if "copies" in top else {}),
    )


def each(f: Fields, key: str, kinds: tuple[str, ...], read: Callable[[Fields, str], T]) -> dict[str, T]:
    """Read one number for all kinds, or one for each."""
    if not f.is_mapping(key):
        return dict.fromkeys(kinds, read(f, key))
    inner = f.part(key)
    return {kind: read(inner, kind) for kind in kinds}


def _buffers(f: Fields) -> dict[str, Area]:
    return {buffer.text("name"): _area(buffer, "address") for buffer in f.items("buffers")}


def _copies(copies: Fields) -> dict[str, Any]:
    turns = tuple(
        Turn(turn.text("task"), turn.text("kind"), turn.number("after"), turn.number("length"), _buffers(turn))
        for turn in copies.items("turns")
    )
    return {"copying": copies.number("channel", 0, 15), "turns": turns}


def _dma(dma: Fields) -> DmaSite:
    kind, bandwidth = dma.text("kind"), each(dma, "bandwidth", MEMORIES, lambda f, key: f.number(key, 1))
    latency = _duration(dma, "latency" if "latency" in dma else "setup")
    if kind == "copy":
        return DmaSite(kind, 0, 0, 0, bandwidth, latency)
    return DmaSite(
        kind,
        _at(dma),
        dma.number("stride", 0x20, 1 << 20),
        dma.number("channels", 1, 16),
        bandwidth,
        latency,
        dma.number("bus", 1) if "bus" in dma else None,
    )


def watchdog_of(dog: Fields) -> Watchdog:
    """Read a watchdog, of a profile or of target.json."""
    address, value = (dog.required(key, parse_address) for key in ("address", "value"))
    return Watchdog(address, value, _duration(dog, "timeout"))


def _unit(unit: Fields) -> UnitSite:
    hart = unit.number("hart", 1, MAX_UNITS)
    ispm, dspm = _area(unit.part("ispm")), _area(unit.part("dspm"))
    return UnitSite(unit.text("name"), hart, ispm, dspm, _at(unit, "mailbox"), _at(unit, "reserved"))


def _ring(ring: Fields, size: int) -> Ring:
    return Ring(_at(ring), ring.number("capacity", 1, 1 << 24), ring.number("record", size, size))


def _image(image: Fields) -> ImageSite:
    return ImageSite(
        image.text("task"),
        image.text("version"),
        image.text("unit"),
        image.text("file"),
        tuple(entry.value for entry in image.texts("entries", _address)),
        tuple((_at(p, "source"), _at(p, "target"), p.number("size")) for p in image.items("load")),
        {name: _area(symbol, "address") for name, symbol, _ in image.entries("symbols")},
        _area(image.part("bss")),
    )


def _contradictions(site: Site) -> Iterator[tuple[str, str]]:
    """Yield what does not fit together, as path and message."""
    if site.dma.kind not in ("pdma", "copy"):
        yield "dma", f'kind "{site.dma.kind}" is neither pdma nor copy'
    if not site.units or len({unit.name for unit in site.units}) < len(site.units):
        yield "units", "there is none, or two have one name"
    harts = sorted(unit.hart for unit in site.units)
    if harts != list(range(1, len(harts) + 1)):
        yield "units", f"their harts are {harts}, not 1 to {len(harts)}"
    areas = [("main memory", site.main), *([("scratchpad", site.scratchpad)] if site.scratchpad else [])]
    areas += [(f"{u.name} {kind}", area) for u in site.units for kind, area in (("ispm", u.ispm), ("dspm", u.dspm))]
    areas += _devices(site)
    for name, area in areas:
        if area.base % 4096 or not area.size or area.size % 8:
            yield name, f"{area.size} bytes at {area.base:#x} do not begin at a page"
    ordered = sorted(areas, key=lambda named: named[1].base)
    for (name, area), (other, follower) in pairwise(ordered):
        if -(-area.end // 4096) * 4096 > follower.base:
            yield name, f"overlaps {other}"
    if sum(area.size for _, area in areas) > MAX_MEMORY:  # devices are small
        yield "main", f"all memories together have more than {MAX_MEMORY} bytes"
    for unit in site.units:
        if not unit.dspm.base <= unit.reserved <= unit.mailbox <= unit.dspm.end - MAILBOX:
            yield f"{unit.name} mailbox", f"{MAILBOX} bytes at {unit.mailbox:#x} are not in what its dspm reserves"
    shared = [("control", Area(site.control, CONTROL_SIZE)), ("entry", Area(site.entry, 4))]
    shared += [(n, Area(r.base, r.capacity * r.record)) for n, r in (("trace", site.trace), ("faults", site.faults))]
    shared += [(f'buffer "{name}"', area) for name, area in site.buffers.items()]
    shared += [(f'copy of "{name}"', area) for turn in site.turns for name, area in turn.buffers.items()]
    for name, area in shared:
        if not (site.main.base <= area.base and area.end <= site.main.end):
            yield name, f"{area.size} bytes at {area.base:#x} are not in main memory"
    yield from _turns(site)
    known = {unit.name for unit in site.units}
    for image in site.images:
        if image.unit not in known:
            yield f'image "{image.file}"', f'there is no unit "{image.unit}"'


def _turns(site: Site) -> Iterator[tuple[str, str]]:
    """Yield copies that meet others, or are not in the order of logical time: what is written, before what is read."""
    if site.copying in site.channels.values() and site.turns:
        yield "copies", "share their channel with a resource"
    ordered = sorted(site.turns, key=lambda turn: turn.after)
    for turn, follower in pairwise(ordered):
        if turn.after + turn.length > follower.after or (turn.kind, follower.kind) == ("read", "write"):
            yield "copies", f'those of "{turn.task}" and "{follower.task}" meet, or are in the wrong order'
    areas = [(area, name) for turn in site.turns for name, area in turn.buffers.items()]
    areas += [(area, name) for name, area in site.buffers.items()]
    for (area, name), (other, _) in pairwise(sorted(areas, key=lambda entry: entry[0].base) if site.turns else []):
        if area.end > other.base:
            yield "copies", f'a copy of "{name}" overlaps another buffer'


def _devices(site: Site) -> Iterator[tuple[str, Area]]:
    yield "clint", Area(site.clint, 0xC000)
    yield "uart", Area(site.uart, 4096)
    if site.dma.kind == "pdma":
        yield "dma", Area(site.dma.base, -(-site.dma.stride * site.dma.channels // 4096) * 4096)
    if site.finisher is not None:
        yield "finisher", Area(site.finisher, 4096)
    if site.watchdog is not None:
        yield "watchdog", Area(site.watchdog.address // 4096 * 4096, 4096)
