"""Measured end-to-end figures of cause-effect chains: latency, reaction time and data age (MODEL 10.7).

The definitions are those of the verified figures, applied to each job that ran instead of the worst case of a table. A
job reads where it starts and writes where it ends, with a logical execution time at its release and at release + LET;
a path that leaves the recording is not counted.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import defaultdict
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Severity, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.core.samples import quantile
from halpipe.core.suggest import counted
from halpipe.models import Anchor
from halpipe.models.trace import NONE
from halpipe.pipeline.compare.codes import CHAIN_EXCEEDED, NOT_MEASURED
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.cost import with_latencies
from halpipe.pipeline.measure.placement import Placement

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Chain, ChainLatency, Schedule, TaskModel
    from halpipe.pipeline.compare.matching import Matching

FIGURES = ("latency", "reaction", "age")


@record(kw_only=True)
class ChainRow:
    """A figure of a chain over all paths of a recording, beside the verified worst case and the limit of the model."""

    chain: str
    figure: str
    count: int
    least: Duration | None = None
    median: Duration | None = None
    p99: Duration | None = None
    worst: Duration | None = None
    verified: Duration | None = None
    limit: Duration | None = None


Span = tuple["int | Fraction", "int | Fraction"]
"""When a job reads and writes."""


def measured_chains(
    model: TaskModel, schedule: Schedule, played: Mapping[int, str], matching: Matching
) -> list[ChainRow]:
    """Return the figures of the chains of the model that run in a mode of `played`, the tables by their cycles.

    A path ends where a table without the chain is played.
    """
    names = set(played.values())
    modes = with_latencies(model, schedule.alone(tuple(m for m in schedule.modes if m.name in names))).modes
    active = {}
    for chain in filter(partial(is_measurable, model), model.chains):
        if own := {mode.name: row for mode in modes for row in mode.chains if row.name == chain.name}:
            active[chain] = own
    spans: dict[str, list[tuple[int | None, Span]]] = defaultdict(list)
    wanted = {task for chain in active for task in chain.tasks}
    for cycle, task, span in _spans(model, schedule, matching, wanted) if wanted else ():
        spans[task].append((cycle, span))
    rows = []
    for chain, own in active.items():
        between = {t.name for t in schedule.transitions if t.source in own and t.target in own}
        parts = _parts(chain, played, {*own, *between}, spans)
        for figure in FIGURES:
            values = [value for members in parts for value in _values(figure, members, chain)]
            rows.append(_row(chain, figure, values, list(own.values())))
    return rows


def _parts(
    chain: Chain, played: Mapping[int, str], active: set[str], spans: Mapping[str, Sequence[tuple[int | None, Span]]]
) -> list[list[list[Span]]]:
    """Return when the jobs of each task of a chain read and write, for each part of the run in which it is active."""
    number = 0
    part_of: dict[int, int | None] = {}
    for cycle in sorted(played):
        number += played[cycle] not in active
        part_of[cycle] = number if played[cycle] in active else None
    elsewhere = 0 if len(set(played.values())) == 1 else None
    found: dict[tuple[int | None, str], list[Span]] = defaultdict(list)
    for task in set(chain.tasks):
        for ran, span in spans.get(task, ()):
            found[elsewhere if ran is None else part_of.get(ran, elsewhere), task].append(span)
    return [[sorted(found[part, name]) for name in chain.tasks] for part in range(number + 1)]


def is_measurable(model: TaskModel, chain: Chain) -> bool:
    """Tell whether recorded starts and ends decide the figures: of releases only those of LETs are known."""
    first, last = (model.task(chain.tasks[at]).let is not None for at in (0, -1))
    begins = chain.anchor in (None, Anchor.RELEASE) if first else chain.anchor is not Anchor.RELEASE
    return begins and (chain.to is None if last else chain.to is not Anchor.RELEASE)


def _spans(
    model: TaskModel, schedule: Schedule, matching: Matching, wanted: Collection[str]
) -> Iterator[tuple[int | None, str, Span]]:
    """Yield the cycle, the task, and when it read and wrote, of each job of the `wanted` tasks that had data.

    One with a LET lasts from its read to its write (MODEL 10.6). If it ends after its write, it leaves the datum of the
    one before, so it takes part in no chain.
    """
    lets = {task.name: task.let.ns for task in model.tasks if task.let is not None}
    delays: dict[tuple[str, str, int], Duration] = {}
    for mode in schedule.modes if lets else ():
        placement = Placement.of(expand(model, model.mode(mode.name)), mode.jobs, model.units)
        for job in placement.jobs:
            delays[mode.name, job.active.name, job.index] = placement.tick * placement.delay(job)
    seen, lines = matching.executions, matching.lines
    names = {number: name for number, name in enumerate(seen.names) if name in wanted}
    for row in (*matching.rows(), *matching.extra):
        name, end, line = names.get(seen.task[row]), seen.end[row], matching.line[row]
        if name is None or end == NONE or seen.has_data.get(row) is False:
            continue
        let = lets.get(name)
        if let is None:
            cycle = seen.cycle[row] if line < 0 else lines.cycle[line]
            yield None if cycle == NONE else cycle, name, (seen.start[row], end)
        elif line >= 0:
            # A job of a table between modes is released when it starts.
            late = delays.get((lines.table[line].name, name, matching.due(row).job.index), ZERO)
            read = matching.origin + matching.start(row) - late.ns
            if end <= read + let:
                yield lines.cycle[line], name, (read, read + let)


def deviations(
    model: TaskModel, rows: Sequence[ChainRow], allowance: Duration, prefix: str, *, one_mode: bool
) -> Iterator[Diagnostic]:
    """Yield the figures beyond their bounds, and the chains that cannot be measured.

    The verified worst cases are those of `one_mode`: across a switch only the limits of the model hold (MODEL 5).
    """
    for row in rows:
        path = prefix + about(chain=row.chain)
        if row.worst is None:
            continue
        if row.limit is not None and row.worst > row.limit + allowance:
            message = f"{row.figure} of {row.worst} measured, the limit of the model is {row.limit}"
            yield CHAIN_EXCEEDED(message, path=path, help="remove the deviations of its jobs")
        elif one_mode and row.verified is not None and row.worst > row.verified + allowance:
            message = f"{row.figure} of {row.worst} measured, the verified worst case is {row.verified}"
            help = "remove the deviations of its jobs, or lower the tolerance to see them"
            yield CHAIN_EXCEEDED(message, path=path, help=help, severity=Severity.WARNING)
    if left := [chain.name for chain in model.chains if not is_measurable(model, chain)]:
        message = f"counted from or to releases: {counted(len(left), 'chain')}: {', '.join(left[:5])}"
        yield NOT_MEASURED(prefix + message, help="compare the starts and ends of their tasks")


def _row(chain: Chain, figure: str, values: list[int | Fraction], verified: Sequence[ChainLatency]) -> ChainRow:
    bounds: list[Duration | None] = [getattr(row, figure) for row in verified]
    known = [bound for bound in bounds if bound is not None]
    values.sort()

    def at(percent: int) -> Duration | None:
        return Duration(quantile(values, Fraction(percent, 100))) if values else None

    return ChainRow(
        chain=chain.name,
        figure=figure,
        count=len(values),
        least=Duration(values[0]) if values else None,
        median=at(50),
        p99=at(99),
        worst=at(100),
        verified=max(known) if known and len(known) == len(bounds) else None,
        limit=getattr(chain, f"max_{figure}"),
    )


def _values(figure: str, members: Sequence[list[Span]], chain: Chain) -> list[int | Fraction]:
    """Return the figure of each path; members are sorted by the instants at which they read."""
    paths: list[tuple[Span | None, Span | None]]
    begin, end = int(chain.anchor is Anchor.END), int(chain.to is not Anchor.START)
    firsts, lasts = members[0], members[-1]
    if figure == "age":
        by_write = [sorted(spans, key=lambda span: (span[1], span[0])) for spans in members[:-1]]
        paths = [(_backward(by_write, last), last) for last in lasts]
    elif figure == "latency":
        paths = [(first, _forward(members[1:], first)) for first in firsts]
    else:  # from the job that just missed the stimulus, by way of the next one
        following = [bisect_right(firsts, first[0], key=lambda span: span[0]) for first in firsts]
        pairs = [(first, firsts[n]) for first, n in zip(firsts, following, strict=True) if n < len(firsts)]
        paths = [(missed, _forward(members[1:], seen)) for missed, seen in pairs]
    return [last[end] - first[begin] for first, last in paths if first is not None and last is not None]


def _forward(members: Sequence[list[Span]], span: Span) -> Span | None:
    """Return the last job to which the data of a job lead: each time the first that reads once they are written."""
    for spans in members:
        reached = bisect_left(spans, span[1], key=lambda other: other[0])
        if reached == len(spans):
            return None
        span = spans[reached]
    return span


def _backward(members: Sequence[list[Span]], span: Span) -> Span | None:
    """Return the first job from which the data of a job come: each time the latest that had written by its start."""
    for spans in reversed(members):
        reached = bisect_right(spans, span[0], key=lambda other: other[1]) - 1
        if reached < 0:
            return None
        span = spans[reached]
    return span
