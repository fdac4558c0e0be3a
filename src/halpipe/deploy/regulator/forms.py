"""Comparison of the forms that hardware and software load (memory images, C header) with tables.json."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, about
from halpipe.deploy.regulator.codes import FORMS_DIFFER, OTHER_SCHEDULE, TOO_DEEP

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.core.bundles import Bundle
    from halpipe.deploy.regulator.reading import Tables, Unit

FOLDER = "table"
HEADER = f"{FOLDER}/bw_tables.h"
_AGAIN = "export the bundle again; the forms of one bundle are made from one object"
TERMINATOR, NO_TABLE = "ffffffff0000000000000000", "0" * 16
MOST_HEADERS = 256


def header_lines(tables: Tables) -> int:
    """Return the headers of every unit: a power of two, one at least without a table as far as there are addresses."""
    lines = 16
    while lines <= len(tables.tables) and lines < MOST_HEADERS:
        lines *= 2
    return lines


def image_names(unit: Unit) -> tuple[str, str]:
    """Return the names of a unit's memory images: its entries and its headers."""
    return f"{FOLDER}/unit{unit.index}.tab.memh", f"{FOLDER}/unit{unit.index}.hdr.memh"


def check_forms(bundle: Bundle, tables: Tables) -> Iterator[Diagnostic]:
    """Yield every form that is missing or says something else."""
    names = [name for unit in tables.units for name in image_names(unit)]
    missing = [name for name in (*names, HEADER) if name not in bundle.files]
    for name in missing:
        yield FORMS_DIFFER("is missing", at=bundle.at(name), help=_AGAIN)
    for name, expected in images(tables).items():
        if name not in missing:
            yield from _lines(bundle, name, expected.decode().splitlines())
    for unit in tables.units:
        yield from _depth(bundle, image_names(unit)[0], tables, unit)
    if HEADER not in missing:
        yield from _c_header(bundle, tables)


def images(tables: Tables) -> dict[str, bytes]:
    """Return the memory images of all units by name, as they follow from the tables."""
    found = {}
    for unit in tables.units:
        entries, headers = [*entry_words(tables, unit), TERMINATOR], header_words(tables, unit)
        headers += [NO_TABLE] * (header_lines(tables) - len(headers))
        for name, words in zip(image_names(unit), (entries, headers), strict=True):
            found[name] = "\n".join([*words, ""]).encode()
    return found


def entry_words(tables: Tables, unit: Unit) -> list[str]:
    """Return the entries of a unit as words of 96 bits, all tables one after the other."""
    return [f"{e.window:08x}{e.read:08x}{e.write:08x}" for table in tables.tables for e in table.entries[unit.name]]


def _headers(tables: Tables, unit: Unit) -> list[tuple[int, int, int]]:
    """Return successor, base and windows of each table of a unit."""
    found, base = [], 0
    for table in tables.tables:
        found.append((table.successor, base, table.windows))
        base += len(table.entries[unit.name])
    return found


def header_words(tables: Tables, unit: Unit) -> list[str]:
    """Return the headers of a unit as words of 64 bits."""
    return [f"{successor:02x}{base:06x}{windows:08x}" for successor, base, windows in _headers(tables, unit)]


def _lines(bundle: Bundle, name: str, expected: Sequence[str]) -> Iterator[Diagnostic]:
    found = bundle.files[name].decode("latin-1").splitlines()
    for number, (have, want) in enumerate(zip(found, expected, strict=False), 1):
        if have != want:
            text = f'is "{have[:40]}", tables.json gives {want}'
            yield FORMS_DIFFER(text, at=bundle.at(name, number), help=_AGAIN)
    if len(found) != len(expected):
        text = f"has {len(found)} lines, tables.json gives {len(expected)}"
        yield FORMS_DIFFER(text, at=bundle.at(name), help=_AGAIN)


def _depth(bundle: Bundle, name: str, tables: Tables, unit: Unit) -> Iterator[Diagnostic]:
    entries, depth = len(entry_words(tables, unit)) + 1, tables.platform.table_depth
    if entries > depth:
        text = f"{entries} entries with the terminator, the unit's table has {depth}"
        help = "use a longer window, quantise the schedule (halpipe schedule --quantise), or build a deeper table"
        yield TOO_DEEP(text, at=bundle.at(name), path=about(unit=unit.name), help=help)


# ------------------------------------------------------------------------------------------------ C header

_DEFINE = re.compile(r'^#define\s+(BW_\w+)\s+"?([0-9a-f]+)u?"?\s*$', re.MULTILINE)
_ARRAY = re.compile(r"\b(bw_\w+)\s*\[[^\]]*\]\s*=\s*\{(.*?)\}\s*;", re.DOTALL)
_WORD = re.compile(r'"([^"]*)"|\b(\d+)u?\b|\b(bw_\w+)\b')


def _c_header(bundle: Bundle, tables: Tables) -> Iterator[Diagnostic]:
    """Compare every definition and every initialiser."""
    text = re.sub(r"/\*.*?\*/", "", bundle.files[HEADER].decode("latin-1"), flags=re.DOTALL)
    at = bundle.at(HEADER)
    defined = dict(_DEFINE.findall(text))
    for name, value in _definitions(tables).items():
        if defined.get(name) != value:
            code = OTHER_SCHEDULE if name.endswith("SHA256") else FORMS_DIFFER
            yield code(f"{name} is {defined.get(name, 'missing')}, tables.json gives {value}", at=at, help=_AGAIN)
    named = sorted(int(value) for name, value in defined.items() if name.startswith("BW_TABLE_"))
    if named != list(range(len(tables.tables))):
        text_ = f"names tables {', '.join(map(str, named)) or 'none'}; tables.json has 0 to {len(tables.tables) - 1}"
        yield FORMS_DIFFER(text_, at=at, help=_AGAIN)
    arrays = {name: ["".join(word) for word in _WORD.findall(body)] for name, body in _ARRAY.findall(text)}
    for name, words in _initialisers(tables).items():
        have = arrays.get(name)
        if have != words:
            where = _difference(have, words)
            yield FORMS_DIFFER(f"{name} is not what tables.json gives: {where}", at=at, help=_AGAIN)


def _definitions(tables: Tables) -> dict[str, str]:
    platform = tables.platform
    return {
        "BW_WINDOW_CYCLES": str(platform.window_cycles),
        "BW_WINDOW_EXTRA": str(platform.window_extra.numerator),
        "BW_WINDOW_OF": str(platform.window_extra.denominator),
        "BW_CLOCK_HZ": str(platform.clock_hz),
        "BW_BUS_BYTES": str(platform.bus_bytes),
        "BW_BURST_BYTES": str(platform.burst_bytes),
        "BW_CAPACITY_BYTES": str(tables.platform.capacity_bytes),
        "BW_UNITS": str(len(tables.units)),
        "BW_TABLES": str(len(tables.tables)),
        "BW_SWITCHES": str(len(tables.switches)),
        "BW_SCHEDULE_SHA256": tables.schedule_sha256,
    }


def _initialisers(tables: Tables) -> dict[str, list[str]]:
    """Return the words that the initialiser of every array must have, in order."""
    arrays: dict[str, list[str]] = {"bw_units": []}
    for unit in tables.units:
        n = str(unit.index)
        words = entry_words(tables, unit)
        numbers = [str(int(word[k : k + 8], 16)) for word in words for k in (0, 8, 16)]
        arrays[f"bw_entries_{n}"] = numbers
        arrays[f"bw_tables_{n}"] = [
            str(value) for successor, base, windows in _headers(tables, unit) for value in (windows, successor, base)
        ]
        facts = (unit.manager, unit.default["read"], unit.default["write"], len(words))
        arrays["bw_units"] += [unit.name, *map(str, facts), f"bw_tables_{n}", f"bw_entries_{n}"]
    if tables.switches:
        modes = {table.mode: table.index for table in tables.tables if not table.is_transition}
        triples = [(modes.get(s.source, "unknown"), modes.get(s.target, "unknown"), s.request) for s in tables.switches]
        arrays["bw_switches"] = [str(value) for triple in triples for value in triple]
    return arrays


def _difference(have: list[str] | None, want: list[str]) -> str:
    if have is None:
        return "it is missing"
    for place, (a, b) in enumerate(zip(have, want, strict=False)):
        if a != b:
            return f"value {place} is {a}, it must be {b}"
    return f"it has {len(have)} values, it must have {len(want)}"
