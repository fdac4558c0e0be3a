"""Rule parts: what a job that is interrupted may look like (MODEL 8.2)."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.rules import Rule

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Part, Version
    from halpipe.pipeline.verify.tables import Clock, ModeTable, Placed, Switch


def check_parts(table: ModeTable) -> Iterator[Diagnostic]:
    """Check the parts of every job of a mode."""
    return _parts(table.jobs, table, table.mode.locks)


def check_parts_on_line(switch: Switch) -> Iterator[Diagnostic]:
    """Check the parts of every job of a transition table."""
    return _parts(switch.jobs, switch, switch.target.mode.locks)


def _parts(jobs: Iterable[Placed], table: ModeTable | Switch, locks: frozenset[str]) -> Iterator[Diagnostic]:
    clock = table.clock
    on: dict[tuple[str, ...], Placed] = {}
    for placed in jobs:
        job = placed.job
        on.setdefault(job.units, placed)
        version = placed.version
        if job.parts and version is not None and job.version in placed.active.wcets:
            path = table.path(placed)
            for text in _shape(placed, clock):
                yield codes.PARTS_DIFFER(text, at=job.at, path=path, help="give each part its start, end, from and to")
            for text in _gaps(placed, version, locks):
                yield codes.WRONG_GAP(text, at=job.at, path=path, help="interrupt the job where its version allows it")
            for text in _lengths(placed, version, clock):
                yield codes.WRONG_LENGTH(text, at=job.at, path=path, help="move the start or the end of the part")
    for units, placed in on.items():
        if placed.service.is_full:  # known by now: the lengths of all its jobs have been asked for
            names = ", ".join(f'"{unit}"' for unit in units)
            text = f"is on {names}, where interrupts take all of the time"
            help = "lighten the interrupts, or use other units"
            yield codes.NO_LENGTH(text, at=placed.job.at, path=table.path(placed), help=help)


def _shape(placed: Placed, clock: Clock) -> Iterator[str]:
    """Say where the parts do not make up the job: its start and end, its WCET from 0 to C, gaps between them."""
    job, parts = placed.job, placed.job.parts
    wcet = placed.active.wcets[job.version]
    if parts[0].start != job.start or parts[-1].end != job.end:
        yield f"lasts from {job.start} to {job.end}, its parts from {parts[0].start} to {parts[-1].end}"
    done = 0
    for number, part in enumerate(parts, 1):
        begun, ended = clock.ticks(part.executed_from), clock.ticks(part.executed_to)
        if begun != done or ended <= begun:
            yield f"executes {part.executed_from} to {part.executed_to} in part {number}, after {clock.text(done)}"
        done = ended
    if done != wcet:
        yield f"executes {clock.text(done)} in all, its WCET is {clock.text(wcet)}"
    for number, (part, then) in enumerate(pairwise(parts), 1):
        if then.start <= part.end:
            yield f"has no gap between part {number}, until {part.end}, and part {number + 1}, from {then.start}"


def _gaps(placed: Placed, version: Version, locks: frozenset[str]) -> Iterator[str]:
    """Say which gaps lie where the version does not allow them."""
    parts, split = placed.job.parts, version.split
    if len(parts) < 2:
        return
    if not split.is_allowed:
        yield f'has {len(parts) - 1} gaps, but version "{version.name}" is not split'
    elif split.max_gaps is not None and len(parts) - 1 > split.max_gaps:
        yield f"has {len(parts) - 1} gaps, at most {split.max_gaps} are allowed"
    points = frozenset(split.points)
    for part in parts[:-1]:
        at = part.executed_to
        if split.points and at not in points:
            yield f"is interrupted after {at}, which is no split point"
        for access in version.accesses:
            if access.start < at < access.end and access.resource not in locks:
                yield f'is interrupted after {at}, in its access to "{access.resource}"'
    if split.anywhere and split.min_part is not None:
        short = [part for part in parts if part.executed_to - part.executed_from < split.min_part]
        for part in short:
            yield f"has a part of {part.executed_to - part.executed_from}, at least {split.min_part} is allowed"


def _lengths(placed: Placed, version: Version, clock: Clock) -> Iterator[str]:
    """Say which parts have not their reserved length."""
    lost = 0
    for number, part in enumerate(placed.job.parts, 1):
        work = lost + clock.ticks(part.executed_to) - clock.ticks(part.executed_from)
        length = placed.service.length(work)
        given = clock.ticks(part.end) - clock.ticks(part.start)
        if length is not None and given != length:
            made = f"{_reason(part, lost, placed, clock)} {clock.text(length)}"
            yield f"lasts {clock.text(given)} in part {number}, {made}"
        lost = clock.ticks(version.split.resume)


def _reason(part: Part, lost: int, placed: Placed, clock: Clock) -> str:
    resumed = f" + {clock.text(lost)} to resume" if lost else ""
    made = "with interrupts make" if placed.service.interrupts else "make"
    return f"{part.executed_to - part.executed_from} of execution{resumed} {made}"


PARTS = Rule(
    "parts",
    "The parts of a job execute its WCET in order, with gaps between them, at most max-gaps of them, at split points "
    "of its version (or anywhere outside access phases, in parts of at least min-part); each part lasts the reserved "
    "length of what it executes, after a gap with the time to resume.",
    check_parts,
)
