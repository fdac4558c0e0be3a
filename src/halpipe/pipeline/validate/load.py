"""Checks of the load of a whole mode: what no schedule can hold, whatever the placement."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING, NamedTuple

from halpipe.core.diagnostics import Severity, about
from halpipe.core.durations import Duration
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import Check, place, quoted
from halpipe.pipeline.validate.sporadic import least_length, load_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Version
    from halpipe.pipeline.validate.context import ActiveMode, ActiveTask, Context

_MAX_CLASSES = 200
"""Distinct unit sets of a mode up to which those contained in each other are added up."""

_HELP = "shorten or thin out these tasks, give them cheaper versions, or let some of them run in another mode"


class Need(NamedTuple):
    """What a task takes at least in a hyperperiod, in nanoseconds, and how many jobs it has."""

    task: str
    amount: int | Fraction
    jobs: int


# ------------------------------------------------------------------------------------------------ units


def check_units(context: Context) -> Iterator[Diagnostic]:
    """The tasks that can run only on a set of units need no more time than those units have."""
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
    text = (
        f"in each hyperperiod of {over.hyperperiod}, the tasks that can run only on {quoted(sorted(over.units))} need "
    )
    text += f"{over.total}, "
    interrupts = f" beside {over.hyperperiod * over.taken} of interrupts" if over.taken else ""
    text += f"{over.total - room} more than the {room} there are{interrupts}; the largest: {_largest(over.needs)}"
    return codes.UNITS_OVERLOADED(text, at=place(over.mode.mode), path=over.mode.path, help=f"{_HELP}, or add units")


def _largest(needs: list[Need]) -> str:
    ordered = sorted((need for need in needs if need.amount > 0), key=lambda need: (-need.amount, need.task))
    return ", ".join(f'"{need.task}" {Duration(need.amount)}' for need in ordered[:3])


# ------------------------------------------------------------------------------------------------ resources


def check_resources(context: Context) -> Iterator[Diagnostic]:
    """The access phases of the least demanding versions need no more of a resource than there is."""
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


# ------------------------------------------------------------------------------------------------ single jobs


def check_length(context: Context) -> Iterator[Diagnostic]:
    """No job is longer than the hyperperiod. A task that has a shorter version too can still be scheduled."""
    for mode in context.active:
        hyperperiod = mode.hyperperiod
        if hyperperiod is None:
            continue
        for active in mode.tasks.values():
            lengths = {v.name: least_length(context.units, v) for v in active.versions}
            long = [v for v in active.versions if _is_beyond(lengths[v.name], hyperperiod) and not _is_late(active, v)]
            severity = None if len(long) == len(active.versions) else Severity.WARNING
            for version in long:
                text = f'version "{version.name}" needs {lengths[version.name]}, longer than the hyperperiod of '
                text += str(hyperperiod)
                at = place(version, active.task)
                path = about(mode.path, task=active.task.name)
                help = "shorten the WCET, or lengthen a period of the mode"
                yield codes.WCET_BEYOND_HYPERPERIOD(text, at=at, path=path, help=help, severity=severity)


def _is_beyond(length: Duration | None, hyperperiod: Duration) -> bool:
    return length is not None and length > hyperperiod


def _is_late(active: ActiveTask, version: Version) -> bool:
    """Tell whether the version is beyond its task's deadline, which is reported as such."""
    deadline = active.task.deadline or active.task.period
    return deadline is not None and version.wcet is not None and version.wcet > deadline


CHECKS = (
    Check(
        "job-length",
        "In every mode each task has a version whose WCET is within the hyperperiod; versions that are longer are "
        "pointed out.",
        (codes.WCET_BEYOND_HYPERPERIOD,),
        check_length,
    ),
    Check(
        "unit-load",
        "In every mode, the tasks that can run only on a set of units need, in their shortest versions, no more time "
        "than those units have in a hyperperiod.",
        (codes.UNITS_OVERLOADED,),
        check_units,
    ),
    Check(
        "resource-load",
        "In every mode, the access phases of the least demanding versions need no more of a resource than there is.",
        (codes.RESOURCE_OVERLOADED,),
        check_resources,
    ),
)
