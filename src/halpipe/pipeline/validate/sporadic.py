"""Checks of work that comes when it likes: interrupts of units, and arrivals that a task polls for (MODEL 8.1)."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.quantities import format_rational
from halpipe.pipeline.parts import reserved_length
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import Check, place, quoted, task_path, version_path

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Task, Unit, Version
    from halpipe.pipeline.parts import Service
    from halpipe.pipeline.validate.context import Context


def load_of(unit: Unit) -> Fraction:
    """Return the share of a unit that its interrupts take at most; those without a meaning are left out."""
    shares = (Fraction(i.wcet.ns) / Fraction(i.distance.ns) for i in unit.interrupts if i.distance > ZERO)
    return sum(shares, Fraction(0))


def least_length(units: Mapping[str, Unit], version: Version) -> Duration | None:
    """Return the shortest time that a job of the version takes on any of its units; None without a WCET.

    A lower bound for gangs, whose members also wait for each other. Units that are filled by interrupts do not count.
    """
    if version.wcet is None:
        return None
    if any(name not in units or not units[name].interrupts for name in version.units):
        return version.wcet  # no unit is quicker
    lengths = [length for name in version.units if (length := _length(units.get(name), version.wcet)) is not None]
    return min(lengths, default=version.wcet)


def _length(unit: Unit | None, work: Duration) -> Duration | None:
    if unit is None or not unit.interrupts:
        return work
    service = tuple((i.distance, i.wcet) for i in unit.interrupts if i.distance > ZERO and i.wcet > ZERO)
    return None if _is_full(service) else _reserved(work, service)


@lru_cache(maxsize=4096)
def _is_full(service: Service[Duration]) -> bool:
    """Tell whether interrupts leave nothing; known once, since it takes long to see that they leave next to nothing."""
    return _reserved(Duration(1), service) is None


def _reserved(work: Duration, service: Service[Duration]) -> Duration | None:
    try:
        return reserved_length(work, service)
    except ValueError:
        return None


def check_interrupts(context: Context) -> Iterator[Diagnostic]:
    """Interrupts keep a distance, are shorter than it, and leave time for the jobs of their units."""
    for unit in context.model.units:
        path = about(unit=unit.name)
        for interrupt in unit.interrupts:
            at, inner = place(interrupt, unit), about(path, interrupt=interrupt.name)
            if interrupt.distance == ZERO:
                help = "state the least time between two of them"
                yield codes.ZERO_DISTANCE("has the distance zero", at=at, path=inner, help=help)
            elif interrupt.wcet > interrupt.distance:
                text = f"takes {interrupt.wcet}, but may come every {interrupt.distance}"
                help = "shorten its wcet, or lengthen its distance"
                yield codes.INTERRUPT_TOO_LONG(text, at=at, path=inner, help=help)
        if unit.interrupts and _length(unit, Duration(1)) is None:
            text = f"its interrupts take {format_rational(load_of(unit))} of its time"
            help = (
                f"shorten or thin out {quoted(i.name for i in unit.interrupts)}: jobs need a share of the unit as well"
            )
            yield codes.INTERRUPTS_FILL(text, at=place(unit), path=path, help=help)


def check_gangs(context: Context) -> Iterator[Diagnostic]:
    """The interrupts of the units of a gang, which all its members wait for, leave time for it."""
    loads = {name: load_of(unit) for name, unit in context.units.items() if unit.interrupts}
    for task, version in context.versions_of_tasks:
        if version.gang < 2 or not loads:
            continue
        shares = sorted(loads.get(name, Fraction(0)) for name in set(version.units))[: version.gang]
        taken = sum(shares, Fraction(0))
        if taken >= 1 and max(shares) < 1:
            text = (
                f"occupies {version.gang} units, whose interrupts together take {format_rational(taken)} of the time; "
            )
            text += "its members wait for each other"
            help = "shorten or thin out interrupts of its units, or give it other units"
            at, path = place(version, task), version_path(task, version)
            yield codes.INTERRUPTS_FILL(text, at=at, path=path, help=help)


# ------------------------------------------------------------------------------------------------ arrivals


def check_arrivals(context: Context) -> Iterator[Diagnostic]:
    """A task that serves arrivals polls at least as often as they come, and often enough for its deadline."""
    for task in context.model.tasks:
        distance, period = task.distance, task.period
        if distance is None:
            continue
        at, path = place(task), task_path(task)
        if distance == ZERO:
            help = "state the least time between two arrivals"
            yield codes.ZERO_DISTANCE("has the distance zero", at=at, path=path, help=help)
        elif period is not None and period > distance:
            text = f"polls every {period}, but arrivals may be {distance} apart"
            help = f"shorten the period to at most {distance}"
            yield codes.POLLED_TOO_RARELY(text, at=at, path=path, help=help)
        elif period is not None and period > ZERO:
            yield from _too_late(context, task, period, distance)


def _too_late(context: Context, task: Task, period: Duration, distance: Duration) -> Iterator[Diagnostic]:
    """Starts are a period apart on average, so some arrival waits for a period and then for the whole job."""
    deadline = distance if task.deadline is None else task.deadline
    lengths = [length for v in task.versions if (length := least_length(context.units, v)) is not None]
    if not lengths or period + min(lengths) <= deadline:
        return
    text = f"polls every {period} and needs {min(lengths)}, so an arrival may wait for {period + min(lengths)}; its "
    text += f"deadline is {deadline}" + (" (its distance)" if task.deadline is None else "")
    room = deadline - min(lengths)
    help = (
        f"poll every {room} at most, or raise the deadline"
        if room > ZERO
        else "shorten the WCET, or raise the deadline"
    )
    yield codes.ARRIVAL_TOO_LATE(text, at=place(task), path=task_path(task), help=help)


CHECKS = (
    Check(
        "interrupts",
        "Interrupts have a positive distance, take no longer than it, and together less than the time of their unit.",
        (codes.ZERO_DISTANCE, codes.INTERRUPT_TOO_LONG, codes.INTERRUPTS_FILL),
        check_interrupts,
    ),
    Check(
        "interrupts-of-gangs",
        "The interrupts of all units of a gang take less than the time together.",
        (codes.INTERRUPTS_FILL,),
        check_gangs,
    ),
    Check(
        "arrivals",
        "A task that serves arrivals polls at least as often as they may come, and period and WCET together are within "
        "its deadline.",
        (codes.ZERO_DISTANCE, codes.POLLED_TOO_RARELY, codes.ARRIVAL_TOO_LATE),
        check_arrivals,
    ),
)
