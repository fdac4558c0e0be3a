"""Comparison of a trace with the schedule it should follow: lateness, overruns and order violations, job by job.

`expected` lays the tables out, `matching` assigns executions to jobs, `judging` reports deviations, `chains` measures
end-to-end figures. Exact throughout: the only allowance is the tolerance that the user states.
"""

from __future__ import annotations

from array import array
from collections import Counter, defaultdict
from dataclasses import field
from fractions import Fraction
from functools import cache
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.options import option, refuse_unused
from halpipe.core.records import record
from halpipe.core.samples import quantile
from halpipe.core.suggest import counted, did_you_mean
from halpipe.models.modes import require_mode
from halpipe.models.trace import NONE, Executions
from halpipe.pipeline.compare.chains import deviations as chain_deviations
from halpipe.pipeline.compare.chains import measured_chains
from halpipe.pipeline.compare.codes import ALIGNED, DID_NOT_RUN, NEEDS_MODE, OTHER_MODEL, UNSCHEDULED, Kind
from halpipe.pipeline.compare.judging import Judge, Scope
from halpipe.pipeline.compare.matching import Matching, find_origin, find_stated_origin, match_nearest, match_stated
from halpipe.pipeline.compare.tables import played_tables, tables_of, unknown_tables

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Schedule, TaskModel
    from halpipe.models.trace import Instant, Trace
    from halpipe.pipeline.compare.chains import ChainRow

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


@record(kw_only=True)
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
    by_line: Mapping[int, int] = field(default_factory=dict)
    starts: tuple[Duration, ...] = ()
    matching: Matching
    others: Sequence[int] = ()


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
        names = {
            name
            for number in {executions.table[row] for row in executions.order}
            if (name := executions.names[number]) in tables
        }
        if names != {options.mode}:
            refuse_unused(options, f"compare with a trace of {', '.join(sorted(names))}", ("mode",))
        first = schedule.modes[0].name if scope.is_whole else ""
        lines = played_tables(executions, tables, judge, first)
        zero = find_stated_origin(executions, lines) if origin is None else origin
        matching = match_stated(executions, lines, zero, is_whole=scope.is_whole and origin is not None)
    else:
        table = tables[_mode(schedule, executions, options)]
        zero = find_origin(executions, table) if origin is None and executions else origin or 0
        matching, names = match_nearest(executions, table, zero), {table.name}
    origin_of = Duration(matching.origin)
    judge.judge(matching, model)
    if origin is None and executions:
        early = judge.counts[Kind.EARLY]
        strays = f"; {counted(early, 'start')} before the planned instant" if early else ""
        message = f"the schedule's zero lies at {origin_of} of the trace{strays}"
        findings.add(ALIGNED(message, path=trace.name, help="state it with --origin if it is known"))
    findings.extend(judge.diagnostics())
    late = {name: _numbers(map(matching.lateness, rows)) for name, rows in _by_task(matching).items()}
    rows = _rows(matching, late, {task for name in names for task in tables[name].starts}, model)
    if idle := [row.task for row in rows if not row.seen + row.missing + row.extra]:
        message = f"no job within the recording of {counted(len(idle), 'task')}: {', '.join(idle[:5])}"
        findings.add(DID_NOT_RUN(message, path=trace.name, help="record at least two cycles of the schedule"))
    chains: list[ChainRow] = []
    played = dict(zip(matching.lines.cycle, (table.name for table in matching.lines.table), strict=True))
    if model is not None:
        chains = measured_chains(model, schedule, played, matching)
        one_mode = len({*played.values()}) == 1
        findings.extend(chain_deviations(model, chains, options.tolerance * 2, prefix, one_mode=one_mode))
    every = sorted(value for values in late.values() for value in values)
    return Comparison(
        name=trace.name,
        origin=origin_of,
        rows=tuple(rows),
        chains=tuple(chains),
        diagnostics=tuple(findings.items),
        played=played,
        counts=judge.counts,
        by_line=judge.by_line,
        starts=tuple(Duration(quantile(every, Fraction(share, 100))) for share in (50, 99, 100) if every),
        matching=matching,
        others=others,
    )


def is_stated(executions: Executions) -> bool:
    """Whether each execution names its table and the cycle of it."""
    nameless = executions.number("")
    return not any(executions.cycle[row] == NONE or executions.table[row] == nameless for row in executions.order)


def _require_same(model: TaskModel, schedule: Schedule) -> None:
    """Raise `HalpipeError` if the schedule was made from another model."""
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
    tables = dict.fromkeys(executions.table[row] for row in executions.order)
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


def _known(trace: Trace, schedule: Schedule, judge: Judge, findings: Findings) -> tuple[Executions, Sequence[int]]:
    """Return the executions of scheduled tasks, by the names of the schedule, and the rows of others.

    In a trace of a whole computer, others are no deviation, and units count only where it has those of the schedule.
    """
    jobs = schedule.all_jobs()
    tasks = {job.task for job in jobs}
    units = {unit for job in jobs for unit in job.units}
    found = Executions.of(trace.executions).copy()
    names = {number: found.names[number] for number in set(found.task)}
    plain_task, plain_unit = _names(tasks, _nodes(names.values(), tasks)), _names(units, {})
    plain = {number: plain_task(name) for number, name in names.items()}
    found.rename(plain)
    on = [tuple(map(plain_unit, names)) for names in found.units]
    found.units = [() if trace.is_shared and not units.issuperset(names) else names for names in on]
    known = {found.number(name) for name in plain.values() if name in tasks}
    every = found.order
    found.order = array("q", (row for row in every if found.task[row] in known))
    if len(found.order) == len(every):
        return found, ()
    others = array("q", (row for row in every if found.task[row] not in known))
    unknown: dict[str, list[int]] = {}
    for row in others:
        unknown.setdefault(found.names[found.task[row]], [row, 0])[1] += 1
    if trace.is_shared and found:
        message = f"not in the schedule: {counted(len(unknown), 'program')}: {', '.join(sorted(unknown)[:5])}"
        findings.add(UNSCHEDULED(message, path=trace.name, help="schedule those that take the time of tasks"))
        return found, ()
    for task, (first, count) in sorted(unknown.items()):
        help = did_you_mean(task, sorted(tasks), "compare with the schedule that was loaded")
        message = f"ran {counted(count, 'time')} and is not in the schedule"
        judge.add(Kind.UNKNOWN_TASK, about(task=task), 0, message, found.row(first).at, help)
    return found, () if trace.is_shared else others


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
        if name in known:
            return name
        if name in long:
            return long[name]
        if name in others:
            return others[name]
        bare = (name.removeprefix(prefix) for prefix in PREFIXES if name.startswith(prefix))
        return next((candidate for candidate in bare if candidate in known), name)

    return plain


def _by_task(matching: Matching) -> dict[str, array[int]]:
    """Return the rows with a job by task."""
    found: dict[str, array[int]] = defaultdict(lambda: array("q"))
    for row in matching.rows():
        found[matching.executions.names[matching.executions.task[row]]].append(row)
    return found


def _numbers(values: Iterable[Instant]) -> array[int] | list[Instant]:
    """Return numbers, in a column if all are whole."""
    kept = [*values]
    try:
        return array("q", kept)  # type: ignore[arg-type]
    except (TypeError, OverflowError):
        return kept


def _rows(
    matching: Matching, late: Mapping[str, Sequence[Instant]], due: set[str], model: TaskModel | None
) -> list[TaskRow]:
    seen = matching.executions
    missing = Counter(matching.lines.table[line].due[place].job.task for line, place in matching.missing)
    extra = Counter(seen.names[seen.task[row]] for row in matching.extra)
    found = _by_task(matching)
    rows = []
    for task in sorted({*found, *missing, *extra, *due}):
        ended = [row for row in found.get(task, ()) if seen.end[row] != NONE]
        ends = (seen.end[row] - matching.origin - matching.start(row) - matching.due(row).length for row in ended)
        longest = max(ended, key=lambda row: seen.length(row) or 0, default=None)
        starts = sorted(late.get(task, ()))
        spread = [starts[0], quantile(starts, Fraction(1, 2)), starts[-1]] if starts else []
        job = matching.due(longest) if longest is not None else None
        version = job.job.version if job else ""
        rows.append(
            TaskRow(
                task=task,
                seen=len(starts),
                missing=missing[task],
                extra=extra[task],
                **dict(zip(("least", "median", "worst"), map(Duration, spread), strict=False)),
                worst_end=Duration(max(ends)) if ended else None,
                longest=Duration(seen.length(longest) or 0) if longest is not None else None,
                reserved=Duration(job.reserved) if job else None,
                wcet=model.task(task).version(version).wcet if model and job else None,
            )
        )
    return rows
