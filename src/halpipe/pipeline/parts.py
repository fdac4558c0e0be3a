"""Interrupt-inflated execution of a job: its pieces, its reserved time, the instants of its access phases.

MODEL 8.2. The functions take times of one kind, exact durations or whole ticks, and return the same kind.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, TypeAlias, TypeVar

from halpipe.core.durations import ZERO, Duration
from halpipe.models import Access, Binding, Job, Part, TaskModel, Unit, Version

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence


T = TypeVar("T", int, Duration)

MAX_STEPS = 100_000
"""Steps towards a reserved length; what needs more has no time to speak of."""

Service: TypeAlias = "tuple[tuple[T, T], ...]"
"""The interrupts that a job has to suffer, each with its distance T and its time c."""


def has_whole_jobs(model: TaskModel) -> bool:
    """Return whether the model uses nothing of MODEL 8: its jobs run in one piece, wherever they may, undisturbed."""
    versions = (version for task in model.tasks for version in task.versions)
    return not (
        any(unit.interrupts for unit in model.units)
        or any(task.distance is not None or task.binding is not Binding.JOB for task in model.tasks)
        or any(version.split.is_allowed for version in versions)
    )


def is_exact_model(model: TaskModel) -> bool:
    """Return whether jobs are whole and, of MODEL 10, only locks are used: objectives and coarse grids know no more."""
    return has_whole_jobs(model) and not any(True for _ in model.refinements())


def service_of(units: Mapping[str, Unit], names: Iterable[str]) -> Service[Duration]:
    """Return the interrupts of all the units named, together: the members of a gang wait for each other."""
    return tuple((i.distance, i.wcet) for name in dict.fromkeys(names) for i in units[name].interrupts)


def interrupt_load(service: Service[T]) -> Fraction:
    """Return the share of the time that interrupts may take: the sum of c/T."""
    return sum((Fraction(_number(c)) / Fraction(_number(distance)) for distance, c in service), Fraction(0))


def _number(time: int | Duration) -> int | Fraction:
    return time.ns if isinstance(time, Duration) else time


def reserved_length(work: T, service: Service[T]) -> T:
    """Return L(x): the least L with L = x + sum ceil(L/T) c, for `work` x above 0; x itself without interrupts.

    Raise ``ValueError`` if the interrupts fill the units, so that no length is enough, or all of them but a sliver, so
    that the length is not found within `MAX_STEPS`.
    """
    if not service or not work:
        return work
    load = interrupt_load(service)
    if load >= 1:
        raise ValueError("interrupts fill the unit: no length is enough for any work")
    length = work if load < Fraction(1, 2) else _at_least(work, load)
    for _ in range(MAX_STEPS):
        longer = work
        for distance, time in service:
            longer += time * -(-length // distance)
        if longer == length:
            return length
        length = longer
    raise ValueError("interrupts leave a sliver of the unit: no length is found")


def _at_least(work: T, load: Fraction) -> T:
    """Return a length that no reserved one is below: what is left of it beside the interrupts is the work."""
    return work * (1 / (1 - load)) if isinstance(work, Duration) else int(work / (1 - load))


def pieces(version: Version) -> tuple[Duration, ...]:
    """Return the bounds of the pieces of a version that is split by a list, 0 and C included; else 0 and C alone."""
    return (ZERO, *version.split.points, version.wcet or ZERO)


def job_of(
    task: str,
    index: int,
    version: Version,
    units: tuple[str, ...],
    spans: Sequence[tuple[Duration, Duration, Duration]],
    service: Service[Duration],
) -> Job:
    """Return a job from its `spans`: for each part its start and what it executes, from and to.

    Parts end their reserved length after their start; those after the first pay for the resumption.
    """
    resume = version.split.resume
    parts = tuple(
        Part(
            start=start,
            end=start + reserved_length(done - begun + (resume if number else ZERO), service),
            executed_from=begun,
            executed_to=done,
        )
        for number, (start, begun, done) in enumerate(spans)
    )
    return Job(
        task=task,
        index=index,
        start=parts[0].start,
        end=parts[-1].end,
        version=version.name,
        units=units,
        parts=parts if len(parts) > 1 else (),
    )


def renewed(job: Job, version: Version, service: Service[Duration]) -> Job | None:
    """Return a job in one piece with the length that its version has now; None where interrupts leave it none."""
    try:
        return job_of(job.task, job.index, version, job.units, [(job.start, ZERO, version.wcet or ZERO)], service)
    except ValueError:
        return None


def parts_of(job: Job, version: Version) -> tuple[Part, ...]:
    """Return the parts of a job, one in all for a job in one piece."""
    whole = Part(start=job.start, end=job.end, executed_from=ZERO, executed_to=version.wcet or ZERO)
    return job.parts or (whole,)


def phase_instants(
    access: Access, parts: Sequence[Part], resume: Duration, service: Service[Duration], *, is_lock: bool = False
) -> tuple[Duration, Duration]:
    """Return when an access phase of a job is in force: it lies in one of the job's `parts`.

    From s_k + (o_k + p - a_k) to s_k + L(o_k + q - a_k), with o_k the time lost at the part's start (MODEL 8.2). Raise
    ``ValueError`` if a gap of the job lies inside the phase, but for a lock, which is held through gaps.
    """
    if is_lock and len(parts) > 1:
        return _held(access, parts, resume, service)
    for number, part in enumerate(parts):
        if len(parts) == 1 or (part.executed_from <= access.start and access.end <= part.executed_to):
            lost = (resume if number else ZERO) - part.executed_from
            return part.start + lost + access.start, part.start + reserved_length(lost + access.end, service)
    raise ValueError("a gap of the job lies inside the phase")


def _held(
    access: Access, parts: Sequence[Part], resume: Duration, service: Service[Duration]
) -> tuple[Duration, Duration]:
    """Return when a lock is held: from the instant at which its access begins to that at which it is over."""
    begin = end = parts[0].start
    for number, part in enumerate(parts):
        lost = (resume if number else ZERO) - part.executed_from
        if part.executed_from <= access.start < part.executed_to:
            begin = part.start + lost + access.start
        if part.executed_from < access.end <= part.executed_to:
            end = part.start + reserved_length(lost + access.end, service)
    return begin, end


def latest_phase(offsets: Sequence[T], circle: T) -> T:
    """Return the phase that leaves all jobs the least delay: where the widest gap of the circle ends.

    Of two jobs half a circle apart, the first: for every checker there is one answer. `offsets` are sorted.
    """
    if len(offsets) == 2 and (offsets[1] - offsets[0]) * 2 == circle:
        return offsets[0]
    gaps = [(later - earlier, later) for earlier, later in pairwise(offsets)]
    gaps.append((offsets[0] + circle - offsets[-1], offsets[0]))
    return max(gaps)[1]
