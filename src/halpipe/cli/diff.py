"""``halpipe diff``."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING, Annotated, Any

import typer

from halpipe.cli import answers, output
from halpipe.cli.answers import AnswerFormat, Answers
from halpipe.cli.parameters import Quiet, Verbose
from halpipe.core.diagnostics import Exit, HalpipeError, Location

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.models import Job, Schedule, TaskModel
    from halpipe.pipeline.diff import Change, JobChange, ScheduleDiff, TaskSummary

JOBS_SHOWN = 5
"""Jobs of a task whose changes are listed before the rest is only counted."""

VALUES_SHOWN = 40


def diff(
    before: Annotated[str, typer.Argument(metavar="BEFORE", help="Schedule or task model XML.")],
    after: Annotated[str, typer.Argument(metavar="AFTER", help="The same kind of file; - is standard input.")],
    format: Answers = AnswerFormat.TEXT,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Compare two schedules, or two task models, by names: exit code 0 if they say the same, 1 if not.

    A schedule's seed, solver and grid are shown, but are no difference; nor is where a model was imported from.
    """
    from halpipe.models import Schedule, TaskModel
    from halpipe.pipeline.diff import diff_models, diff_schedules

    answers.choose(format, quiet=quiet, verbose=verbose)
    one, other = _read(before), _read(after)
    if isinstance(one, Schedule) and isinstance(other, Schedule):
        return _report_schedules(diff_schedules(one, other), as_json=format is AnswerFormat.JSON)
    if isinstance(one, TaskModel) and isinstance(other, TaskModel):
        return _report_models(diff_models(one, other), as_json=format is AnswerFormat.JSON)
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


def _report_models(changes: Sequence[Change], *, as_json: bool) -> int:
    if as_json:
        answers.print_json({"kind": "task-model", "same": not changes, "changes": [_change(c) for c in changes]})
    elif changes:
        _show_values(changes)
    else:
        output.result("same")
    return Exit.FINDINGS if changes else Exit.OK


def _report_schedules(found: ScheduleDiff, *, as_json: bool) -> int:
    if as_json:
        answers.print_json(_schedules_as_json(found))
    else:
        _show_schedules(found)
    return Exit.OK if found.is_same else Exit.FINDINGS


# ------------------------------------------------------------------------------------------------ text


def _show_schedules(found: ScheduleDiff) -> None:
    output.result("same" if found.is_same else f"{len(found.jobs)} jobs of {len(found.tasks)} tasks differ")
    for table, summaries in groupby(found.tasks, key=lambda summary: summary.table):
        _show_tasks(table, list(summaries))
    if found.values:
        output.result("values that differ:")
        _show_values(found.values)
    if found.jobs:
        output.result("jobs that differ:")
        _show_jobs(found.jobs)
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


def _show_jobs(jobs: Sequence[JobChange]) -> None:
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
        "about": [_change(c) for c in found.about],
        "tasks": [
            {
                "table": s.table,
                "task": s.task,
                "jobs": s.jobs,
                **dict(s.counts),
                "shift": None if s.shift is None else str(s.shift),
            }
            for s in found.tasks
        ],
        "values": [_change(c) for c in found.values],
        "jobs": [
            {
                "table": c.table,
                "task": c.job.task,
                "index": c.job.index,
                "changes": c.kinds,
                "before": _job(c.before),
                "after": _job(c.after),
            }
            for c in found.jobs
        ],
    }


def _change(change: Change) -> dict[str, str]:
    return {"element": change.element, "what": change.what, "before": change.before, "after": change.after}


def _job(job: Job | None) -> dict[str, Any] | None:
    if job is None:
        return None
    said = {"start": str(job.start), "end": str(job.end), "version": job.version, "units": list(job.units)}
    parts = [
        {"start": str(p.start), "end": str(p.end), "from": str(p.executed_from), "to": str(p.executed_to)}
        for p in job.parts
    ]
    return said | ({"parts": parts} if parts else {})
