"""Checks of access phases and their data transfers."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import groupby, pairwise
from operator import attrgetter, itemgetter
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.grouping import grouped
from halpipe.core.quantities import format_rational
from halpipe.models import Access, ResourceKind, Task, Version
from halpipe.pipeline.parts import Service, reserved_length, service_of
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import Context, check, place, version_path

if TYPE_CHECKING:
    from collections.abc import Iterator


MAX_BITS = 4096
"""Size of a common denominator of bounds."""


def _path(task: Task, version: Version, access: Access) -> str:
    return about(version_path(task, version), access_to=access.resource)


def _is_share(bound: Fraction) -> bool:
    """Tell whether 0 < bound <= 1; in integers, because a large model has many of them."""
    share, whole = bound.as_integer_ratio()
    return 0 < share <= whole


@check("access-phases", codes.EMPTY_PHASE, codes.PHASE_BEYOND_WCET, codes.BAD_BOUND)
def check_phases(context: Context) -> Iterator[Diagnostic]:
    """Every access phase has 0 <= start < end <= WCET and a bound greater than 0 and at most 1."""
    for task, version, access in context.accesses_of_versions:
        is_empty = access.start.ns >= access.end.ns
        is_late = version.wcet is not None and access.end.ns > version.wcet.ns
        if not is_empty and not is_late and _is_share(access.bound):
            continue
        at, path = place(access, version, task), _path(task, version, access)
        if is_empty:
            text = f"starts at {access.start} and ends at {access.end}"
            yield codes.EMPTY_PHASE(text, at=at, path=path, help="a phase ends after it starts")
        if is_late:
            text = f"ends at {access.end}, the WCET is {version.wcet}"
            help = "phases count from the start of the job; end it earlier, or raise the WCET"
            yield codes.PHASE_BEYOND_WCET(text, at=at, path=path, help=help)
        if not _is_share(access.bound):
            text = f"has the bound {format_rational(access.bound)}"
            help = "a bound is a share of the resource, greater than 0 and at most 1"
            yield codes.BAD_BOUND(text, at=at, path=path, help=help)


@check("denominators", codes.UNLIKE_BOUNDS)
def check_denominators(context: Context) -> Iterator[Diagnostic]:
    """The bounds on a resource have a common denominator of at most 4096 bits."""
    found: dict[str, dict[int, Access]] = {}
    for _, _, access in context.accesses_of_versions:
        found.setdefault(access.resource, {}).setdefault(access.bound.denominator, access)
    for name, accesses in found.items():
        scale = 1
        for denominator, access in accesses.items():
            scale = math.lcm(scale, denominator)
            if scale.bit_length() > MAX_BITS:
                text = f"the common denominator of its bounds has more than {MAX_BITS} bits"
                help = "round the bounds up to few digits, as in 0.25 or 1/3"
                yield codes.UNLIKE_BOUNDS(text, at=place(access), path=about(resource=name), help=help)
                break


@check("locks", codes.LOCK_WITH_SHARE)
def check_locks(context: Context) -> Iterator[Diagnostic]:
    """Accesses to a lock have the bound 1 and move no data, and a lock has no bandwidth."""
    locks = {name: resource for name, resource in context.resources.items() if resource.kind is ResourceKind.LOCK}
    for lock in locks.values():
        if lock.bandwidth is not None:
            help = "remove the bandwidth, or the kind"
            text, owner = "is a lock and has a bandwidth", about(resource=lock.name)
            yield codes.LOCK_WITH_SHARE(text, at=place(lock), path=owner, help=help)
    for task, version, access in context.accesses_of_versions if locks else ():
        lock_of = locks.get(access.resource)
        if lock_of is None or (access.bound == 1 and not access.transfers):
            continue
        at, path = place(access, version, task), _path(task, version, access)
        what = "moves data" if access.bound == 1 else f"has the bound {format_rational(access.bound)}"
        text = f'{what}, but "{access.resource}" is a lock'
        help = "remove the bound and the transfers, or make the resource a memory"
        yield codes.LOCK_WITH_SHARE(text, at=at, path=path, help=help, places=[place(lock_of)])


@check("overlapping-phases", codes.PHASES_OVERLOAD)
def check_overlap(context: Context) -> Iterator[Diagnostic]:
    """Phases of one version that overlap on a resource have bounds that sum to at most 1. Interrupts of its units
    stretch each phase over what follows in the same part.
    """
    serving = {name for name, unit in context.units.items() if unit.interrupts}
    for task, version in context.versions_of_tasks:
        is_served = bool(version.units) and serving.issuperset(version.units)
        if not is_served and all(a.start.ns < a.end.ns <= b.start.ns for a, b in pairwise(version.accesses)):
            continue
        counting = [each for each in version.accesses if each.start.ns < each.end.ns and _is_share(each.bound)]
        for accesses in grouped((access.resource, access) for access in counting).values():
            found = []
            if any(earlier.end.ns > later.start.ns for earlier, later in pairwise(accesses)):
                found = list(_overload(task, version, [(a, a.start, a.end) for a in accesses]))
            if not found and is_served:
                found = _stretched(
                    task, version, accesses, [service_of(context.units, [name]) for name in version.units]
                )
            yield from found


def _stretched(
    task: Task, version: Version, accesses: list[Access], services: list[Service[Duration]]
) -> list[Diagnostic]:
    """Return the overload in a piece whose phases interrupts stretch over each other, wherever it runs (MODEL 8.2).

    A phase begins as if no interrupt came and ends as if all did. They stretch those least that lie nearest behind the
    start of their part: that of the job, or of the piece, after the resumption.
    """
    split = version.split
    if split.anywhere and split.max_gaps != 0:
        return []  # a gap may lie between any two phases
    cuts = [ZERO, *(sorted(split.points, key=attrgetter("ns")) if split.max_gaps != 0 else ())]
    for begin, end in pairwise([*cuts, max(access.end for access in accesses)]):
        inside = [access for access in accesses if begin <= access.start and access.end <= end]
        found: list[Diagnostic] = []
        for before in dict.fromkeys((begin - (split.resume if begin else ZERO), ZERO)) if len(inside) > 1 else ():
            for service in services:
                found = list(_overload(task, version, _spans(inside, before, service), " beside interrupts"))
                if not found:
                    break
            if not found:
                break
        if found:
            return found
    return []


def _spans(
    accesses: list[Access], before: Duration, service: Service[Duration]
) -> list[tuple[Access, Duration, Duration]]:
    """Return when phases are in force if their part begins to execute at `before`; never where none would end."""
    try:
        return [(a, a.start, before + reserved_length(a.end - before, service)) for a in accesses]
    except ValueError:
        return []


def _overload(
    task: Task, version: Version, spans: list[tuple[Access, Duration, Duration]], beside: str = ""
) -> Iterator[Diagnostic]:
    """Sweep over the phases on one resource and report where the sum first passes 1."""
    accesses = [access for access, _, _ in spans]
    steps = [(end, -1, -access.bound, access) for access, _, end in spans]
    steps += [(start, 1, access.bound, access) for access, start, _ in spans]
    total, held = Fraction(0), 0
    steps.sort(key=itemgetter(0))
    for instant, changes in groupby(steps, key=itemgetter(0)):
        before = total
        for _, count, bound, access in changes:
            total, held, latest = total + bound, held + count, access
        if before <= 1 < total:
            text = f"{held} phases are in force together at {instant}{beside}, with bounds that sum to "
            text += format_rational(total)
            at, path = place(latest, version, task), _path(task, version, accesses[0])
            yield codes.PHASES_OVERLOAD(text, at=at, path=path, help="move the phases apart, or lower their bounds")


@check("transfers", codes.EMPTY_TRANSFER)
def check_transfers(context: Context) -> Iterator[Diagnostic]:
    """Every data transfer moves at least one byte."""
    for task, version, access in context.accesses_of_versions:
        for transfer in access.transfers:
            if transfer.size <= 0:
                at, path = place(transfer, access, version, task), _path(task, version, access)
                text = f'the transfer of buffer "{transfer.buffer}" has the size {transfer.size}B'
                yield codes.EMPTY_TRANSFER(text, at=at, path=path, help="state its size, or remove it")
