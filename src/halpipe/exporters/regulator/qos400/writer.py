"""QoS-400 regulators of the Zynq UltraScale+ (NIC-400): a token bucket on addresses for each port and direction.

Rates are 12-bit fractions of transfers per cycle, so that a step is ``clock * burst / 4096`` bytes per second, and 0
switches a regulator off: it is never written. The registers are open to EL3 only; the table is for firmware there, the
script is for the hypervisor Jailhouse with its QoS extension.

Sources: Xilinx UG1087 (register addresses), Arm DSU 0026 (QoS-400 supplement to the NIC-400).
"""

from __future__ import annotations

from fractions import Fraction
from math import ceil
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import about
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.devices import DEVICES
from halpipe.devices.registers import port_registers
from halpipe.exporters.regulator.codes import NO_MANAGER, RATE_DOES_NOT_FIT
from halpipe.exporters.regulator.frames import Row
from halpipe.exporters.regulator.owners import outward
from halpipe.exporters.regulator.platform import DIRECTIONS, READ, WRITE, read_frequency
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
from halpipe.exporters.regulator.writing import falls_first, file_names, identifiers, predecessors, render

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.exporters.regulator.platform import Platform
    from halpipe.exporters.regulator.tables import Table, Tables

STEPS = 4096
ENABLE_RATES = 0x3
DESCRIPTION = port_registers("qos400")
PORTS = DESCRIPTION.ports
PREFIX = {READ: "ar", WRITE: "aw"}


@record
class Setting:
    """Settings at `at_ns` of a table: steps for every port and direction, in the order of the units."""

    at_ns: Fraction
    steps: dict[Row, int]


class Qos400:
    """One setting for each mode, or (granularity: phase) one for each change of bounds."""

    device = DEVICES["qos400"]
    name = device.name
    summary = "ZynqMP QoS-400, held against nothing real: Jailhouse commands, addresses and values for EL3 firmware"

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
            "step_bytes_per_second": step.numerator // step.denominator,
            "settings": {table.name: len(_settings(tables, table)) for table in tables.tables},
        }

    def write(self, tables: Tables, digest: str) -> dict[str, bytes]:
        """Return a script for every table, and ``qos400.h``."""
        values = {"platform": tables.platform, "model": tables.model, "digest": digest}
        settings = [_settings(tables, table) for table in tables.tables]
        orders = [
            list(_orders(_before(tables, settings, table), several))
            for table, several in zip(tables.tables, settings, strict=True)
        ]
        files = {}
        for stem, table, several in zip(file_names(t.name for t in tables.tables), tables.tables, orders, strict=True):
            lines = [(setting, list(_commands(tables, writes))) for setting, writes in several]
            files[f"{stem}.sh"] = render("qos400/table.sh.j2", table=table, lines=lines, **values)
        arrays = [list(_writes(tables, several)) for several in orders]
        names = identifiers(table.name for table in tables.tables)
        files["qos400.h"] = render(
            "qos400/qos400.h.j2",
            init=list(_init(tables)),
            tables=list(zip(names, tables.tables, arrays, strict=True)),
            **values,
        )
        return files


def _is_phased(tables: Tables) -> bool:
    return tables.platform.settings[Qos400.name]["granularity"] == "phase"


def _step(platform: Platform) -> Fraction:
    """Return the bytes per second of one step of a rate."""
    return Fraction(platform.burst * read_frequency(platform.settings[Qos400.name]["clock"]), STEPS)


def _settings(tables: Tables, table: Table) -> list[Setting]:
    whole = [Segment(0, peaks(table.frame))]
    several = segments(table.frame) if _is_phased(tables) else whole
    found: list[Setting] = []
    for segment in several:
        steps = _steps(tables, segment.bounds)
        if not found or found[-1].steps != steps:  # other bounds may be the same steps
            found.append(Setting(tables.grid.ns(segment.begin), steps))
    return found


def _steps(tables: Tables, bounds: dict[Row, Fraction]) -> dict[Row, int]:
    """Return the least steps of every port and direction that keep its promise, never 0."""
    step = _step(tables.platform)
    return {
        Row(unit.name, d): max(1, ceil(rate_of(tables, bounds.get(Row(unit.name, d), Fraction(0))) / step))
        for unit in tables.units
        for d in DIRECTIONS
    }


def _before(tables: Tables, settings: list[list[Setting]], table: Table) -> list[dict[Row, int]]:
    """Return the steps that may be in force when a table begins."""
    return [settings[t.index][-1].steps for t in predecessors(tables, table)]


def _orders(before: list[dict[Row, int]], several: list[Setting]) -> Iterator[tuple[Setting, list[tuple[Row, int]]]]:
    """Yield each setting of a table with its writes: those that fall come first; later ones write what changes."""
    for setting in several:
        writes = falls_first(before, setting.steps)
        if setting is not several[0]:
            (now,) = before
            writes = [(row, steps) for row, steps in writes if steps != now[row]]
        yield setting, writes
        before = [setting.steps]


def _check_ports(tables: Tables) -> Iterator[Diagnostic]:
    ports = [tables.platform.units[unit.name] for unit in tables.units]
    yield from check_owners(
        ((port.unit, port.port, port.at) for port in ports if port.port), "port", outward(list(PORTS))
    )
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
    several = segments(table.frame) if _is_phased(tables) else [Segment(0, peaks(table.frame))]
    for segment in several:
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
        can_help = not _is_phased(tables) and _fits_by_phase(tables, table)
        fault = over_limit(tables, table, given, promised, _OTHERWISE[not can_help])
        if fault:
            found.setdefault("sum", fault[0])
    return list(found.values())


def _fits_by_phase(tables: Tables, table: Table) -> bool:
    """Return whether the rates of every stretch of constant bounds fit together."""
    step, limit = _step(tables.platform), limit_of(tables)
    return all(sum(_steps(tables, s.bounds).values()) * step <= limit for s in segments(table.frame))


_OTHERWISE = {
    False: 'set "qos400: {granularity: phase}", or use the back-end table or axi-realm',
    True: "leave out ports that need no rate, or use the back-end table or axi-realm",
}


def _commands(tables: Tables, writes: list[tuple[Row, int]]) -> Iterator[str]:
    """Yield a command for every run of writes to one port, in which no parameter comes twice."""
    burstiness = tables.platform.settings[Qos400.name]["burstiness"]
    runs: list[dict[Row, int]] = []
    for row, steps in writes:
        if not runs or row in runs[-1] or next(iter(runs[-1])).unit != row.unit:
            runs.append({})
        runs[-1][row] = steps
    for run in runs:
        rates = ((PREFIX[row.direction], steps) for row, steps in run.items())
        parameters = ",".join(f"{prefix}_b={burstiness},{prefix}_r={steps}" for prefix, steps in rates)
        yield f"jailhouse qos {tables.platform.units[next(iter(run)).unit].port}:{parameters}"


def _init(tables: Tables) -> Iterator[tuple[int, int]]:
    """Yield (address, value) once: burstiness, lowest rates, and only then both regulators on."""
    burstiness = int(tables.platform.settings[Qos400.name]["burstiness"])
    for unit in tables.units:
        port = tables.platform.units[unit.name].port
        for d in DIRECTIONS:
            yield _word(port, f"{d}_burstiness", burstiness)
            yield _word(port, f"{d}_rate", 1)
        yield _word(port, "control", ENABLE_RATES)


def _word(port: str, register: str, value: int) -> tuple[int, int]:
    """Return the address of a register of a port, and the word that holds a value."""
    found = DESCRIPTION.registers[register]
    return PORTS[port] + found.offset, found.encode(value)


def _writes(tables: Tables, orders: Iterable[tuple[Setting, list[tuple[Row, int]]]]) -> Iterator[tuple[int, int, int]]:
    """Yield (nanoseconds, address, value) of a table: all rates at its start, then those that change."""
    for setting, writes in orders:
        for row, steps in writes:
            yield int(setting.at_ns), *_word(tables.platform.units[row.unit].port, f"{row.direction}_rate", steps)


WRITER = Qos400()
