"""Late transfers of any length up to a hyperperiod, and the jobs of other tasks that each of them holds.

The channel of a transfer under way takes no other one, and its unit is not given to another job. A job that waits
beyond its phase is abandoned (docs/reference/riscv-bundle.md). Delays for which that depends on few ticks are left out.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.deploy.riscv.run.injection import Injection, Kind

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.deploy.riscv.run.expectation import PlannedExecution, PlannedJob, PlannedTransfer

SPACE = 4
"""Tables from one delay to the next: what a delay of one hyperperiod changes is over by then."""


def delays(jobs: Sequence[PlannedJob], length: int, margin: int, turn: int = 0) -> list[Injection]:
    """Return a late transfer in every fourth table, as many ticks late as `length` at most, and what follows from each.

    `jobs` are those of the tables that may be changed; each `turn` takes other transfers and delays.
    """
    found: list[Injection] = []
    last = max((job.table.cycle for job in jobs), default=0)
    for number, cycle in enumerate(range(0, last - 1, SPACE)):
        choices = list(
            _choices([job for job in jobs if cycle - 1 <= job.table.cycle < cycle + SPACE - 1], cycle, length, margin)
        )
        found += choices[(turn * (last // SPACE + 1) + number) % len(choices)] if choices else []
    return found


def _choices(jobs: Sequence[PlannedJob], cycle: int, length: int, margin: int) -> Iterator[list[Injection]]:
    """Yield the late transfers of a table with their consequences: those that hold units first."""
    made = []
    for job in jobs:
        for late in _lasts(job) if job.table.cycle == cycle else ():
            others = [other for other in jobs if other is not job]
            ends = {late.end + length} | {end + margin for other in others for _, end in _spans(other)}
            for end in sorted(end for end in ends if late.end + margin <= end <= late.end + length):
                held = _held(others, late, end, margin)
                if held is not None:
                    own = Injection(Kind.LATE_DMA, cycle, job.row, end - late.end, late)
                    made.append([own, *held])
    yield from sorted(made, key=lambda one: (_by_unit(*one), len(one)), reverse=True)


def _by_unit(late: Injection, *held: Injection) -> int:
    """Return how many jobs wait for the unit, and not for the channel."""
    channel = getattr(late.stated, "channel", 0)
    return sum(getattr(one.stated, "channel", -1) != channel for one in held)


def _lasts(job: PlannedJob) -> list[PlannedTransfer]:
    """Return the last transfer of each phase, if none overlaps another."""
    if any(earlier[1] > later[0] for earlier, later in pairwise(_spans(job))):
        return []
    return list({t.begin: t for t in job.transfers}.values())


def _spans(job: PlannedJob) -> list[tuple[int, int]]:
    return sorted({(t.begin, t.end) for t in job.transfers})


def _held(jobs: Sequence[PlannedJob], late: PlannedTransfer, end: int, margin: int) -> list[Injection] | None:
    """Return which jobs a transfer holds that is complete after tick `end`; None if that hangs on a few ticks."""
    found = []
    for job in jobs:
        hits: list[PlannedTransfer | PlannedExecution] = [
            t for t in job.transfers if t.end > late.begin and (t.channel == late.channel or t.hart == late.hart)
        ]
        hits += [e for e in job.executions if e.end > late.begin and e.hart == late.hart]
        hits = sorted((hit for hit in hits if late.begin <= hit.begin <= end), key=lambda hit: hit.begin)
        if not hits:
            continue
        first = hits[0]
        decided = first.begin + margin if first in job.executions else first.end + margin
        if decided > end or not _lasts(job):
            return None
        found.append(Injection(Kind.HELD, job.table.cycle, job.row, 0, first))
    return found
