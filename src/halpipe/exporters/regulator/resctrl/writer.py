"""Linux resctrl: shares of the memory bandwidth for groups of tasks, in the steps of processor and kernel.

Every value is the least that keeps the promise after the kernel has rounded it, and what belongs to no unit (the root
group, and other domains) gets the least there is. Sources: Linux, fs/resctrl (ranges, rounding up to multiples of the
step), arch/x86 resctrl (AMD: least 0) and drivers/resctrl (MPAM: parts of the component's maximum).
"""

from __future__ import annotations

from fractions import Fraction
from functools import cached_property
from itertools import count
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, about
from halpipe.devices import DEVICES
from halpipe.exporters.regulator.codes import APPROXIMATE, NO_MANAGER, RATE_DOES_NOT_FIT
from halpipe.exporters.regulator.platform import Platform, levels_of
from halpipe.exporters.regulator.rates import check_owners, coarse, over_limit, rate_text, unit_rates
from halpipe.exporters.regulator.writing import Backend, falls_first, file_names, predecessors, render

if TYPE_CHECKING:
    from collections.abc import Iterator

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


class Steps:
    """Values that the kernel takes: from `least` to `most`, each rounded up to a multiple of `step`.

    `levels` are measured bytes per second by value; without, shares are of `peak`.
    """

    def __init__(self, platform: Platform) -> None:
        settings = platform.settings[Resctrl.name]
        self.kind, self.peak, self.parts = settings["kind"], platform.peak, 1 << int(settings["width"])
        least, step = {"intel": (10, 10), "amd": (0, 1), "mpam": (_nearest(100, self.parts), -(-100 // self.parts))}[
            self.kind
        ]
        self.least, self.step = int(settings["min"] or least), int(settings["step"] or step)
        self.most = int(settings["max"] or (2048 if self.kind == "amd" else 100))
        self.levels = levels_of(settings["levels"])

    @cached_property
    def values(self) -> list[int]:
        """Values to write, ascending with what they grant: one for each grant.

        A limit of 0 is written only where it is known to mean the least part (MPAM), where the largest value may wrap.
        """
        first = self.least if self.kind == "mpam" else max(1, self.least)
        found: dict[Fraction, int] = {}
        for value in (min(n, self.most) for n in range(self.rounded(first), self.most + self.step, self.step)):
            is_taken = self.kind == "mpam" or self.rounded(value) <= self.most
            if is_taken and (not self.levels or value in self.levels):
                found.setdefault(self.given(value), value)
        return [found[grant] for grant in sorted(found)]

    def rounded(self, value: int) -> int:
        """Return what the kernel makes of a value."""
        return -(-value // self.step) * self.step

    def given(self, value: int) -> Fraction:
        """Return the bytes per second that a value stands for."""
        if self.kind == "amd":
            return Fraction(self.rounded(value) * EIGHTH)
        if self.levels:
            return Fraction(self.levels[value])
        if self.kind == "intel":
            return Fraction(self.rounded(value) * self.peak, 100)
        return Fraction(self._part(value) * self.peak, self.parts)

    def shown(self, value: int) -> int:
        """Return what schemata has after a value was written."""
        return _nearest(self._part(value) * 100, self.parts) if self.kind == "mpam" else self.rounded(value)

    def _part(self, value: int) -> int:
        """Return the parts that the driver of MPAM takes, the nearest number from 1 on; beyond its field it wraps."""
        return (max(1, _nearest(self.rounded(value) * self.parts, 100)) - 1) % self.parts + 1

    def value_for(self, rate: Fraction) -> int:
        """Return the smallest value that gives `rate`, the largest there is for what no value gives."""
        return next((value for value in self.values if self.given(value) >= rate), self.values[-1])


def _nearest(numerator: int, denominator: int) -> int:
    return (2 * numerator + denominator) // (2 * denominator)


class Resctrl(Backend):
    """One script for each table: a line ``MB:`` for the group of every unit, and for everything else."""

    device = DEVICES["resctrl"]
    name = device.name

    def check(self, tables: Tables) -> list[Diagnostic]:
        """Return units without a group of their own, rates that do not fit, and shares that are approximate."""
        found = [*_check_groups(tables), *_check_steps(tables.platform)]
        for table in () if any(d.is_error for d in found) else tables.tables:
            found += _check_shares(tables, table)
        return found

    def facts(self, tables: Tables) -> dict[str, Any]:
        """Return the value of every group in every table, and what the rest gets."""
        names = {tables.platform.units[unit.name].group: unit.name for unit in tables.units}
        steps = Steps(tables.platform)
        return {
            "kernel": KERNELS[steps.kind],
            "least": steps.values[0],
            "shares": {
                t.name: {names[g]: v for g, v in _values(tables, t).items() if g in names} for t in tables.tables
            },
        }

    def write(self, tables: Tables, digest: str) -> dict[str, bytes]:
        """Return a script for every table."""
        settings = tables.platform.settings[self.name]
        groups = [tables.platform.units[unit.name].group for unit in tables.units]
        steps = Steps(tables.platform)
        own, others = int(settings["domain"]), [int(domain) for domain in settings["others"].split()]
        domains = sorted([own, *others])

        def line(value: int, rest: int) -> str:
            return "MB:" + ";".join(f"{d}={value if d == own else rest}" for d in domains)

        values = {
            "platform": tables.platform,
            "model": tables.model,
            "digest": digest,
            "groups": groups,
            "kernel": KERNELS[steps.kind],
            "steps": steps,
            "domains": domains,
        }
        files = {}
        for stem, table in zip(file_names(t.name for t in tables.tables), tables.tables, strict=True):
            before = [_values(tables, t) for t in predecessors(tables, table)]
            least, shown = steps.values[0], steps.shown
            written = falls_first(before, _values(tables, table))
            lines = [(group, line(n, least), line(shown(n), shown(least))) for group, n in written]
            files[f"{stem}.sh"] = render("resctrl/table.sh.j2", table=table, lines=lines, **values)
        return files


def _values(tables: Tables, table: Table) -> dict[str, int]:
    """Return the value of every group; of what cannot be served the largest."""
    steps = Steps(tables.platform)
    rates = unit_rates(tables, table)
    return {
        ROOT: steps.values[0],
        **{tables.platform.units[unit].group: steps.value_for(r) for unit, r in rates.items()},
    }


def _check_steps(platform: Platform) -> Iterator[Diagnostic]:
    """Yield steps without a value to write, levels that are no steps, and shares of what was not stated."""
    steps, path = Steps(platform), "platform resctrl"
    strange = [n for n in steps.levels if not max(1, steps.least) <= n <= steps.most or n % steps.step]
    if steps.kind != "intel" and steps.levels:
        message = f"levels are of kind intel, the platform states {steps.kind}"
        yield RATE_DOES_NOT_FIT(message, at=platform.at, path=path, help='remove "levels", or state "kind: intel"')
    elif strange:
        message = (
            f"the level of {strange[0]} is of no value from {steps.least} to {steps.most} in steps of {steps.step}"
        )
        help = "state levels of values that the kernel takes, or min and step as info/MB has them"
        yield RATE_DOES_NOT_FIT(message, at=platform.at, path=path, help=help)
    elif not steps.values:
        message = f"there is no value from {steps.least} to {steps.most} in steps of {steps.step}"
        help = "state min, max and step as info/MB/min_bandwidth and bandwidth_gran have them"
        yield RATE_DOES_NOT_FIT(message, at=platform.at, path=path, help=help)
    elif steps.kind == "intel" and not steps.levels:
        message = "percentages are taken as parts of the peak; MBA delays each core, and its effect is not linear"
        help = 'measure the bandwidth of a group at each value, and state "levels: 10=4GB/s 20=6.1GB/s ..."'
        yield APPROXIMATE(message, at=platform.at, path=path, help=help)
    elif steps.kind == "mpam" and platform.stated_peak is None:
        message = "shares are parts of what the memory component has at most, which is taken to be the capacity"
        help = 'state "peak", the largest bandwidth of the component'
        yield APPROXIMATE(message, at=platform.at, path=path, help=help)


def _check_groups(tables: Tables) -> Iterator[Diagnostic]:
    ports = [tables.platform.units[unit.name] for unit in tables.units]
    for port in ports:
        if not port.group:
            help = 'state "group: NAME", the folder in /sys/fs/resctrl for the tasks of this unit'
            yield NO_MANAGER("has no group for resctrl", at=port.at, path=about(unit=port.unit), help=help)
        elif port.group in _RESERVED:
            help = "name the group otherwise; resctrl has a folder of this name"
            yield NO_MANAGER(f'has the group "{port.group}"', at=port.at, path=about(unit=port.unit), help=help)
    owned = ((port.unit, port.group, port.at) for port in ports if port.group)
    yield from check_owners(owned, "group", lambda group: (f"{group}-{n}" for n in count(2)))
    settings = tables.platform.settings[Resctrl.name]
    if settings["domain"] in settings["others"].split():
        message = f"domain {settings['domain']} is the one that is regulated and one of the others"
        help = "list under others: only the further domains of the MB line"
        yield RATE_DOES_NOT_FIT(message, at=tables.platform.at, path="platform resctrl", help=help)


_RESERVED = {"info", "mon_groups", "mon_data", "schemata", "tasks", "cpus", "cpus_list", "mode", "size", ".", ".."}


def _check_shares(tables: Tables, table: Table) -> Iterator[Diagnostic]:
    """Yield rates that no value gives, those far above the promise, and sums above the capacity."""
    steps, platform = Steps(tables.platform), tables.platform
    found: list[Diagnostic] = []
    promised = {"everything else": Fraction(0), **unit_rates(tables, table)}
    given = {unit: steps.given(steps.value_for(rate)) for unit, rate in promised.items()}
    for unit, rate in promised.items():
        if given[unit] < rate:
            message = f"is promised {rate_text(rate)}; the largest share is {rate_text(given[unit])}"
            path = about(table.frame.path, unit=unit)
            help = "lower the bound, or measure the level of a higher value"
            found.append(RATE_DOES_NOT_FIT(message, at=table.frame.at, path=path, help=help))
        else:
            found += coarse(table, unit, given[unit], rate)
    yield from found
    if not any(d.is_error for d in found):
        other = "use a processor with finer steps, or the back-end table or axi-realm"
        most = None if steps.kind == "amd" or steps.levels else platform.peak
        yield from over_limit(tables, table, given, promised, other, most=most)


WRITER = Resctrl()
