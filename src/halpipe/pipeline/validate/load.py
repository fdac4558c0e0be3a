"""Checks of the load of a mode, and of sporadic work: interrupts and polled arrivals (MODEL 8.1)."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

from halpipe.core.diagnostics import Diagnostic, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.quantities import format_rational
from halpipe.core.suggest import few
from halpipe.pipeline.parts import Service, reserved_length
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import check, place, task_path, version_path

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from halpipe.models import Task, Unit, Version
    from halpipe.pipeline.validate.context import ActiveMode, ActiveTask, Context

_MAX_CLASSES = 200
"""Distinct unit sets of a mode up to which those contained in each other are added up."""

_HELP = "shorten or thin out these tasks, give them cheaper versions, or let some of them run in another mode"


class Need(NamedTuple):
    """Least demand of a task in a hyperperiod, in nanoseconds, and its number of jobs."""

    task: str
    amount: int | Fraction
    jobs: int


# ------------------------------------------------------------------------------------------------ units


@check("unit-load", codes.UNITS_OVERLOADED)
def check_units(context: Context) -> Iterator[Diagnostic]:
    """In every mode, the tasks that can run only on a set of units need, in their shortest versions, no more time than
    those units have in a hyperperiod.
    """
    for over in overloads(context):
        yield _units_overloaded(over)


class Overload(NamedTuple):
    """A set of units on which the tasks of a mode need more than there is; `taken` is the share of interrupts."""

    mode: ActiveMode
    hyperperiod: Duration
    units: frozenset[str]
    needs: list[Need]
    total: Duration
    taken: Fraction


def overloads(context: Context) -> Iterator[Overload]:
    """Yield the overloaded sets of units: of those that contain each other the smallest.

    The sets tried are the unit sets of the tasks, and all units.
    """
    loads = {name: min(Fraction(1), load_of(unit)) for name, unit in context.units.items() if unit.interrupts}
    for mode in context.active:
        if mode.hyperperiod is None:
            continue
        classes = _unit_classes(context, mode)
        everything = frozenset(context.units)
        overloaded: list[frozenset[str]] = []
        for units in sorted({*classes, everything}, key=lambda s: (len(s), sorted(s))):
            if any(smaller <= units for smaller in overloaded):
                continue
            needs = _needs_within(classes, units, units == everything)
            total = Duration(sum(need.amount for need in needs))
            taken = sum((loads[unit] for unit in units & loads.keys()), Fraction(0))
            if total > mode.hyperperiod * (len(units) - taken):
                overloaded.append(units)
                yield Overload(mode, mode.hyperperiod, units, needs, total, taken)


def _unit_classes(context: Context, mode: ActiveMode) -> dict[frozenset[str], list[Need]]:
    """Group the tasks of a mode by the units that any of their versions may use."""
    jobs = mode.least_jobs
    classes: dict[frozenset[str], list[Need]] = {}
    for name, active in mode.tasks.items():
        units = frozenset().union(*(version.units for version in active.versions))
        if units and units <= context.units.keys():
            classes.setdefault(units, []).append(Need(name, jobs[name] * _shortest(active), jobs[name]))
    return classes


def _shortest(active: ActiveTask) -> int | Fraction:
    """Return the least unit time of one job: gang times WCET."""
    return min(max(version.gang, 0) * (version.wcet.ns if version.wcet else 0) for version in active.versions)


def _needs_within(
    classes: Mapping[frozenset[str], list[Need]], units: frozenset[str], is_everything: bool
) -> list[Need]:
    if len(classes) > _MAX_CLASSES and not is_everything:
        return classes[units]
    return [need for within, needs in classes.items() if within <= units for need in needs]


def _units_overloaded(over: Overload) -> Diagnostic:
    room = over.hyperperiod * (len(over.units) - over.taken)
    text = f"in each hyperperiod of {over.hyperperiod}, the tasks that can run only on {few(sorted(over.units))} need "
    text += f"{over.total}, "
    interrupts = f" beside {over.hyperperiod * over.taken} of interrupts" if over.taken else ""
    text += f"{over.total - room} more than the {room} there are{interrupts}; the largest: {_largest(over.needs)}"
    return codes.UNITS_OVERLOADED(text, at=place(over.mode.mode), path=over.mode.path, help=f"{_HELP}, or add units")


def _largest(needs: list[Need]) -> str:
    ordered = sorted((need for need in needs if need.amount > 0), key=lambda need: (-need.amount, need.task))
    return ", ".join(f'"{need.task}" {Duration(need.amount)}' for need in ordered[:3])


# ------------------------------------------------------------------------------------------------ resources


@check("resource-load", codes.RESOURCE_OVERLOADED)
def check_resources(context: Context) -> Iterator[Diagnostic]:
    """In every mode, the access phases of the least demanding versions need no more of a resource than there is."""
    for mode in context.active:
        if mode.hyperperiod is None:
            continue
        jobs = mode.least_jobs
        totals: dict[str, dict[int, int | Fraction]] = {}
        for name, active in mode.tasks.items():
            for resource, (amount, parts) in _least_access(active).items():
                total = totals.setdefault(resource, {})
                total[parts] = total.get(parts, 0) + jobs[name] * amount
        for resource in sorted(totals.keys() & context.resources.keys()):
            total_need = Duration(sum((Fraction(n) / d for d, n in totals[resource].items()), Fraction(0)))
            if total_need > mode.hyperperiod:
                yield _resource_overloaded(mode, mode.hyperperiod, resource, jobs, total_need)


def _least_access(active: ActiveTask) -> dict[str, tuple[int | Fraction, int]]:
    """Return what one job takes at least of each resource, as nanoseconds in parts of the whole."""
    first, *others = (_access(version) for version in active.versions)
    for other in others:
        for resource in list(first):
            if resource not in other:
                del first[resource]
            elif other[resource][0] * first[resource][1] < first[resource][0] * other[resource][1]:
                first[resource] = other[resource]
    return first


def _access(version: Version) -> dict[str, tuple[int | Fraction, int]]:
    """Sum bound times length over the phases of a version, by resource, as nanoseconds and denominator."""
    sums: dict[str, tuple[int | Fraction, int]] = {}
    for access in version.accesses:
        length, (bound, part) = access.end.ns - access.start.ns, access.bound.as_integer_ratio()
        if length > 0 and bound > 0:
            amount, parts = sums.get(access.resource, (0, part))
            if part == parts:
                sums[access.resource] = (amount + length * bound, parts)
            else:
                sums[access.resource] = (amount * part + length * bound * parts, parts * part)
    return sums


def _resource_overloaded(
    mode: ActiveMode, hyperperiod: Duration, resource: str, jobs: Mapping[str, int], total: Duration
) -> Diagnostic:
    needs = [
        Need(name, jobs[name] * Fraction(*least), jobs[name])
        for name, active in mode.tasks.items()
        if (least := _least_access(active).get(resource))
    ]
    text = f'in each hyperperiod of {hyperperiod}, the access phases need the whole of resource "{resource}" for '
    text += f"{total}; the largest: {_largest(needs)}"
    help = f"{_HELP}, or lower the bounds"
    return codes.RESOURCE_OVERLOADED(text, at=place(mode.mode), path=mode.path, help=help)


# ------------------------------------------------------------------------------------------------ interrupts


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
    lengths = [length for name in version.units if (length := _length(units[name], version.wcet)) is not None]
    return min(lengths, default=version.wcet)


def _length(unit: Unit, work: Duration) -> Duration | None:
    """Return how long some work takes beside the interrupts of a unit; None where they leave nothing."""
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


@check("interrupts", codes.ZERO_DISTANCE, codes.INTERRUPT_TOO_LONG, codes.INTERRUPTS_FILL)
def check_interrupts(context: Context) -> Iterator[Diagnostic]:
    """Interrupts have a positive distance, take no longer than it, and together less than the time of their unit."""
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
            help = f"shorten or thin out {few(i.name for i in unit.interrupts)}: jobs need a share of the unit as well"
            yield codes.INTERRUPTS_FILL(text, at=place(unit), path=path, help=help)


@check("interrupts-of-gangs", codes.INTERRUPTS_FILL)
def check_gangs(context: Context) -> Iterator[Diagnostic]:
    """The interrupts of all units of a gang take less than the time together."""
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


@check("arrivals", codes.ZERO_DISTANCE, codes.POLLED_TOO_RARELY, codes.ARRIVAL_TOO_LATE)
def check_arrivals(context: Context) -> Iterator[Diagnostic]:
    """A task that serves arrivals polls at least as often as they may come, and period and WCET together are within
    its deadline.
    """
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
