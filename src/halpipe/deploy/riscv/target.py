"""The description of a target (target.json of a bundle): where everything lies. See docs/reference/riscv-bundle.md."""

from __future__ import annotations

import json
from contextlib import suppress
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.core.durations import ZERO, Duration
from halpipe.core.quantities import parse_rational
from halpipe.core.records import record
from halpipe.deploy.riscv.codes import BROKEN_TARGET

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from halpipe.core.bundles import Bundle

NAME = "target.json"
MAX_MEMORY = 1 << 31
MAX_UNITS = 64
CONTROL_SIZE = 18 * 8
MEMORIES = ("ispm", "dspm", "main")


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
    of the management core; a job's multiplication or division takes `multiply`, and
    `latency` is what each access of the management core takes beyond that.
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
    multiply: Fraction = Fraction(1)
    latency: Duration = ZERO

    @property
    def tick(self) -> Duration:
        """The resolution of mtime."""
        return Duration(Fraction(10**9, self.timebase))

    def unit(self, name: str) -> UnitSite:
        """Return the unit called `name`; raise ``KeyError`` if there is none."""
        for unit in self.units:
            if unit.name == name:
                return unit
        raise KeyError(name)

    def unit_of(self, hart: int) -> UnitSite:
        """Return the unit that is `hart`; raise ``KeyError`` if there is none."""
        for unit in self.units:
            if unit.hart == hart:
                return unit
        raise KeyError(hart)


def read_site(bundle: Bundle) -> Site:
    """Read target.json of a bundle; raise `HalpipeError` with everything in it that cannot be used."""
    at = bundle.at(NAME)
    help = "export the bundle again with this version of halpipe"
    try:
        data = json.loads(bundle.files[NAME])
    except KeyError:
        raise HalpipeError(BROKEN_TARGET(f"the bundle has no {NAME}", at=at, help=help)) from None
    except (ValueError, RecursionError) as failure:
        raise HalpipeError(BROKEN_TARGET(f"is no JSON: {failure}", at=at, help=help)) from None
    findings = Findings()

    def complain(path: str, message: str) -> None:
        findings.add(BROKEN_TARGET(message, at=at, path=path.strip(), help=help))

    site = _site(_Reader(data, "", complain))
    findings.stop_on_errors()
    for path, message in _contradictions(site):
        complain(path, message)
    findings.stop_on_errors()
    return site


class _Reader:
    """Typed access to a JSON object; what is wrong is reported, and a harmless value returned in its place."""

    def __init__(self, data: Any, path: str, complain: Callable[[str, str], None]) -> None:
        self.path, self._complain = path, complain
        if not isinstance(data, dict):
            complain(path, "is no object")
            data = {}
        self._data: dict[str, Any] = data

    def _get(self, key: str) -> Any:
        if key not in self._data:
            self._complain(self.path, f'lacks "{key}"')
        return self._data.get(key)

    def _read(self, key: str, what: str, fits: Callable[[Any], bool], default: Any) -> Any:
        value = self._get(key)
        if fits(value):
            return value
        if key in self._data:
            self._complain(self.path, f'"{key}" is {_shown(value)}, no {what}')
        return default

    def number(self, key: str, low: int = 0, high: int = 1 << 62) -> int:
        found: int = self._read(
            key, f"whole number from {low} to {high}", lambda value: type(value) is int and low <= value <= high, low
        )
        return found

    def address(self, key: str) -> int:
        return self._address(self._get(key), key) or 0

    def _address(self, value: Any, key: str) -> int:
        with suppress(ValueError):
            if isinstance(value, str) and 0 <= (number := int(value, 16)) < 1 << 56:
                return number
        if value is not None:
            self._complain(self.path, f'"{key}" is {_shown(value)}, no address')
        return 0

    def addresses(self, key: str) -> tuple[int, ...]:
        return tuple(self._address(value, key) for value in self._list(key))

    def text(self, key: str) -> str:
        found: str = self._read(key, "text", lambda value: isinstance(value, str), "")
        return found

    def texts(self, key: str) -> tuple[str, ...]:
        return tuple(value for value in self._list(key) if isinstance(value, str))

    def duration(self, key: str) -> Duration:
        text = self.text(key)
        try:
            return Duration.parse(text) if text else ZERO
        except ValueError as failure:
            self._complain(self.path, f'"{key}": {failure}')
            return ZERO

    def share(self, key: str) -> Fraction:
        text = self.text(key)
        with suppress(ValueError):
            if 1 <= (number := parse_rational(text)) <= 1000:
                return number
        self._complain(self.path, f'"{key}" is {_shown(text)}, no number from 1 to 1000')
        return Fraction(1)

    def _list(self, key: str) -> list[Any]:
        found: list[Any] = self._read(key, "list", lambda value: isinstance(value, list), [])
        return found

    def object(self, key: str) -> _Reader:
        return _Reader(self._data.get(key, {}), f"{self.path}{key} ", self._complain)

    def objects(self, key: str) -> Iterator[_Reader]:
        for i, value in enumerate(self._list(key)):
            yield _Reader(value, f"{self.path}{key}[{i}] ", self._complain)

    def named(self, key: str) -> Iterator[tuple[str, _Reader]]:
        value = self._get(key)
        for name in value if isinstance(value, dict) else ():
            yield name, _Reader(value[name], f'{self.path}{key} "{name}" ', self._complain)

    def area(self, key: str) -> Area:
        return self.object(key).as_area("base")

    def as_area(self, base: str) -> Area:
        return Area(self.address(base), self.number("size", 0, MAX_MEMORY))

    def is_object(self, key: str) -> bool:
        return isinstance(self._data.get(key), dict)

    def has(self, key: str) -> bool:
        return key in self._data


def _shown(value: Any) -> str:
    return repr(value)[:40]


def _site(top: _Reader) -> Site:
    top.number("halpipe-target", 2, 2)
    dma, cpi = top.object("dma"), _cpi(top)
    return Site(
        profile=top.text("profile"),
        clock=top.number("clock", 1, 10**12),
        timebase=top.number("timebase", 1, 10**12),
        main=top.area("main"),
        clint=top.object("clint").address("base"),
        uart=top.object("uart").address("base"),
        dma=_dma(dma),
        finisher=top.address("finisher") if top.text("finisher") else None,
        stack=top.number("stack", 16, MAX_MEMORY),
        entry=top.address("entry"),
        units=tuple(_unit(unit) for unit in top.objects("units")),
        channels={r.text("name"): r.number("channel", 0, 15) for r in top.objects("resources")},
        control=top.address("control"),
        trace=_ring(top.object("trace"), 48),
        faults=_ring(top.object("faults"), 64),
        tables=tuple(_table(table) for table in top.objects("tables")),
        buffers={buffer.text("name"): buffer.as_area("address") for buffer in top.objects("buffers")},
        images=tuple(_image(image) for image in top.objects("images")),
        qemu=top.texts("qemu"),
        service=top.duration("service"),
        cpi=cpi["jobs"],
        management_cpi=cpi["management"],
        multiply=cpi["multiply"],
        latency=top.duration("latency"),
    )


def _cpi(top: _Reader) -> dict[str, Fraction]:
    """Read one number for every instruction, or one for each kind."""
    kinds = ("jobs", "management", "multiply")
    if not top.is_object("cpi"):
        return dict.fromkeys(kinds, top.share("cpi"))
    each = top.object("cpi")
    return {kind: each.share(kind) for kind in kinds}


def _dma(dma: _Reader) -> DmaSite:
    kind, bandwidth = dma.text("kind"), _bandwidth(dma)
    latency = dma.duration("latency" if dma.has("latency") else "setup")
    if kind == "copy":
        return DmaSite(kind, 0, 0, 0, bandwidth, latency)
    return DmaSite(
        kind,
        dma.address("base"),
        dma.number("stride", 0x20, 1 << 20),
        dma.number("channels", 1, 16),
        bandwidth,
        latency,
        dma.number("bus", 1) if dma.has("bus") else None,
    )


def _bandwidth(dma: _Reader) -> dict[str, int]:
    """Read one number for all memories, or one for each."""
    if not dma.is_object("bandwidth"):
        return dict.fromkeys(MEMORIES, dma.number("bandwidth", 1))
    each = dma.object("bandwidth")
    return {memory: each.number(memory, 1) for memory in MEMORIES}


def _unit(unit: _Reader) -> UnitSite:
    hart = unit.number("hart", 1, MAX_UNITS)
    ispm, dspm = unit.area("ispm"), unit.area("dspm")
    return UnitSite(unit.text("name"), hart, ispm, dspm, unit.address("mailbox"), unit.address("reserved"))


def _ring(ring: _Reader, size: int) -> Ring:
    return Ring(ring.address("base"), ring.number("capacity", 1, 1 << 24), ring.number("record", size, size))


def _table(table: _Reader) -> TableSite:
    return TableSite(table.text("name"), table.number("length"), table.duration("lateness"))


def _image(image: _Reader) -> ImageSite:
    return ImageSite(
        image.text("task"),
        image.text("version"),
        image.text("unit"),
        image.text("file"),
        image.addresses("entries"),
        tuple((p.address("source"), p.address("target"), p.number("size")) for p in image.objects("load")),
        {name: symbol.as_area("address") for name, symbol in image.named("symbols")},
        image.area("bss"),
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
    areas = [("main memory", site.main)]
    areas += [(f"{unit.name} {kind}", area) for unit in site.units for kind, area in _scratchpads(unit)]
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
    shared = [("control", Area(site.control, CONTROL_SIZE)), ("entry", Area(site.entry, 4))]
    shared += [(n, Area(r.base, r.capacity * r.record)) for n, r in (("trace", site.trace), ("faults", site.faults))]
    shared += [(f'buffer "{name}"', area) for name, area in site.buffers.items()]
    for name, area in shared:
        if not (site.main.base <= area.base and area.end <= site.main.end):
            yield name, f"{area.size} bytes at {area.base:#x} are not in main memory"
    known = {unit.name for unit in site.units}
    for image in site.images:
        if image.unit not in known:
            yield f'image "{image.file}"', f'there is no unit "{image.unit}"'


def _devices(site: Site) -> Iterator[tuple[str, Area]]:
    yield "clint", Area(site.clint, 0xC000)
    yield "uart", Area(site.uart, 4096)
    if site.dma.kind == "pdma":
        yield "dma", Area(site.dma.base, -(-site.dma.stride * site.dma.channels // 4096) * 4096)
    if site.finisher is not None:
        yield "finisher", Area(site.finisher, 4096)


def _scratchpads(unit: UnitSite) -> tuple[tuple[str, Area], tuple[str, Area]]:
    return ("ispm", unit.ispm), ("dspm", unit.dspm)
