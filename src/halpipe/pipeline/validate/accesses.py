"""Checks of access phases and their data transfers."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.diagnostics import about
from halpipe.durations import ZERO, Duration
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
    steps: list[tuple[Duration, Fraction]] = []
    for access in accesses:
        steps += [(access.start, access.bound), (access.end, -access.bound)]
    total, since = Fraction(0), ZERO
    for instant, step in sorted(steps):  # at equal instants the ends, being negative, come first
        if total <= 1 < total + step:
            since = instant
            held = [a for a in accesses if a.start <= instant < a.end]
            excess = sum((a.bound for a in held), Fraction(0))
            text = f"{len(held)} phases are in force together at {since}, with bounds that sum to "
            text += format_rational(excess)
            at, path = place(held[-1], version, task), _path(task, version, accesses[0])
            yield codes.PHASES_OVERLOAD(text, at=at, path=path, help="move the phases apart, or lower their bounds")
        total += step


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
