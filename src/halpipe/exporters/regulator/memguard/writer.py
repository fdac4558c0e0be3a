"""MemGuard (heechul/memguard): events per core and period, for units that are cores of a CPU.

Limits are written as events, not as MB/s: the module's own conversion divides 10^6 by the period in integers and is
wrong unless it divides. A limit of 0 is rejected, and cores that a line does not reach keep what they had, which after
loading is 1000 MB/s of reads and 500 of writes; so every line has every core. The period is not aligned with the
schedule, so each mode has one limit per core, that of its largest bound, rounded up; or with ``granularity: phase``,
one for each stretch of periods.

The module counts refills of cache lines as reads. A cache that allocates on writes refills a line before it is written,
so that lines written bring `write-refills` lines read with them. Lines read may be written back, so that they bring
`write-backs` lines written. Without room for both a core would stall at its first write or write-back.
"""

from __future__ import annotations

from fractions import Fraction
from math import ceil
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, about
from halpipe.core.quantities import parse_rational, parse_size
from halpipe.devices import DEVICES
from halpipe.exporters.regulator.codes import NO_MANAGER, RATE_DOES_NOT_FIT
from halpipe.exporters.regulator.frames import Row
from halpipe.exporters.regulator.platform import DIRECTIONS, READ, WRITE, Platform
from halpipe.exporters.regulator.rates import check_owners, limit_of, over_limit, peaks, rate_of, segments
from halpipe.exporters.regulator.writing import Backend, file_names, predecessors, render

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from halpipe.exporters.regulator.tables import Table, Tables

LEAST_PERIOD = 1000
"""Microseconds: below, the interrupts that end and begin periods take a core's time themselves."""

MOST_PERIOD = 10**6
ZERO_DIVISOR = 4096
"""Microseconds, of whose multiples the module's 32-bit product with 2^20 is 0, and divides when limits are read."""

LONGEST_LINE = 255
"""Characters that the module takes of one line."""


class MemGuard(Backend):
    """One script for each table: limits of all cores, in events (cache lines) per period."""

    device = DEVICES["memguard"]
    name = device.name

    def check(self, tables: Tables) -> list[Diagnostic]:
        """Return units that are no cores, a period that does not do, and rates that do not fit."""
        found = [*_check_cores(tables), *_check_period(tables.platform)]
        for table in () if found else tables.tables:
            found += _check_limits(tables, table)
        return found

    def facts(self, tables: Tables) -> dict[str, Any]:
        """Return the events of every table, by core."""
        return {
            "period_us": _period(tables.platform),
            "cores": _count(tables),
            "events": {t.name: {d: _events(tables, peaks(t.frame), d) for d in DIRECTIONS} for t in tables.tables},
            "settings": {t.name: len(_settings(tables, t)) for t in tables.tables},
        }

    def write(self, tables: Tables, digest: str) -> dict[str, bytes]:
        """Return a script for every table, and one that loads the module."""
        values = {"platform": tables.platform, "model": tables.model, "digest": digest, "cores": _count(tables)}
        defaults = [(d, _defaults(tables)[d]) for d in DIRECTIONS]
        period = _period(tables.platform)
        files = {"setup.sh": render("memguard/setup.sh.j2", period=period, limits=defaults, **values)}
        for stem, table in zip(file_names(t.name for t in tables.tables), tables.tables, strict=True):
            blocks = list(_blocks(tables, table))
            files[f"{stem}.sh"] = render("memguard/table.sh.j2", table=table, blocks=blocks, **values)
        return files


def _cores(tables: Tables) -> dict[int, str]:
    ports = ((unit.name, tables.platform.units[unit.name].core) for unit in tables.units)
    return {core: name for name, core in ports if core is not None}


def _count(tables: Tables) -> int:
    """Return the number of cores of the machine: as stated, else up to the last that is a unit."""
    return int(tables.platform.settings[MemGuard.name]["cores"]) or max(_cores(tables)) + 1


def _line(platform: Platform) -> int:
    return parse_size(platform.settings[MemGuard.name]["line"])


def _period(platform: Platform) -> int:
    """Return the period in microseconds: as stated, else the window."""
    stated = platform.settings[MemGuard.name]["period"]
    return int(stated) if stated else int(platform.window.in_unit("us"))


def _bytes(platform: Platform, rate: Fraction) -> Fraction:
    return rate * _period(platform) / 10**6


def _events(tables: Tables, highest: Mapping[Row, Fraction], direction: str) -> list[int]:
    """Return the events per period of every core for the largest bounds of a stretch, rounded up to lines."""
    cores, line = _cores(tables), _line(tables.platform)

    def lines(unit: str, direction: str) -> int:
        bound = highest.get(Row(unit, direction), Fraction(0))
        return ceil(_bytes(tables.platform, rate_of(tables, bound)) / line)

    other, ratio = (WRITE, "write-refills") if direction == READ else (READ, "write-backs")
    share = _ratio(tables.platform, ratio)
    units = [cores.get(core, "") for core in range(_count(tables))]
    return [max(1, lines(unit, direction) + ceil(share * lines(unit, other))) for unit in units]


def _ratio(platform: Platform, name: str) -> Fraction:
    return parse_rational(platform.settings[MemGuard.name][name])


def _defaults(tables: Tables) -> dict[str, list[int]]:
    """Return the events per period before the first table; both directions leave room for what they bring."""
    p, cores = tables.platform, _cores(tables)
    backs, refills = _ratio(p, "write-backs"), _ratio(p, "write-refills")
    budgets = {unit.name: unit.default for unit in tables.units}
    lines = int(_bytes(p, limit_of(tables)) / _line(p)) - 2 * _count(tables)  # beside the one that every core has
    found: dict[str, list[int]] = {d: [] for d in DIRECTIONS}
    for core in range(_count(tables)):
        budget = budgets.get(cores.get(core, ""), dict.fromkeys(DIRECTIONS, 0))
        share = {d: Fraction(max(0, lines) * budget[d], p.window_capacity) for d in DIRECTIONS}
        read, write = int(share[READ] / (1 + backs)), int(share[WRITE] / (1 + refills))
        found[READ].append(1 + read + int(refills * write))
        found[WRITE].append(1 + write + int(backs * read))
    return found


Limits = dict[tuple[str, int], int]
"""Events per period by direction and core."""


def _settings(tables: Tables, table: Table, granularity: str = "") -> list[tuple[int, Limits]]:
    """Return what is set from which nanosecond of a table on: once, or (granularity: phase) as bounds change.

    What is written holds from the next end of a period on, which comes at any time within a period, and until that of
    the next setting. So a setting has the largest bounds from its instant to a period after the next one.
    """

    def all_of(highest: Mapping[Row, Fraction]) -> Limits:
        return {(d, core): n for d in DIRECTIONS for core, n in enumerate(_events(tables, highest, d))}

    if (granularity or tables.platform.settings[MemGuard.name]["granularity"]) != "phase":
        return [(0, all_of(peaks(table.frame)))]
    period, span = _period(tables.platform) * 1000, tables.grid.ns(table.frame.span)
    stretches = [(tables.grid.ns(segment.begin), segment.bounds) for segment in segments(table.frame)]
    found: list[tuple[int, Limits]] = []
    for begin in range(0, ceil(span), period):
        end = min(Fraction(begin + period), span) + period
        turns = ceil(end / span) if table.successor == table.index else 1
        highest: dict[Row, Fraction] = {}
        for turn in range(turns):
            ends = [*(start for start, _ in stretches[1:]), span]
            for (start, bounds), stop in zip(stretches, ends, strict=True):
                if start + turn * span < end and stop + turn * span > begin:
                    highest |= {row: max(bound, highest.get(row, Fraction(0))) for row, bound in bounds.items()}
        limits = all_of(highest)
        if not found or found[-1][1] != limits:
            found.append((begin, limits))
    return found


def _blocks(tables: Tables, table: Table) -> Iterator[tuple[int, list[tuple[str, list[int]]]]]:
    """Yield each setting with the limits to write: those that fall, of reads and writes, before those that rise."""

    def lines(limits: Limits) -> list[tuple[str, list[int]]]:
        return [(d, [limits[d, core] for core in range(_count(tables))]) for d in DIRECTIONS]

    before = [_settings(tables, t)[-1][1] for t in predecessors(tables, table)]
    for instant, new in _settings(tables, table):
        floors = {key: min([value, *(setting[key] for setting in before)]) for key, value in new.items()}
        falls = lines(floors)
        rises = [line for line in lines(new) if line not in falls]
        if instant:  # what is in force is known, and only what changes is written
            falls = [line for line in falls if line not in lines(before[0])]
        yield instant, [*falls, *rises]
        before = [new]


# ------------------------------------------------------------------------------------------------- checks


def _check_cores(tables: Tables) -> Iterator[Diagnostic]:
    ports = [tables.platform.units[unit.name] for unit in tables.units]
    for port in ports:
        if port.core is None:
            help = 'state "core: N", the number of the core as the system counts them'
            message = "is no core: it has no number for MemGuard"
            yield NO_MANAGER(message, at=port.at, path=about(unit=port.unit), help=help)
    known = _cores(tables)
    stated = int(tables.platform.settings[MemGuard.name]["cores"])
    owned = ((port.unit, port.core, port.at) for port in ports if port.core is not None)
    last = max(known, default=0)
    yield from check_owners(owned, "core", lambda _: range(stated or len(ports) + last))
    if stated and last >= stated:
        message = f"core {last} does not exist; the platform has {stated} cores"
        help = f'use 0 to {stated - 1}, or state "memguard: {{cores: {last + 1}}}"'
        yield NO_MANAGER(message, at=tables.platform.at, path=about(unit=known[last]), help=help)
    gaps = sorted(set(range(last)) - set(known))
    if gaps and not stated:
        message = f"cores {', '.join(map(str, gaps))} belong to no unit, and MemGuard wants a limit for every core"
        help = f'state "memguard: {{cores: {last + 1}}}" if they run nothing that counts: they get the lowest limit'
        yield NO_MANAGER(message, at=tables.platform.at, path="platform units", help=help)


def _check_period(platform: Platform) -> Iterator[Diagnostic]:
    stated = platform.settings[MemGuard.name]["period"]
    period = Fraction(int(stated)) if stated else platform.window.in_unit("us")
    path = "platform memguard" if stated else "platform window"
    if period.denominator == 1 and period % ZERO_DIVISOR == 0:
        message = f"with a period of {period}us the module divides by zero when its limits are read"
        help = f'state "memguard: {{period: {period - 1}us}}"; a period need not be the window'
        yield RATE_DOES_NOT_FIT(message, at=platform.at, path=path, help=help)
        return
    if period.denominator != 1 or not LEAST_PERIOD <= period <= MOST_PERIOD:
        what = f"{stated}us are" if stated else f"the window of {platform.window} is"
        message = f"{what} no period for MemGuard, which counts in whole microseconds, from {LEAST_PERIOD} on"
        near = min(MOST_PERIOD, max(LEAST_PERIOD, ceil(period)))
        help = f'state "memguard: {{period: {near}us}}"; a period need not be the window'
        yield RATE_DOES_NOT_FIT(message, at=platform.at, path=path, help=help)


def _check_limits(tables: Tables, table: Table) -> Iterator[Diagnostic]:
    """Yield limits that do not go into a line, and settings that may be in force together above the capacity."""
    p, cores, line = tables.platform, _cores(tables), _line(tables.platform)
    settings = [limits for _, limits in _settings(tables, table)]
    for d in DIRECTIONS:
        events = [max(limits[d, core] for limits in settings) for core in range(_count(tables))]
        text = " ".join(map(str, events))
        if len(text) > LONGEST_LINE or max(events) >= 2**31:
            message = f"the limits of {len(events)} cores are {len(text)} characters, up to {max(events)}; the module "
            message += f"takes {LONGEST_LINE}, and numbers below 2^31"
            help = "use a shorter period, or leave cores out of the system"
            yield RATE_DOES_NOT_FIT(message, at=table.frame.at, path=table.frame.path, help=help)
    highest = peaks(table.frame)

    def rates(limits: Limits) -> dict[str, Fraction]:
        return {
            f"{cores.get(core, f'core {core}')} {d}": Fraction(n * line * 10**6, _period(p))
            for (d, core), n in limits.items()
        }

    given = _worst(table, settings)
    promised: Mapping[str, Fraction] = dict.fromkeys(rates(given), Fraction(0)) | {
        f"{row.unit} {row.direction}": rate_of(tables, bound) for row, bound in highest.items()
    }
    if sum(rates(given).values()) <= limit_of(tables):
        return
    stated, others = p.settings[MemGuard.name], ["use the back-end table or axi-realm"]
    for name, text in (("write-refills", "refilled per line written"), ("write-backs", "written per line read")):
        if _ratio(p, name):
            others.insert(0, f'state "memguard: {{{name}: ...}}", measured, which is {stated[name]} lines {text}')
    by_phase = _worst(table, [limits for _, limits in _settings(tables, table, "phase")])
    if stated["granularity"] != "phase" and sum(rates(by_phase).values()) <= limit_of(tables):
        others.insert(0, 'set "memguard: {granularity: phase}"')
    yield from over_limit(tables, table, rates(given), promised, ", or ".join(others))


def _worst(table: Table, settings: list[Limits]) -> Limits:
    """Return the limits that take most while one setting follows the other: a core may have that of either."""
    first = settings[-1] if table.successor == table.index else settings[0]
    pairs = zip(settings, [first, *settings], strict=False)
    return max(({k: max(n, b[k]) for k, n in a.items()} for a, b in pairs), key=lambda limits: sum(limits.values()))


WRITER = MemGuard()
