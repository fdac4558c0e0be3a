"""Lateness of the management core: it serves one operation at a time, and several may be due at once.

All operations are known, so this is computed and not estimated: tables are played, two in a row and around every
switch, with the longest time that an operation takes.
"""

from __future__ import annotations

import math
from collections import defaultdict
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.exporters.riscv.codes import PHASE_TOO_SHORT
from halpipe.exporters.riscv.render import DECISION

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.exporters.riscv.images import Part
    from halpipe.exporters.riscv.operations import Operation, Program, Table
    from halpipe.exporters.riscv.profile import Profile

_RELEASE, _DECIDE = 1, 3
"""The orders of a release or the end of a table, and of the look at the mailbox, among what is due at one tick."""


@record
class Backlog:
    """The greatest lateness of every operation, by (program, position), and of all in each table, by its index."""

    operations: dict[tuple[int, int], Duration]
    tables: dict[int, Duration]


def find_backlog(tables: Sequence[Table], programs: Sequence[Program], profile: Profile) -> Backlog:
    """Play every mode twice, and every switch between its modes."""
    found = Backlog({}, defaultdict(lambda: ZERO))
    modes = [i for i, table in enumerate(tables) if table.is_mode]
    for mode in modes:
        _play([mode, mode], tables, programs, profile, found)
    for index, table in enumerate(tables):
        if not table.is_mode:
            _play([table.origin, index, table.target], tables, programs, profile, found)
    return found


def _play(
    line: Sequence[int], tables: Sequence[Table], programs: Sequence[Program], profile: Profile, found: Backlog
) -> None:
    """Serve all that is due on a line of tables, first come first served at equal ticks by their order."""
    due: list[tuple[int, int, int, Duration, tuple[int, int] | None]] = []  # tick, order, table, driver, operation
    start = 0
    for index in line:
        table = tables[index]
        for release in table.releases:
            due.append((start + release.tick, _RELEASE, index, ZERO, None))
            for position, operation in enumerate(programs[release.program].operations):
                tick, order = operation.key
                place = (release.program, position)
                due.append((start + release.tick + tick, order, index, operation.time, place))
        start += table.length
        due.append((start, _RELEASE, index, ZERO, None))
        if table.is_mode:
            due.append((start - DECISION, _DECIDE, index, ZERO, None))
    free = ZERO
    for tick, _, index, time, which in sorted(due, key=lambda d: d[:2]):
        instant = profile.tick * tick
        late = free - instant if free > instant else ZERO
        free = instant + late + profile.service + time
        found.tables[index] = max(found.tables[index], late)
        if which is not None:
            found.operations[which] = max(found.operations.get(which, ZERO), late)


def too_short(
    programs: Sequence[Program], backlog: Backlog, parts: Iterable[Part], profile: Profile
) -> Iterable[Diagnostic]:
    """Yield the phases that do not hold their transfers, given how late these may start."""
    owners = {(part.task, part.version.name): part for part in parts}
    told = set()
    for index, program in enumerate(programs):
        for position, operation in enumerate(program.operations):
            late = backlog.operations.get((index, position), ZERO)
            if operation.access is None or math.ceil(late / profile.tick) + operation.needs <= operation.limit:
                continue
            part = owners[program.task, program.version]
            key = (part.path, operation.access.start)
            if key not in told:
                told.add(key)
                yield _finding(part, operation, late, profile)


def _finding(part: Part, operation: Operation, late: Duration, profile: Profile) -> Diagnostic:
    assert operation.access is not None
    needed = profile.tick * operation.needs
    message = f"the {operation.access.kind} phase has {profile.tick * operation.limit}, its transfers need {needed}"
    if late:
        message += f", and the management core may begin them {late} late, for it has other operations to do"
    help = "run `halpipe deploy prepare` with the same profile and toolchain, and schedule the prepared model"
    return PHASE_TOO_SHORT(message, at=operation.access.at, path=part.path, help=help)
