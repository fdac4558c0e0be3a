"""Make room in a job: for loading its image, and for what its memory phases move.

The load happens within the job, before all else. What is added to the front of a job, or to a phase, moves everything
behind it and the WCET by as much; executions keep their length. What fits stays as it is, so that nothing grows twice.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.exporters.riscv.phases import load_of, shares
from halpipe.models import Access, AccessKind

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from halpipe.exporters.riscv.phases import Clock
    from halpipe.models import Version


def grow(
    version: Version,
    sizes: Sequence[int],
    resource: str,
    clock: Clock,
    patience: int,
    driving: Callable[[Access], Duration] = lambda access: ZERO,
) -> Version:
    """Return a version whose phases hold its transfers, each `patience` ticks more than they take.

    `sizes` are those of the parts of its image; a load phase that it lacks is made on `resource`. `driving` tells how
    long drivers take in a phase before its transfers begin.
    """
    assert version.wcet is not None, "models without WCET do not validate"
    load = load_of(version)
    first = load or Access(resource=resource, start=ZERO, end=ZERO, kind=AccessKind.LOAD)
    loading = patience + version.gang * sum(clock.transfer(first.resource, size) for size in sizes)
    loaded = _with_end(first, first.start, first.end, loading, clock)
    # From an instant on, everything is later by a growth.
    growths = [(first.end, loaded.end - first.end)]
    others = []
    for access in sorted((a for a in version.accesses if a is not load), key=lambda a: (a.start, a.end)):
        start, end = _later(access.start, growths), _later(access.end, growths)
        waiting = patience + clock.up(driving(access))
        moved = _with_end(access, start, end, _needs(access, version.gang, clock, waiting), clock)
        growths.append((access.end, moved.end - end))
        others.append(moved)
    if not any(growth for _, growth in growths):
        return version
    points = tuple(_later(point, growths) for point in version.split.points)
    split = replace(version.split, points=points)
    return replace(version, wcet=_later(version.wcet, growths), accesses=(loaded, *others), split=split)


def _later(instant: Duration, growths: Iterable[tuple[Duration, Duration]]) -> Duration:
    return sum((growth for at, growth in growths if instant >= at), instant)


def _needs(access: Access, gang: int, clock: Clock, patience: int) -> int:
    """Return the ticks that the transfers of a phase take, with those of every member of a gang."""
    if not access.transfers:
        return 0
    sizes = [size for transfer in access.transfers for _, _, size in shares(access, transfer.size, gang)]
    return patience + sum(clock.transfer(access.resource, size) for size in sizes)


def _with_end(access: Access, start: Duration, end: Duration, needed: int, clock: Clock) -> Access:
    """Return the phase at its new place, at least `needed` ticks long when rounded inwards."""
    if clock.down(end) - clock.up(start) < needed:
        end = clock.tick * (clock.up(start) + needed)
    return replace(access, start=start, end=end)
