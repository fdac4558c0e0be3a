"""Rule precedence: every constraint of a job's chosen version finds its job of the predecessor (MODEL 3; 5, rule 2).

(D) Any present job of the predecessor may serve, also one that serves other jobs or an earlier hyperperiod's. An end
counts where it falls, also beyond the hyperperiod: x = t_n, not reduced.
"""

from __future__ import annotations

from itertools import chain
from math import gcd
from typing import TYPE_CHECKING, Protocol

from halpipe.core.diagnostics import Subject
from halpipe.models import Anchor
from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.recurrence import Future, Listed, Past
from halpipe.pipeline.verify.rules import Rule
from halpipe.pipeline.verify.tables import MAX_LINE

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Precedence
    from halpipe.pipeline.verify.recurrence import Found
    from halpipe.pipeline.verify.tables import Clock, ModeTable, Placed, Switch

    class Findable(Protocol):
        """Instants among which the last one up to a time can be found."""

        def latest(self, until: int) -> Found:
            """Return the last instant at or before `until`, with its job."""
            ...


def check_precedence(table: ModeTable) -> Iterator[Diagnostic]:
    """Look for a predecessor of every constraint of every job on the circle.

    The last instant x at or before theta_j - min on the circle unrolled without end gives the smallest difference that
    is at least min; the constraint holds iff that is at most max. As min >= 0 and x_k >= 0, its m is never negative.
    """
    for placed in table.jobs:
        for constraint in placed.version.precedences if placed.version else ():
            found = _witness(
                placed.start, constraint, table.instants.of(constraint.task, constraint.anchor), table.clock
            )
            if found is None or not found[1]:
                text = _fault(placed, constraint, found and found[0], table)
                help = "move one of the two jobs, or change the window"
                yield _out_of_window(text, placed, constraint, table.path(placed), help)


def _out_of_window(text: str, placed: Placed, constraint: Precedence, path: str, help: str) -> Diagnostic:
    before = Subject("task", constraint.task)
    return codes.OUT_OF_WINDOW(text, at=placed.job.at, path=path, help=help, subjects=[before])


def _witness(
    start: int, constraint: Precedence, instants: Findable, clock: Clock
) -> tuple[tuple[int, Placed], bool] | None:
    """Return the nearest predecessor at least min before `start`, and whether it is at most max before it."""
    found = instants.latest(start - clock.ticks(constraint.min))
    if found is None:
        return None
    return found, start - found[0] <= clock.ticks(constraint.max)


def _fault(placed: Placed, constraint: Precedence, found: Found, table: ModeTable) -> str:
    clock = table.clock
    window = f"[{constraint.min}, {constraint.max}]"
    if found is None:
        return f'needs a job of "{constraint.task}" whose {constraint.anchor} lies {window} before it; there is none'
    late = placed.start - found[0] - clock.ticks(constraint.max)
    least = placed.start - clock.ticks(constraint.min)
    following = table.instants.of(constraint.task, constraint.anchor).earliest(least)
    if following is not None and following[0] - least < late:
        text = (
            f"starts at {placed.job.start}, {clock.text(placed.start - following[0])} after the {constraint.anchor} of "
        )
        if following[0] > placed.start:
            text = f"starts at {placed.job.start}, {clock.text(following[0] - placed.start)} before the "
            text += f"{constraint.anchor} of "
        return text + f"{following[1].label}; the window is {window}: {clock.text(following[0] - least)} too early"
    text = f"starts at {placed.job.start}, {clock.text(placed.start - found[0])} after the {constraint.anchor} of "
    return text + f"{found[1].label}; the window is {window}: {clock.text(late)} too late"


# ------------------------------------------------------------------------------------------------ switches


class LineInstants:
    """The starts and ends of every task on the line of a switch.

    (D) Mode n has run for ever before the switch and mode m runs for ever after it, so a predecessor (or a step of a
    chain) may lie further from the switch than the two cycles whose jobs are checked.
    """

    def __init__(self, switch: Switch) -> None:
        self._switch = switch
        self._made: dict[tuple[str, Anchor], tuple[Findable, ...]] = {}

    def latest(self, task: str, anchor: Anchor, until: int) -> Found:
        """Return the last start (or end) of `task` at or before `until`; of equal ones, the job started later."""
        if (task, anchor) not in self._made:
            self._made[task, anchor] = self._parts(task, anchor)
        found = [f for f in (part.latest(until) for part in self._made[task, anchor]) if f is not None]
        return max(found, key=lambda f: (f[0], f[1].start - f[1].end)) if found else None

    def _parts(self, task: str, anchor: Anchor) -> tuple[Findable, ...]:
        switch = self._switch
        listed = sorted((p for p in switch.jobs if p.job.task == task), key=lambda p: (p.start, p.job.index))
        if anchor is Anchor.START:
            points = [(p.start, p) for p in listed]
        else:
            points = [(p.end, p) for p in listed if p.span is not None]
        before, after = switch.source.instants.of(task, anchor), switch.target.instants.of(task, anchor)
        past = [Past(before)] if before.points else []
        future = [Future(after, switch.length)] if after.points else []
        return (*past, Listed(points), *future)


class _Of:
    """The instants of one constraint's predecessor."""

    def __init__(self, line: LineInstants, constraint: Precedence) -> None:
        self._line = line
        self._constraint = constraint

    def latest(self, until: int) -> Found:
        return self._line.latest(self._constraint.task, self._constraint.anchor, until)


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
    cycles = _cycles_back(cyclic, constraint, switch.target)
    cycle, least = switch.target.period, switch.clock.ticks(constraint.min)
    before = min(cycles, max(0, -((switch.length + cyclic.start - least) // cycle)))
    repeat = switch.source.period // gcd(cycle, switch.source.period)
    return range(min(before, repeat)), range(before, cycles)


def _cycles_back(placed: Placed, constraint: Precedence, table: ModeTable) -> int:
    """Return how many cycles before a job its nearest predecessor on the circle lies; 0 where the mode has none.

    In so many cycles after a switch the job needs a predecessor from before mode m; in later ones that one serves.
    """
    found = _witness(placed.start, constraint, table.instants.of(constraint.task, constraint.anchor), table.clock)
    if found is None or not found[1]:
        return 0
    instant, before = found[0]
    own = before.start if constraint.anchor is Anchor.START else before.end
    return (own - instant) // table.period


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
    found = _witness(placed.start, constraint, _Of(line, constraint), clock)
    if found is None or not found[1]:
        window = f"{constraint.anchor} lies [{constraint.min}, {constraint.max}] before"
        text = f'starts at {clock.text(placed.start)} after the switch and needs a job of "{constraint.task}" whose '
        text += f"{window}; {_nearest(placed, found and found[0], clock)}"
        help = "start the predecessor during the switch, or move the jobs"
        yield _out_of_window(text, placed, constraint, switch.path(placed), help)


def _nearest(placed: Placed, found: Found, clock: Clock) -> str:
    if found is None:
        return "there is none"
    return f"the nearest, {found[1].label}, lies {clock.text(placed.start - found[0])} before"


PRECEDENCE = Rule(
    "precedence",
    "For every precedence constraint of the version a job uses, a job of the predecessor starts (or ends) at least min "
    "and at most max before the job starts, possibly in an earlier hyperperiod.",
    check_precedence,
)
