"""Comparison of a trace with the schedule it should follow: lateness, overruns and order violations, job by job.

`expected` lays the tables out, `matching` assigns executions to jobs, `judging` reports deviations, `chains` measures
end-to-end figures. Exact throughout: the only allowance is the tolerance that the user states.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import field
from fractions import Fraction
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from halpipe.core.diagnostics import Diagnostic, Findings, HalpipeError, Location, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.files import refuse_more_than
from halpipe.core.options import option, refuse_unused
from halpipe.core.records import record
from halpipe.core.samples import quantile
from halpipe.core.suggest import counted, did_you_mean, few
from halpipe.models.modes import require_mode
from halpipe.models.trace import NONE, Column, Executions, Trace, column, groups, plain
from halpipe.pipeline.compare.chains import deviations as chain_deviations
from halpipe.pipeline.compare.chains import measured_chains
from halpipe.pipeline.compare.codes import ALIGNED, DID_NOT_RUN, NEEDS_MODE, OTHER_MODEL, UNSCHEDULED, Kind
from halpipe.pipeline.compare.judging import Judge, Scope
from halpipe.pipeline.compare.matching import Matching, Ran, match_nearest, match_stated
from halpipe.pipeline.compare.tables import played_tables, tables_of, unknown_tables

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from halpipe.models import Schedule, TaskModel
    from halpipe.pipeline.compare.chains import ChainRow

MOST_NAMES = 100_000
"""Names of tasks in a recording, of which each may get a finding; a task model has as many tasks at most."""

PREFIXES = ("TASK_", "Core_")
"""What recorders, and halpipe's own traces, put before the names of tasks and units for the sake of their viewers."""

COMM = 15
"""Characters that Linux keeps of the name of a thread."""


def _origin(text: str) -> Duration | None:
    return None if text == "auto" else Duration.parse(text)


@record(kw_only=True)
class CompareOptions:
    """`origin`: the instant of the trace at which the first table starts; None: found, so that no job starts early."""

    mode: str = option(
        "", "The mode that ran, where the trace does not say.", metavar="NAME", completes="modes", otherwise="none"
    )
    tolerance: Duration = option(
        ZERO, "Lateness that is allowed at starts and ends, such as 10us.", Duration.parse, metavar="TIME"
    )
    origin: Duration | None = option(
        None,
        "Instant of the trace at which the schedule starts; auto: no job is early, but for single strays.",
        _origin,
        metavar="TIME",
        otherwise="auto",
    )


@record(kw_only=True)
class TaskRow:
    """Account of one task: jobs matched, missing and extra, lateness of starts and ends, and run times.

    `reserved` is what the schedule reserves for the job that ran longest, interrupts included; `wcet` is the WCET of
    its version, where the model is known.
    """

    task: str
    seen: int
    missing: int
    extra: int
    least: Duration | None = None
    median: Duration | None = None
    worst: Duration | None = None
    worst_end: Duration | None = None
    longest: Duration | None = None
    reserved: Duration | None = None
    wcet: Duration | None = None


@record(kw_only=True, eq=False)
class Comparison:
    """Comparison of one line of time: the schedule's zero in it, tasks, chains (with a model), and deviations.

    `played` has the tables by cycle, `counts` the deviations by kind, `by_line` by line of the matching; `starts` are
    median, p99 and worst of the lateness of all starts; `others` are the rows of tasks that the schedule does not have.
    """

    name: str
    origin: Duration
    rows: tuple[TaskRow, ...]
    chains: tuple[ChainRow, ...] = ()
    diagnostics: tuple[Diagnostic, ...]
    played: Mapping[int, str] = field(default_factory=dict)
    counts: Mapping[Kind, int] = field(default_factory=dict)
    by_line: Column
    starts: tuple[Duration, ...] = ()
    matching: Matching
    ran: Ran
    others: Column


def compare(
    schedule: Schedule,
    trace: Trace,
    options: CompareOptions,
    model: TaskModel | None = None,
    scope: Scope | None = None,
) -> Comparison:
    """Compare one line of time with the schedule, and with a `model` its WCETs, chains and resources.

    Raise `HalpipeError` if it is open which table ran, or if the model is not that of the schedule.
    """
    if model is not None:
        _require_same(model, schedule)
    scope = scope or Scope()
    tables = tables_of(schedule)
    findings = Findings()
    prefix = f"{trace.name}, " if trace.name else ""
    judge = Judge(options.tolerance, prefix, scope)
    executions, others = _known(trace, schedule, judge, findings)
    unknown_tables(executions, tables, judge)
    origin = None if options.origin is None else options.origin.ns
    if executions and is_stated(executions):
        names = {name for number in _tables(executions) if (name := executions.names[number]) in tables}
        if names != {options.mode}:
            refuse_unused(options, f"compare with a trace of {', '.join(sorted(names))}", ("mode",))
        first = schedule.modes[0].name if scope.is_whole else ""
        lines = played_tables(executions, tables, judge, first)
        matching = match_stated(executions, lines, origin, is_whole=scope.is_whole)
    else:
        table = tables[_mode(schedule, executions, options)]
        matching, names = match_nearest(executions, table, origin), {table.name}
    origin_of = Duration(matching.origin)
    ran = Ran(matching)
    judge.judge(matching, ran, model)
    if origin is None and executions:
        early = judge.counts[Kind.EARLY]
        strays = f"; {counted(early, 'start')} before the planned instant" if early else ""
        message = f"the schedule's zero lies at {origin_of} of the trace{strays}"
        findings.add(ALIGNED(message, path=trace.name, help="state it with --origin if it is known"))
    findings.extend(judge.diagnostics())
    rows = _rows(matching, ran, {task for name in names for task in tables[name].starts}, model)
    if idle := [row.task for row in rows if not row.seen + row.missing + row.extra]:
        message = f"no job within the recording of {counted(len(idle), 'task')}: {few(idle, quote='')}"
        findings.add(DID_NOT_RUN(message, path=trace.name, help="record at least two cycles of the schedule"))
    chains: list[ChainRow] = []
    played = dict(zip(matching.lines.cycle, (table.name for table in matching.lines.table), strict=True))
    if model is not None:
        chains = measured_chains(model, schedule, played, matching, ran)
        one_mode = len({*played.values()}) == 1
        findings.extend(chain_deviations(model, chains, options.tolerance * 2, prefix, one_mode=one_mode))
    every = np.sort(ran.late)
    return Comparison(
        name=trace.name,
        origin=origin_of,
        rows=tuple(rows),
        chains=tuple(chains),
        diagnostics=tuple(findings.items),
        played=played,
        counts=judge.counts,
        by_line=judge.by_line,
        starts=tuple(Duration(plain(quantile(every, Fraction(share, 100)))) for share in (50, 99, 100) if len(every)),
        matching=matching,
        ran=ran,
        others=others,
    )


def is_stated(executions: Executions) -> bool:
    """Whether each execution names its table and the cycle of it."""
    cycles = np.asarray(executions.cycle)[executions.order]
    return not (cycles == NONE).any() and all(executions.names[number] for number in _tables(executions))


def _tables(executions: Executions) -> list[int]:
    """Return the numbers of the tables that a trace names, from the first on."""
    numbers, first = np.unique(np.asarray(executions.table)[executions.order], return_index=True)
    return [int(number) for number in numbers[np.argsort(first)]]


def _require_same(model: TaskModel, schedule: Schedule) -> None:
    modes = {mode.name for mode in schedule.modes} <= {mode.name for mode in model.modes}
    jobs = schedule.all_jobs()
    versions = {(task.name, version.name) for task in model.tasks for version in task.versions}
    changed = model.digest and schedule.model_sha256 and model.digest != schedule.model_sha256
    if changed or model.name != schedule.model or not modes or not {(j.task, j.version) for j in jobs} <= versions:
        message = f'model "{model.name}" is not the one from which this schedule of "{schedule.model}" was made'
        raise HalpipeError(OTHER_MODEL(message, help="give the model file from which the schedule was made"))


def _mode(schedule: Schedule, executions: Executions, options: CompareOptions) -> str:
    """Return the mode that ran: the one asked for, the only one that the trace names, or the only one there is."""
    names = [mode.name for mode in schedule.modes]
    tables = _tables(executions)
    stated = [name for number in tables if (name := executions.names[number])]
    if options.mode:
        require_mode(options.mode, schedule.modes)
        return options.mode
    if stated:
        if len(tables) == 1 and stated[0] in names:
            return stated[0]
        what = f"the trace names {counted(len(stated), 'table')}, but not the cycle of every job"
        help = (
            "add a column cycle, which counts the tables played from 0 on, or cut the trace where the mode changes and "
            "compare each piece with its --mode"
        )
        raise HalpipeError(NEEDS_MODE(what, at=executions[0].at, help=help))
    if len(names) != 1:
        help = "say which one ran with --mode: " + ", ".join(names)
        raise HalpipeError(NEEDS_MODE("the trace names no tables and cycles", help=help))
    return names[0]


def _known(trace: Trace, schedule: Schedule, judge: Judge, findings: Findings) -> tuple[Executions, Column]:
    """Return the executions of scheduled tasks, by the names of the schedule, and the rows of others.

    In a trace of a whole computer, others are no deviation, and units count only where it has those of the schedule.
    """
    jobs = schedule.all_jobs()
    tasks = {job.task for job in jobs}
    units = {unit for job in jobs for unit in job.units}
    found = Executions.of(trace.executions).copy()
    names = {number: found.names[number] for number in np.unique(np.asarray(found.task)).tolist()}
    at = Location(found.row(0).at.file) if names else Location()
    refuse_more_than(MOST_NAMES, len(names), "names of tasks", at)
    plain_task, plain_unit = _names(tasks, _nodes(names.values(), tasks)), _names(units, {})
    plain = {number: plain_task(name) for number, name in names.items()}
    found.rename(plain)
    on = [tuple(map(plain_unit, names)) for names in found.units]
    found.units = [() if trace.is_shared and not units.issuperset(names) else names for names in on]
    every, task = found.order, np.asarray(found.task)[found.order]
    is_known = np.array([name in tasks for name in found.names], dtype=bool)[task]
    found.order, others = every[is_known], every[~is_known]
    if not len(others):
        return found, others
    unknown = {found.names[number]: others[places] for number, places in groups(task[~is_known])}
    if trace.is_shared and len(found):
        message = f"not in the schedule: {counted(len(unknown), 'program')}: {few(sorted(unknown), quote='')}"
        findings.add(UNSCHEDULED(message, path=trace.name, help="schedule those that take the time of tasks"))
        return found, others[:0]
    for name, rows in sorted(unknown.items()):
        help = did_you_mean(name, sorted(tasks), "compare with the schedule that was loaded")
        message = f"ran {counted(len(rows), 'time')} and is not in the schedule"
        judge.add(Kind.UNKNOWN_TASK, about(task=name), 0, message, found.row(int(rows[0])).at, help)
    return found, others[:0] if trace.is_shared else others


def _nodes(names: Collection[str], tasks: Collection[str]) -> dict[str, str]:
    """Return the tasks that are called after the node of their only callback, by the name of that callback."""
    called: dict[str, set[str]] = defaultdict(set)
    for name in names:
        node, slash, _ = name.rpartition("/")
        if slash and name not in tasks and node in tasks:
            called[node].add(name)
    return {next(iter(names)): node for node, names in called.items() if len(names) == 1}


def _names(known: Collection[str], others: Mapping[str, str]) -> Callable[[str], str]:
    """Return what gives a name as the schedule has it: one of `others`, or without the prefix of a viewer."""

    short = Counter(name[:COMM] for name in known)
    long = {name[:COMM]: name for name in known if len(name) > COMM and short[name[:COMM]] == 1}

    @cache
    def plain(name: str) -> str:
        bare = (name.removeprefix(prefix) for prefix in PREFIXES if name.startswith(prefix))
        found = (long.get(name), others.get(name), *(candidate for candidate in bare if candidate in known))
        return name if name in known else next(filter(None, found), name)

    return plain


def _rows(matching: Matching, ran: Ran, due: set[str], model: TaskModel | None) -> list[TaskRow]:
    seen, found = matching.executions, ran.by_task()
    missing: Counter[str] = Counter()
    for number, places in groups(matching.located(matching.missing)[1]):
        missing[matching.jobs[number][1].job.task] += len(places)
    extra = {seen.names[number]: len(places) for number, places in groups(np.asarray(seen.task)[matching.extra])}
    end, due_after = column(seen.end), matching.of_jobs("length") + column([matching.origin])
    late, length, has_end = ran.late, ran.length, ran.has_end
    rows = []
    for task in sorted({*found, *missing, *extra, *due}):
        places = found.get(task, np.arange(0))
        ended = places[has_end[places]]
        longest = int(ended[np.argmax(length[ended])]) if len(ended) else None
        after = end[ran.row[ended]] - ran.due[ended] - due_after[ran.job[ended]]
        starts = np.sort(late[places])
        spread = [starts[0], quantile(starts, Fraction(1, 2)), starts[-1]] if len(starts) else []
        job = matching.jobs[ran.job[longest]][1] if longest is not None else None
        version = job.job.version if job else ""
        rows.append(
            TaskRow(
                task=task,
                seen=len(starts),
                missing=missing[task],
                extra=extra.get(task, 0),
                **dict(zip(("least", "median", "worst"), map(Duration, map(plain, spread)), strict=False)),
                worst_end=Duration(plain(after.max())) if len(ended) else None,
                longest=Duration(plain(length[longest])) if longest is not None else None,
                reserved=Duration(job.reserved) if job else None,
                wcet=model.task(task).version(version).wcet if model and job else None,
            )
        )
    return rows
