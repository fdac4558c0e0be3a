"""What back-ends need that hold one rate per unit for a whole mode or phase: the rates that a table asks for."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.exporters.regulator.codes import RATE_DOES_NOT_FIT
from halpipe.exporters.regulator.rounding import pieces
from halpipe.quantities import format_rational

if TYPE_CHECKING:
    from halpipe.diagnostics import Diagnostic
    from halpipe.exporters.regulator.frames import Frame, Row
    from halpipe.exporters.regulator.tables import Tables


@dataclass(frozen=True, slots=True)
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
    highest: dict[Row, Fraction] = {}
    for segment in segments(frame):
        for row, bound in segment.bounds.items():
            highest[row] = max(bound, highest.get(row, Fraction(0)))
    return dict(sorted(highest.items()))


def check_peaks(tables: Tables, other: str) -> list[Diagnostic]:
    """Return a finding for every table whose peak rates exceed the capacity together; `other` says what to do."""
    p = tables.platform
    limit = Fraction(p.capacity * p.cycles - tables.reserve * p.clock, p.guaranteed * p.cycles)
    found = []
    for table in tables.tables:
        highest = peaks(table.frame)
        total = sum(highest.values(), Fraction(0))
        if total > limit:
            each = ", ".join(f"{row.unit} {row.direction} {format_rational(b)}" for row, b in highest.items())
            message = (
                f"the largest bounds of the units sum to {format_rational(total)} ({each}), at most "
                f"{format_rational(limit)} fits: one rate for the whole {table.frame.kind} cannot keep to the capacity"
            )
            found.append(RATE_DOES_NOT_FIT(message, at=table.frame.at, path=table.frame.path, help=other))
    return found


def rate_of(tables: Tables, bound: Fraction) -> Fraction:
    """Return the bytes per second that a bound promises."""
    return bound * tables.platform.guaranteed
