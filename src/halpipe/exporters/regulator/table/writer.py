"""The generic table-driven unit (paper, section IV): images of its memories, and a C header.

The unit itself, in Verilog, and its description, in SystemRDL and IP-XACT, go with the tables.
"""

from __future__ import annotations

from importlib import resources
from itertools import accumulate
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, about
from halpipe.devices import DEVICES
from halpipe.exporters.regulator.codes import DOES_NOT_FIT
from halpipe.exporters.regulator.platform import LEAST_CYCLES
from halpipe.exporters.regulator.writing import Backend, identifiers, render

if TYPE_CHECKING:
    from halpipe.exporters.regulator.tables import RegulatedUnit, Tables

MOST_UNITS = 63
"""What the Verilog that comes with the tables can do."""

LEAST_HEADERS, MOST_HEADERS = 16, 256
"""Of a unit: what its Verilog has unless told otherwise, and what it has addresses for."""

_END = "ffffffff" + "0" * 16


class TableUnit(Backend):
    """Admission is strict: a burst passes only if what is left of the budget covers it, so nothing overshoots."""

    device = DEVICES["table"]
    name = device.name

    def check(self, tables: Tables) -> list[Diagnostic]:
        """Return the units whose entries do not fit the memory of their regulator, and what else it cannot do."""
        depth = int(tables.platform.settings["table"]["depth"])
        found = []
        if tables.platform.cycles < LEAST_CYCLES:
            message = f"a window of {tables.platform.cycles} cycles is too short to read the next entry"
            help = f"use a window of at least {LEAST_CYCLES} cycles"
            found.append(DOES_NOT_FIT(message, at=tables.platform.at, path="platform window", help=help))
        if len(tables.units) > MOST_UNITS:
            message = f"{len(tables.units)} units; one block of windows serves {MOST_UNITS}"
            help = "leave out units that do not use the resource"
            found.append(DOES_NOT_FIT(message, at=tables.platform.at, path="platform units", help=help))
        for unit in tables.units:
            entries = 1 + sum(len(table.entries(unit.name)) for table in tables.tables)
            if entries > depth:
                message = f"needs {entries} table entries, the regulator has {depth}"
                help = (
                    f'state "table: {{depth: {entries}}}" and build it so, use longer windows, or schedule on the grid'
                )
                at = tables.platform.units[unit.name].at
                found.append(DOES_NOT_FIT(message, at=at, path=about(unit=unit.name), help=help))
        return found

    def facts(self, tables: Tables) -> dict[str, Any]:
        """Return the memory needed by every unit."""
        depth = int(tables.platform.settings["table"]["depth"])
        entries = {u.name: 1 + sum(len(table.entries(u.name)) for table in tables.tables) for u in tables.units}
        return {"table_depth": depth, "entries": entries, "headers": header_lines(len(tables.tables))}

    def write(self, tables: Tables, digest: str) -> dict[str, bytes]:
        """Return memory images, C header, registers and the unit."""
        units = [_UnitWords(tables, unit) for unit in tables.units]
        files = {}
        for words in units:
            files[f"unit{words.unit.index}.tab.memh"] = words.table_image()
            files[f"unit{words.unit.index}.hdr.memh"] = words.header_image()
        names = identifiers(table.name for table in tables.tables)
        files["bw_tables.h"] = render(
            "table/bw_tables.h.j2",
            tables=list(zip(names, tables.tables, strict=True)),
            units=units,
            switches=tables.switches,
            number={table.name: table.index for table in tables.tables},
            platform=tables.platform,
            capacity=tables.platform.window_capacity,
            model=tables.model,
            digest=digest,
        )
        return files | _descriptions(tables, units, sorted(files)) | unit_sources()


class _UnitWords:
    """The words of one unit's memories: `heads` (windows, successor, base) and `entries` (start, read, write)."""

    def __init__(self, tables: Tables, unit: RegulatedUnit) -> None:
        self.unit = unit
        burst = tables.platform.burst
        blocks = [table.entries(unit.name) for table in tables.tables]
        bases = accumulate((len(block) for block in blocks), initial=0)
        self.heads = [(t.windows, t.successor, base) for t, base in zip(tables.tables, bases, strict=False)]
        self.entries = [(e.window, e.read * burst, e.write * burst) for block in blocks for e in block]

    def table_image(self) -> bytes:
        lines = [f"{start:08x}{read:08x}{write:08x}" for start, read, write in self.entries]
        return "\n".join([*lines, _END, ""]).encode()

    def header_image(self) -> bytes:
        lines = [f"{succ:02x}{base:06x}{windows:08x}" for windows, succ, base in self.heads]
        return "\n".join([*lines, *["0" * 16] * (header_lines(len(lines)) - len(lines)), ""]).encode()


def header_lines(tables: int) -> int:
    """Return the lines of a header image: a power of two, with one at least that no table has, as far as there are."""
    return min(MOST_HEADERS, max(LEAST_HEADERS, 1 << tables.bit_length()))


def _descriptions(tables: Tables, units: list[_UnitWords], made: list[str]) -> dict[str, bytes]:
    """Return registers in SystemRDL and the component in IP-XACT, built as these tables need it."""
    platform, sources = tables.platform, unit_sources()
    beats = platform.burst // platform.bus
    parameters = {
        "UNITS": len(units),
        "DEPTH": int(platform.settings["table"]["depth"]),
        "TABLES": header_lines(len(tables.tables)),
        "BANKS": 1,
        "PORTS": 1,
        "SIZE": platform.bus.bit_length() - 1,
        "CYCLES": platform.cycles,
        "IMAGES": '""',
        "ADDR": 40,
        "ID": 4,
        "BUFFER": max(16, 1 << (beats - 1).bit_length()),  # a write longer than the buffer is refused
        "STAGE": 0,
    }
    file_sets = (
        ("rtl", "verilogSource", [name for name in sources if name.startswith("rtl/") and name.endswith(".v")]),
        ("constraints", "SDC", [name for name in sources if name.endswith(".sdc")]),
        ("images", "", [name for name in made if name.endswith(".memh")]),
        ("software", "cSource", ["bw_tables.h", *(name for name in sources if name.endswith((".c", ".h")))]),
    )
    return {
        name: render(f"table/{name}.j2", units=units, parameters=parameters, file_sets=file_sets)
        for name in ("regulator.rdl", "component.xml")
    }


_SHIPPED = (".v", ".sdc", ".core", ".c", ".h", ".dtso")


def unit_sources() -> dict[str, bytes]:
    """Return Verilog, constraints, core descriptions, driver for Linux and DMA engine, by bundle name."""
    here = resources.files(__package__)
    folders = ("dma/", "linux/", "rtl/")
    found = {f"{name}{file.name}": file for name in folders for file in here.joinpath(name).iterdir()}
    return {name: found[name].read_bytes() for name in sorted(found) if name.endswith(_SHIPPED)}


WRITER = TableUnit()
