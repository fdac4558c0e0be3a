"""Rule chain: reaction time and data age of cause-effect chains (MODEL 3; 5, rule 5).

A job of the next task reads what the newest job of the previous task had finished when it started. Latencies are
followed over as many hyperperiods as the chain spans.

(D) Only chains all of whose tasks run in the mode are looked at. "Newest" is the job that ended last; "job a + 1" is
the next one that starts later. A chain with a limit through which no instance ever gets breaks its limit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.models import Anchor
from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.precedence import LineInstants
from halpipe.pipeline.verify.recurrence import Listed
from halpipe.pipeline.verify.rules import Rule

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.core.durations import Duration
    from halpipe.models import Chain
    from halpipe.pipeline.verify.recurrence import Found
    from halpipe.pipeline.verify.tables import Clock, ModeTable, Placed, Switch

    Search = Callable[[str, int], Found]
    """The first start of a task since a time, or its last end until a time."""


def check_chain(table: ModeTable) -> Iterator[Diagnostic]:
    """Compare the worst latencies of every chain that runs in the mode with its limits."""
    for chain in table.chains():
        worst = (reaction(table, chain), age(table, chain))
        for what, limit, found in zip(WHAT, (chain.max_reaction, chain.max_age), worst, strict=True):
            if limit is not None and (found is None or found[0] > table.clock.ticks(limit)):
                help = "move its jobs closer together, or raise the limit"
                path = about(table.path(), chain=chain.name)
                yield codes.CHAIN_LIMIT(_fault(what, limit, found, table.clock), at=table.at, path=path, help=help)


WHAT = ("reaction time", "data age")


def _fault(what: str, limit: Duration, found: Found, clock: Clock) -> str:
    if found is None:
        return f"no data ever arrives, its limit of {what} is {limit}"
    latency, placed = found
    text = f"{what} {clock.text(latency)} for {placed.label} at {clock.text(placed.start)}, the limit is {limit}"
    return text + f": {clock.text(latency - clock.ticks(limit))} too long"


def reaction(table: ModeTable, chain: Chain) -> Found:
    """Return the worst reaction time in ticks and the job that just missed the stimulus; None if no data arrives."""

    def first(task: str, since: int) -> Found:
        return table.instants.of(task, Anchor.START).earliest(since)

    return _worst(_reaction(placed, chain.tasks, first) for placed in table.by_task.get(chain.tasks[0], ()))


def age(table: ModeTable, chain: Chain) -> Found:
    """Return the worst data age in ticks, with the job that puts the data out; None if no data arrives."""

    def last(task: str, until: int) -> Found:
        return table.instants.of(task, Anchor.END).latest(until)

    jobs = _known(table.by_task.get(chain.tasks[-1], ()))
    return _worst(_age(placed, chain.tasks[-2::-1], last) for placed in jobs)


def _known(jobs: Sequence[Placed]) -> list[Placed]:
    return [p for p in jobs if p.span is not None]


def _worst(latencies: Iterator[tuple[int, Placed] | None]) -> Found:
    found = [latency for latency in latencies if latency is not None]
    return max(found, key=lambda pair: pair[0]) if found else None


def _reaction(missed: Placed, tasks: Sequence[str], first: Search) -> Found:
    """Follow a stimulus that arrives just after `missed` starts through `tasks`."""
    end = _follow(missed.start + 1, tasks, first)
    return None if end is None else (end[0] - missed.start, missed)


def _follow(since: int, tasks: Sequence[str], first: Search) -> tuple[int, int] | None:
    """Return the end and the start of the last job that a stimulus at `since` leads to; starts are whole ticks."""
    start = end = since
    for task in tasks:
        found = first(task, end)
        if found is None or found[1].span is None:
            return None
        start, end = found[0], found[0] + found[1].span
    return end, start


def _age(placed: Placed, tasks: Sequence[str], last: Search) -> Found:
    """Trace the data that `placed` reads back through `tasks`, and return its age when `placed` ends."""
    start = _trace(placed, tasks, last)
    return None if start is None else (placed.end - start, placed)


def _trace(placed: Placed, tasks: Sequence[str], last: Search) -> int | None:
    """Return the start of the first job of the trace."""
    start = placed.start
    for task in tasks:
        found = last(task, start)
        if found is None:
            return None
        start = found[0] - (found[1].end - found[1].start)
    return start


# ------------------------------------------------------------------------------------------------ switches


def check_chain_on_line(switch: Switch) -> Iterator[Diagnostic]:
    """Check every chain that runs in both modes, for each of its paths that crosses the switch.

    Each step waits less than a hyperperiod and takes at most one, so a path that crosses lies in two cycles per task,
    less one, of each mode.
    """
    within = {chain.name for chain in switch.source.chains()}
    line = _Line(switch)
    for chain in switch.target.chains():
        if chain.name not in within or (chain.max_reaction is None and chain.max_age is None):
            continue
        turns = 2 * len(chain.tasks) - 1
        worst = (_worst(line.reactions(chain, turns)), _worst(line.ages(chain, turns)))
        for what, limit, found in zip(WHAT, (chain.max_reaction, chain.max_age), worst, strict=True):
            if limit is not None and found is not None and found[0] > switch.clock.ticks(limit):
                help = "start its tasks during the switch, or raise the limit"
                path = about(switch.path(), chain=chain.name)
                text = _fault(what, limit, found, switch.clock) + " across the switch"
                yield codes.CHAIN_LIMIT(text, at=switch.table.at, path=path, help=help)


class _Line:
    """The paths of chains along the line of a switch."""

    def __init__(self, switch: Switch) -> None:
        self._switch = switch
        self._instants = LineInstants(switch)
        self._listed: dict[str, Listed] = {}

    def _first(self, task: str, since: int) -> Found:
        switch = self._switch
        found = switch.source.instants.of(task, Anchor.START).earliest(since)
        if found is not None and found[0] < 0:
            return found
        if task not in self._listed:
            jobs = sorted((p for p in switch.jobs if p.job.task == task), key=lambda p: p.job.index)
            self._listed[task] = Listed([(p.start, p) for p in jobs])
        found = self._listed[task].earliest(since)
        if found is not None:
            return found
        since = max(since - switch.length, 0)
        found = switch.target.instants.of(task, Anchor.START).earliest(since)
        return (found[0] + switch.length, found[1]) if found else None

    def _last(self, task: str, until: int) -> Found:
        return self._instants.latest(task, Anchor.END, until)

    def reactions(self, chain: Chain, turns: int) -> Iterator[Found]:
        """Yield the reaction times of the paths that do not lie within one of the modes."""
        for missed in (*self._switch.before(turns), *self._switch.jobs):
            if missed.job.task == chain.tasks[0]:
                path = _follow(missed.start + 1, chain.tasks, self._first)
                if path is not None and path[1] >= 0:
                    yield path[0] - missed.start, missed

    def ages(self, chain: Chain, turns: int) -> Iterator[Found]:
        """Yield the data ages of the paths that do not lie within one of the modes."""
        for placed in _known([*self._switch.jobs, *self._switch.after(turns)]):
            if placed.job.task == chain.tasks[-1]:
                start = _trace(placed, chain.tasks[-2::-1], self._last)
                if start is not None and start < self._switch.length:
                    yield placed.end - start, placed


CHAIN = Rule(
    "chain",
    "Every cause-effect chain whose tasks run in the mode keeps its limits of reaction time and data age.",
    check_chain,
)
