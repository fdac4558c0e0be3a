"""Accuracy of the tables: for every access phase the promised amount, the granted amount, and the lag."""

from __future__ import annotations

from fractions import Fraction
from itertools import accumulate
from math import ceil
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.core.quantities import format_rational
from halpipe.core.records import record
from halpipe.exporters.regulator.codes import BELOW_BURST, OFF_GRID, SHORT_PHASE
from halpipe.exporters.regulator.words import CONTROLLED, WHOLE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.exporters.regulator.frames import Phase
    from halpipe.exporters.regulator.tables import Table, Tables
    from halpipe.models import TaskModel


@record
class Served:
    """A phase with what it was promised and granted, in bytes, when it ends.

    Where each window is rounded up, the windows that a phase touches count in full. `lag` is how far its row is behind
    the promise then, `wait` how long the phase's own bandwidth needs for that, in nanoseconds.
    """

    phase: Phase
    promised: Fraction
    granted: Fraction
    lag: Fraction
    wait: Fraction


def served(tables: Tables, table: Table) -> Iterator[Served]:
    """Yield every phase that ends within a table, or on its circle."""
    p, window, frame = tables.platform, tables.grid.window, table.frame
    per_ns = Fraction(p.guaranteed, 10**9)
    given = {row: [0, *accumulate(bursts)] for row, bursts in table.bursts.items()}
    for phase in frame.phases:
        if phase.end > frame.span and table.successor != table.index:
            continue  # it ends in the table of the mode after
        end = phase.end if phase.end <= frame.span else phase.end - frame.span
        rate = phase.bound * per_ns
        promised = rate * tables.grid.ns(phase.end - phase.begin)
        k = -(-end // window)
        if table.rounding == WHOLE:
            begin = phase.begin if phase.begin < frame.span else phase.begin - frame.span
            windows = given[phase.row][k] - given[phase.row][max(begin, 0) // window]
            if begin + phase.end - phase.begin > frame.span:  # it began at the end of the circle
                windows += given[phase.row][-1]
            yield Served(phase, promised, Fraction(windows * p.burst), ZERO, ZERO)
            continue
        behind = table.promised[phase.row].at(k) - given[phase.row][k]
        lag = max(ZERO, min(behind * p.burst, promised))
        yield Served(phase, promised, promised - lag, lag, lag / rate)


ZERO = Fraction(0)


def check_phases(model: TaskModel, tables: Tables) -> list[Diagnostic]:
    """Return what is odd about the phases: below a burst, off the grid, too short for their transfers."""
    return [*_below_burst(model, tables), *_off_grid(model, tables), *_short(model, tables)]


def _below_burst(model: TaskModel, tables: Tables) -> Iterator[Diagnostic]:
    """Report the bounds that give less than one burst per window, where bursts are rationed."""
    p, seen = tables.platform, set()
    for table in tables.tables:
        for phase in table.frame.phases if table.rounding == CONTROLLED else ():
            per_window = phase.bound * tables.bursts
            if per_window >= 1 or phase.access in seen:
                continue
            seen.add(phase.access)
            least = phase.access.bound / per_window
            cycles = ceil(p.cycles / per_window)
            message = (
                f"bound {format_rational(phase.access.bound)} is {_three(per_window)} bursts of {p.burst} bytes per "
                f'window for unit "{phase.row.unit}": one burst every {ceil(1 / per_window)} windows'
            )
            named = f"a bound of at least {format_rational(least)}, or " if least <= 1 else ""
            help = f"use {named}a window of at least {cycles} cycles"
            path = about(task=phase.job.task, version=phase.job.version)
            yield BELOW_BURST(message, at=phase.access.at, path=path, help=help)


def _off_grid(model: TaskModel, tables: Tables) -> Iterator[Diagnostic]:
    """Report, once, how many phases begin or end inside a window, and the task with the widest of them."""
    window, p = tables.grid.window, tables.platform
    phases = [phase for table in tables.tables for phase in table.frame.phases]
    off = [phase for phase in phases if phase.begin % window or phase.end % window]
    if off:
        widest = max(off, key=lambda phase: phase.bound)
        task = model.task(widest.job.task)
        message = (
            f"up to {int(widest.bound * p.promise)} bytes can be used outside its phase, which begins or ends inside a "
            f"window of {p.window}; so do {len(off)} of {len(phases)} phases, of {len({f.job.task for f in off})} tasks"
        )
        help = "state starts and ends of phases in multiples of the window; --quantise sees to the starts of jobs"
        yield OFF_GRID(message, at=task.at, path=about(task=task.name), help=help)


def _short(model: TaskModel, tables: Tables) -> Iterator[Diagnostic]:
    """Report the access phases that are promised less than their transfers need."""
    rate = Fraction(tables.platform.guaranteed, 10**9)
    for task in model.tasks:
        for version in task.versions:
            for access in version.accesses:
                needed = sum(transfer.size for transfer in access.transfers)
                promised = access.bound * rate * (access.end - access.start).fraction
                if access.resource != tables.resource or promised >= needed:
                    continue
                longer = needed / (access.bound * rate)
                message = f"{int(promised)} bytes are promised, its transfers need {needed}"
                bound = access.bound * needed / promised
                help = f"let it last at least {ceil(longer)}ns" + (
                    f", or bind it to {_up(bound)}" if bound <= 1 else ""
                )
                path = about(task=task.name, version=version.name)
                yield SHORT_PHASE(message, at=access.at, path=path, help=help)


def _up(value: Fraction) -> str:
    """Return a number rounded up to three decimals."""
    return format_rational(Fraction(ceil(value * 1000), 1000))


def _three(value: Fraction) -> str:
    return format_rational(Fraction(int(value * 1000), 1000))
