"""Measured end-to-end figures of cause-effect chains: latency, reaction time and data age (MODEL 10.7).

The definitions are those of the verified figures, applied to each job that ran instead of the worst case of a table. A
job reads where it starts and writes where it ends, with a logical execution time at its release and at release + LET;
a path that leaves the recording is not counted.
"""

from __future__ import annotations

from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from halpipe.core.diagnostics import Diagnostic, Severity, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.core.samples import quantile
from halpipe.core.suggest import counted, few
from halpipe.models import Anchor, Chain, ChainLatency, Schedule, TaskModel
from halpipe.models.trace import NONE, Column, column, groups, plain
from halpipe.pipeline.compare.codes import CHAIN_EXCEEDED, NOT_MEASURED
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.cost import with_latencies
from halpipe.pipeline.measure.placement import Placement

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from halpipe.pipeline.compare.matching import Matching, Ran

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


Spans = tuple["Column", "Column"]
"""When jobs read and write, by the first and then by the second."""


def measured_chains(
    model: TaskModel, schedule: Schedule, played: Mapping[int, str], matching: Matching, ran: Ran
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
    spans = _spans(model, schedule, matching, ran, {task for chain in active for task in chain.tasks})
    rows = []
    for chain, own in active.items():
        between = {t.name for t in schedule.transitions if t.source in own and t.target in own}
        parts = _parts(chain, played, {*own, *between}, spans)
        for figure in FIGURES:
            values = np.sort(np.concatenate([_values(figure, members, chain) for members in parts]))
            rows.append(_row(chain, figure, values, list(own.values())))
    return rows


def _parts(
    chain: Chain, played: Mapping[int, str], active: set[str], spans: Mapping[str, tuple[Column, Spans]]
) -> list[list[Spans]]:
    """Return when the jobs of each task of a chain read and write, for each part of the run in which it is active."""
    cycles = np.array(sorted(played))
    is_active = np.array([played[cycle] in active for cycle in cycles.tolist()], dtype=bool)
    number = np.cumsum(~is_active)
    elsewhere = 0 if len(set(played.values())) == 1 else -1
    found: dict[tuple[int, str], Spans] = {}
    for task in set(chain.tasks):
        ran, (reads, writes) = spans[task]
        place = np.minimum(np.searchsorted(cycles, ran), len(cycles) - 1)
        part = np.where(is_active[place], number[place], elsewhere)
        part[cycles[place] != ran] = elsewhere
        for of, places in groups(part + 1):
            found[of - 1, task] = reads[places], writes[places]
    nothing = np.arange(0), np.arange(0)
    return [[found.get((part, name), nothing) for name in chain.tasks] for part in range(int(number[-1]) + 1)]


def is_measurable(model: TaskModel, chain: Chain) -> bool:
    """Tell whether recorded starts and ends decide the figures: of releases only those of LETs are known."""
    first, last = (model.task(chain.tasks[at]).let is not None for at in (0, -1))
    begins = chain.anchor in (None, Anchor.RELEASE) if first else chain.anchor is not Anchor.RELEASE
    return begins and (chain.to is None if last else chain.to is not Anchor.RELEASE)


def _spans(
    model: TaskModel, schedule: Schedule, matching: Matching, ran: Ran, wanted: Collection[str]
) -> dict[str, tuple[Column, Spans]]:
    """Return the cycles, and when they read and wrote, of the jobs of the `wanted` tasks that had data.

    One with a LET lasts from its read to its write (MODEL 10.6). If it ends after its write, it leaves the datum of the
    one before, so it takes part in no chain.
    """
    lets = {task.name: task.let.ns for task in model.tasks if task.let is not None}
    delays: dict[tuple[str, str, int], Duration] = {}
    for mode in schedule.modes if lets else ():
        placement = Placement.of(expand(model, model.mode(mode.name)), mode.jobs, model.units)
        for job in placement.jobs:
            delays[mode.name, job.active.name, job.index] = placement.tick * placement.delay(job)
    # A job of a table between modes is released when it starts.
    after = column([delays.get((table.name, due.job.task, due.job.index), ZERO).ns for table, due in matching.jobs])
    seen, extra, lines = matching.executions, matching.extra, np.array(matching.lines.cycle, dtype=np.int64)
    start, end, cycle = column(seen.start), column(seen.end), np.asarray(seen.cycle)
    no_data = np.array([row for row, has in seen.has_data.items() if not has], dtype=np.int64)
    own = ran.by_task()
    others = {seen.names[number]: extra[places] for number, places in groups(np.asarray(seen.task)[extra])}
    found = {}
    for name in wanted:
        places, more = own.get(name, extra[:0]), others.get(name, extra[:0])
        rows, cycles = ran.row[places], lines[ran.line[places]]
        if name in lets:
            reads = column([matching.origin]) + ran.due[places] - after[ran.job[places]]
            writes = reads + column([lets[name]])
            kept = end[rows] <= writes
        else:
            rows, cycles = np.concatenate((rows, more)), np.concatenate((cycles, cycle[more]))
            reads, writes, kept = start[rows], end[rows], np.ones(len(rows), dtype=bool)
        places = np.flatnonzero(kept & (end[rows] != NONE) & ~np.isin(rows, no_data))
        for times in (writes, reads):
            places = places[np.argsort(times[places], kind="stable")]
        found[name] = cycles[places], (reads[places], writes[places])
    return found


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
        message = f"counted from or to releases: {counted(len(left), 'chain')}: {few(left, quote='')}"
        yield NOT_MEASURED(prefix + message, help="compare the starts and ends of their tasks")


def _row(chain: Chain, figure: str, values: Column, verified: Sequence[ChainLatency]) -> ChainRow:
    bounds: list[Duration | None] = [getattr(row, figure) for row in verified]
    known = [bound for bound in bounds if bound is not None]

    def at(share: Fraction) -> Duration | None:
        return Duration(plain(quantile(values, share))) if len(values) else None

    return ChainRow(
        chain=chain.name,
        figure=figure,
        count=len(values),
        least=at(Fraction(0)),
        median=at(Fraction(1, 2)),
        p99=at(Fraction(99, 100)),
        worst=at(Fraction(1)),
        verified=max(known) if known and len(known) == len(bounds) else None,
        limit=getattr(chain, f"max_{figure}"),
    )


def _values(figure: str, members: Sequence[Spans], chain: Chain) -> Column:
    begin, end = int(chain.anchor is Anchor.END), int(chain.to is not Anchor.START)
    firsts, lasts = members[0], members[-1]
    if figure == "age":
        kept, found = _backward(members[:-1], lasts)
        return lasts[end][kept] - found[begin]
    missed = seen = np.arange(len(firsts[0]))
    if figure == "reaction":  # from the job that just missed the stimulus, by way of the next one
        following = np.searchsorted(firsts[0], firsts[0], side="right")
        missed = np.flatnonzero(following < len(following))
        seen = following[missed]
    kept, found = _forward(members[1:], (firsts[0][seen], firsts[1][seen]))
    return found[end] - firsts[begin][missed[kept]]


def _forward(members: Sequence[Spans], spans: Spans) -> tuple[Column, Spans]:
    """Return the last jobs to which the data of jobs lead: each time the first that reads once they are written.

    With them come the numbers of the jobs whose data lead to one.
    """
    kept = np.arange(len(spans[0]))
    for reads, writes in members:
        reached = np.searchsorted(reads, spans[1])
        is_there = reached < len(reads)
        kept, reached = kept[is_there], reached[is_there]
        spans = reads[reached], writes[reached]
    return kept, spans


def _backward(members: Sequence[Spans], spans: Spans) -> tuple[Column, Spans]:
    """Return the first jobs from which the data of jobs come: each time the latest that had written by their start."""
    kept = np.arange(len(spans[0]))
    for reads, writes in reversed(members):
        order = np.argsort(writes, kind="stable")
        reached = np.searchsorted(writes[order], spans[0], side="right") - 1
        is_there = reached >= 0
        kept, reached = kept[is_there], order[reached[is_there]]
        spans = reads[reached], writes[reached]
    return kept, spans
