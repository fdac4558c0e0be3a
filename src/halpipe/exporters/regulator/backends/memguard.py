"""MemGuard (heechul/memguard): events per core and period, for units that are cores of a CPU.

Limits are written as events, not as MB/s: the module's own conversion divides 10^6 by the period in integers and is
wrong unless it divides. A limit of 0 is rejected. The period is the platform's window; it is not aligned with the
schedule, so each mode has one limit per core, that of its largest bound.
"""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.durations import seconds
from halpipe.exporters.regulator.backends.base import file_names, render
from halpipe.exporters.regulator.backends.rates import check_peaks, peaks
from halpipe.exporters.regulator.codes import NO_MANAGER, RATE_DOES_NOT_FIT, SHARED_MANAGER
from halpipe.exporters.regulator.frames import Row
from halpipe.exporters.regulator.platform import DIRECTIONS
from halpipe.quantities import parse_size

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.diagnostics import Diagnostic
    from halpipe.exporters.regulator.platform import Platform
    from halpipe.exporters.regulator.tables import Table, Tables


class MemGuard:
    """One script for each table: limits of all cores, in events (cache lines) per period."""

    name = "memguard"
    summary = "MemGuard: a script for every mode with the events per period of every core"
    least = 0

    def overshoot(self, platform: Platform) -> int:
        """Return 0; what passes until the interrupt is taken is for the platform to state."""
        return 0

    def check(self, tables: Tables) -> list[Diagnostic]:
        """Return units that are no cores, a period that is not whole microseconds, and rates that do not fit."""
        found = [*_check_cores(tables), *_check_period(tables.platform)]
        return found + check_peaks(
            tables, "use the back-end table or axi-realm, or make the bounds of the units smaller"
        )

    def facts(self, tables: Tables) -> dict[str, Any]:
        """Return the events of every table, by core."""
        return {
            "period_us": str(tables.platform.window.in_unit("us")),
            "events": {t.name: {d: _events(tables, t, d) for d in DIRECTIONS} for t in tables.tables},
        }

    def write(self, tables: Tables, digest: str) -> dict[str, bytes]:
        """Return a script for every table, and one that loads the module."""
        values = {"platform": tables.platform, "model": tables.model, "digest": digest}
        period = int(tables.platform.window.in_unit("us"))
        defaults = {d: _defaults(tables, d) for d in DIRECTIONS}
        files = {"setup.sh": render("memguard_setup.sh.j2", period=period, events=defaults, **values)}
        for stem, table in zip(file_names(t.name for t in tables.tables), tables.tables, strict=True):
            events = {d: _events(tables, table, d) for d in DIRECTIONS}
            files[f"{stem}.sh"] = render("memguard.sh.j2", table=table, events=events, **values)
        return files


def _cores(tables: Tables) -> dict[int, str]:
    ports = ((unit.name, tables.platform.units[unit.name].core) for unit in tables.units)
    return {core: name for name, core in ports if core is not None}


def _line(platform: Platform) -> int:
    return parse_size(platform.settings[MemGuard.name]["line"])


def _events(tables: Tables, table: Table, direction: str) -> list[int]:
    """Return the events per period of every core from 0 on: the largest bound of the table, rounded down to lines."""
    cores, highest = _cores(tables), peaks(table.frame)
    promised = tables.platform.promise / _line(tables.platform)
    bounds = (highest.get(Row(cores.get(n, ""), direction), Fraction(0)) for n in range(max(cores, default=-1) + 1))
    return [max(1, int(bound * promised)) for bound in bounds]


def _defaults(tables: Tables, direction: str) -> list[int]:
    by_name = {unit.name: unit.default[direction] for unit in tables.units}
    line = _line(tables.platform)
    return [max(1, by_name[name] // line) for _, name in sorted(_cores(tables).items())]


def _check_cores(tables: Tables) -> Iterator[Diagnostic]:
    owner: dict[int, str] = {}
    for unit in tables.units:
        port = tables.platform.units[unit.name]
        path = f'unit "{unit.name}"'
        if port.core is None:
            help = 'state "core: N", the number of the core as the system counts them'
            yield NO_MANAGER("is no core: it has no number for MemGuard", at=port.at, path=path, help=help)
        elif owner.setdefault(port.core, unit.name) != unit.name:
            message = f'core {port.core} is the one of unit "{owner[port.core]}", too'
            yield SHARED_MANAGER(message, at=port.at, path=path, help="give each unit a core of its own")
    gaps = sorted(set(range(max(owner, default=0))) - set(owner))
    if gaps and owner:
        message = f"cores {', '.join(map(str, gaps))} belong to no unit, and MemGuard wants a limit for every core"
        help = "add units for them to the model and the platform; what no task runs on gets the lowest limit"
        yield NO_MANAGER(message, at=tables.platform.at, path="platform units", help=help)


def _check_period(platform: Platform) -> Iterator[Diagnostic]:
    period = platform.window.in_unit("us")
    if period.denominator != 1:
        cycles = [n * platform.clock // 10**6 for n in (int(period), int(period) + 1) if n]
        whole = [n for n in cycles if n * 10**6 % platform.clock == 0]
        near = " or ".join(f"{n} cycles ({seconds(Fraction(n, platform.clock))})" for n in whole)
        message = f"the window of {platform.window} is the period of MemGuard, which counts in whole microseconds"
        help = f"use {near}" if near else "use a clock and a window that give whole microseconds"
        yield RATE_DOES_NOT_FIT(message, at=platform.at, path="platform window", help=help)
