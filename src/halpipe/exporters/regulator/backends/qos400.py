"""QoS-400 regulators of the Zynq UltraScale+ (NIC-400): a token bucket on addresses for each port and direction.

Rates are 12-bit fractions of transfers per cycle, so that a step is ``clock * burst / 4096`` bytes per second, and 0
switches a regulator off: it is never written. The registers are open to EL3 only; the table is for firmware there, the
script is for the hypervisor Jailhouse with its QoS extension.

Sources: Xilinx UG1087 (register addresses), Arm DSU 0026 (QoS-400 supplement to the NIC-400).
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from math import ceil
from typing import TYPE_CHECKING, Any

from halpipe.exporters.regulator.backends.base import file_names, identifiers, render
from halpipe.exporters.regulator.backends.rates import Segment, check_peaks, peaks, rate_of, segments
from halpipe.exporters.regulator.codes import COARSE_RATE, NO_MANAGER, RATE_DOES_NOT_FIT
from halpipe.exporters.regulator.frames import Row
from halpipe.exporters.regulator.platform import DIRECTIONS, READ, WRITE, read_frequency
from halpipe.quantities import format_bandwidth
from halpipe.suggest import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.diagnostics import Diagnostic
    from halpipe.exporters.regulator.platform import Platform
    from halpipe.exporters.regulator.tables import Table, Tables

_FPD, _LPD = 0xFD700000, 0xFE100000
PORTS = {
    "afifm0": _FPD + 0x45100, "afifm1": _FPD + 0x46100, "afifm2": _FPD + 0x47100, "afifm3": _FPD + 0x4A100,
    "afifm4": _FPD + 0x4B100, "afifm5": _FPD + 0x4C100, "smmutbu3": _FPD + 0x43100, "smmutbu4": _FPD + 0x44100,
    "smmutbu5": _FPD + 0x48100, "dp": _FPD + 0x49100, "gpu": _FPD + 0x4D100, "pcie": _FPD + 0x4E100,
    "gdma": _FPD + 0x4F100, "sata": _FPD + 0x50100, "rpu0": _LPD + 0x42100, "rpu1": _LPD + 0x43100,
    "adma": _LPD + 0x44100, "afifm6": _LPD + 0x45100,
}  # fmt: skip

STEPS = 4096
QOS_CNTL, ENABLE_RATES = 0x0C, 0x3
BURSTINESS = {READ: 0x28, WRITE: 0x1C}
RATE = {READ: 0x2C, WRITE: 0x20}
PREFIX = {READ: "ar", WRITE: "aw"}


@dataclass(frozen=True, slots=True)
class Setting:
    """What is set at `at_ns` of a table: steps for every port and direction, in the order of the units."""

    at_ns: Fraction
    steps: dict[Row, int]


class Qos400:
    """One setting for each mode, or (granularity: phase) one for each change of bounds."""

    name = "qos400"
    summary = "ZynqMP QoS-400: Jailhouse command lines, and addresses with values for EL3 firmware"
    least = 0

    def overshoot(self, platform: Platform) -> int:
        """Return the burstiness: what a full token bucket lets pass at once."""
        return int(platform.settings[self.name]["burstiness"]) * platform.burst

    def check(self, tables: Tables) -> list[Diagnostic]:
        """Return units without a port, rates that do not fit, and rates that are not what was promised."""
        found = list(_check_ports(tables))
        if not found and not _is_phased(tables):
            help = 'set "qos400: {granularity: phase}", or use the back-end table or axi-realm'
            found += check_peaks(tables, help)
        if not found:
            for table in tables.tables:
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
        files = {}
        for stem, table, several in zip(
            file_names(t.name for t in tables.tables), tables.tables, settings, strict=True
        ):
            lines = [(setting, list(_commands(tables, setting))) for setting in several]
            files[f"{stem}.sh"] = render("qos400.sh.j2", table=table, lines=lines, **values)
        arrays = [list(_writes(tables, several)) for several in settings]
        names = identifiers(table.name for table in tables.tables)
        files["qos400.h"] = render(
            "qos400.h.j2",
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
    return [Setting(tables.grid.ns(segment.begin), _steps(tables, segment.bounds)) for segment in several]


def _limit(tables: Tables) -> int:
    """Return the steps that fit into the capacity, all ports and directions together."""
    p = tables.platform
    left = p.capacity - Fraction(tables.reserve * p.clock, p.cycles)
    return int(left / _step(p))


def _steps(tables: Tables, bounds: dict[Row, Fraction]) -> dict[Row, int]:
    """Return the steps of every port and direction: rounded up where all fit, else as many as fit, never 0."""
    exact: dict[Row, Fraction] = {
        Row(unit.name, d): rate_of(tables, bounds.get(Row(unit.name, d), Fraction(0))) / _step(tables.platform)
        for unit in tables.units
        for d in DIRECTIONS
    }
    steps: dict[Row, int] = {row: max(1, ceil(rate)) for row, rate in exact.items()}
    excess = sum(steps.values()) - _limit(tables)
    losing = sorted((row for row, rate in exact.items() if steps[row] > rate > 1), key=lambda row: exact[row] % 1)
    for row in losing[: max(0, excess)]:  # those first that lose least
        steps[row] -= 1
    return steps


def _check_ports(tables: Tables) -> Iterator[Diagnostic]:
    for unit in tables.units:
        port = tables.platform.units[unit.name]
        if port.port not in PORTS:
            message = f'has the port "{port.port}", which is none of the ZynqMP' if port.port else "has no port"
            help = did_you_mean(port.port, PORTS, 'state "port: ", one of ' + ", ".join(PORTS))
            yield NO_MANAGER(message, at=port.at, path=f'unit "{unit.name}"', help=help)


def _check_rates(tables: Tables, table: Table) -> list[Diagnostic]:
    """Compare what is set with what was promised, once for every row and table."""
    found: dict[tuple[Row | None, str], Diagnostic] = {}
    step, path, limit = _step(tables.platform), table.frame.path, _limit(tables)
    several = segments(table.frame) if _is_phased(tables) else [Segment(0, peaks(table.frame))]
    for segment in several:
        steps = _steps(tables, segment.bounds)
        total = sum(steps.values())
        if total > limit:
            message = f"{total} steps of {_rate(step)} are needed for all ports together, {limit} fit the capacity"
            help = "leave ports out that need none, or raise the capacity of the platform"
            found[None, "sum"] = RATE_DOES_NOT_FIT(message, at=table.frame.at, path=path, help=help)
        for row, bound in segment.bounds.items():
            promised, given = rate_of(tables, bound), steps[row] * step
            where = f'{path} unit "{row.unit}"'
            if steps[row] >= STEPS:
                message = (
                    f"{row.direction} rate {_rate(promised)} is {steps[row]} steps; the register holds {STEPS - 1}"
                )
                help = f"use longer bursts or a faster clock: at most {_rate(step * (STEPS - 1))} can be set"
                found[row, "range"] = RATE_DOES_NOT_FIT(message, at=table.frame.at, path=where, help=help)
            elif given < promised:
                message = f"{row.direction} rate is set to {_rate(given)}, less than the {_rate(promised)} promised"
                help = "not all rates can be rounded up within the capacity; raise it, or lower a bound"
                found[row, "less"] = COARSE_RATE(message, at=table.frame.at, path=where, help=help)
    return list(found.values())


def _rate(value: Fraction) -> str:
    return format_bandwidth(value.numerator // value.denominator)


def _commands(tables: Tables, setting: Setting) -> Iterator[str]:
    burstiness = tables.platform.settings[Qos400.name]["burstiness"]
    for unit in tables.units:
        parameters = ",".join(
            f"{PREFIX[d]}_b={burstiness},{PREFIX[d]}_r={setting.steps[Row(unit.name, d)]}" for d in DIRECTIONS
        )
        yield f"jailhouse qos {tables.platform.units[unit.name].port}:{parameters}"


def _init(tables: Tables) -> Iterator[tuple[int, int]]:
    """Yield (address, value) once: burstiness, lowest rates, and only then both regulators on."""
    burstiness = int(tables.platform.settings[Qos400.name]["burstiness"])
    for unit in tables.units:
        base = PORTS[tables.platform.units[unit.name].port]
        for d in DIRECTIONS:
            yield base + BURSTINESS[d], burstiness
            yield base + RATE[d], 1 << 20
        yield base + QOS_CNTL, ENABLE_RATES


def _writes(tables: Tables, settings: list[Setting]) -> Iterator[tuple[int, int, int]]:
    """Yield (nanoseconds, address, value) of a table: all rates at its start, then those that change.

    Rates that fall come before those that rise, so that the sum is never above both settings.
    """
    before: dict[Row, int] = {}
    for setting in settings:
        changed = [row for row, steps in setting.steps.items() if before.get(row) != steps]
        for row in sorted(changed, key=lambda row: setting.steps[row] > before.get(row, 0)):
            address = PORTS[tables.platform.units[row.unit].port] + RATE[row.direction]
            yield int(setting.at_ns), address, setting.steps[row] << 20
        before = setting.steps
