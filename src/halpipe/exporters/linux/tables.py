"""The schedule as the dispatcher knows it: a thread for each task on its units, with its jobs in every table."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from halpipe.exporters.linux.codes import NO_PIECES

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.diagnostics import Findings
    from halpipe.durations import Duration
    from halpipe.models import Job, Schedule, TaskModel, Version


@dataclass(frozen=True, slots=True)
class Part:
    """From `start` (ns) on, the functions [first, last) run."""

    start: int
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class Row:
    """A job as a thread plays it: times in ns, `parts` as an index of all parts, `program` of all programs."""

    start: int
    end: int
    parts: int
    n_parts: int
    program: int
    index: int


@dataclass(slots=True)
class Worker:
    """A thread."""

    task: str
    unit: str
    units: str
    cpu: int
    priority: int
    tables: list[list[Row]]


@dataclass(frozen=True, slots=True)
class Table:
    """A mode or a table between modes; its length is `length` + `rest` / `Tables.parts` ns."""

    name: str
    length: int
    rest: int
    source: int
    target: int


@dataclass(slots=True)
class Tables:
    """Everything that the C file of the tables states of the schedule."""

    parts: int
    tables: list[Table]
    switches: list[int]
    workers: list[Worker] = field(default_factory=list)
    all_parts: list[tuple[Part, ...]] = field(default_factory=list)


def tables_of(
    model: TaskModel,
    schedule: Schedule,
    cpus: Mapping[str, int],
    levels: Mapping[str, int],
    programs: Mapping[tuple[str, str], int],
    findings: Findings,
) -> Tables:
    """Lay out the schedule; `programs` gives the program of each version by task and version."""
    result = _frame(schedule)
    jobs = [list(mode.jobs) for mode in schedule.modes] + [list(table.jobs) for table in schedule.transitions]
    workers: dict[tuple[str, tuple[str, ...]], Worker] = {}
    known: dict[tuple[Part, ...], int] = {}
    for number, rows in enumerate(jobs):
        for job in sorted(rows, key=lambda job: (job.start.fraction, job.task, job.index)):
            key = (job.task, job.units)
            if key not in workers:
                unit, levelled = job.units[0], levels[job.task]
                tables: list[list[Row]] = [[] for _ in jobs]
                workers[key] = Worker(job.task, unit, " ".join(job.units), cpus[unit], levelled, tables)
            parts = _parts(job, model.task(job.task).version(job.version), findings)
            place = known.setdefault(parts, len(known))
            program = programs[job.task, job.version]
            row = Row(_ns(job.start), _ns(job.end), place, len(parts), program, job.index)
            workers[key].tables[number].append(row)
    result.workers = [workers[key] for key in sorted(workers)]
    result.all_parts = list(known)
    return result


def _frame(schedule: Schedule) -> Tables:
    names = [mode.name for mode in schedule.modes]
    lengths = [mode.hyperperiod for mode in schedule.modes] + [table.length for table in schedule.transitions]
    parts = math.lcm(*(length.fraction.denominator for length in lengths))
    wholes = [divmod(int(length.fraction * parts), parts) for length in lengths]
    ends = [(i, i) for i in range(len(names))]
    ends += [(names.index(t.source), names.index(t.target)) for t in schedule.transitions]
    titles = names + [f"{t.source}->{t.target}" for t in schedule.transitions]
    tables = [Table(title, whole, rest, *pair) for title, (whole, rest), pair in zip(titles, wholes, ends, strict=True)]
    switches = [-1] * len(names) ** 2
    for number, table in enumerate(tables[len(names) :], len(names)):
        switches[table.source * len(names) + table.target] = number
    return Tables(parts, tables, switches)


def _ns(instant: Duration) -> int:
    return math.floor(instant.fraction)


def _parts(job: Job, version: Version, findings: Findings) -> tuple[Part, ...]:
    """Return which functions run from when on; a job that may be interrupted anywhere runs through."""
    functions = len(version.source.entry.split()) if version.source is not None else 1
    if not job.parts or version.split.anywhere:
        return (Part(_ns(job.start), 0, functions),)
    points = [*version.split.points]
    if functions != len(points) + 1:
        path = f'task "{job.task}", version "{version.name}"'
        text = f"{len(points)} split points make {len(points) + 1} pieces, the entry names {functions} functions"
        help = 'name one function for each piece: entry="first second ..."; or leave the split points away'
        findings.add(NO_PIECES(text, at=version.at, path=path, help=help))
        return (Part(_ns(job.start), 0, functions),)
    ends = [points.index(part.executed_to) + 1 if part.executed_to in points else functions for part in job.parts]
    firsts = [0, *ends[:-1]]
    return tuple(Part(_ns(part.start), first, last) for part, first, last in zip(job.parts, firsts, ends, strict=True))
