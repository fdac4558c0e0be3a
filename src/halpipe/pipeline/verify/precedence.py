"""Rule precedence: every constraint of a job's chosen version finds its job of the predecessor (MODEL 3; 5, rule 2).

(D) Any present job of the predecessor may serve, also one that serves other jobs or an earlier hyperperiod's. Instants
are not reduced, and of any cycle: a window that leads to an end may begin after the start. A constraint on the same
cycle names its job; in a table between modes, and for a job of the cycle before the switch, it reads as a window.
"""

from __future__ import annotations

from functools import partial
from itertools import chain
from math import gcd
from typing import TYPE_CHECKING, Protocol

from halpipe.core.diagnostics import Diagnostic, Subject
from halpipe.models import Match, Precedence
from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.tables import MAX_LINE, Rule, key_of, points_of, reached
from halpipe.pipeline.verify.ticks import Future, Listed, Past

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from halpipe.pipeline.verify.tables import Clock, Key, ModeTable, Placed, Switch
    from halpipe.pipeline.verify.ticks import Found

    class Findable(Protocol):
        """Instants among which the nearest one can be found."""

        def latest(self, until: int) -> Found:
            """Return the last instant at or before `until`, with its job."""
            ...

        def earliest(self, since: int) -> Found:
            """Return the first instant at or after `since`, with its job."""
            ...


def check_precedence(table: ModeTable) -> Iterator[Diagnostic]:
    """Look for a predecessor of every constraint of every job on the circle.

    The last instant x at or before theta_j - min on the circle unrolled without end gives the smallest difference that
    is at least min; the constraint holds iff that is at most max.
    """
    for placed in table.jobs:
        for constraint in placed.version.precedences if placed.version else ():
            if constraint.match is Match.CYCLE:
                yield from _same_cycle(placed, constraint, table)
                continue
            instants = table.instants.of(constraint.task, key_of(constraint, table.clock))
            found = _witness(placed, constraint, instants.latest, table.clock)
            if found is None or not found[1]:
                text = _fault(placed, constraint, found and found[0], table)
                help = "move one of the two jobs, or change the window"
                yield _out_of_window(text, placed, constraint, table.path(placed), help)


def _out_of_window(text: str, placed: Placed, constraint: Precedence, path: str, help: str) -> Diagnostic:
    before = Subject("task", constraint.task)
    return codes.OUT_OF_WINDOW(text, at=placed.job.at, path=path, help=help, subjects=[before])


def _same_cycle(placed: Placed, constraint: Precedence, table: ModeTable) -> Iterator[Diagnostic]:
    """Compare the job with the one of its cycle, floor(j * D / D'), both where they belong (MODEL 10.3)."""
    before = table.mode.tasks.get(constraint.task)
    period = placed.active.period if before is None else before.period  # of a task that does not run, any
    if not placed.active.period or not period:
        return  # the model's fault
    clock = table.clock
    index = placed.job.index * placed.active.period // period
    window = f"[{constraint.min}, {constraint.max}]"
    own = reached(constraint, placed) + placed.lap
    others = [p for p in table.by_task.get(constraint.task, ()) if p.job.index == index]
    for other in others:
        instant = other.instant(key_of(constraint, clock))
        if instant is not None and clock.ticks(constraint.min) <= own - other.lap - instant <= clock.ticks(
            constraint.max
        ):
            return
    text = f'has its {constraint.to} not within {window} after the {constraint.instant} of "{constraint.task}" job '
    text += f"{index}, that of its cycle"
    text += "" if others else ", which is missing"
    help = "move one of the two jobs, or change the window"
    yield _out_of_window(text, placed, constraint, table.path(placed), help)


def _witness(
    placed: Placed, constraint: Precedence, latest: Callable[[int], Found], clock: Clock
) -> tuple[tuple[int, Placed], bool] | None:
    """Return the nearest predecessor at least min before the job, and whether it is at most max before it."""
    instant = reached(constraint, placed)
    found = latest(instant - clock.ticks(constraint.min))
    if found is None:
        return None
    return found, instant - found[0] <= clock.ticks(constraint.max)


def _fault(placed: Placed, constraint: Precedence, found: Found, table: ModeTable) -> str:
    clock = table.clock
    window = f"[{constraint.min}, {constraint.max}]"
    if found is None:
        return f'needs a job of "{constraint.task}" whose {constraint.instant} lies {window} before it; there is none'
    instant = reached(constraint, placed)
    does = f"{constraint.to}s at {clock.text(instant)}"
    late = instant - found[0] - clock.ticks(constraint.max)
    least = instant - clock.ticks(constraint.min)
    following = table.instants.of(constraint.task, key_of(constraint, clock)).earliest(least)
    if following is not None and following[0] - least < late:
        text = f"{does}, {clock.text(instant - following[0])} after the {constraint.instant} of "
        if following[0] > instant:
            text = f"{does}, {clock.text(following[0] - instant)} before the {constraint.instant} of "
        return text + f"{following[1].label}; the window is {window}: {clock.text(following[0] - least)} too early"
    text = f"{does}, {clock.text(instant - found[0])} after the {constraint.instant} of "
    return text + f"{found[1].label}; the window is {window}: {clock.text(late)} too late"


# ------------------------------------------------------------------------------------------------ switches


class LineInstants:
    """The instants of every task on the line of a switch.

    (D) Mode n has run for ever before the switch and mode m runs for ever after it, so a predecessor (or a step of a
    chain) may lie further from the switch than the two cycles whose jobs are checked. A job is one of mode n if it
    starts before the switch, and of mode m if it starts in one of its cycles.
    """

    def __init__(self, switch: Switch) -> None:
        self._switch = switch
        self._table: dict[str, list[Placed]] = {}
        for placed in switch.jobs:
            self._table.setdefault(placed.job.task, []).append(placed)
        self._made: dict[tuple[str, Key], tuple[Findable, ...]] = {}

    def latest(self, task: str, key: Key, until: int) -> Found:
        """Return the last instant of `task` at or before `until`; two jobs without a fault do not share one."""
        found = [f for f in (part.latest(until) for part in self._parts(task, key)) if f is not None]
        return max(found, key=lambda f: f[0], default=None)

    def earliest(self, task: str, key: Key, since: int) -> Found:
        """Return the first instant of `task` at or after `since`; of equal ones, of the job earlier on the line."""
        found = [f for f in (part.earliest(since) for part in self._parts(task, key)) if f is not None]
        return min(found, key=lambda f: f[0], default=None)

    def _parts(self, task: str, key: Key) -> tuple[Findable, ...]:
        if (task, key) not in self._made:
            self._made[task, key] = self._make(task, key)
        return self._made[task, key]

    def _make(self, task: str, key: Key) -> tuple[Findable, ...]:
        switch = self._switch
        listed = points_of(self._table.get(task, []), key)
        before, after = switch.source.instants.of(task, key), switch.target.instants.of(task, key)
        past = [Past(before)] if before.points else []
        future = [Future(after, switch.length)] if after.points else []
        return (*past, Listed(listed), *future)


def check_precedence_on_line(switch: Switch) -> Iterator[Diagnostic]:
    """Look for a predecessor of every constraint of the table's jobs and of mode m's, each in the cycles in question.

    What is broken in mode m without any switch is left to the rule of that mode.
    """
    line = LineInstants(switch)
    for placed in switch.jobs:
        for constraint in placed.version.precedences if placed.version else ():
            yield from _check_on_line(placed, constraint, line, switch)
    left = MAX_LINE
    for cyclic in switch.target.jobs:
        for constraint in cyclic.version.precedences if cyclic.version else ():
            turns = _turns(cyclic, constraint, switch)
            left -= sum(turn.stop - turn.start for turn in turns)
            if left < 0:
                text = (
                    f'a constraint on "{constraint.task}" looks at another instant of the old mode in too many cycles'
                )
                help = "shorten the window, choose periods with a common divisor, or list only the transitions needed"
                yield codes.TOO_LONG(text, at=switch.table.at, path=switch.path(cyclic), help=help)
                return
            yield from _first_broken(cyclic, constraint, chain(*turns), line, switch)


def _turns(cyclic: Placed, constraint: Precedence, switch: Switch) -> tuple[range, range]:
    """Return the cycles of mode m in which a job may need a predecessor from before it, those that differ.

    As long as the window ends before the switch, the predecessors are those of mode n, and repeat with it.
    """
    if constraint.match is Match.CYCLE:
        return range(0), range(1 if cyclic.lap else 0)
    cycles = _cycles_back(cyclic, constraint, switch.target)
    cycle, least = switch.target.period, switch.clock.ticks(constraint.min)
    before = min(cycles, max(0, -((switch.length + reached(constraint, cyclic) - least) // cycle)))
    repeat = switch.source.period // gcd(cycle, switch.source.period)
    return range(min(before, repeat)), range(before, cycles)


def _cycles_back(placed: Placed, constraint: Precedence, table: ModeTable) -> int:
    """Return how many cycles before a job its nearest predecessor on the circle lies; 0 where the mode has none.

    In so many cycles after a switch the job needs a predecessor from before mode m; in later ones that one serves.
    """
    key = key_of(constraint, table.clock)
    found = _witness(placed, constraint, table.instants.of(constraint.task, key).latest, table.clock)
    if found is None or not found[1]:
        return 0
    instant, before = found[0]
    return ((before.instant(key) or 0) - instant) // table.period


def _first_broken(
    cyclic: Placed, constraint: Precedence, turns: Iterable[int], line: LineInstants, switch: Switch
) -> Iterator[Diagnostic]:
    """Report the first of some cycles of mode m in which a job misses its predecessor."""
    for turn in turns:
        placed = cyclic.moved(switch.length + turn * switch.target.period, f' of mode "{switch.target.name}"')
        broken = list(_check_on_line(placed, constraint, line, switch))
        if broken:
            yield from broken
            return


def _check_on_line(placed: Placed, constraint: Precedence, line: LineInstants, switch: Switch) -> Iterator[Diagnostic]:
    clock = switch.clock
    latest = partial(line.latest, constraint.task, key_of(constraint, clock))
    found = _witness(placed, constraint, latest, clock)
    if found is None or not found[1]:
        window = f"{constraint.instant} lies [{constraint.min}, {constraint.max}] before"
        instant = reached(constraint, placed)
        text = f"{constraint.to}s at {clock.text(instant)} after the switch and needs a job of "
        text += f'"{constraint.task}" whose {window}; {_nearest(instant, found and found[0], clock)}'
        help = "start the predecessor during the switch, or move the jobs"
        yield _out_of_window(text, placed, constraint, switch.path(placed), help)


def _nearest(instant: int, found: Found, clock: Clock) -> str:
    if found is None:
        return "there is none"
    return f"the nearest, {found[1].label}, lies {clock.text(instant - found[0])} before"


PRECEDENCE = Rule(
    "precedence",
    "For every precedence constraint of the version a job uses, a job of the predecessor has its start, end, release "
    "or point at least min and at most max before the job starts (or ends), possibly in an earlier hyperperiod; with "
    "match=cycle, the one of the same cycle.",
    check_precedence,
)
