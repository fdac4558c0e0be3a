"""Target profiles: memory map, clocks and DMA engine of a board or simulator, as data.

The profiles that come with halpipe are files in a folder of the package; a user's own is a file of the same form. The
check of bundles reads the same files with eyes of its own.
"""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.core.durations import ZERO, Duration, seconds
from halpipe.core.files import YamlMap, parse_yaml, read_bytes
from halpipe.core.quantities import parse_address, parse_bandwidth, parse_rational, parse_size, whole
from halpipe.core.records import record
from halpipe.core.settings import Fields, Words
from halpipe.core.suggest import did_you_mean
from halpipe.exporters.riscv.codes import BAD_PROFILE, UNKNOWN_PROFILE
from halpipe.exporters.riscv.hardware import SUFFIXES, profile_of

if TYPE_CHECKING:
    from collections.abc import Iterator

FOLDER = Path(__file__).parents[2] / "profiles"
VERSION = "1"
FILES = (".yaml", ".yml", *SUFFIXES)

MONITOR = 4096
"""Bytes at the beginning of an instruction scratchpad that the monitor has."""

MAILBOX = 256
"""Bytes at the end of a data scratchpad: what the management core and the monitor tell each other."""

RESERVED = 4096
"""Bytes at the end of a data scratchpad that jobs do not have: mailbox and monitor stack."""

PAGE = 4096
"""Bytes that the registers of a device take at least."""

MEMORIES = ("ispm", "dspm", "main")
"""Where a transfer may lead: an engine has another bandwidth into each."""

CLASSES = {
    "load": "",
    "load-byte": "load",
    "multiply": "",
    "multiply-word": "multiply",
    "divide": "multiply",
    "taken": "",
    "mispredicted": "",
}
"""Instructions that take other times than simple ones, each with the class whose time is its default."""

CLINT_SIZE = 0x10000
"""Bytes of the CLINT, which one entry of the memory protection keeps from jobs."""

REACH = 2**31 - PAGE
"""Bytes within which instructions name addresses."""

_KEYS = (
    "halpipe-profile",
    "summary",
    "cores",
    "clock",
    "timebase",
    "main",
    "scratchpad",
    "watchdog",
    "coherence",
    "ispm",
    "dspm",
    "stack",
    "service",
    "cpi",
    "latency",
    "clint",
    "uart",
    "dma",
    "finisher",
    "qemu",
)


@record
class Region:
    """Bytes [base, base + size)."""

    base: int
    size: int

    @property
    def end(self) -> int:
        """The first address behind it."""
        return self.base + self.size

    def meets(self, other: Region) -> bool:
        """Whether some byte is in both."""
        return self.base < other.end and other.base < self.end


@record
class Scratchpads:
    """One memory for each core, `stride` apart; `has_reservations` where lr and sc work on it."""

    base: int
    stride: int
    size: int
    has_reservations: bool = True

    def of(self, core: int) -> Region:
        """Return the memory of application core `core`, counted from 0."""
        return Region(self.base + core * self.stride, self.size)


@record
class Dma:
    """The DMA engine; `setup` is the longest time from the instant of a transfer until its bytes flow.

    A channel moves `into` a memory (ispm, dspm, main) so many bytes per second, and all of them together move `bus`, by
    default as many times the slowest of these.
    `kind` is ``pdma`` (SiFive's engine) or ``copy`` (none: the management core copies).
    """

    kind: str
    base: int
    stride: int
    channels: int
    into: dict[str, int]
    stated_bus: int | None
    setup: Duration

    @property
    def bandwidth(self) -> int:
        """Least bandwidth of a channel, whatever the memory."""
        return min(self.into.values())

    @property
    def bus(self) -> int:
        """Bandwidth of all channels together."""
        return self.channels * self.bandwidth if self.stated_bus is None else self.stated_bus


@record
class Watchdog:
    """A timer that resets the system where nothing writes a `value` of 32 bits to its `address` within a time."""

    address: int
    value: int
    timeout: Duration


@record
class Profile:
    """A target. `clock` and `timebase` (mtime) are in Hz; `finisher` is 0 where there is none; `text` is the file.

    The runtime is in the `scratchpad` of hart 0, where there is one; else in main memory. The DMA engine `is_coherent`
    if it reads and writes what hart 0 does, whose data cache is not between them.
    `service` is the longest time that the management core needs for one operation. `cpi` are the cycles of an
    instruction of a job, or of the management core; those of a job that are of other `classes` take others. `latency`
    is what an access of the management core takes beyond that.
    """

    name: str
    summary: str
    cores: int
    clock: int
    timebase: int
    main: Region
    scratchpad: Region | None
    watchdog: Watchdog | None
    is_coherent: bool
    ispm: Scratchpads
    dspm: Scratchpads
    stack: int
    service: Duration
    cpi: Fraction
    management_cpi: Fraction
    classes: dict[str, Fraction]
    latency: Duration
    clint: int
    uart_kind: str
    uart: int
    dma: Dma
    finisher: int
    qemu: tuple[str, ...]
    text: bytes = b""

    @property
    def tick(self) -> Duration:
        """The resolution of the timer: jobs are released at its multiples."""
        return seconds(Fraction(1, self.timebase))

    @property
    def patience(self) -> int:
        """Ticks by which an operation may be late because of others at the same instant: four for each core.

        These are the end of a job, the release of the next, and the end of one phase and the start of another.
        """
        return math.ceil(4 * self.cores * self.service / self.tick)

    @property
    def code_room(self) -> int:
        """Bytes of code that an image may have."""
        return self.ispm.size - MONITOR

    @property
    def data_room(self) -> int:
        """Bytes of constants, data, .bss and transfer buffers that an image may have."""
        return self.dspm.size - RESERVED - self.stack


def names() -> list[str]:
    """Return the names of the profiles that come with halpipe."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def read_profile(name: str) -> Profile:
    """Return a profile by its name, or from a file of one of `FILES`; raise `HalpipeError` with all that is wrong."""
    if name.endswith(FILES):
        path = name
    elif name in names():
        path = str(FOLDER / f"{name}.yaml")
    else:
        help = did_you_mean(name, names(), "there are " + ", ".join(names()) + "; or name a file: " + " ".join(FILES))
        raise HalpipeError(UNKNOWN_PROFILE(f'there is no profile "{name}"', help=help))
    content = read_bytes(path)
    if path.endswith(SUFFIXES):
        content = profile_of(content, path)
    document = parse_yaml(content, path)
    if not isinstance(document, YamlMap) or document.get("halpipe-profile") != VERSION:
        help = f'begin it with "halpipe-profile: {VERSION}"'
        raise HalpipeError(BAD_PROFILE(f"is no profile of version {VERSION}", at=Location(path, 1), help=help))
    findings = Findings()
    fields = Fields(path, findings, document, "profile", _KEYS)
    profile = replace(_profile(Path(path).stem, fields), text=content)
    if not findings.has_errors:
        findings.extend(BAD_PROFILE(m, at=Location(path), help="correct the profile") for m in _faults(profile))
    findings.stop_on_errors()
    return profile


def _profile(name: str, f: Fields) -> Profile:
    f.require("main", "ispm", "dspm", "uart", "dma")
    uart = _section(f, "uart", "kind", "base")
    jobs, management, classes = _cpi(f)
    return Profile(
        name=name,
        summary=f.text("summary"),
        cores=f.required("cores", whole(1, 64)),
        clock=f.required("clock", whole(1000, 10**11)),
        timebase=f.required("timebase", whole(1000, 10**9)),
        main=_region(f, "main"),
        scratchpad=_region(f, "scratchpad") if "scratchpad" in f else None,
        watchdog=_watchdog(f) if "watchdog" in f else None,
        is_coherent=f.value("coherence", Words("front-bus", "none"), "front-bus") == "front-bus",
        ispm=_scratchpads(f, "ispm"),
        dspm=_scratchpads(f, "dspm", "lr-sc"),
        stack=f.value("stack", _size, 8192),
        service=f.required("service", Duration.parse),
        cpi=jobs,
        management_cpi=management,
        classes=classes,
        latency=f.value("latency", Duration.parse, ZERO),
        clint=f.required("clint", parse_address),
        uart_kind=uart.required("kind", Words("sifive", "ns16550", "ns16550x4", "litex")),
        uart=uart.required("base", parse_address),
        dma=_dma(f),
        finisher=f.value("finisher", parse_address, 0),
        qemu=tuple(stated.value for stated in f.texts("qemu", str)),
    )


def _cpi(f: Fields) -> tuple[Fraction, Fraction, dict[str, Fraction]]:
    """Read the cycles of an instruction: of jobs, of the management core, and of a job's instructions by class."""
    if not f.is_mapping("cpi"):
        jobs = f.value("cpi", _cycles, Fraction(1))
        return jobs, jobs, dict.fromkeys(CLASSES, jobs)
    each = _section(f, "cpi", "jobs", "management", *CLASSES)
    jobs = each.required("jobs", _cycles)
    classes: dict[str, Fraction] = {}
    for name, like in CLASSES.items():
        classes[name] = each.value(name, _cycles, classes.get(like, jobs))
    return jobs, each.value("management", _cycles, jobs), classes


def _section(f: Fields, key: str, *keys: str) -> Fields:
    """Return a mapping; where it is absent or wrong, an empty one whose faults are not reported."""
    return f.section(key, keys, key) or Fields("", Findings(), YamlMap(0), key)


def _region(f: Fields, key: str) -> Region:
    section = _section(f, key, "base", "size")
    return Region(section.required("base", parse_address), section.required("size", _size))


def _watchdog(f: Fields) -> Watchdog:
    section = _section(f, "watchdog", "address", "value", "timeout")
    address, value = (section.required(key, parse_address) for key in ("address", "value"))
    return Watchdog(address, value, section.required("timeout", Duration.parse))


def _scratchpads(f: Fields, key: str, *others: str) -> Scratchpads:
    section = _section(f, key, "base", "stride", "size", *others)
    return Scratchpads(
        section.required("base", parse_address),
        section.required("stride", parse_address),
        section.required("size", _size),
        section.value("lr-sc", Words("yes", "no"), "yes") == "yes",
    )


def _dma(f: Fields) -> Dma:
    section = _section(f, "dma", "kind", "bandwidth", "setup", "base", "stride", "channels", "bus")
    kind = section.required("kind", Words("pdma", "copy"))
    if kind == "pdma":
        section.require("base")
    return Dma(
        kind=kind,
        base=section.value("base", parse_address, 0),
        stride=section.value("stride", parse_address, 4096),
        channels=section.value("channels", whole(1, 64), 1),
        into=_into(section),
        stated_bus=section.value("bus", parse_bandwidth, None),
        setup=section.required("setup", Duration.parse),
    )


def _into(dma: Fields) -> dict[str, int]:
    """Read a bandwidth for each memory that bytes are moved into, or one for all."""
    if not dma.is_mapping("bandwidth"):
        return dict.fromkeys(MEMORIES, dma.required("bandwidth", parse_bandwidth))
    each = _section(dma, "bandwidth", *MEMORIES)
    return {memory: each.required(memory, parse_bandwidth) for memory in MEMORIES}


def _faults(p: Profile) -> Iterator[str]:
    memories = {"main": p.main} | ({"scratchpad": p.scratchpad} if p.scratchpad else {})
    for core in range(p.cores):
        memories |= {f"ispm of core {core + 1}": p.ispm.of(core), f"dspm of core {core + 1}": p.dspm.of(core)}
    for name, region in memories.items():
        if region.base % 4096 or region.size % 4096:
            yield f"{name} does not begin and end at multiples of 4 KiB"
    places = memories | _devices(p)
    for name, region in places.items():
        if region.end > 2**40:
            yield f"{name} ends beyond 2^40"
    for (name, region), (other, its) in combinations(places.items(), 2):
        if region.meets(its):
            yield f"{name} and {other} overlap"
    yield from _far(p)
    if p.clint % CLINT_SIZE:
        yield f"clint does not begin at a multiple of {CLINT_SIZE:#x}"
    if p.watchdog and (p.watchdog.address % 4 or p.watchdog.value >> 32):
        yield "watchdog is no word of 32 bits"
    if not p.is_coherent and p.dma.kind == "pdma":
        yield 'coherence "none": the DMA engine would miss what hart 0 has in its cache, as buffers that it empties'
    if p.code_room <= 0:
        yield f"ispm has no room beside the monitor's {MONITOR} bytes"
    if p.data_room <= 0 or p.stack % 16:
        yield "dspm has no room beside stack and mailbox, or the stack is no multiple of 16 bytes"


def _far(p: Profile) -> Iterator[str]:
    """Yield memories that code does not reach, which names addresses at most 2 GiB from itself."""
    pairs = [(f"dspm of core {i + 1}", p.dspm.of(i), f"ispm of core {i + 1}", p.ispm.of(i)) for i in range(p.cores)]
    if p.scratchpad:
        pairs.append(("scratchpad", p.scratchpad, "the first page of main", Region(p.main.base, PAGE)))
    for name, memory, code, own in pairs:
        if max(memory.end, own.end) - min(memory.base, own.base) > REACH:
            low, high = max(own.end - REACH, 0), own.base + REACH - memory.size
            yield f"{name} is more than 2 GiB from {code}, whose code names it; begin it from {low:#x} to {high:#x}"


def _devices(p: Profile) -> dict[str, Region]:
    """Return the registers of the devices, in whole pages; the channels of the DMA engine lie a stride apart."""
    found = {"clint": Region(p.clint, CLINT_SIZE), "uart": Region(p.uart, PAGE)}
    if p.dma.kind == "pdma":
        found["dma"] = Region(p.dma.base, -(-p.dma.stride * p.dma.channels // PAGE) * PAGE)
    if p.watchdog:
        found["watchdog"] = Region(p.watchdog.address // PAGE * PAGE, PAGE)
    return found | ({"finisher": Region(p.finisher, PAGE)} if p.finisher else {})


def _size(text: str) -> int:
    size = parse_size(text)
    if not size or size > 2**34:
        raise ValueError(f"{text} is out of range; write a size above 0 and up to 16GiB")
    return size


def _cycles(text: str) -> Fraction:
    number = parse_rational(text)
    if not 1 <= number <= 1000:
        raise ValueError(f"{text} is no number of cycles; write one from 1 to 1000, such as 1.5")
    return number
