"""Rates of a table for back-ends that hold one rate per unit for a whole mode or phase."""

from __future__ import annotations

from collections import defaultdict
from fractions import Fraction
from math import ceil
from typing import TYPE_CHECKING, TypeVar

from halpipe.core.diagnostics import Diagnostic, Location, about
from halpipe.core.grouping import grouped
from halpipe.core.quantities import format_bandwidth, format_rational
from halpipe.core.records import record
from halpipe.exporters.regulator.codes import COARSE_RATE, RATE_DOES_NOT_FIT, SHARED_MANAGER
from halpipe.exporters.regulator.platform import free_help
from halpipe.exporters.regulator.rounding import pieces

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from halpipe.exporters.regulator.frames import Frame, Row
    from halpipe.exporters.regulator.tables import Table, Tables


T = TypeVar("T", int, str)


@record
class Segment:
    """A stretch of a table, from `begin` ticks on, in which the bounds in force do not change; rows with a bound."""

    begin: int
    bounds: dict[Row, Fraction]


def segments(frame: Frame) -> list[Segment]:
    """Return the table as stretches of constant bounds."""
    changes: dict[int, dict[Row, Fraction]] = defaultdict(lambda: defaultdict(Fraction))
    changes[0] = defaultdict(Fraction)
    for phase in frame.phases:
        for begin, end in pieces(frame, phase):
            changes[begin][phase.row] += phase.bound
            changes[end][phase.row] -= phase.bound
    found: list[Segment] = []
    bounds: dict[Row, Fraction] = {}
    for instant in sorted(changes):
        if instant >= frame.span:
            break
        for row, change in changes[instant].items():
            bounds[row] = bounds.get(row, Fraction(0)) + change
        now = {row: bound for row, bound in sorted(bounds.items()) if bound}
        if not found or found[-1].bounds != now:
            found.append(Segment(instant, now))
    return found


def peaks(frame: Frame) -> dict[Row, Fraction]:
    """Return the largest bound of every row that has any, over the whole table."""
    bounds = grouped(bound for segment in segments(frame) for bound in segment.bounds.items())
    return {row: max(bounds[row]) for row in sorted(bounds)}


def limit_of(tables: Tables) -> Fraction:
    """Return the bytes per second that all units may have together: the capacity less what is kept for overshoot."""
    p = tables.platform
    return p.capacity - tables.reserve / p.window.in_unit("s")


def over_limit(
    tables: Tables,
    table: Table,
    given: Mapping[str, Fraction],
    promised: Mapping[str, Fraction],
    other: str,
    *,
    most: int | None = None,
) -> list[Diagnostic]:
    """Return a finding if the rates `given`, by owner, exceed the capacity together; `other` names a remedy.

    The capacity proposed is at most `most`, the peak of a device whose steps are parts of it (None: the bus decides).
    """
    limit, total = limit_of(tables), sum(given.values(), Fraction(0))
    if total <= limit:
        return []
    each = ", ".join(f"{name} {rate_text(rate)} for {rate_text(promised[name])}" for name, rate in given.items())
    message = (
        f"one rate per unit for the whole {table.frame.kind} comes to {rate_text(total)}, there is room for "
        f"{rate_text(limit)}: the least that can be set for what is promised is {each}"
    )
    capacity = tables.platform.capacity + ceil(total - limit)
    carried = tables.platform.bus * tables.platform.clock
    is_possible = capacity <= (carried if most is None else min(most, carried))
    help = f'state "capacity: {format_bandwidth(capacity)}" if memory serves it, or {other}' if is_possible else other
    return [RATE_DOES_NOT_FIT(message, at=table.frame.at, path=table.frame.path, help=help)]


def coarse(table: Table, unit: str, given: Fraction, promised: Fraction) -> list[Diagnostic]:
    """Return a finding if a unit is given more than it was promised, by a quarter or more."""
    if not promised or given * 4 < promised * 5:
        return []
    message = f"{rate_text(given)} is the least that can be set for the {rate_text(promised)} promised"
    help = "choose bounds on the steps of the regulator, or regulate this unit by another back-end"
    return [COARSE_RATE(message, at=table.frame.at, path=about(table.frame.path, unit=unit), help=help)]


def unit_rates(tables: Tables, table: Table) -> dict[str, Fraction]:
    """Return the bytes per second promised to every unit at its most, reads and writes together."""
    highest = dict.fromkeys((unit.name for unit in tables.units), Fraction(0))
    for segment in segments(table.frame):
        bounds: dict[str, Fraction] = defaultdict(Fraction)
        for row, bound in segment.bounds.items():
            bounds[row.unit] += bound
        highest |= {unit: max(bound, highest[unit]) for unit, bound in bounds.items()}
    return {unit: rate_of(tables, bound) for unit, bound in highest.items()}


def rate_of(tables: Tables, bound: Fraction) -> Fraction:
    """Return the bytes per second that a bound promises."""
    return bound * tables.platform.guaranteed


def rate_text(rate: Fraction) -> str:
    """Return whole bytes per second for people, always in megabytes, so that two can be compared."""
    return format_rational(Fraction(int(rate), 10**6)) + "MB/s"


def check_owners(
    owners: Iterable[tuple[str, T, Location]], what: str, choices: Callable[[T], Iterable[T]]
) -> Iterator[Diagnostic]:
    """Yield a finding for each of `owners` (unit, what it owns, place) whose property another unit has already."""
    owners = list(owners)
    taken = {owned for _, owned, _ in owners}
    first: dict[T, str] = {}
    for unit, owned, at in owners:
        if first.setdefault(owned, unit) != unit:
            message = f'{what} {owned} is the one of unit "{first[owned]}", too; what is written last holds for both'
            help = free_help(what, taken, choices(owned))
            yield SHARED_MANAGER(message, at=at, path=about(unit=unit), help=help)
