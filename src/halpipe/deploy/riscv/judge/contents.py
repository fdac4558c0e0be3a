"""Static checks of a bundle: its parts agree with each other, and its machine with its profile.

A board that loads `bundle.bin` has to get the program that was checked, and the machine that a check simulates
has to be the one that the profile describes.
"""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, HalpipeError
from halpipe.core.durations import Duration
from halpipe.core.files import parse_yaml, read_bytes
from halpipe.core.quantities import format_rational, parse_bandwidth, parse_rational, parse_size
from halpipe.deploy.riscv.board.elf import read_program
from halpipe.deploy.riscv.codes import FOREIGN_CONTENT, FOREIGN_MACHINE

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from halpipe.core.bundles import Bundle
    from halpipe.deploy.riscv.board.elf import Program
    from halpipe.deploy.riscv.run.expectation import Image
    from halpipe.deploy.riscv.target import Site

PROFILES = Path(__file__).parents[3] / "profiles"
OWN_PROFILE = "profile.yaml"
FLAT = "bundle.bin"
AGAIN = "export the bundle again; edit the model or its sources, not the bundle"
MAILBOX, RESERVED = 256, 4096
MEMORIES = ("ispm", "dspm", "main")
_DEFAULTS = {"stack": "8KiB", "finisher": "0", "qemu": [], "cpi": "1", "latency": "0ns"}


def contradictions(
    bundle: Bundle, site: Site, program: Program, images: Mapping[tuple[str, str, str], Image]
) -> Iterator[Diagnostic]:
    """Yield what of a bundle's parts does not agree."""
    yield from machine_faults(bundle)
    yield from _flat(bundle, site, program)
    for image in images.values():
        yield from _image(bundle, program, image)
    for unit in site.units:
        yield from _monitor(bundle, program, unit.hart)


def is_known_profile(name: str) -> bool:
    """Whether a profile comes with halpipe."""
    return name in {path.stem for path in PROFILES.glob("*.yaml")}


# ------------------------------------------------------------------------------------------------ the machine


def machine_faults(bundle: Bundle) -> Iterator[Diagnostic]:
    """Hold target.json against the profile that it names; a user's own profile travels with the bundle."""
    target = json.loads(bundle.files["target.json"])
    name = str(target.get("profile"))
    at = bundle.at("target.json")
    known = is_known_profile(name)
    if not known and OWN_PROFILE not in bundle.files:
        message = f'its profile "{name}" does not come with halpipe, and the bundle does not have it'
        yield FOREIGN_MACHINE(message, at=at, help=AGAIN)
        return
    text = read_bytes(PROFILES / f"{name}.yaml") if known else bundle.files[OWN_PROFILE]
    try:
        stated = _described(parse_yaml(text, f"{name}.yaml"))
    except HalpipeError as failure:
        yield from failure.diagnostics
        return
    except (ValueError, KeyError, TypeError, AttributeError, ZeroDivisionError) as failure:
        message = f'its profile "{name}" cannot be understood: {failure}'
        yield FOREIGN_MACHINE(message, at=bundle.at(OWN_PROFILE), help=AGAIN)
        return
    for path, value in _leaves(stated, ""):
        found = _at(target, path)
        if _plain(found) != _plain(value):
            message = f'{path} is {_shown(found)}, profile "{name}" says {_shown(value)}'
            yield FOREIGN_MACHINE(message, at=at, path=path, help=AGAIN)
    yield from _cores(target, parse_yaml(text, name), at, name)


def _described(profile: Mapping[str, Any]) -> dict[str, Any]:
    dma = profile["dma"]
    text = {**_DEFAULTS, **profile}
    stated = dma["bandwidth"]
    each = stated if isinstance(stated, dict) else dict.fromkeys(MEMORIES, stated)
    into = {memory: parse_bandwidth(each[memory]) for memory in MEMORIES}
    bandwidth = into if len({*into.values()}) > 1 else into["main"]
    return {
        "clock": int(profile["clock"]),
        "timebase": int(profile["timebase"]),
        "main": {"base": _address(profile["main"]["base"]), "size": parse_size(profile["main"]["size"])},
        "clint": {"base": _address(profile["clint"])},
        "uart": {"kind": profile["uart"]["kind"], "base": _address(profile["uart"]["base"])},
        "dma": {
            "kind": dma["kind"],
            "base": _address(dma.get("base", "0")),
            "stride": _address(dma.get("stride", "4096")),
            "channels": int(dma.get("channels", "1")),
            "bandwidth": bandwidth,
            "bus": parse_bandwidth(dma["bus"]) if "bus" in dma else int(dma.get("channels", "1")) * min(into.values()),
            "setup": Duration.parse(dma["setup"]),
        },
        "service": Duration.parse(profile["service"]),
        "cpi": _cycles(text["cpi"]),
        "latency": Duration.parse(text["latency"]),
        "stack": parse_size(text["stack"]),
        "finisher": _address(text["finisher"]) or "",
        "qemu": [str(word) for word in text["qemu"]],
        "decision": 2,
        "margin": -(-2 * int(profile["timebase"]) // 1_000_000),
    }


def _cycles(stated: Any) -> Any:
    """Return the cycles of an instruction: one number, or one for each kind where these differ."""
    each = stated if isinstance(stated, dict) else {"jobs": stated}
    read = {kind: format_rational(parse_rational(str(value))) for kind, value in each.items()}
    read = {kind: read.get(kind, read["jobs"]) for kind in ("jobs", "management", "multiply")}
    return read if len({*read.values()}) > 1 else read["jobs"]


def _cores(target: Any, profile: Mapping[str, Any], at: Any, name: str) -> Iterator[Diagnostic]:
    """Hold the scratchpads of every core against the profile's rows of them."""
    for unit in target.get("units", []):
        core = int(unit["hart"]) - 1
        places = {}
        for kind in ("ispm", "dspm"):
            row = profile[kind]
            base = _address(row["base"]) + core * _address(row["stride"])
            places[kind] = {"base": base, "size": parse_size(row["size"])}
        end = places["dspm"]["base"] + places["dspm"]["size"]
        stated = {**places, "monitor": places["ispm"]["base"], "mailbox": end - MAILBOX, "reserved": end - RESERVED}
        for path, value in _leaves(stated, ""):
            found = _at(unit, path)
            if _plain(found) != _plain(value):
                where = f'{path} of unit "{unit.get("name")}"'
                message = f'{where} is {_shown(found)}, profile "{name}" says {_shown(value)}'
                yield FOREIGN_MACHINE(message, at=at, path=where, help=AGAIN)


def _address(text: Any) -> int:
    return int(str(text), 0)


def _leaves(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(inner, f"{path} {key}".strip())
    else:
        yield path, value


def _at(value: Any, path: str) -> Any:
    for key in path.split():
        value = value.get(key) if isinstance(value, dict) else None
    return value


def _plain(value: Any) -> Any:
    """Return a value so that equal ones compare equal: addresses as numbers, durations as fractions."""
    if isinstance(value, Duration):
        return value.fraction
    if isinstance(value, str) and value:
        for read in (_from_address, _from_duration):
            try:
                return read(value)
            except ValueError:
                continue
    return Fraction(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _from_address(text: str) -> Fraction:
    return Fraction(int(text, 16))


def _from_duration(text: str) -> Fraction:
    return Duration.parse(text).fraction


def _shown(value: Any) -> str:
    return "absent" if value is None else f"{value}"[:60]


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
    """Return what a program stores at a physical address; None if it does not store all of it."""
    for segment in program.segments:
        at = address - segment.source
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


def _monitor(bundle: Bundle, program: Program, hart: int) -> Iterator[Diagnostic]:
    """Hold the monitor's own file against the program; what it does is seen when it is played."""
    name = f"images/monitor{hart}.elf"
    at = bundle.at(name)
    if name not in bundle.files:
        yield FOREIGN_CONTENT(f"the bundle has no {name}", at=at, help=AGAIN)
        return
    try:
        monitor = read_program(bundle.files[name], at)
    except HalpipeError as failure:
        yield from failure.diagnostics
        return
    for segment in monitor.segments:
        if segment.data and not any(segment.data in whole.data for whole in program.segments):
            yield FOREIGN_CONTENT("its code is not in bundle.elf", at=at, help=AGAIN)
