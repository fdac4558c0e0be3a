"""Checks of the times of tasks and versions, of preemption points and of static mapping (MODEL 2 and 8.1)."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, Path, Severity, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.quantities import format_rational
from halpipe.core.suggest import few
from halpipe.models import WHOLE, Binding, Chain, Interrupt, Task, Version
from halpipe.pipeline.jobs import common_sets
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import ActiveMode, Context, check, place, task_path, version_path
from halpipe.pipeline.validate.load import least_length

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


_STATE_WCET = "state it in the model, or in an overlay: tasks: {%s: {versions: {%s: {wcet: 1ms}}}}"


@check("tasks", codes.ZERO_PERIOD, codes.BAD_SLACK, codes.NEEDS_PERIOD, codes.SLACK_WITHOUT_PERIOD)
def check_tasks(context: Context) -> Iterator[Diagnostic]:
    """Periods are positive and slacks lie in [0, 1]; only a task with a period has an offset, a deadline or a slack."""
    for task in context.model.tasks:
        at, path = place(task), task_path(task)
        if task.period == ZERO:
            help = "give a positive period, or none if the task runs only on demand"
            yield codes.ZERO_PERIOD("has the period zero", at=at, path=path, help=help)
        share, whole = task.slack.as_integer_ratio()  # comparisons of fractions take three times as long
        if not 0 <= share <= whole:
            text = f"has the slack {format_rational(task.slack)}, which is not a number from 0 to 1"
            help = "state it as a share of the period, such as 0.1 for ten percent"
            yield codes.BAD_SLACK(text, at=at, path=path, help=help)
        if task.period is None:
            yield from _without_period(task)


def _without_period(task: Task) -> Iterator[Diagnostic]:
    at, path = place(task), task_path(task)
    stated = ("offset", task.offset), ("deadline", task.deadline), ("distance", task.distance), ("let", task.let)
    for what, value in stated:
        if value is not None:
            text = f"has the {what} {value} but no period to count it from"
            help = f"give the task a period, or remove the {what}"
            yield codes.NEEDS_PERIOD(text, at=at, path=path, help=help)
    if task.slack:
        text = f"has the slack {format_rational(task.slack)} but no period, so it has no effect"
        yield codes.SLACK_WITHOUT_PERIOD(text, at=at, path=path, help="give the task a period, or remove the slack")


@check("wcet", codes.MISSING_WCET, codes.ZERO_WCET, codes.WCET_BEYOND_DEADLINE, codes.WCET_BEYOND_PERIOD)
def check_wcet(context: Context) -> Iterator[Diagnostic]:
    """Every version states a positive WCET, and in every mode some version of each task keeps its deadline (the
    period, where no deadline is given); versions that never do, or that pass the period, are pointed out.
    """
    for task, version in context.versions_of_tasks:
        wcet = version.wcet
        if wcet is not None and wcet > ZERO:
            yield from _too_long(context, task, version, least_length(context.units, version) or wcet)
            continue
        at, path = place(version, task), version_path(task, version)
        if wcet is None:
            help = _STATE_WCET % (task.name, version.name)
            yield codes.MISSING_WCET("has no WCET", at=at, path=path, help=help)
        elif wcet == ZERO:
            help = "state the worst-case execution time, rounded up"
            yield codes.ZERO_WCET("has the WCET zero", at=at, path=path, help=help)


def _due(task: Task) -> tuple[Duration, str] | None:
    """Return the longest time that a job may take, and where that comes from; None where nothing bounds it."""
    period = task.period
    if period is None or period <= ZERO or (task.distance is not None and task.distance < period):
        return None
    deadline, whose = (period, " (its period)") if task.deadline is None else (task.deadline, "")
    if task.distance is not None:  # counted from the arrival, which is after the start of the job before
        deadline = (task.distance if task.deadline is None else task.deadline) - period * (1 - task.slack)
        whose = ", less the least time since the job before"
    if task.let is not None and ZERO < task.let < deadline:
        deadline, whose = task.let, " (its LET)"
    return deadline, whose


def _is_late(context: Context, task: Task, version: Version) -> bool:
    """Tell whether a version can never meet its deadline."""
    due, length = _due(task), least_length(context.units, version)
    return due is not None and length is not None and length > due[0]


def _is_last(context: Context, task: Task, version: Version) -> bool:
    """Tell whether some mode that runs a version has none of its task that may meet its deadline."""
    modes = [mode.tasks[task.name].versions for mode in context.active if task.name in mode.tasks]
    modes = [versions for versions in modes if version in versions] or ([] if modes else [task.versions])
    return any(all(_is_late(context, task, other) for other in versions) for versions in modes)


def _too_long(context: Context, task: Task, version: Version, wcet: Duration) -> Iterator[Diagnostic]:
    due, period = _due(task), task.period
    if due is None or period is None:
        return
    deadline, whose = due
    if wcet > deadline:
        text = f'version "{version.name}" needs {wcet}, its deadline is {max(deadline, ZERO)}{whose}'
        help = f"shorten the WCET by at least {wcet - deadline}, raise the deadline, or remove the version"
        severity = None if _is_last(context, task, version) else Severity.WARNING
        text += "" if severity is None else ", so it is never tried"
        at, path = place(version, task), task_path(task)
        yield codes.WCET_BEYOND_DEADLINE(text, at=at, path=path, help=help, severity=severity)
    elif wcet > period:
        text = f'version "{version.name}" needs {wcet}, its period is {period}: successive jobs overlap'
        help = "shorten the WCET or lengthen the period, unless the jobs may run beside each other on different units"
        yield codes.WCET_BEYOND_PERIOD(text, at=place(version, task), path=task_path(task), help=help)


@check("job-length", codes.WCET_BEYOND_HYPERPERIOD)
def check_length(context: Context) -> Iterator[Diagnostic]:
    """In every mode each task has a version whose WCET is within the hyperperiod; versions that are longer are pointed
    out.
    """
    for mode in context.active:
        hyperperiod = mode.hyperperiod
        if hyperperiod is None:
            continue
        for active in mode.tasks.values():
            task, lengths = active.task, {v.name: least_length(context.units, v) for v in active.versions}
            long = [v for v in active.versions if (lengths[v.name] or ZERO) > hyperperiod]
            severity = None if len(long) == len(active.versions) else Severity.WARNING
            for version in long:
                if _is_late(context, task, version):
                    continue  # reported as such
                text = f'version "{version.name}" needs {lengths[version.name]}, longer than the hyperperiod of '
                text += str(hyperperiod)
                at, path = place(version, task), about(mode.path, task=task.name)
                help = "shorten the WCET, or lengthen a period of the mode"
                yield codes.WCET_BEYOND_HYPERPERIOD(text, at=at, path=path, help=help, severity=severity)


@check("gang", codes.BAD_GANG)
def check_gang(context: Context) -> Iterator[Diagnostic]:
    """The gang size of every version is at least 1 and at most the number of its units."""
    for task, version in context.versions_of_tasks:
        if version.gang == 1:
            continue
        at, path = place(version, task), version_path(task, version)
        units = len(set(version.units))
        if version.gang < 1:
            text = f"has the gang size {version.gang}"
            yield codes.BAD_GANG(text, at=at, path=path, help="a job occupies at least 1 unit")
        elif version.units and version.gang > units:
            text = f"has the gang size {version.gang} but only {units} valid unit{'s' if units > 1 else ''}"
            yield codes.BAD_GANG(text, at=at, path=path, help="add units, or make the gang smaller")


@check("negative-times", codes.NEGATIVE_TIME)
def check_negative(context: Context) -> Iterator[Diagnostic]:
    """No duration is negative."""
    for what, value, elements in _durations(context):
        if value is not None and value.ns < 0:
            text = f"has the negative {what} {value}"
            path = _path(*elements)
            yield codes.NEGATIVE_TIME(text, at=place(*elements), path=path, help="durations are zero or more")


def _durations(context: Context) -> Iterator[tuple[str, Duration | None, tuple[Any, ...]]]:
    """Yield every duration of the model with what it is, and the elements around it, innermost first."""
    for unit in context.model.units:
        for interrupt in unit.interrupts:
            yield "distance", interrupt.distance, (interrupt, unit)
            yield "wcet", interrupt.wcet, (interrupt, unit)
    for task in context.model.tasks:
        yield "period", task.period, (task,)
        yield "distance", task.distance, (task,)
        yield "offset", task.offset, (task,)
        yield "deadline", task.deadline, (task,)
        yield "let", task.let, (task,)
        for version in task.versions:
            yield "WCET", version.wcet, (version, task)
            yield "resume", version.split.resume, (version, task)
            yield "min-part", version.split.min_part, (version, task)
            for access in version.accesses:
                yield "access start", access.start, (access, version, task)
            for constraint in version.precedences:
                yield "window minimum", constraint.min, (constraint, version, task)
                yield "point", constraint.point, (constraint, version, task)
    for chain in context.model.chains:
        yield "limit of latency", chain.max_latency, (chain,)
        yield "limit of reaction time", chain.max_reaction, (chain,)
        yield "limit of data age", chain.max_age, (chain,)
    for transition in context.model.transitions:
        yield "maximum length", transition.max_length, (transition,)


def _path(*elements: Any) -> Path:
    """Return how messages name the innermost of elements that has a name."""
    match elements:
        case (Interrupt() as interrupt, unit):
            return about(unit=unit.name, interrupt=interrupt.name)
        case (*_, Version() as version, task):
            return version_path(task, version)
        case (Task() as task,):
            return task_path(task)
        case (Chain() as chain,):
            return about(chain=chain.name)
    (transition,) = elements
    return about(transition=(transition.source, transition.target))


# ------------------------------------------------------------------------------------------------ preemption points


@check("split-points", codes.SPLIT_OUTSIDE, codes.SPLIT_NOT_ASCENDING, codes.SPLIT_IN_PHASE)
def check_points(context: Context) -> Iterator[Diagnostic]:
    """The split points of a version ascend between 0 and its WCET, and none is strictly within an access phase."""
    for task, version in context.versions_of_tasks:
        if version.split.points:
            yield from _points(context, task, version, version.split.points)


def _points(context: Context, task: Task, version: Version, points: tuple[Duration, ...]) -> Iterator[Diagnostic]:
    at, path, wcet = place(version, task), version_path(task, version), version.wcet
    outside = [p for p in points if p <= ZERO or (wcet is not None and p >= wcet)]
    if outside:
        shown = few(outside, 3, quote="")
        text = f"has the split point{'s' * (len(outside) > 1)} {shown}, not between 0 and the WCET {wcet}"
        help = (
            "split points count execution time from the start of the job: remove those at its start, its end or beyond"
        )
        yield codes.SPLIT_OUTSIDE(text, at=at, path=path, help=help)
    wrong = [later for before, later in pairwise(points) if later <= before]
    if wrong:
        ascending = " ".join(map(str, sorted(set(points) - set(outside))))
        text = f"has split points that do not ascend, at {few(wrong, 3, quote='')}"
        help = f'write split="{ascending}"' if ascending else "leave the split out"
        yield codes.SPLIT_NOT_ASCENDING(text, at=at, path=path, help=help)
    for access in version.accesses:
        if context.is_lock(access.resource):
            continue  # held through the gap
        inside = [p for p in points if access.start < p < access.end]
        if inside:
            text = f"has the split point{'s' * (len(inside) > 1)} {few(inside, 3, quote='')} within its access to "
            text += f'"{access.resource}" from {access.start} to {access.end}'
            help = "move the points to an end of the phase, or cut the phase in two"
            yield codes.SPLIT_IN_PHASE(text, at=place(access, version, task), path=path, help=help)


@check("split-limits", codes.NO_MAX_GAPS, codes.SPLIT_WITHOUT_EFFECT)
def check_limits(context: Context) -> Iterator[Diagnostic]:
    """A version that may be split anywhere states max-gaps; resume, max-gaps and min-part are stated where they have
    an effect.
    """
    for task, version in context.versions_of_tasks:
        split, wcet = version.split, version.wcet
        if split == WHOLE:
            continue
        at, path = place(version, task), version_path(task, version)
        if split.anywhere and split.max_gaps is None:
            help = 'state max-gaps, such as max-gaps="3"'
            text = "may be split anywhere, but states no largest number of gaps"
            yield codes.NO_MAX_GAPS(text, at=at, path=path, help=help)
        for text, help in _without_effect(version, wcet):
            yield codes.SPLIT_WITHOUT_EFFECT(text, at=at, path=path, help=help)


def _without_effect(version: Version, wcet: Duration | None) -> Iterator[tuple[str, str]]:
    """Say what does nothing, and what to do about it."""
    split = version.split
    stated = [
        name
        for name, is_stated in (
            ("resume", split.resume != ZERO),
            ("max-gaps", split.max_gaps is not None),
            ("min-part", split.min_part is not None),
        )
        if is_stated
    ]
    if not split.is_allowed:
        if stated:
            yield f"states {' and '.join(stated)}, but is not split", 'state a split, or split="anywhere", or remove it'
        return
    if split.max_gaps == 0:
        yield "is split, but allows no gap (max-gaps 0)", "allow at least one gap, or remove the split"
    if split.min_part is None:
        return
    if not split.anywhere:
        yield "states min-part for a list of split points", "remove it: the parts of a list are as long as its pieces"
    elif wcet is not None and split.min_part * 2 > wcet:
        text = f"demands parts of at least {split.min_part}, more than half of its WCET {wcet}, so it has no gap"
        yield text, f"use at most {wcet / 2}, or remove the split"


# ------------------------------------------------------------------------------------------------ binding


@check("binding", codes.NOTHING_TO_BIND_TO)
def check_bindings(context: Context) -> Iterator[Diagnostic]:
    """A task that is bound in the whole system can run on one and the same set of units in all its modes."""
    for task in context.tasks.values():
        if task.binding is not Binding.SYSTEM:
            continue
        modes = [mode for mode in context.active if task.name in mode.tasks]
        if modes and not _has_common(task, modes):
            text = f"is bound to one set of units in the whole system, but {_why(task, modes)}"
            help = 'give its versions common units and gang sizes, or bind it within each mode (binding="mode")'
            yield codes.NOTHING_TO_BIND_TO(text, at=place(task), path=task_path(task), help=help)


def _has_common(task: Task, modes: Iterable[ActiveMode]) -> bool:
    """Return whether some units can be used in each of the modes, by some version available there."""
    versions = [mode.tasks[task.name].versions for mode in modes]
    return any(common_sets(versions, gang) for gang in {version.gang for version in versions[0]})


def _why(task: Task, modes: list[ActiveMode]) -> str:
    """Say what its modes allow: the first two that have nothing in common, or all."""
    for number, one in enumerate(modes):
        for other in modes[number + 1 :]:
            if not _has_common(task, (one, other)):
                return f"{_allowed(task, one)} and {_allowed(task, other)}"
    return few((_allowed(task, mode) for mode in modes), quote="", between="; ")


def _allowed(task: Task, mode: ActiveMode) -> str:
    sets = []
    for version in mode.tasks[task.name].versions:
        gang = f"{version.gang} of " if version.gang > 1 else ""
        sets.append(gang + few(version.units))
    return f'mode "{mode.mode.name}" allows {" or ".join(dict.fromkeys(sets))}'
