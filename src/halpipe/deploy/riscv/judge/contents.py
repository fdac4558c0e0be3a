"""Static checks of a bundle: its parts agree with each other, and its machine with its profile.

A board that loads `bundle.bin` has to get the program that was checked, and the machine that a check simulates
has to be the one that the profile describes.
"""

from __future__ import annotations

import struct
from dataclasses import fields, is_dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from halpipe.core.diagnostics import Diagnostic, Findings, HalpipeError, named
from halpipe.core.durations import ZERO, Duration
from halpipe.core.files import read_bytes
from halpipe.core.quantities import parse_address, parse_bandwidth, parse_rational, parse_size
from halpipe.core.settings import Fields
from halpipe.deploy.riscv.board.elf import Program, read_program
from halpipe.deploy.riscv.codes import FOREIGN_CONTENT, FOREIGN_MACHINE
from halpipe.deploy.riscv.target import CLASSES, MAILBOX, MEMORIES, Area, DmaSite, Site, UnitSite, each, watchdog_of
from halpipe.models import AccessKind, TaskModel

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from halpipe.core.bundles import Bundle
    from halpipe.deploy.riscv.run.expectation import Image

T = TypeVar("T")

PROFILES = Path(__file__).parents[3] / "profiles"
OWN_PROFILE = "profile.yaml"
FLAT = "bundle.bin"
AGAIN = "export the bundle again; edit the model or its sources, not the bundle"
RESERVED = 4096
_LIKE = {"multiply-word": "multiply", "divide": "multiply", "load-byte": "load"}
"""Classes of instructions that take the time of another one, where the profile states none."""


def contradictions(
    bundle: Bundle, site: Site, program: Program, images: Mapping[tuple[str, str, str], Image]
) -> Iterator[Diagnostic]:
    """Yield what of a bundle's parts does not agree."""
    yield from machine_faults(bundle, site)
    yield from _flat(bundle, site, program)
    for image in images.values():
        yield from _image(bundle, program, image)
    for unit in site.units:
        yield from _monitor(bundle, program, unit)


# ------------------------------------------------------------------------------------------------ the machine


def machine_faults(bundle: Bundle, site: Site) -> Iterator[Diagnostic]:
    """Compare target.json with the profile that it names; a user's own profile travels with the bundle."""
    name, at = site.profile, bundle.at("target.json")
    known = name in {path.stem for path in PROFILES.glob("*.yaml")}
    if not known and OWN_PROFILE not in bundle.files:
        message = f'its profile "{name}" does not come with halpipe, and the bundle does not have it'
        yield FOREIGN_MACHINE(message, at=at, help=AGAIN)
        return
    text = read_bytes(PROFILES / f"{name}.yaml") if known else bundle.files[OWN_PROFILE]
    findings = Findings()
    try:
        stated = _described(Fields.sealed(text, f"{name}.yaml", findings, FOREIGN_MACHINE, AGAIN), site)
        findings.stop_on_errors()
    except HalpipeError as failure:
        yield from failure.diagnostics
        return
    for path, found, value in _differences("", site, stated):
        message = f'{path} is {found}, profile "{name}" says {value}'
        yield FOREIGN_MACHINE(message, at=at, path=path, help=AGAIN)


def _described(f: Fields, site: Site) -> Site:
    """Return the target with the machine that a profile describes; findings go where those of the fields go."""
    cycles = f.part("cpi") if f.is_mapping("cpi") else f
    jobs = _own(cycles, "cpi" if cycles is f else "jobs", parse_rational, Fraction(1))
    classes: dict[str, Fraction] = {}
    for name in CLASSES:
        classes[name] = _own(cycles, name, parse_rational, classes.get(_LIKE.get(name, ""), jobs))
    rows = [_row(f.part(name)) for name in ("ispm", "dspm")]
    f.stop_on_errors()
    return replace(
        site,
        clock=f.required("clock", int),
        timebase=f.required("timebase", int),
        main=_memory(f.part("main")),
        clint=f.required("clint", parse_address),
        uart=f.part("uart").required("base", parse_address),
        dma=_engine(f.part("dma")),
        finisher=_own(f, "finisher", parse_address, 0) or None,
        stack=_own(f, "stack", parse_size, 8192),
        units=tuple(_unit(unit, rows) for unit in site.units),
        qemu=tuple(word.value for word in f.texts("qemu", str)) if "qemu" in f else (),
        service=f.required("service", Duration.parse),
        cpi=jobs,
        management_cpi=_own(cycles, "management", parse_rational, jobs),
        classes=classes,
        latency=_own(f, "latency", Duration.parse, ZERO),
        watchdog=watchdog_of(f.part("watchdog")) if "watchdog" in f else None,
        scratchpad=_memory(f.part("scratchpad")) if "scratchpad" in f else None,
    )


def _memory(f: Fields) -> Area:
    return Area(f.required("base", parse_address), f.required("size", parse_size))


def _row(f: Fields) -> tuple[int, int, int]:
    return f.required("base", parse_address), f.required("stride", parse_address), f.required("size", parse_size)


def _own(f: Fields, key: str, read: Callable[[str], T], default: T) -> T:
    """Read a value that may be absent."""
    return f.required(key, read) if key in f else default


def _engine(dma: Fields) -> DmaSite:
    into = each(dma, "bandwidth", MEMORIES, lambda f, key: f.required(key, parse_bandwidth))
    engine = DmaSite(dma.text("kind"), 0, 0, 0, into, dma.required("setup", Duration.parse))
    if engine.kind == "copy":
        return engine
    channels = _own(dma, "channels", int, 1)
    dma.stop_on_errors()
    bus = dma.required("bus", parse_bandwidth) if "bus" in dma else channels * min(into.values())
    base, stride = dma.required("base", parse_address), _own(dma, "stride", parse_address, 4096)
    return replace(engine, base=base, stride=stride, channels=channels, bus=bus)


def _unit(unit: UnitSite, rows: Iterable[tuple[int, int, int]]) -> UnitSite:
    """Return a unit with the scratchpads that the profile's rows have for its core."""
    ispm, dspm = (Area(base + (unit.hart - 1) * stride, size) for base, stride, size in rows)
    return replace(unit, ispm=ispm, dspm=dspm, mailbox=dspm.end - MAILBOX, reserved=dspm.end - RESERVED)


def _differences(path: str, found: Any, stated: Any) -> Iterator[tuple[str, Any, Any]]:
    """Yield path and values of the fields in which two records differ, at any depth."""
    if is_dataclass(found) and is_dataclass(stated):
        for name in (field.name for field in fields(found)):
            yield from _differences(f"{path} {name}".strip(), getattr(found, name), getattr(stated, name))
    elif isinstance(found, tuple) and path == "units":
        for one, other in zip(found, stated, strict=True):
            yield from _differences(f'unit "{one.name}"', one, other)
    elif found != stated:
        yield path, found, stated


def wrong_sizes(bundle: Bundle, site: Site, model: TaskModel) -> Iterator[Diagnostic]:
    """Compare buffers with the model: as large as what is written into them, or, where nothing is, read."""
    deployed = {(image.task, image.version) for image in site.images}
    sizes: dict[str, dict[tuple[str, str], int]] = {kind: {} for kind in AccessKind}
    for task in model.tasks:
        accesses = (a for version in task.versions if (task.name, version.name) in deployed for a in version.accesses)
        for kind, transfer in ((access.kind, transfer) for access in accesses for transfer in access.transfers):
            for key in (("", transfer.buffer), (task.name, transfer.buffer)):
                own = sizes[kind or AccessKind.LOAD]
                own[key] = max(own.get(key, 0), transfer.size)
    shared = sizes[AccessKind.READ] | sizes[AccessKind.WRITE]
    rows = [("", name, area, shared) for name, area in site.buffers.items()]
    rows += [(t.task, name, area, sizes.get(t.kind, {})) for t in site.turns for name, area in t.buffers.items()]
    for task_name, name, area, wanted in rows:
        size = wanted.get((task_name, name), 0)
        if area.size != size:
            message = f"target.json says that it has {area.size} bytes; by the model it has {size}"
            yield FOREIGN_CONTENT(message, at=bundle.at("target.json"), path=named("buffer", name), help=AGAIN)


# ------------------------------------------------------------------------------------------------ the programs


def _flat(bundle: Bundle, site: Site, program: Program) -> Iterator[Diagnostic]:
    """Hold the flat program, byte by byte, against the one that is played."""
    found = bundle.files.get(FLAT)
    at = bundle.at(FLAT)
    if found is None:
        yield FOREIGN_CONTENT(f"the bundle has no {FLAT}", at=at, help=AGAIN)
        return
    end = max((s.source + len(s.data) for s in program.segments), default=site.main.base) - site.main.base
    flat = bytearray(max(end, 0))
    for segment in program.segments:
        place = segment.source - site.main.base
        flat[place : place + len(segment.data)] = segment.data
    if bytes(flat) != found:
        yield FOREIGN_CONTENT(f"differs from bundle.elf {_first(bytes(flat), found)}", at=at, help=AGAIN)


def _first(one: bytes, other: bytes) -> str:
    if len(one) != len(other):
        return f"in size: {len(other)} bytes, not {len(one)}"
    differing = [i for i, (a, b) in enumerate(zip(one, other, strict=True)) if a != b]
    return f"in {len(differing)} bytes, first at {differing[0]:#x}"


def stored(program: Program, address: int, size: int) -> bytes | None:
    """Return what a program stores at an address, physical or virtual; None if it does not store all of it."""
    for at, segment in ((address - begin, s) for s in program.segments for begin in (s.source, s.target)):
        if at >= 0 and at + size <= len(segment.data):
            return segment.data[at : at + size]
    return None


def _image(bundle: Bundle, program: Program, image: Image) -> Iterator[Diagnostic]:
    """Hold an image against the program that carries it, and against what target.json says of it."""
    at = bundle.at(image.site.file)
    parts = [s for s in image.program.segments if s.data]
    for segment in parts:
        if stored(program, segment.source, len(segment.data)) != segment.data:
            message = f"{len(segment.data)} bytes at {segment.source:#x} are others in bundle.elf"
            yield FOREIGN_CONTENT(message, at=at, help=AGAIN)
    symbols = image.program.symbols
    facts: list[tuple[str, object, object]] = [
        ("load", sorted(image.site.load), sorted((s.source, s.target, len(s.data)) for s in parts)),
        ("bss", (image.site.bss.base, image.site.bss.end), tuple(symbols.get(n, (0, 0))[0] for n in BSS)),
    ]
    for name, area in image.site.symbols.items():
        facts.append((f'symbol "{name}"', (area.base, area.size), symbols.get(name)))
    for entry in image.site.entries:
        if entry not in {address for address, _ in symbols.values()}:
            facts.append(("entry", hex(entry), "no function"))
    for what, stated, found in facts:
        if stated != found:
            message = f"target.json says of its {what}: {stated}; the image says {found}"
            yield FOREIGN_CONTENT(message, at=at, help=AGAIN)


BSS = ("hp_bss_begin", "hp_bss_end")


_UNIT = struct.Struct("<4Q")  # of hp_units: both scratchpads, place and size of the monitor


def _monitor(bundle: Bundle, program: Program, unit: UnitSite) -> Iterator[Diagnostic]:
    """Hold the monitor's own file against the program; what it does is seen when it is played."""
    name = f"images/monitor{unit.hart}.elf"
    at = bundle.at(name)
    if name not in bundle.files:
        yield FOREIGN_CONTENT(f"the bundle has no {name}", at=at, help=AGAIN)
        return
    try:
        monitor = read_program(bundle.files[name], at)
    except HalpipeError as failure:
        yield from failure.diagnostics
        return
    rows = program.symbols.get("hp_units", (0, 0))[0]
    row = stored(program, rows + (unit.hart - 1) * _UNIT.size, _UNIT.size) or bytes(_UNIT.size)
    ispm, dspm, place, size = _UNIT.unpack(row)
    own = (monitor.entry, [(s.target, s.data) for s in monitor.segments if s.data])
    if (ispm, dspm) != (unit.ispm.base, unit.dspm.base) or own != (ispm, [(ispm, stored(program, place, size))]):
        yield FOREIGN_CONTENT("its code, or where that is put, is another in bundle.elf", at=at, help=AGAIN)
