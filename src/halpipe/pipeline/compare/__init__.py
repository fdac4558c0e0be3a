"""Comparison of a trace with the schedule it should follow: lateness, overruns and order violations, job by job.

`expected` lays the tables out, `matching` assigns executions to jobs, `judging` reports deviations, `chains` measures
end-to-end figures. Exact throughout: the only allowance is the tolerance that the user states.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import field, replace
from functools import cache
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.options import option, refuse_unused
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.models.modes import require_mode
from halpipe.pipeline.compare.chains import deviations as chain_deviations
from halpipe.pipeline.compare.chains import exchanges, measured_chains
from halpipe.pipeline.compare.codes import ALIGNED, DID_NOT_RUN, NEEDS_MODE, OTHER_MODEL, UNSCHEDULED, Kind
from halpipe.pipeline.compare.judging import Judge, Scope
from halpipe.pipeline.compare.matching import (
    Matching,
    Table,
    find_origin,
    find_stated_origin,
    lateness,
    match_nearest,
    match_stated,
    played_tables,
    tables_of,
    unknown_tables,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Schedule, TaskModel
    from halpipe.models.trace import Execution, Trace
    from halpipe.pipeline.compare.chains import ChainRow
    from halpipe.pipeline.compare.matching import Match, Played

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
        "Instant of the trace at which the schedule starts; auto: no job is early.",
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

    `played` has the tables by cycle, `counts` the deviations by kind, `starts` the sorted lateness of all starts;
    `matches` are the executions with their jobs, `others` those of tasks that the schedule does not have.
    """

    name: str
    origin: Duration
    rows: tuple[TaskRow, ...]
    chains: tuple[ChainRow, ...] = ()
    diagnostics: tuple[Diagnostic, ...]
    played: Mapping[int, str] = field(default_factory=dict)
    counts: Mapping[Kind, int] = field(default_factory=dict)
    starts: tuple[Duration, ...] = ()
    matches: Sequence[Match] = ()
    others: Sequence[Execution] = ()


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
    if executions and all(execution.cycle is not None and execution.table for execution in executions):
        names = {execution.table for execution in executions if execution.table in tables}
        if names != {options.mode}:
            refuse_unused(options, f"compare with a trace of {', '.join(sorted(names))}", ("mode",))
        first = schedule.modes[0].name if scope.is_whole else ""
        entries, pauses = played_tables(executions, tables, judge, first)
        played = {entry.cycle: entry.table.name for entry in entries}
        origin, matching = _stated(executions, entries, options, is_whole=scope.is_whole)
        matching = replace(matching, pauses=pauses)
    else:
        names = {_mode(schedule, executions, options)}
        origin, matching = _repeated(executions, tables[min(names)], options)
        played = {match.cycle: match.table.name for match in matching.matches}
    if options.origin is None and executions:
        message = f"the schedule's zero lies at {origin} of the trace"
        findings.add(ALIGNED(message, path=trace.name, help="state it with --origin if it is known"))
    judge.judge(matching, origin, model)
    findings.extend(judge.diagnostics())
    rows = _rows(matching, origin, {task for name in names for task in tables[name].jobs}, model)
    if idle := [row.task for row in rows if not row.seen + row.missing + row.extra]:
        message = f"{len(idle)} tasks have no job within the recording: {', '.join(idle[:5])}"
        findings.add(DID_NOT_RUN(message, path=trace.name, help="record at least two cycles of the schedule"))
    chains: list[ChainRow] = []
    if model is not None:
        seen = list(exchanges(model, schedule, matching.matches, origin))
        plain = (e for e in matching.extra if model.task(e.task).let is None)
        seen += [(-1 if e.cycle is None else e.cycle, e) for e in plain]
        chains = measured_chains(model, schedule, played, seen)
        one_mode = len({*played.values()}) == 1
        findings.extend(chain_deviations(model, chains, options.tolerance * 2, prefix, one_mode=one_mode))
    return Comparison(
        name=trace.name,
        origin=origin,
        rows=tuple(rows),
        chains=tuple(chains),
        diagnostics=tuple(findings.items),
        played=played,
        counts=judge.counts,
        starts=tuple(sorted(lateness(match, origin) for match in matching.matches)),
        matches=matching.matches,
        others=others,
    )


def _require_same(model: TaskModel, schedule: Schedule) -> None:
    """Raise `HalpipeError` if the schedule was made from another model."""
    modes = {mode.name for mode in schedule.modes} <= {mode.name for mode in model.modes}
    jobs = [job for mode in schedule.modes for job in mode.jobs]
    jobs += [job for switch in schedule.transitions for job in switch.jobs]
    versions = {(task.name, version.name) for task in model.tasks for version in task.versions}
    changed = model.digest and schedule.model_sha256 and model.digest != schedule.model_sha256
    if changed or model.name != schedule.model or not modes or not {(j.task, j.version) for j in jobs} <= versions:
        message = f'model "{model.name}" is not the one from which this schedule of "{schedule.model}" was made'
        raise HalpipeError(OTHER_MODEL(message, help="give the model file from which the schedule was made"))


def _stated(
    executions: Sequence[Execution], played: Sequence[Played], options: CompareOptions, *, is_whole: bool
) -> tuple[Duration, Matching]:
    """Match a trace that names its tables and counts them."""
    if options.origin is not None:
        return options.origin, match_stated(executions, played, options.origin, is_whole=is_whole)
    origin = find_stated_origin(executions, played)
    return origin, match_stated(executions, played, origin)


def _repeated(executions: Sequence[Execution], table: Table, options: CompareOptions) -> tuple[Duration, Matching]:
    """Match a trace of one mode that says nothing but what ran when."""
    if not executions:
        return ZERO, Matching([], [], [])
    origin = find_origin(executions, table) if options.origin is None else options.origin
    return origin, match_nearest(executions, table, origin)


def _mode(schedule: Schedule, executions: Sequence[Execution], options: CompareOptions) -> str:
    """Return the mode that ran: the one asked for, the only one that the trace names, or the only one there is."""
    names = [mode.name for mode in schedule.modes]
    stated = list(dict.fromkeys(execution.table for execution in executions if execution.table))
    if options.mode:
        require_mode(options.mode, schedule.modes)
        return options.mode
    if stated:
        if len(stated) == 1 and stated[0] in names and all(execution.table for execution in executions):
            return stated[0]
        what = f"the trace names {len(stated)} tables, but not the cycle of every job"
        help = (
            "add a column cycle, which counts the tables played from 0 on, or cut the trace where the mode changes and "
            "compare each piece with its --mode"
        )
        raise HalpipeError(NEEDS_MODE(what, at=executions[0].at, help=help))
    if len(names) != 1:
        help = "say which one ran with --mode: " + ", ".join(names)
        raise HalpipeError(NEEDS_MODE("the trace names no tables and cycles", help=help))
    return names[0]


def _known(
    trace: Trace, schedule: Schedule, judge: Judge, findings: Findings
) -> tuple[list[Execution], list[Execution]]:
    """Return the executions of scheduled tasks, by the names of the schedule, and others; report these once per name.

    In a trace of a whole computer, others are no deviation, and units count only where it has those of the schedule.
    """
    jobs = [job for mode in schedule.modes for job in mode.jobs]
    jobs += [job for switch in schedule.transitions for job in switch.jobs]
    tasks = {job.task for job in jobs}
    units = {unit for job in jobs for unit in job.units}
    plain_task, plain_unit = _names(tasks, _nodes(trace.executions, tasks)), _names(units, {})
    found: list[Execution] = []
    unknown: dict[str, list[Execution]] = defaultdict(list)
    for execution in trace.executions:
        task = plain_task(execution.task)
        if task not in tasks:
            unknown[task].append(execution)
            continue
        on = tuple(map(plain_unit, execution.units))
        if trace.is_shared and not units.issuperset(on):
            on = ()
        same = task == execution.task and on == execution.units
        found.append(execution if same else replace(execution, task=task, units=on))
    for task, lost in sorted(unknown.items()) if not (trace.is_shared and found) else ():
        help = did_you_mean(task, sorted(tasks), "compare with the schedule that was loaded")
        message = f"ran {len(lost)} times and is not in the schedule"
        judge.add(Kind.UNKNOWN_TASK, about(task=task), ZERO, message, lost[0].at, help)
    if unknown and trace.is_shared and found:
        message = f"{len(unknown)} programs are not in the schedule: {', '.join(sorted(unknown)[:5])}"
        findings.add(UNSCHEDULED(message, path=trace.name, help="schedule those that take the time of tasks"))
    return found, [] if trace.is_shared else [execution for lost in unknown.values() for execution in lost]


def _nodes(executions: Sequence[Execution], tasks: Collection[str]) -> dict[str, str]:
    """Return the tasks that are called after the node of their only callback, by the name of that callback."""
    called: dict[str, set[str]] = defaultdict(set)
    for execution in executions:
        node, slash, _ = execution.task.rpartition("/")
        if slash and execution.task not in tasks and node in tasks:
            called[node].add(execution.task)
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


def _rows(matching: Matching, origin: Duration, due: set[str], model: TaskModel | None) -> list[TaskRow]:
    matches = defaultdict(list)
    for match in matching.matches:
        matches[match.job.task].append(match)
    missing = Counter(job.task for _, _, job, _ in matching.missing)
    extra = Counter(execution.task for execution in matching.extra)
    rows = []
    for task in sorted({*matches, *missing, *extra, *due}):
        found = matches[task]
        starts = sorted((lateness(match, origin) for match in found), key=lambda late: late.ns)
        ended = [match for match in found if match.execution.end is not None]
        ends = [_end_lateness(match.execution, match.end, origin) for match in ended]
        longest = max(ended, key=lambda match: _busy(match.execution).ns, default=None)
        rows.append(
            TaskRow(
                task=task,
                seen=len(found),
                missing=missing[task],
                extra=extra[task],
                least=starts[0] if starts else None,
                median=starts[(len(starts) - 1) // 2] if starts else None,
                worst=starts[-1] if starts else None,
                worst_end=max(ends, default=None),
                longest=_busy(longest.execution) if longest else None,
                reserved=longest.reserved if longest else None,
                wcet=model.task(task).version(longest.job.version).wcet if model and longest else None,
            )
        )
    return rows


def _busy(execution: Execution) -> Duration:
    if execution.busy is not None:
        return execution.busy
    return ZERO if execution.end is None else execution.end - execution.start


def _end_lateness(execution: Execution, due: Duration, origin: Duration) -> Duration:
    return (execution.end or execution.start) - origin - due
