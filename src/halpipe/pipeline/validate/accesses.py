"""Checks of access phases and their data transfers."""

from __future__ import annotations

from fractions import Fraction
from itertools import groupby, pairwise
from operator import itemgetter
from typing import TYPE_CHECKING

from halpipe.diagnostics import about
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import Check, place, version_path
from halpipe.quantities import format_rational

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.diagnostics import Diagnostic
    from halpipe.models import Access, Task, Version
    from halpipe.pipeline.validate.context import Context


def _path(task: Task, version: Version, access: Access) -> str:
    return about(version_path(task, version), access_to=access.resource)


def _is_share(bound: Fraction) -> bool:
    """Tell whether 0 < bound <= 1; in integers, because a large model has many of them."""
    return 0 < bound.numerator <= bound.denominator


def check_phases(context: Context) -> Iterator[Diagnostic]:
    """0 <= start < end <= C, and 0 < bound <= 1."""
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


def check_overlap(context: Context) -> Iterator[Diagnostic]:
    """Phases of one version that overlap on a resource have bounds that sum to at most 1."""
    for task, version in context.versions_of_tasks:
        if len(version.accesses) < 2:
            continue
        by_resource: dict[str, list[Access]] = {}
        for access in version.accesses:
            if access.start.ns < access.end.ns and _is_share(access.bound):
                by_resource.setdefault(access.resource, []).append(access)
        for accesses in by_resource.values():
            if any(earlier.end.ns > later.start.ns for earlier, later in pairwise(accesses)):
                yield from _overload(task, version, accesses)


def _overload(task: Task, version: Version, accesses: list[Access]) -> Iterator[Diagnostic]:
    """Sweep over the phases on one resource and report where the sum first passes 1."""
    steps = [(access.end, -1, -access.bound, access) for access in accesses]
    steps += [(access.start, 1, access.bound, access) for access in accesses]
    total, held = Fraction(0), 0
    steps.sort(key=itemgetter(0))
    for instant, changes in groupby(steps, key=itemgetter(0)):
        before = total
        for _, count, bound, access in changes:
            total, held, latest = total + bound, held + count, access
        if before <= 1 < total:
            text = f"{held} phases are in force together at {instant}, with bounds that sum to {format_rational(total)}"
            at, path = place(latest, version, task), _path(task, version, accesses[0])
            yield codes.PHASES_OVERLOAD(text, at=at, path=path, help="move the phases apart, or lower their bounds")


def check_transfers(context: Context) -> Iterator[Diagnostic]:
    """Every transfer moves data."""
    for task, version, access in context.accesses_of_versions:
        for transfer in access.transfers:
            if transfer.size <= 0:
                at, path = place(transfer, access, version, task), _path(task, version, access)
                text = f'the transfer of buffer "{transfer.buffer}" has the size {transfer.size}B'
                yield codes.EMPTY_TRANSFER(text, at=at, path=path, help="state its size, or remove it")


CHECKS = (
    Check(
        "access-phases",
        "Every access phase has 0 <= start < end <= WCET and a bound greater than 0 and at most 1.",
        (codes.EMPTY_PHASE, codes.PHASE_BEYOND_WCET, codes.BAD_BOUND),
        check_phases,
    ),
    Check(
        "overlapping-phases",
        "Phases of one version that overlap on a resource have bounds that sum to at most 1.",
        (codes.PHASES_OVERLOAD,),
        check_overlap,
    ),
    Check("transfers", "Every data transfer moves at least one byte.", (codes.EMPTY_TRANSFER,), check_transfers),
)
