"""Sequence of tables in a run: effects of mode requests, and requests that visit every table.

A mode request is taken a little before the end of a mode's hyperperiod; then the table of the transition and the new
mode follow. Written from docs/reference/riscv-bundle.md, not from the runtime, which is checked by it.
"""

from __future__ import annotations

from collections import deque
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.deploy.riscv.target import DECISION
from halpipe.models.modes import tour

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.models import Job, Schedule


@record
class Played:
    """A table in a run: the `cycle`-th, from `start` for `length`; a mode, or ``a->b`` for a transition.

    At its end so many requests have to be `refused`.
    """

    cycle: int
    name: str
    start: Duration
    length: Duration
    jobs: tuple[Job, ...]
    source: str = ""
    refused: int = 0

    @property
    def is_transition(self) -> bool:
        """Whether it leads from one mode to another."""
        return bool(self.source)


@record
class Request:
    """A mode that is asked for at an instant from the beginning of the run."""

    instant: Duration
    mode: str


@record
class Wish:
    """A mode that a health rule wants from an instant on; the least `priority` goes before others."""

    instant: Duration
    mode: str
    priority: int


@record
class Tour:
    """A run: the mode it begins with, what is requested in it, and how many tables it plays."""

    first: str
    requests: tuple[Request, ...]
    tables: int


def played_tables(
    schedule: Schedule,
    first: str,
    requests: Sequence[Request],
    tables: int,
    tick: Duration,
    wishes: Sequence[Wish] = (),
    stop: Duration | None = None,
) -> list[Played]:
    """Return the tables that have to be played, `tables` of them, each where it begins.

    What health rules wish goes before what is requested; none follows the one in which a rule has the run `stop`.
    """
    switches = {(t.source, t.target): t for t in schedule.transitions}
    waiting = deque(sorted(requests, key=lambda request: request.instant))
    left = sorted(wishes, key=lambda wish: wish.instant)
    found: list[Played] = []
    mode, now = first, ZERO
    while len(found) < tables and (stop is None or now < stop):
        table = schedule.mode(mode)
        start, now = now, now + table.hyperperiod
        wanted = mode
        while waiting and waiting[0].instant <= now - tick * DECISION:
            wanted = waiting.popleft().mode
        due = [wish for wish in left if wish.instant <= now - tick * DECISION]
        left = left[len(due) :]
        healthy = min(due, key=lambda wish: wish.priority).mode if due else mode
        refused = int(mode != wanted != healthy != mode)
        wanted = healthy if healthy != mode else wanted
        switch = switches.get((mode, wanted))
        refused += wanted != mode and switch is None
        found.append(Played(len(found), mode, start, table.hyperperiod, table.jobs, refused=refused))
        if switch is not None and len(found) < tables and (stop is None or now < stop):
            found.append(Played(len(found), switch.name, now, switch.length, switch.jobs, source=mode))
            now += switch.length
        if switch is not None:
            mode = wanted
    return found


def tables_named(schedule: Schedule, names: Sequence[str]) -> list[Played]:
    """Return the tables with these names one after the other, leaving out what the schedule does not have."""
    modes = {mode.name: mode for mode in schedule.modes}
    switches = {t.name: t for t in schedule.transitions}
    found: list[Played] = []
    for name in names:
        now = found[-1].start + found[-1].length if found else ZERO
        if name in modes:
            mode = modes[name]
            found.append(Played(len(found), name, now, mode.hyperperiod, mode.jobs))
        elif name in switches:
            switch = switches[name]
            found.append(Played(len(found), name, now, switch.length, switch.jobs, source=switch.source))
    return found


def tours(schedule: Schedule, cycles: int) -> list[Tour]:
    """Return runs that together play every mode and every transition, each mode for at least `cycles` hyperperiods."""
    untaken = dict.fromkeys((t.source, t.target) for t in schedule.transitions)
    unseen = [mode.name for mode in schedule.modes]
    found = []
    while unseen or untaken:
        sources = {source for source, _ in untaken}
        first = next((mode.name for mode in schedule.modes if mode.name in sources), "") or unseen[0]
        walk = [first, *tour(first, schedule.transitions, untaken)]
        unseen = [name for name in unseen if name not in walk]
        found.append(_tour(schedule, walk, cycles))
    return found


def _tour(schedule: Schedule, walk: list[str], cycles: int) -> Tour:
    """Request every further mode of `walk` in the middle of the last hyperperiod of the one before.

    In the first hyperperiod of each, where there are more, a mode is requested to which no table leads; at the end of
    the walk the mode that is played, which has no effect.
    """
    lengths = {(t.source, t.target): t.length for t in schedule.transitions}
    requests = []
    now, tables = ZERO, 0
    for i, mode in enumerate(walk):
        hyperperiod = schedule.mode(mode).hyperperiod
        tables += cycles
        refused = next((m.name for m in schedule.modes if (mode, m.name) not in lengths and m.name != mode), "")
        if refused and cycles > 1:
            requests.append(Request(now + hyperperiod / 2, refused))
        requests.append(Request(now + hyperperiod * Fraction(2 * cycles - 1, 2), walk[min(i + 1, len(walk) - 1)]))
        if i + 1 < len(walk):
            now += hyperperiod * cycles + lengths[mode, walk[i + 1]]
            tables += 1
    return Tour(walk[0], tuple(requests), tables)
