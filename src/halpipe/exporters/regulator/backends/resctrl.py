"""Linux resctrl: shares of the memory bandwidth for groups of tasks, in the coarse steps of the processor.

Every value is the least step that keeps the promise, and what belongs to no unit (the root group, and other domains)
gets the least there is. Shares are approximate and no hard bound. Source: Linux, Documentation/filesystems/resctrl.rst.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import count
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import about
from halpipe.core.quantities import format_bandwidth
from halpipe.core.records import record
from halpipe.exporters.regulator.backends.base import falls_first, file_names, predecessors, render
from halpipe.exporters.regulator.backends.rates import Shares, check_owners, coarse, over_limit, rate_text, unit_rates
from halpipe.exporters.regulator.codes import NO_MANAGER, RATE_DOES_NOT_FIT

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.exporters.regulator.platform import Platform
    from halpipe.exporters.regulator.tables import Table, Tables

EIGHTH = 125_000_000
"""AMD counts in eighths of a GB/s."""

ROOT = "."
"""The group of all tasks that are in no other: the folder of resctrl itself."""

KERNELS = {
    "intel": "Linux 4.12 or later, a processor with MBA",
    "amd": "Linux 5.0 or later, a processor with QoS for memory bandwidth",
    "mpam": "Linux with the resctrl driver of MPAM, a memory system with MBW_MAX",
}


@record
class Steps:
    """The values that the processor takes: from `least` on in steps of `step` up to `most`."""

    kind: str
    least: int
    step: int
    most: int
    width: int
    capacity: int

    def given(self, value: int) -> Fraction:
        """Return the bytes per second that a value stands for."""
        if self.kind == "amd":
            return Fraction(value * EIGHTH)
        if self.kind == "intel":
            return Fraction(value * self.capacity, 100)
        parts = 2**self.width  # the driver takes the nearest part, at least one
        return Fraction(max(1, (value * parts * 2 + 100) // 200) * self.capacity, parts)

    def least_for(self, rate: Fraction) -> int | None:
        """Return the smallest value that gives `rate`, None if there is none."""
        low, high = 0, (self.most - self.least) // self.step
        if self.given(self.least + high * self.step) < rate:
            return None
        while low < high:
            middle = (low + high) // 2
            if self.given(self.least + middle * self.step) < rate:
                low = middle + 1
            else:
                high = middle
        return self.least + low * self.step


class Resctrl:
    """One script for each table: a line ``MB:`` for the group of every unit, and for everything else."""

    name = "resctrl"
    summary = "Linux resctrl: a script for every mode with the bandwidth share of every unit's group"
    least = 0
    reserves = "used"
    rates = True
    carries = False

    def overshoot(self, platform: Platform) -> int:
        """Return 0; resctrl knows no windows."""
        return 0

    def check(self, tables: Tables) -> list[Diagnostic]:
        """Return units without a group of their own, rates that do not fit, and shares far above the promise."""
        found = list(_check_groups(tables))
        for table in () if found else tables.tables:
            found += _check_shares(tables, table)
        return found

    def facts(self, tables: Tables) -> dict[str, Any]:
        """Return the value of every group in every table, and what the rest gets."""
        names = {tables.platform.units[unit.name].group: unit.name for unit in tables.units}
        return {
            "kernel": KERNELS[tables.platform.settings[self.name]["kind"]],
            "least": steps_of(tables.platform).least,
            "shares": {
                t.name: {names[g]: v for g, v in _values(tables, t).items() if g in names} for t in tables.tables
            },
        }

    def write(self, tables: Tables, digest: str) -> dict[str, bytes]:
        """Return a script for every table."""
        settings = tables.platform.settings[self.name]
        groups = [tables.platform.units[unit.name].group for unit in tables.units]
        steps = steps_of(tables.platform)
        tail = "".join(f";{domain}={steps.least}" for domain in settings["others"].split())
        values = {
            "platform": tables.platform,
            "model": tables.model,
            "digest": digest,
            "groups": groups,
            "kernel": KERNELS[settings["kind"]],
            "steps": steps,
            "settings": settings,
        }
        files = {}
        for stem, table in zip(file_names(t.name for t in tables.tables), tables.tables, strict=True):
            before = [_values(tables, t) for t in predecessors(tables, table)]
            lines = [
                (group, f"MB:{settings['domain']}={value}{tail}")
                for group, value in falls_first(before, _values(tables, table))
            ]
            files[f"{stem}.sh"] = render("resctrl.sh.j2", table=table, lines=lines, **values)
        return files


def steps_of(platform: Platform) -> Steps:
    """Return the steps of the platform: those stated, else those that the kernel has for this kind."""
    settings = platform.settings[Resctrl.name]
    kind, width = settings["kind"], int(settings["width"])
    grain = {"intel": 10, "amd": 1, "mpam": max(1, 100 // 2**width)}[kind]
    least, step = int(settings["min"] or grain), int(settings["step"] or grain)
    return Steps(kind, least, step, 2048 if kind == "amd" else 100, width, platform.capacity)


def _values(tables: Tables, table: Table) -> dict[str, int]:
    """Return the value of every group; of what cannot be served the largest."""
    steps = steps_of(tables.platform)
    values = {ROOT: steps.least}
    for unit, rate in unit_rates(tables, table).items():
        value = steps.least_for(rate)
        values[tables.platform.units[unit].group] = steps.most if value is None else value
    return values


def _check_groups(tables: Tables) -> Iterator[Diagnostic]:
    ports = [tables.platform.units[unit.name] for unit in tables.units]
    for port in ports:
        if not port.group:
            help = 'state "group: NAME", the folder in /sys/fs/resctrl for the tasks of this unit'
            yield NO_MANAGER("has no group for resctrl", at=port.at, path=about(unit=port.unit), help=help)
        elif port.group in _RESERVED:
            help = "name the group otherwise; resctrl has a folder of this name"
            yield NO_MANAGER(f'has the group "{port.group}"', at=port.at, path=about(unit=port.unit), help=help)
    yield from check_owners(((port.unit, port.group, port.at) for port in ports if port.group), "group", _numbered)
    settings = tables.platform.settings[Resctrl.name]
    if settings["domain"] in settings["others"].split():
        message = f"domain {settings['domain']} is the one that is regulated and one of the others"
        help = "list under others: only the further domains of the MB line"
        yield RATE_DOES_NOT_FIT(message, at=tables.platform.at, path="platform resctrl", help=help)


def _numbered(group: str) -> Iterator[str]:
    return (f"{group}-{n}" for n in count(2))


_RESERVED = {"info", "mon_groups", "mon_data", "schemata", "tasks", "cpus", "cpus_list", "mode", "size", ".", ".."}


def _check_shares(tables: Tables, table: Table) -> Iterator[Diagnostic]:
    steps = steps_of(tables.platform)
    found: list[Diagnostic] = []
    promised = {"everything else": Fraction(0), **unit_rates(tables, table)}
    given = {}
    for unit, rate in promised.items():
        value = steps.least_for(rate)
        given[unit] = steps.given(steps.most if value is None else value)
        if value is None:
            message = f"is promised {rate_text(rate)}; the largest share is {rate_text(given[unit])}"
            capacity = -(-rate.numerator // rate.denominator)
            help = f'state "capacity: {format_bandwidth(capacity)}" or lower the bound'
            path = about(table.frame.path, unit=unit)
            found.append(RATE_DOES_NOT_FIT(message, at=table.frame.at, path=path, help=help))
        else:
            found += coarse(tables, table, unit, given[unit], rate)
    yield from found
    if not any(d.is_error for d in found):
        other = "use a processor with finer steps, or the back-end table or axi-realm"
        shares = None if steps.kind == "amd" else _shares(steps, list(promised.values()))
        yield from over_limit(tables, table, given, promised, other, shares=shares)


def _shares(steps: Steps, rates: list[Fraction]) -> Shares:
    """Return what these rates take of another capacity."""

    def total(capacity: int) -> Fraction | None:
        other, given = replace(steps, capacity=capacity), Fraction(0)
        for rate in rates:
            value = other.least_for(rate)
            if value is None:
                return None
            given += other.given(value)
        return given

    parts = [Fraction(value, 100) for value in range(steps.least, steps.most + 1, steps.step)]
    if steps.kind == "mpam":
        parts = [steps.given(value) / steps.capacity for value in range(steps.least, steps.most + 1, steps.step)]
    return Shares(total, [rate / part for rate in rates for part in parts])
