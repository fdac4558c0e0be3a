"""Dummy tasks for versions without sources (paper, section VI-B): they move data in memory phases and count in between.

The result is an ordinary model with ordinary sources, so that all that follows knows nothing of dummies.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.exporters.riscv.phases import functions_of, spans
from halpipe.models import Access, AccessKind, Source, Transfer

if TYPE_CHECKING:
    from halpipe.exporters.riscv.phases import Clock
    from halpipe.exporters.riscv.profile import Profile
    from halpipe.models import Task, TaskModel, Version

FILE = "halpipe_dummy.c"
SYMBOL = "dummy_words"

SHARE = Fraction(9, 10)
"""How much of the time that an execution surely has is spent with counting."""

START = Duration.parse("5us")
"""What a core needs besides counting; it also may start late, since the management core has other things to do."""

INSTRUCTIONS = 2
"""Instructions of one count, see templates/dummy.c."""


_LEAST, _MOST = 64, 8192
"""Bytes that a memory phase moves; whole DMA transactions."""


def with_dummies(model: TaskModel, profile: Profile, clock: Clock) -> tuple[TaskModel, int]:
    """Give every version without sources dummy ones; return the model and the most functions that one needs."""
    most = 0
    tasks = []
    for task in model.tasks:
        versions = []
        for version in task.versions:
            if version.source is None and version.wcet is not None:
                version = _dummy(task, version, profile, clock)
            if version.source is not None and FILE in version.source.files:
                most = max(most, len(functions_of(version)))
            versions.append(version)
        tasks.append(replace(task, versions=tuple(versions)))
    return replace(model, tasks=tuple(tasks)), most


def _dummy(task: Task, version: Version, profile: Profile, clock: Clock) -> Version:
    assert version.wcet is not None, "models without WCET have no dummies"
    lost = clock.tick * profile.patience + START
    phases = _without_scraps(_on_grid(version, version.wcet, clock), version.wcet, lost * 2)
    phases = _with_directions(phases, version.wcet, clock)
    size = min([_MOST, *(_fitting(access, clock) for access in phases if _is_window(access))]) // _LEAST * _LEAST
    buffer = f"{task.name}/{version.name}/dummy"
    transfer = Transfer(buffer=buffer, symbol=SYMBOL, size=max(size, _LEAST))
    moving = tuple(replace(a, transfers=(transfer,)) if _is_window(a) and not a.transfers else a for a in phases)
    version = replace(version, accesses=moving)
    pieces = ((clock.up(begin), clock.down(end)) for begin, end in spans(version, cut=True))
    executions = [end - begin for begin, end in pieces if end > begin]
    counts = [f"COUNT_{n}={_count(clock.tick * ticks - lost, profile)}" for n, ticks in enumerate(executions)]
    entry = " ".join(f"dummy_{n}" for n in range(len(executions)))
    source = Source(files=(FILE,), entry=entry or "dummy_0", defines=(f"WORDS={transfer.size // 8}", *counts))
    return replace(version, source=source)


def _is_window(access: Access) -> bool:
    return access.kind in (AccessKind.READ, AccessKind.WRITE)


def _on_grid(version: Version, wcet: Duration, clock: Clock) -> list[Access]:
    """Return the phases by their start, widened to ticks, so that later shifts by ticks change no execution."""
    widened = (
        replace(a, start=clock.tick * clock.down(a.start), end=min(clock.tick * clock.up(a.end), wcet))
        for a in version.accesses
    )
    return sorted(widened, key=lambda access: (access.start, access.end))


def _without_scraps(phases: list[Access], wcet: Duration, least: Duration) -> list[Access]:
    """Widen windows over executions that would be shorter than `least`: too short to be begun and ended."""
    found: list[Access] = []
    front = ZERO
    for access in phases:
        if access.kind is None and ZERO < access.start - front < least:
            access = replace(access, start=front)
        front = max(front, access.end)
        found.append(access)
    if found and found[-1].kind is None and found[-1].end == front and ZERO < wcet - front < least:
        found[-1] = replace(found[-1], end=wcet)
    return found


def _with_directions(phases: list[Access], wcet: Duration, clock: Clock) -> list[Access]:
    """Say of each window whether data goes (after an execution), comes (before one), or first goes and then comes.

    Windows that share their resource with others stay as they are: nothing can be moved in them.
    """
    found = []
    front = ZERO
    for access, following in zip(phases, [*(a.start for a in phases), wcet][1:], strict=True):
        goes = access.start > front
        front = max(front, access.end)
        comes = following > front
        if access.kind is not None or access.bound != 1 or not (goes or comes):
            found.append(access)
        elif goes and comes:
            middle = clock.tick * clock.up((access.start + access.end) / 2)
            found.append(replace(access, end=middle, kind=AccessKind.WRITE))
            found.append(replace(access, start=middle, kind=AccessKind.READ))
        else:
            found.append(replace(access, kind=AccessKind.WRITE if goes else AccessKind.READ))
    return [access for access in found if access.start < access.end]


def _fitting(access: Access, clock: Clock) -> int:
    """Return the bytes that a phase has time for."""
    time = clock.tick * (clock.down(access.end) - clock.up(access.start)) - clock.setup
    return max(int(time.in_unit("s") * clock.bandwidths[access.resource]), 0)


def _count(time: Duration, profile: Profile) -> int:
    """Return up to what to count in a time."""
    cycles = SHARE * time.in_unit("s") * profile.clock
    return max(int(cycles / profile.cpi / INSTRUCTIONS), 1)
