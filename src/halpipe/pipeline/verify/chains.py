"""Rule chain: latency, reaction time and data age of cause-effect chains (MODEL 3 and 10.7; 5, rule 5).

A job of the next task reads what the newest job of the previous task had written when it read; jobs read at their start
and write at their end, or at their release and their release + LET. Figures are followed over as many hyperperiods as
the chain spans, and count from and to the events that the chain names.

(D) Only chains all of whose tasks run in the mode are looked at. "Newest" is the job that wrote last; "job a + 1" is
the next one that reads later. A chain with a limit through which no data ever arrive breaks its limit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

from halpipe.core.diagnostics import Diagnostic, about
from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.precedence import LineInstants
from halpipe.pipeline.verify.tables import READ, WRITE, Clock, Instants, ModeTable, Placed, Rule, Switch

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from halpipe.core.durations import Duration
    from halpipe.models import Chain
    from halpipe.pipeline.verify.ticks import Found


WHAT = ("latency", "reaction time", "data age")
"""The figures of a chain, in the order in which they are measured and limited."""

Figures: TypeAlias = "tuple[Found, Found, Found]"


def limits(chain: Chain) -> tuple[Duration | None, Duration | None, Duration | None]:
    """Return the limits of the figures of a chain."""
    return chain.max_latency, chain.max_reaction, chain.max_age


def check_chain(table: ModeTable) -> Iterator[Diagnostic]:
    """Compare the worst figures of every chain that runs in the mode with its limits."""
    for chain in table.chains():
        if any(limit is not None for limit in limits(chain)):
            yield from _too_long(table, chain, measured(table, chain, limits(chain)))


def measured(table: ModeTable, chain: Chain, limited: Sequence[object] = (True, True, True)) -> Figures:
    """Return latency, reaction time and data age in ticks at their worst, each with its job; None without data.

    A figure that nothing limits, None in `limited`, is not computed.
    """
    first, last = (table.by_task.get(task, ()) for task in (chain.tasks[0], chain.tasks[-1]))
    return _worst_figures(_Path(chain, table.instants), first, last, limited)


def _worst_figures(paths: _Path, first: Iterable[Placed], last: Iterable[Placed], limited: Sequence[object]) -> Figures:
    ways = (
        (paths.forward(placed) for placed in first),
        (paths.forward(placed, placed.read + 1) for placed in first),  # of a stimulus that it just missed
        (paths.backward(placed) for placed in last),
    )
    latency, reaction, age = (
        None if limit is None else _worst(found) for limit, found in zip(limited, ways, strict=True)
    )
    return latency, reaction, age


def _too_long(table: ModeTable | Switch, chain: Chain, figures: Figures, where: str = "") -> Iterator[Diagnostic]:
    """Report the figures beyond their limits; in a mode, no data at all is beyond any."""
    for what, limit, found in zip(WHAT, limits(chain), figures, strict=True):
        if limit is None or (found is None and where) or (found and found[0] <= table.clock.ticks(limit)):
            continue
        text = _fault(what, limit, found, table.clock) + where
        help = "start its tasks during the switch" if where else "move its jobs closer together"
        yield codes.CHAIN_LIMIT(
            text, at=table.at, path=about(table.path(), chain=chain.name), help=f"{help}, or raise the limit"
        )


def _fault(what: str, limit: Duration, found: Found, clock: Clock) -> str:
    if found is None:
        return f"no data ever arrives, its limit of {what} is {limit}"
    latency, placed = found
    text = f"{what} {clock.text(latency)} for {placed.label} at {clock.text(placed.start)}, the limit is {limit}"
    return text + f": {clock.text(latency - clock.ticks(limit))} too long"


def _worst(latencies: Iterator[Found]) -> Found:
    found = [latency for latency in latencies if latency is not None]
    return max(found, key=lambda pair: pair[0]) if found else None


class _Path:
    """The paths of data through a chain, in a mode or on the line of a switch.

    `is_counted` tells whether a path counts by the starts of its first and its last job.
    """

    def __init__(
        self,
        chain: Chain,
        instants: Instants | LineInstants,
        is_counted: Callable[[int, int], bool] = lambda first, last: True,
    ) -> None:
        self._tasks = chain.tasks
        self._instants = instants
        self._is_counted = is_counted
        self._from = READ if chain.anchor is None else (str(chain.anchor), 0)
        self._to = WRITE if chain.to is None else (str(chain.to), 0)

    def forward(self, first: Placed, since: int | None = None) -> Found:
        """Follow what `first` writes to the last task, or what arrives at `since`, a whole tick; count from `first`."""
        last, by = first, 0
        for task in self._tasks[0 if since is not None else 1 :]:
            if since is None:
                written = last.instant(WRITE)
                if written is None:
                    return None
                since = written + by
            found = self._instants.earliest(task, READ, since)
            if found is None:
                return None
            last, by, since = found[1], found[0] - found[1].read, None
        return self._count(first, 0, last, by, first)

    def backward(self, last: Placed) -> Found:
        """Trace what `last` reads back to the first task."""
        read, first, by = last.read, last, 0
        for task in self._tasks[-2::-1]:
            found = self._instants.latest(task, WRITE, read)
            if found is None:
                return None
            first, by = found[1], found[0] - (found[1].instant(WRITE) or 0)
            read = first.read + by
        return self._count(first, by, last, 0, last)

    def _count(self, first: Placed, first_by: int, last: Placed, last_by: int, blamed: Placed) -> Found:
        """Return the time from the event of the first job to that of the last one, each moved by some ticks."""
        begin, end = first.instant(self._from), last.instant(self._to)
        if begin is None or end is None or not self._is_counted(first.start + first_by, last.start + last_by):
            return None
        return end + last_by - begin - first_by, blamed


# ------------------------------------------------------------------------------------------------ switches


def check_chain_on_line(switch: Switch) -> Iterator[Diagnostic]:
    """Check every chain that runs in both modes, for each of its paths that crosses the switch.

    Each step waits less than a hyperperiod and takes at most one, or a LET, so a path that crosses lies in two cycles
    per task, or as many more as a LET lasts, of each mode.
    """
    within = {chain.name for chain in switch.source.chains()}
    line = LineInstants(switch)
    for chain in switch.target.chains():
        if chain.name not in within or all(limit is None for limit in limits(chain)):
            continue
        paths = _Path(chain, line, lambda first, last: first < switch.length and last >= 0)
        before, after = (_turns(table, chain) for table in (switch.source, switch.target))
        head, tail = chain.tasks[0], chain.tasks[-1]
        first = [*switch.before(before, head), *(p for p in switch.jobs if p.job.task == head)]
        last = [*(p for p in switch.jobs if p.job.task == tail), *switch.after(after, tail)]
        yield from _too_long(switch, chain, _worst_figures(paths, first, last, limits(chain)), " across the switch")


def _turns(table: ModeTable, chain: Chain) -> int:
    lets = (table.mode.tasks[name].let or 0 for name in chain.tasks)
    return sum(1 + max(1, -(-let // table.period)) for let in lets)


CHAIN = Rule(
    "chain",
    "Every cause-effect chain whose tasks run in the mode keeps its limits of latency, reaction time and data age.",
    check_chain,
)
