"""Linux resctrl: shares of the memory bandwidth for groups of tasks, in the coarse steps of the processor.

Values between two steps go to the next step up on Intel, and to the nearest on Arm MPAM, which both promise more than
there is; so every value is a step at or below what was promised. Shares are approximate and no hard bound.
Source: Linux, Documentation/filesystems/resctrl.rst.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.exporters.regulator.backends.base import file_names, render
from halpipe.exporters.regulator.backends.rates import check_peaks, peaks, rate_of
from halpipe.exporters.regulator.codes import COARSE_RATE, NO_MANAGER
from halpipe.quantities import format_bandwidth

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.diagnostics import Diagnostic
    from halpipe.exporters.regulator.platform import Platform
    from halpipe.exporters.regulator.tables import Table, Tables

EIGHTH = 125_000_000
"""AMD counts in eighths of a GB/s."""


@dataclass(frozen=True, slots=True)
class Share:
    """The value written for a group, and the bytes per second that it stands for."""

    group: str
    unit: str
    value: int
    promised: Fraction
    given: Fraction


class Resctrl:
    """One script for each table: a line ``MB:`` for the group of every unit."""

    name = "resctrl"
    summary = "Linux resctrl: a script for every mode with the bandwidth share of every unit's group"
    least = 0

    def overshoot(self, platform: Platform) -> int:
        """Return 0; resctrl knows no windows."""
        return 0

    def check(self, tables: Tables) -> list[Diagnostic]:
        """Return units without a group, rates that do not fit, and shares that are not what was promised."""
        found = list(_check_groups(tables))
        found += check_peaks(tables, "use the back-end table or axi-realm, or make the bounds of the units smaller")
        for table in () if any(d.is_error for d in found) else tables.tables:
            found += _check_shares(tables, table)
        return found

    def facts(self, tables: Tables) -> dict[str, Any]:
        """Return the value of every group in every table."""
        return {"shares": {t.name: {s.unit: s.value for s in _shares(tables, t)} for t in tables.tables}}

    def write(self, tables: Tables, digest: str) -> dict[str, bytes]:
        """Return a script for every table."""
        values = {"platform": tables.platform, "model": tables.model, "digest": digest}
        domain = tables.platform.settings[self.name]["domain"]
        return {
            f"{stem}.sh": render("resctrl.sh.j2", table=table, shares=_shares(tables, table), domain=domain, **values)
            for stem, table in zip(file_names(t.name for t in tables.tables), tables.tables, strict=True)
        }


def _shares(tables: Tables, table: Table) -> list[Share]:
    bounds: dict[str, Fraction] = {}
    for row, bound in peaks(table.frame).items():
        bounds[row.unit] = bounds.get(row.unit, Fraction(0)) + bound
    shares = []
    for unit in tables.units:
        promised = rate_of(tables, bounds.get(unit.name, Fraction(0)))
        value, given = _step(tables.platform, promised)
        shares.append(Share(tables.platform.units[unit.name].group, unit.name, value, promised, given))
    return shares


def _step(platform: Platform, rate: Fraction) -> tuple[int, Fraction]:
    """Return the largest value that gives no more than `rate`, or the smallest there is, and what it gives."""
    settings = platform.settings[Resctrl.name]
    least, step = int(settings["min"]), int(settings["step"])
    share = rate / platform.capacity
    if settings["kind"] == "amd":
        value = max(1, int(rate / EIGHTH))
        return value, Fraction(value * EIGHTH)
    if settings["kind"] == "intel":
        value = max(least, least + (int(share * 100) - least) // step * step)
        return value, Fraction(value * platform.capacity, 100)
    parts = 2 ** int(settings["width"])
    value = next((v for v in range(100, 0, -1) if _mpam(v, parts) <= share), 1)
    return value, _mpam(value, parts) * platform.capacity


def _mpam(percent: int, parts: int) -> Fraction:
    """Return the share that Linux's driver makes of a value: the nearest of `parts` steps, at least one."""
    return Fraction(max(1, (percent * parts * 2 + 100) // 200), parts)


def _check_groups(tables: Tables) -> Iterator[Diagnostic]:
    for unit in tables.units:
        port = tables.platform.units[unit.name]
        if not port.group:
            help = 'state "group: NAME", the folder in /sys/fs/resctrl for the tasks of this unit'
            yield NO_MANAGER("has no group for resctrl", at=port.at, path=f'unit "{unit.name}"', help=help)


def _check_shares(tables: Tables, table: Table) -> Iterator[Diagnostic]:
    shares = _shares(tables, table)
    total, capacity = sum(share.given for share in shares), tables.platform.capacity
    for share in shares:
        if share.given != share.promised and (share.promised or total > capacity):
            word = "more" if share.given > share.promised else "less"
            message = f"the share of {_rate(share.given)} is {word} than the {_rate(share.promised)} promised"
            help = "resctrl has coarse steps; choose bounds on them, or regulate this unit in hardware"
            yield COARSE_RATE(message, at=table.frame.at, path=f'{table.frame.path} unit "{share.unit}"', help=help)


def _rate(value: Fraction) -> str:
    return format_bandwidth(value.numerator // value.denominator)
