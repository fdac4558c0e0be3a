"""QoS-400 regulators of the Zynq UltraScale+ (NIC-400): a token bucket on addresses for each port and direction.

Rates are 12-bit fractions of transfers per cycle, so that a step is ``clock * burst / 4096`` bytes per second, and 0
switches a regulator off: it is never written. The registers are open to EL3 only; the scripts are for firmware there.

Sources: Xilinx UG1087 (register addresses), Arm DSU 0026 (QoS-400 supplement to the NIC-400).
"""

from __future__ import annotations

from fractions import Fraction
from math import ceil
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, about
from halpipe.core.quantities import parse_frequency
from halpipe.core.suggest import did_you_mean
from halpipe.devices import DEVICES
from halpipe.devices.registers import port_registers
from halpipe.exporters.regulator.codes import NO_MANAGER, RATE_DOES_NOT_FIT
from halpipe.exporters.regulator.frames import Row
from halpipe.exporters.regulator.platform import DIRECTIONS, Platform
from halpipe.exporters.regulator.rates import (
    Segment,
    check_owners,
    limit_of,
    over_limit,
    peaks,
    rate_of,
    rate_text,
    segments,
)
from halpipe.exporters.regulator.writing import (
    ALL,
    START,
    Check,
    Write,
    falls_first,
    file_names,
    predecessors,
    render,
    script,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.exporters.regulator.tables import Table, Tables

STEPS = 4096
ENABLE_RATES = 0x3
PORTS, REGISTERS = port_registers("qos400")


Setting = tuple[Fraction, dict[Row, int]]
"""Nanosecond of a table, and the steps for every port and direction from there on, in the order of the units."""


class Qos400:
    """One setting for each mode, or (granularity: phase) one for each change of bounds."""

    device = DEVICES["qos400"]
    name = device.name

    def overshoot(self, platform: Platform) -> int:
        """Return the burstiness: what a full token bucket lets pass at once."""
        return int(platform.settings[self.name]["burstiness"]) * platform.burst

    def check(self, tables: Tables) -> list[Diagnostic]:
        """Return units without a port, rates that do not fit, and rates that are not what was promised."""
        found = list(_check_ports(tables))
        for table in () if found else tables.tables:
            found += _check_rates(tables, table)
        return found

    def facts(self, tables: Tables) -> dict[str, Any]:
        """Return the step and the number of settings of every table."""
        step = _step(tables.platform)
        return {
            "step_bytes_per_second": int(step),
            "settings": {table.name: len(_settings(tables, table)) for table in tables.tables},
        }

    def write(self, tables: Tables, digest: str) -> dict[str, bytes]:
        """Return ``setup.txt``, a script for every table, and ``load.sh`` that loads them."""
        meaning = "Load it before any accelerator starts: buckets and lowest rates, and only then both rates on."
        files = {"setup.txt": script(tables, digest, "QoS-400 set-up", meaning, _read_back(list(_init(tables))))}
        meaning = "WRITE(nanosecond, address, value) that long after the table's begin; -1: when it begins."
        settings = [_settings(tables, table) for table in tables.tables]
        stems = file_names(table.name for table in tables.tables)
        for stem, table, several in zip(stems, tables.tables, settings, strict=True):
            title = f"QoS-400 rates of {table.frame.path}"
            steps = _read_back(
                list(_writes(tables, [settings[t.index][-1][1] for t in predecessors(tables, table)], several))
            )
            files[f"{stem}.txt"] = script(tables, digest, title, meaning, steps)
        return {**files, "load.sh": render("load.sh.j2", base="0x0", digest=digest)}


def _step(platform: Platform) -> Fraction:
    """Return the bytes per second of one step of a rate."""
    return Fraction(platform.burst * parse_frequency(platform.settings[Qos400.name]["clock"]), STEPS)


def _segments(tables: Tables, table: Table) -> list[Segment]:
    is_phased = tables.platform.settings[Qos400.name]["granularity"] == "phase"
    return segments(table.frame) if is_phased else [Segment(0, peaks(table.frame))]


def _settings(tables: Tables, table: Table) -> list[Setting]:
    found: list[Setting] = []
    for segment in _segments(tables, table):
        steps = _steps(tables, segment.bounds)
        if not found or found[-1][1] != steps:  # other bounds may be the same steps
            found.append((tables.grid.ns(segment.begin), steps))
    return found


def _steps(tables: Tables, bounds: dict[Row, Fraction]) -> dict[Row, int]:
    """Return the least steps of every port and direction that keep its promise, never 0."""
    step = _step(tables.platform)
    return {
        Row(unit.name, d): max(1, ceil(rate_of(tables, bounds.get(Row(unit.name, d), Fraction(0))) / step))
        for unit in tables.units
        for d in DIRECTIONS
    }


def _writes(tables: Tables, before: list[dict[Row, int]], several: list[Setting]) -> Iterator[Write]:
    """Yield the writes of each setting of a table: those that fall come first; later settings write what changes."""
    for instant, setting in several:
        at = int(instant) or START
        for row, steps in falls_first(before, setting):
            if at == START or steps != before[0][row]:
                yield _write(tables, at, row.unit, f"{row.direction}_rate", steps)
        before = [setting]


def _check_ports(tables: Tables) -> Iterator[Diagnostic]:
    ports = [tables.platform.units[unit.name] for unit in tables.units]
    yield from check_owners(((port.unit, port.port, port.at) for port in ports if port.port), "port", lambda _: PORTS)
    for unit in tables.units:
        port = tables.platform.units[unit.name]
        if port.port not in PORTS:
            message = f'has the port "{port.port}", which is none of the ZynqMP' if port.port else "has no port"
            help = did_you_mean(port.port, PORTS, 'state "port: ", one of ' + ", ".join(PORTS))
            yield NO_MANAGER(message, at=port.at, path=about(unit=unit.name), help=help)


def _check_rates(tables: Tables, table: Table) -> list[Diagnostic]:
    """Return rates that no register holds, and settings whose rates exceed the capacity together; each once."""
    found: dict[str, Diagnostic] = {}
    step, path = _step(tables.platform), table.frame.path
    for segment in _segments(tables, table):
        steps = _steps(tables, segment.bounds)
        names = {row: f"{row.unit} {row.direction}" for row in steps}
        promised = {names[row]: rate_of(tables, segment.bounds.get(row, Fraction(0))) for row in steps}
        for row in segment.bounds:
            if steps[row] >= STEPS:
                most = step * (STEPS - 1)
                rate = rate_text(promised[names[row]])
                message = f"{row.direction} rate {rate} is more than the {rate_text(most)} that the register holds"
                help = f"use longer bursts or a faster clock, or bounds of at most {rate_text(most)}"
                where = about(path, unit=row.unit)
                found[where] = RATE_DOES_NOT_FIT(message, at=table.frame.at, path=where, help=help)
        given = {names[row]: count * step for row, count in steps.items()}
        by_phase = (sum(_steps(tables, s.bounds).values()) * step for s in segments(table.frame))
        is_phased = tables.platform.settings[Qos400.name]["granularity"] == "phase"
        can_help = not is_phased and max(by_phase) <= limit_of(tables)
        fault = over_limit(tables, table, given, promised, _OTHERWISE[not can_help])
        if fault:
            found.setdefault("sum", fault[0])
    return list(found.values())


_OTHERWISE = {
    False: 'set "qos400: {granularity: phase}", or use the back-end table or axi-realm',
    True: "leave out ports that need no rate, or use the back-end table or axi-realm",
}


def _init(tables: Tables) -> Iterator[Write]:
    """Yield the writes of the set-up: burstiness, lowest rates, and only then both regulators on."""
    burstiness = int(tables.platform.settings[Qos400.name]["burstiness"])
    for unit in tables.units:
        for d in DIRECTIONS:
            yield _write(tables, START, unit.name, f"{d}_burstiness", burstiness)
            yield _write(tables, START, unit.name, f"{d}_rate", 1)
        yield _write(tables, START, unit.name, "control", ENABLE_RATES)


def _write(tables: Tables, at: int, unit: str, register: str, value: int) -> Write:
    """Return the write of a value into a register of a unit's port."""
    found = REGISTERS[register]
    return Write(at, PORTS[tables.platform.units[unit].port] + found.offset, value << found.shift)


def _read_back(writes: list[Write]) -> list[Write | Check]:
    """Return writes in their order, with reads of what was written at the start before those that come later."""
    first = [write for write in writes if write.at == START]
    held = {write.offset: write.value for write in first}
    return [*first, *(Check(offset, ALL, n, n) for offset, n in held.items()), *writes[len(first) :]]


WRITER = Qos400()
