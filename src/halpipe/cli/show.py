"""``halpipe show`` and ``halpipe diff``: schedules as text, with Gantt charts of one letter for each task."""

from __future__ import annotations

import shutil
from dataclasses import asdict
from enum import StrEnum
from itertools import groupby
from string import ascii_letters, digits
from typing import TYPE_CHECKING, Annotated, Any

import typer

from halpipe.cli import output
from halpipe.cli.options import Quiet, ScheduleFile, Verbose, modes, print_json, takes
from halpipe.core.diagnostics import Exit, HalpipeError, Location, printable
from halpipe.core.suggest import counted

if TYPE_CHECKING:
    from collections.abc import Sequence
    from fractions import Fraction

    from halpipe.core.durations import Duration
    from halpipe.models import Job, ModeSchedule, Schedule, TaskModel, TransitionTable
    from halpipe.pipeline.diff import Change, JobChange, ScheduleDiff, TaskSummary


LETTERS = ascii_letters[26:] + ascii_letters[:26] + digits
IDLE, SEVERAL = "·", "#"
LEAST_WIDTH = 20


def gantt(jobs: tuple[Job, ...], length: Duration, letters: dict[str, str], width: int, *, wraps: bool) -> list[str]:
    """Return a scale over [0, length) and a line for each unit that has jobs; `wraps`: the line is a circle."""
    rows: dict[str, list[str]] = {}
    names = sorted({unit for job in jobs for unit in job.units})
    shown = {name: printable(name) for name in names}
    margin = max(map(len, shown.values()), default=0) + 2
    columns = max(LEAST_WIDTH, width - margin)
    for name in names:
        rows[name] = [IDLE] * columns
    for job in jobs:
        for column in _columns(job, length, columns, wraps=wraps):
            for unit in job.units:
                known = rows[unit][column]
                letter = letters[job.task]
                rows[unit][column] = letter if known in (IDLE, letter) else SEVERAL
    end = str(length)
    scale = "0" + end.rjust(columns - 1)
    return [" " * margin + scale, *(shown[name].ljust(margin) + "".join(cells) for name, cells in rows.items())]


def _columns(job: Job, length: Duration, columns: int, *, wraps: bool) -> list[int]:
    """Return the columns that a job touches; in an unverified schedule it may be longer than the chart."""
    found: list[int] = []
    if not length:
        return found
    for start, end in job.occupations():
        first = int(start.fraction * columns / length.fraction)
        last = int(-(-end.fraction * columns // length.fraction))
        inside = range(first, min(max(first + 1, last), first + columns))
        found += [column % columns for column in inside if wraps or column < columns]
    return found


def letters_of(modes: tuple[ModeSchedule, ...], switches: tuple[TransitionTable, ...]) -> dict[str, str]:
    """Return a letter for each task, the same in every chart; they start again where there are more tasks."""
    tasks = dict.fromkeys(job.task for mode in modes for job in mode.jobs)
    tasks |= dict.fromkeys(job.task for switch in switches for job in switch.jobs)
    return {task: LETTERS[number % len(LETTERS)] for number, task in enumerate(tasks)}


MOST_JOBS = 200


class Form(StrEnum):
    """The forms of a schedule that is shown; diagnostics are JSON where it is."""

    TEXT = "text"
    JSON = "json"
    CSV = "csv"


def show(
    schedule: ScheduleFile,
    mode: Annotated[
        str, typer.Option(metavar="NAME", help="This mode only; otherwise all, and the switches.", autocompletion=modes)
    ] = "",
    jobs: Annotated[bool, typer.Option(help=f"List every job, also where there are more than {MOST_JOBS}.")] = False,
    format: Annotated[
        Form, typer.Option(help="text; json: jobs, loads, latencies, switches; csv: a row for each part of a job.")
    ] = Form.TEXT,
    model: Annotated[
        str, typer.Option(metavar="FILE", help="Task model of the schedule: latencies of all chains, as well.")
    ] = "",
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Show a schedule in the terminal: a Gantt chart, jobs, loads and chain latencies of every mode, and switches."""
    from halpipe.importers.native import read_schedule
    from halpipe.models.modes import require_mode

    output.choose(output.Format.JSON if format is Form.JSON else None, quiet=quiet, verbose=verbose)
    tables = read_schedule(schedule)
    if model:
        from halpipe.importers.native import read_model
        from halpipe.pipeline.checked import refuse_invalid
        from halpipe.pipeline.measure.cost import with_latencies

        system = read_model(model)
        refuse_invalid(system, tables)
        tables = with_latencies(system, tables)
    if mode:
        require_mode(mode, tables.modes)
        tables = tables.alone((tables.mode(mode),))
    if format is not Form.TEXT:
        from halpipe.exporters.common.rows import as_csv, as_json

        output.text((as_json if format is Form.JSON else as_csv)(tables))
        return Exit.OK
    letters = letters_of(tables.modes, tables.transitions)
    for table in tables.modes:
        _show_mode(table, letters, every=jobs)
    if tables.transitions:
        _show_switches(tables, letters)
    return Exit.OK


def _width() -> int:
    return shutil.get_terminal_size((100, 24)).columns


def _show_chart(jobs: tuple[Job, ...], length: Duration, letters: dict[str, str], *, wraps: bool) -> None:
    """Print a Gantt chart; under an ASCII terminal with full stops where nothing runs."""
    idle = IDLE if output.can_print(IDLE) else "."
    for line in gantt(jobs, length, letters, _width() - 2, wraps=wraps):
        output.result(f"  {line.replace(IDLE, idle)}")


def _show_mode(mode: ModeSchedule, letters: dict[str, str], *, every: bool) -> None:
    output.result(f"mode {mode.name}: {counted(len(mode.jobs), 'job')} in {mode.hyperperiod}, claimed {mode.status}")
    _show_chart(mode.jobs, mode.hyperperiod, letters, wraps=True)
    if every or len(mode.jobs) <= MOST_JOBS:
        _show_jobs(mode.jobs, letters)
    else:
        output.result(f"  {counted(len(mode.jobs), 'job')}; --jobs lists them")
    if mode.margin_words:
        output.result(f"  least margin of a WCET: {mode.margin_words}")
    for unit in mode.unit_loads:
        output.result(f"  {unit.unit}: busy {unit.busy}, {_percent(unit.share)}")
    for load in mode.resource_loads:
        if load.peak is not None and load.mean is not None:
            output.result(f"  {load.resource}: peak {_percent(load.peak)}, mean {_percent(load.mean)}")
    for chain in mode.chains:
        latency = "" if chain.latency is None else f"latency {chain.latency}, "
        reaction, age = chain.reaction or "never", chain.age or "never"
        output.result(f"  chain {chain.name}: {latency}reaction {reaction}, age {age}")
    output.result()


def _show_jobs(jobs: tuple[Job, ...], letters: dict[str, str]) -> None:
    rows = []
    for job in sorted(jobs, key=lambda job: (job.start.ns, job.units)):
        where = " ".join(job.units)
        rows.append((letters[job.task], str(job.start), str(job.end), job.task, str(job.index), job.version, where))
        for part in job.parts:
            executed = f"executes {part.executed_from} to {part.executed_to}"
            rows.append(("", str(part.start), str(part.end), "", "", executed, ""))
    output.table(("", "start", "end", "task", "job", "version", "units"), rows, right=(1, 2))


def _show_switches(tables: Schedule, letters: dict[str, str]) -> None:
    rows = []
    for switch in tables.transitions:
        facts = (str(switch.length), str(switch.worst_latency), str(len(switch.jobs)), str(switch.status))
        rows.append((switch.source, switch.target, *facts))
    output.table(("switch", "to", "table", "at worst", "jobs", "claimed"), rows)
    for switch in tables.transitions:
        if switch.length:
            output.result()
            output.result(f"{switch.source} to {switch.target}")
            _show_chart(switch.jobs, switch.length, letters, wraps=False)


def _percent(share: Fraction) -> str:
    """Return a share in per cent with one decimal, rounded half to even, without a float."""
    tenths = round(share * 1000)
    return f"{tenths // 10}.{tenths % 10} %"


JOBS_SHOWN = 5
"""Jobs of a task whose changes are listed before the rest is only counted."""

VALUES_SHOWN = 40


@takes(answers=True)
def diff(
    before: Annotated[str, typer.Argument(metavar="BEFORE", help="Schedule or task model XML.")],
    after: Annotated[str, typer.Argument(metavar="AFTER", help="The same kind of file; - is standard input.")],
) -> int:
    """Compare two schedules, or two task models, by names: exit code 0 if they say the same, 1 if not.

    A schedule's seed, solver and grid are shown, but are no difference; nor is where a model was imported from.
    """
    from halpipe.models import Schedule, TaskModel
    from halpipe.pipeline.diff import diff_models, diff_schedules

    one, other = _read(before), _read(after)
    if isinstance(one, Schedule) and isinstance(other, Schedule):
        found = diff_schedules(one, other)
        _show_schedules(found) if output.is_text() else print_json(_schedules_as_json(found))
        return Exit.OK if found.is_same else Exit.FINDINGS
    if isinstance(one, TaskModel) and isinstance(other, TaskModel):
        changes = diff_models(one, other)
        if output.is_text():
            _show_values(changes) if changes else output.result("same")
        else:
            print_json({"kind": "task-model", "same": not changes, "changes": [asdict(c) for c in changes]})
        return Exit.FINDINGS if changes else Exit.OK
    raise HalpipeError(_unlike(before, one, after, other))


def _read(path: str) -> Schedule | TaskModel:
    """Read a file of either kind, by its root element."""
    from halpipe.core.files import parse_xml, read_bytes
    from halpipe.importers.native import parse_model, parse_schedule
    from halpipe.schemas import SCHEDULE, namespace

    data = read_bytes(path)
    if parse_xml(data, path).tag == f"{{{namespace(SCHEDULE)}}}schedule":
        return parse_schedule(data, path)
    return parse_model(data, path)


def _unlike(before: str, one: object, after: str, other: object) -> Any:
    from halpipe.models import Schedule
    from halpipe.pipeline.whatif.codes import NOT_COMPARABLE

    kinds = ["a schedule" if isinstance(read, Schedule) else "a task model" for read in (one, other)]
    text = f"is {kinds[1]}, but {before} is {kinds[0]}"
    return NOT_COMPARABLE(text, at=Location(after), help="name two schedules, or two task models")


# ------------------------------------------------------------------------------------------------ text


def _show_schedules(found: ScheduleDiff) -> None:
    amount = f"{counted(len(found.jobs), 'job')} of {counted(len(found.tasks), 'task')}"
    output.result("same" if found.is_same else f"different: {amount}")
    for table, summaries in groupby(found.tasks, key=lambda summary: summary.table):
        _show_tasks(table, list(summaries))
    if found.values:
        output.result("values that differ:")
        _show_values(found.values)
    if found.jobs:
        output.result("jobs that differ:")
        _show_changed_jobs(found.jobs)
    for change in found.about:
        output.inform(f"made otherwise: {change.what} {change.before or 'none'} -> {change.after or 'none'}")


def _show_tasks(table: str, summaries: Sequence[TaskSummary]) -> None:
    rows = []
    for summary in summaries:
        text = ", ".join(f"{count} {kind}" for kind, count in summary.counts)
        if summary.shift is not None:
            text += f", all by {summary.shift}"
        rows.append((summary.task, str(summary.jobs), text))
    output.table((table, "jobs", "what changed"), rows)


def _show_values(changes: Sequence[Change]) -> None:
    shown = changes if output.Settings.verbose else changes[:VALUES_SHOWN]
    for change in shown:
        values = f": {change.before or 'none'} -> {change.after or 'none'}" if change.before or change.after else ""
        output.result(f"  {change.element}: {change.what}{values}")
    if len(changes) > len(shown):
        output.result(f"  {len(changes) - len(shown)} more; --verbose shows all")


def _show_changed_jobs(jobs: Sequence[JobChange]) -> None:
    for (table, task), group in groupby(jobs, key=lambda change: (change.table, change.job.task)):
        changes = list(group)
        shown = changes if output.Settings.verbose else changes[:JOBS_SHOWN]
        for change in shown:
            kinds = ", ".join(change.kinds)
            places = " -> ".join(_place(job) for job in (change.before, change.after) if job is not None)
            output.result(f"  {table} {task} job {change.job.index}: {kinds}: {places}")
        if len(changes) > len(shown):
            output.result(f"  {table} {task}: {len(changes) - len(shown)} more; --verbose shows all")


def _place(job: Job) -> str:
    parts = f" in {len(job.parts)} parts" if job.parts else ""
    return f"{job.start} to {job.end}{parts} {job.version} on {' '.join(job.units)}"


# ------------------------------------------------------------------------------------------------ JSON


def _schedules_as_json(found: ScheduleDiff) -> dict[str, Any]:
    return {
        "kind": "schedule",
        "same": found.is_same,
        "about": [asdict(c) for c in found.about],
        "tasks": [
            {"table": s.table, "task": s.task, "jobs": s.jobs, **dict(s.counts), "shift": s.shift} for s in found.tasks
        ],
        "values": [asdict(c) for c in found.values],
        "jobs": [
            {"table": c.table, "task": c.job.task, "index": c.job.index, "changes": c.kinds}
            | {"before": _job(c.before), "after": _job(c.after)}
            for c in found.jobs
        ],
    }


def _job(job: Job | None) -> dict[str, Any] | None:
    if job is None:
        return None
    said = {"start": job.start, "end": job.end, "version": job.version, "units": list(job.units)}
    parts = [{"start": p.start, "end": p.end, "from": p.executed_from, "to": p.executed_to} for p in job.parts]
    return said | ({"parts": parts} if parts else {})
