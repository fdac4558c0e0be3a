"""Tables of the dispatcher: a thread for each task on its units, with its priority and its jobs in every table."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, about, version_of
from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.exporters.common.priorities import levels_of, relation_of
from halpipe.exporters.common.timeline import PhaseTimes
from halpipe.exporters.linux.codes import EARLY_PHASE, NO_ORDER, NO_PIECES, TOO_LARGE
from halpipe.models import HealthAction, HealthEvent, HealthRule, Job, Schedule, TaskModel, Version

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping


MOST, MOST_CPUS, MOST_NS = 2**16 - 1, 1024, 2**62
"""Limits of the types of dispatch.h, and of a set of CPUs (CPU_SETSIZE)."""

_OVERRUN, _FAULT = HealthEvent.OVERRUN, HealthEvent.FAULT


@record
class Part:
    """From `start` (ns) on, the functions [first, last) run; none where a job only resumes after a gap."""

    start: int
    first: int
    last: int


@record
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
    refuge: int
    fault: int
    tables: list[list[Row]]


@record
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
    functions: Mapping[tuple[str, str], int],
    findings: Findings,
) -> Tables:
    """Lay out the schedule; of each version by task and version, `programs` gives the program, and its `functions`."""
    result = _frame(schedule)
    jobs = [list(mode.jobs) for mode in schedule.modes] + [list(table.jobs) for table in schedule.transitions]
    workers: dict[tuple[str, tuple[str, ...]], Worker] = {}
    known: dict[tuple[Part, ...], int] = {}
    held = _Programs(model, functions, findings)
    for number, rows in enumerate(jobs):
        for job in sorted(rows, key=lambda job: (job.start.fraction, job.task, job.index)):
            key = (job.task, job.units)
            if key not in workers:
                unit, levelled = job.units[0], levels[job.task]
                tables: list[list[Row]] = [[] for _ in jobs]
                overrun, fault = (_refuge(model, schedule, job.task, event) for event in (_OVERRUN, _FAULT))
                workers[key] = Worker(job.task, unit, " ".join(job.units), cpus[unit], levelled, overrun, fault, tables)
            parts = held.parts(job)
            place = known.setdefault(parts, len(known))
            program = programs[job.task, job.version]
            row = Row(_ns(job.start), _ns(job.end), place, len(parts), program, job.index)
            workers[key].tables[number].append(row)
    result.workers = [workers[key] for key in sorted(workers)]
    result.all_parts = list(known)
    _refuse_large(result, programs, cpus, model, findings)
    return result


def _refuse_large(
    result: Tables,
    programs: Mapping[tuple[str, str], int],
    cpus: Mapping[str, int],
    model: TaskModel,
    findings: Findings,
) -> None:
    """Report numbers that the types of the C tables do not hold, which a compiler would cut without a word."""
    units = {worker.unit for worker in result.workers}
    jobs = (row.index + 1 for worker in result.workers for rows in worker.tables for row in rows)
    sizes: dict[str, tuple[Iterable[int], int]] = {
        "jobs of a table": (jobs, MOST),
        "tables": ([len(result.tables)], MOST),
        "programs": ([len(programs)], MOST),
        "parts of a job": (map(len, result.all_parts), MOST),
        "units": ([len(units)], MOST_CPUS),
        "CPUs": ((cpus[unit] + 1 for unit in units), MOST_CPUS),
        "nanoseconds of a table": ((table.length for table in result.tables), MOST_NS),
        "parts of a nanosecond": ([result.parts], MOST_NS),
    }
    for what, (counts, most) in sizes.items():
        count = max(counts, default=0)
        if count > most:
            text = f"{count} {what}, there is room for {most}"
            help = "split the model, choose periods with a shorter hyperperiod, or state other CPUs"
            findings.add(TOO_LARGE(text, at=model.at, path=about(model=model.name), help=help))


def _frame(schedule: Schedule) -> Tables:
    names = [mode.name for mode in schedule.modes]
    lengths = [mode.hyperperiod for mode in schedule.modes] + [table.length for table in schedule.transitions]
    parts = math.lcm(*(length.fraction.denominator for length in lengths))
    wholes = [divmod(int(length.fraction * parts), parts) for length in lengths]
    ends = [(i, i) for i in range(len(names))]
    ends += [(names.index(t.source), names.index(t.target)) for t in schedule.transitions]
    titles = names + [t.name for t in schedule.transitions]
    tables = [Table(title, whole, rest, *pair) for title, (whole, rest), pair in zip(titles, wholes, ends, strict=True)]
    switches = [-1] * len(names) ** 2
    for number, table in enumerate(tables[len(names) :], len(names)):
        switches[table.source * len(names) + table.target] = number
    return Tables(parts, tables, switches)


def _ns(instant: Duration) -> int:
    return math.floor(instant.fraction)


class _Programs:
    """Functions of a job, each with the run time from which it runs (MODEL 8.2).

    A job split by a list is held where it has a gap. In models of splits or interrupts, all are also held where an
    access phase begins, which must be where a function does.
    """

    def __init__(self, model: TaskModel, functions: Mapping[tuple[str, str], int], findings: Findings) -> None:
        self._functions = functions
        self._findings = findings
        self._times = PhaseTimes(model)
        splits = any(version.split.is_allowed for version in self._times.versions.values())
        self._holds_phases = splits or any(unit.interrupts for unit in model.units)

    def parts(self, job: Job) -> tuple[Part, ...]:
        """Return the functions of a job; one that may be interrupted anywhere runs through."""
        version = self._times.versions[job.task, job.version]
        listed = not version.split.anywhere
        gaps = {part.executed_from: part.start for part in job.parts[1:]} if listed else {}
        phases = self._phases(job) if self._holds_phases else {}
        # Held until the gap ends, and then until the phase begins; between the two the preemption overhead passes.
        holds = {place: sorted({at[place] for at in (gaps, phases) if place in at}) for place in gaps | phases}
        functions = self._functions[job.task, job.version]
        bounds = [ZERO, *version.split.points]
        whole = (Part(_ns(job.start), 0, functions),)
        if not holds:
            return whole
        if gaps and functions != len(bounds):
            self._refuse_pieces(job, version, functions)
            return whole
        if functions != len(bounds) or any(position not in bounds for position in holds):
            self._refuse_phase(job, version)
            return whole
        held = [(first, start) for first in sorted(map(bounds.index, holds)) for start in holds[bounds[first]]]
        firsts, starts = [0, *(first for first, _ in held)], [job.start, *(start for _, start in held)]
        pairs = zip(starts, firsts, [*firsts[1:], functions], strict=True)
        return tuple(Part(_ns(start), first, last) for start, first, last in pairs)

    def _phases(self, job: Job) -> dict[Duration, Duration]:
        """Return when the phases of a job begin, by where in its execution; the job's start needs no hold."""
        return {a.start: job.start + begin for a, begin, _ in self._times.of(job) if a.start > ZERO}

    def _refuse_pieces(self, job: Job, version: Version, functions: int) -> None:
        points = len(version.split.points)
        named = f"{functions} function" + ("s" if functions > 1 else "")
        text = f"{points} split points make {points + 1} pieces, the entry names {named}"
        help = 'name one function for each piece: entry="first second ..."; or omit the split points'
        self._findings.add(NO_PIECES(text, at=version.at, path=version_of(job.task, job.version), help=help))

    def _refuse_phase(self, job: Job, version: Version) -> None:
        text = "an access phase begins within a function; where jobs end early it would begin before its instant"
        help = "state a split point where the phase begins, and name one function for each piece in the entry"
        self._findings.add(EARLY_PHASE(text, at=version.at, path=version_of(job.task, job.version), help=help))


def is_followed(rule: HealthRule, schedule: Schedule, *, catches_faults: bool = False) -> bool:
    """Return whether the dispatcher follows a rule: a switch to a mode of the schedule, after one event it can survive.

    A fault of a shared object is a signal that ends the process; hosts that catch exceptions survive theirs.
    """
    survives = catches_faults or rule.event is not _FAULT
    is_switch = rule.action is HealthAction.SWITCH and rule.mode in {mode.name for mode in schedule.modes}
    return is_switch and rule.count == 1 and survives


def _refuge(model: TaskModel, schedule: Schedule, task: str, event: HealthEvent) -> int:
    """Return the mode that the first health rule of a task goes to after an event, -1 if there is none."""
    modes = [mode.name for mode in schedule.modes]
    rules = (
        rule
        for rule in model.health
        if rule.task == task
        and is_followed(rule, schedule, catches_faults=True)
        and rule.event in (event, HealthEvent.ANY)
    )
    return next((modes.index(rule.mode) for rule in rules), -1)


HIGHEST = 99
"""The highest priority of Linux (sched(7)); the conductor has the one above those of the threads."""


def thread_levels(model: TaskModel, schedule: Schedule, priority: int) -> dict[str, int]:
    """Return the level of each task, 0 for `priority`; raise `HalpipeError` if there are none, or too many.

    A thread has one priority wherever it runs, so the relations of all units count together.
    """
    everywhere: dict[str, set[str]] = defaultdict(set)
    for above in relation_of(model, schedule).values():
        for low, highs in above.items():
            everywhere[low] |= highs
    related = levels_of({"": everywhere})[""]
    levels = {task.name: related.get(task.name, 0) for task in model.tasks}
    count = max(levels.values(), default=0) + 1
    if priority + count > HIGHEST:
        text = f"{count} levels from {priority} on and the conductor need priorities up to {priority + count}"
        help = (
            f"state --priority {HIGHEST - count} or lower" if count < HIGHEST else "let fewer tasks preempt each other"
        )
        raise HalpipeError(NO_ORDER(f"{text}; the highest is {HIGHEST}", at=model.at, help=help))
    return levels
