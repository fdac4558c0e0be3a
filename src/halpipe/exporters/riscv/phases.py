"""Timeline of one job in ticks from its start: transfers in memory phases, execution between them.

A job acquires, executes and restitutes: it loads its image, reads, executes, writes. With several functions, there are
several such stretches. Everything is exact; boundaries of phases are rounded inwards to ticks.
"""

from __future__ import annotations

import math
from dataclasses import field
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration, seconds
from halpipe.core.records import record
from halpipe.exporters.riscv.codes import (
    FIRST_ALONE,
    KINDLESS_PHASE,
    NO_LOAD_PHASE,
    PHASE_ORDER,
    SHARED_PHASE,
    UNDIVIDED,
)
from halpipe.models import Access, AccessKind, TaskModel, Transfer, Version

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.core.diagnostics import Diagnostic, Findings
    from halpipe.exporters.riscv.profile import Profile


@record
class Clock:
    """The ticks of the timer, and how long transfers take on each resource: at least, and `into` each memory."""

    tick: Duration
    setup: Duration
    bandwidths: dict[str, int]
    into: dict[tuple[str, str], int] = field(default_factory=dict)

    def transfer(self, resource: str, size: int, memory: str = "") -> int:
        """Return the ticks that one transfer of `size` bytes into a memory has to itself."""
        moving = seconds(Fraction(size, self.into.get((resource, memory), self.bandwidths[resource])))
        return math.ceil((self.setup + moving) / self.tick)

    def up(self, instant: Duration) -> int:
        """Return the first tick that is not before `instant`."""
        return math.ceil(instant / self.tick)

    def down(self, instant: Duration) -> int:
        """Return the last tick that is not after `instant`."""
        return math.floor(instant / self.tick)


def clock_of(model: TaskModel, profile: Profile) -> Clock:
    """Return the clock of a target; the DMA engine is no faster than a resource states that it is.

    Every resource has a channel. What each is sure of is the share of the bus that it has when all of them move.
    """
    fastest = max(profile.dma.into.values())
    most = {r.name: min(fastest, r.bandwidth or fastest) for r in model.resources}
    moving = {a.resource for task in model.tasks for v in task.versions for a in v.accesses if moves_data(a)}
    if any(task.let is not None and transfers_of(version) for task in model.tasks for version in task.versions):
        most[COPIES] = fastest
        moving.add(COPIES)
    into = {}
    for name, limit in most.items():
        others = [most[other] for other in moving if other != name]
        for memory, rate in profile.dma.into.items():
            own = min(rate, limit)
            into[name, memory] = min(own, _share([own, *others], profile.dma.bus)) if name in moving else own
    sure = {name: min(into[name, memory] for memory in profile.dma.into) for name in most}
    return Clock(profile.tick, profile.dma.setup, sure, into)


def _share(rates: list[int], bus: int) -> int:
    """Return what a channel gets at least when all move and the bus divides itself equally among them."""
    left = bus
    for number, rate in enumerate(sorted(rates)):
        if rate * (len(rates) - number) >= left:
            return max(left // (len(rates) - number), 1)
        left -= rate
    return bus


COPIES = ""
"""The resource over which the copies of logical execution times go: a channel of their own, which no model names."""


def transfers_of(version: Version) -> list[tuple[AccessKind, Transfer]]:
    """Return what a version reads and writes of buffers, in the order of its phases."""
    return [(a.kind, t) for a in phases_of(version) if a.kind is not None for t in a.transfers]


def moves_data(access: Access) -> bool:
    """Whether the management core has something to transfer in a phase."""
    return access.kind is AccessKind.LOAD or bool(access.transfers)


def phases_of(version: Version) -> list[Access]:
    """Return the phases in which something is moved, by their start."""
    return sorted(filter(moves_data, version.accesses), key=lambda access: (access.start, access.end))


def check_phases(version: Version, path: str, findings: Findings) -> bool:
    """Collect what keeps the phases of a version from being played; return whether there is nothing."""
    before = len(findings.items)
    if load_of(version) is None:
        help = "let `halpipe deploy prepare` add it, and schedule the prepared model"
        findings.add(NO_LOAD_PHASE("no load phase begins with the job", at=version.at, path=path, help=help))
    for access in phases_of(version):
        if access.bound != 1:
            help = 'set bound="1"'
            findings.add(SHARED_PHASE(f"the phase has bound {access.bound}", at=access.at, path=path, help=help))
        if access.kind is None:
            help = 'say kind="read" or kind="write"'
            findings.add(KINDLESS_PHASE("the phase has transfers, but no kind", at=access.at, path=path, help=help))
        for transfer in access.transfers if access.kind is AccessKind.WRITE else ():
            whole = SCALAR * version.gang
            if version.gang > 1 and transfer.size > SCALAR and transfer.size % whole:
                message = f'a gang of {version.gang} cannot divide the {transfer.size} bytes of "{transfer.symbol}"'
                help = f"make it a multiple of {whole} bytes: each member writes whole words of {SCALAR} bytes"
                findings.add(UNDIVIDED(message, at=transfer.at, path=path, help=help))
        if access.kind is AccessKind.LOAD and access.start > ZERO:
            help = "let the one load phase of the version begin with the job"
            findings.add(PHASE_ORDER(f"a load phase begins at {access.start}", at=access.at, path=path, help=help))
    return len(findings.items) == before


def load_of(version: Version) -> Access | None:
    """Return the phase in which a version is loaded."""
    return next((a for a in version.accesses if a.kind is AccessKind.LOAD and a.start == ZERO), None)


def disorder(version: Version, functions: int, clock: Clock) -> str:
    """Return why the phases of a version leave not one stretch of time in ticks for each function; empty if they do."""
    moving = phases_of(version)
    found = executions(version, functions) or spans(version, cut=False)
    if functions == 1:
        last = max((a.start for a in moving if a.kind is not AccessKind.WRITE), default=ZERO)
        if last >= found[0][1]:
            return "a write phase comes before a read phase, so no single execution can do"
    held = [begin for begin, end in found if clock.up(begin) < clock.down(end)]
    return "" if len(held) == functions else f"phases leave {len(held)} stretches of time for {functions} functions"


SCALAR = 8
"""Bytes of a word, which the members of a gang never divide: a single one is written by the first member."""


def written_alone(versions: Iterable[tuple[str, Version]]) -> Iterable[Diagnostic]:
    """Yield the scalars of gangs that their first members write; `versions` come with their path for diagnostics."""
    for path, version in versions:
        transfers = [t for a in version.accesses if a.kind is AccessKind.WRITE for t in a.transfers]
        names = [f'"{t.symbol}"' for t in transfers if version.gang > 1 and t.size <= SCALAR]
        if names:
            message = f"of its {version.gang} members the first alone writes {', '.join(names)}"
            help = "nothing, if all members compute the same; otherwise give each member a part of a larger variable"
            yield FIRST_ALONE(message, at=version.at, path=path, help=help)


def memory_of(access: Access) -> str:
    """Return the memory into which the transfers of a read or write phase lead."""
    return "main" if access.kind is AccessKind.WRITE else "dspm"


def shares(access: Access, size: int, members: int) -> list[tuple[int, int, int]]:
    """Return (member, offset, bytes) of what each member of a gang moves of a transfer.

    All of it comes to every member. What goes away is divided: each member writes its part of the variable into that
    part of the buffer, so that none of their results is lost; of a scalar the first one writes all.
    """
    if access.kind is not AccessKind.WRITE:
        return [(member, 0, size) for member in range(members)]
    if size <= SCALAR:
        return [(0, 0, size)]
    part = size // members
    return [(member, member * part, part) for member in range(members)]


def spans(version: Version, *, cut: bool) -> list[tuple[Duration, Duration]]:
    """Return the gaps between phases in execution time; `cut` at the split points, too."""
    assert version.wcet is not None, "models without WCET do not validate"
    found = []
    front = ZERO
    for start, end in [*((a.start, a.end) for a in phases_of(version)), (version.wcet, version.wcet)]:
        if start > front:
            inside = [point for point in version.split.points if front < point < start] if cut else []
            found += [*pairwise([front, *inside, start])]
        front = max(front, end)
    return found


def executions(version: Version, functions: int) -> list[tuple[Duration, Duration]]:
    """Return one stretch of execution time for each function; empty if there are not as many.

    One function has all between what brings data and what takes it away. More have the gaps between phases, or, if
    they are as many, the pieces between phases and split points.
    """
    assert version.wcet is not None, "models without WCET do not validate"
    moving = phases_of(version)
    if functions == 1:
        acquired = max((a.end for a in moving if a.kind is not AccessKind.WRITE), default=ZERO)
        return [(acquired, min((a.start for a in moving if a.kind is AccessKind.WRITE), default=version.wcet))]
    for cut in (False, True):
        found = spans(version, cut=cut)
        if len(found) == functions:
            return found
    return []


def functions_of(version: Version) -> tuple[str, ...]:
    """Return the functions that the entry of a version names."""
    return () if version.source is None else tuple(version.source.entry.split())
