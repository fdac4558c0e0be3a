"""Measured end-to-end figures of cause-effect chains: latency, reaction time and data age (MODEL 10.7).

The definitions are those of the verified figures, applied to each job that ran instead of the worst case of a table. A
job reads where it starts and writes where it ends, with a logical execution time at its release and at release + LET;
a path that leaves the recording is not counted.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import defaultdict
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Severity, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.models import Anchor
from halpipe.pipeline.compare.codes import CHAIN_EXCEEDED, NOT_MEASURED
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.cost import with_latencies
from halpipe.pipeline.measure.placement import Placement

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from fractions import Fraction

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Chain, ChainLatency, Schedule, TaskModel
    from halpipe.models.trace import Execution
    from halpipe.pipeline.compare.matching import Match

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
    model: TaskModel, schedule: Schedule, played: Mapping[int, str], executions: Sequence[tuple[int, Execution]]
) -> list[ChainRow]:
    """Return the figures of the chains of the model that run in a mode of `played`, the tables by their cycles.

    `executions` come with the cycles to which they belong. A path ends where a table without the chain is played.
    """
    names = set(played.values())
    modes = with_latencies(model, schedule.alone(tuple(m for m in schedule.modes if m.name in names))).modes
    rows = []
    for chain in filter(partial(is_measurable, model), model.chains):
        active = {mode.name: row for mode in modes for row in mode.chains if row.name == chain.name}
        if not active:
            continue
        between = {t.name for t in schedule.transitions if t.source in active and t.target in active}
        parts = _parts(chain, played, {*active, *between}, executions)
        for figure in FIGURES:
            values = [value for members in parts for value in _values(figure, members, chain)]
            rows.append(_row(chain, figure, values, list(active.values())))
    return rows


def _parts(
    chain: Chain, played: Mapping[int, str], active: set[str], executions: Sequence[tuple[int, Execution]]
) -> list[list[list[Span]]]:
    """Return when the jobs of each task of a chain read and write, for each part of the run in which it is active."""
    number, part_of = 0, {}
    for cycle in sorted(played):
        number += played[cycle] not in active
        part_of[cycle] = number if played[cycle] in active else None
    spans: dict[tuple[int | None, str], list[Span]] = defaultdict(list)
    for cycle, execution in executions:
        if execution.end is not None and execution.has_data is not False:
            part = part_of.get(cycle, 0 if len(set(played.values())) == 1 else None)
            spans[part, execution.task].append((execution.start.ns, execution.end.ns))
    return [[sorted(spans[part, name]) for name in chain.tasks] for part in range(number + 1)]


def is_measurable(model: TaskModel, chain: Chain) -> bool:
    """Tell whether recorded starts and ends decide the figures: of releases only those of LETs are known."""
    first, last = (model.task(chain.tasks[at]).let is not None for at in (0, -1))
    begins = chain.anchor in (None, Anchor.RELEASE) if first else chain.anchor is not Anchor.RELEASE
    return begins and (chain.to is None if last else chain.to is not Anchor.RELEASE)


def exchanges(
    model: TaskModel, schedule: Schedule, matches: Iterable[Match], origin: Duration
) -> Iterator[tuple[int, Execution]]:
    """Yield the executions of jobs with their cycles; those with a LET last from its read to its write (MODEL 10.6).

    A job that ends after its write leaves the datum of the one before, so it takes part in no chain.
    """
    lets = {task.name: task.let for task in model.tasks if task.let is not None}
    delays: dict[tuple[str, str, int], Duration] = {}
    for mode in schedule.modes if lets else ():
        placement = Placement.of(expand(model, model.mode(mode.name)), mode.jobs, model.units)
        for job in placement.jobs:
            delays[mode.name, job.active.name, job.index] = placement.tick * placement.delay(job)
    for match in matches:
        let, execution = lets.get(match.job.task), match.execution
        if let is not None:
            # A job of a table between modes is released when it starts.
            read = origin + match.start - delays.get((match.table.name, match.job.task, match.job.index), ZERO)
            if execution.end is None or execution.end > read + let:
                continue
            execution = replace(execution, start=read, end=read + let)
        yield match.cycle, execution


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
        message = f"{len(left)} chains count from or to releases: {', '.join(left[:5])}"
        yield NOT_MEASURED(prefix + message, help="compare the starts and ends of their tasks")


def _row(chain: Chain, figure: str, values: list[int | Fraction], verified: Sequence[ChainLatency]) -> ChainRow:
    bounds: list[Duration | None] = [getattr(row, figure) for row in verified]
    known = [bound for bound in bounds if bound is not None]
    values.sort()

    def at(percent: int) -> Duration | None:
        """Return the smallest value that so many per cent of all do not exceed."""
        return Duration(values[-(-len(values) * percent // 100) - 1]) if values else None

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
