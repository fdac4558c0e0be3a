"""``halpipe sensitivity``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from halpipe.cli import answers, output
from halpipe.cli.answers import BUDGET, AnswerFormat, Answers, Budget, Step
from halpipe.cli.parameters import ModelFile, Quiet, ScheduleFile, Seed, Verbose
from halpipe.core.diagnostics import Exit, Findings

if TYPE_CHECKING:
    from collections.abc import Sequence
    from fractions import Fraction

    from halpipe.core.durations import Duration
    from halpipe.models import TaskModel
    from halpipe.pipeline.whatif.sensitivity import Searched, Sensitivity


def sensitivity(
    model: ModelFile,
    schedule: ScheduleFile,
    task: Annotated[list[str] | None, typer.Option(help="This task only; repeatable.")] = None,
    search: Annotated[bool, typer.Option("--search", help="Look too for schedules with longer WCETs.")] = False,
    step: Step = "1/100",
    seed: Seed = 1,
    budget: Budget = BUDGET,
    format: Answers = AnswerFormat.TEXT,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Show for each version how much its WCET can grow before the schedule breaks, and what would break.

    All jobs keep their starts, and access phases stay where they are. With --search, also before no schedule is found
    for some mode, in steps of a share of the WCET; the switches between modes are then left aside.
    """
    from halpipe.importers.native import read_model, read_schedule
    from halpipe.pipeline.checked import validate_model, verify_schedule
    from halpipe.pipeline.whatif.sensitivity import sensitivities

    answers.choose(format, quiet=quiet, verbose=verbose)
    grid = answers.parse_step(step)
    system, tables = read_model(model), read_schedule(schedule)
    for name in task or ():
        answers.check_name(name, [t.name for t in system.tasks], "task", "--task")
    findings = Findings(validate_model(system))
    findings.stop_on_errors()
    findings.extend(verify_schedule(system, tables))
    findings.stop_on_errors()
    rows = list(sensitivities(system, tables, frozenset(task or ())))
    if search:
        rows = _with_search(system, rows, grid, seed, budget)
    if format is AnswerFormat.JSON:
        answers.print_json([_as_json(row) for row in rows])
    else:
        _show(rows, search=search)
    return Exit.OK


def _with_search(
    system: TaskModel, rows: Sequence[Sensitivity], step: Fraction, seed: int, budget: int
) -> list[Sensitivity]:
    from dataclasses import replace

    from halpipe.cli.searching import Watch
    from halpipe.pipeline.solve.schedule import SearchOptions
    from halpipe.pipeline.whatif.sensitivity import searched
    from halpipe.pipeline.whatif.trial import Search

    with Watch() as watch:
        how = Search(SearchOptions(seed=seed, budget=budget), watch.on_progress)
        return [replace(row, searched=searched(system, row, how, step)) for row in rows]


def _as_json(row: Sensitivity) -> dict[str, Any]:
    result: dict[str, Any] = {
        "task": row.task,
        "version": row.version,
        "wcet": str(row.wcet),
        "growth": None if row.growth is None else str(row.growth),
        "limit": row.reason,
    }
    if row.searched is not None:
        found = row.searched
        result["found"] = {
            "wcet": _or_none(found.found),
            "proven-at-most": _or_none(found.bound),
            "failed": [str(wcet) for wcet in found.failed],
        }
    return result


def _or_none(wcet: Duration | None) -> str | None:
    return None if wcet is None else str(wcet)


def _show(rows: Sequence[Sensitivity], *, search: bool) -> None:
    columns = ["task", "version", "WCET", "can grow by", "share"]
    columns += ["found up to", "proven at most"] if search else []
    lines = []
    for row in rows:
        if row.growth is None:
            growth, share, reason = "", "", "not used in this schedule"
        else:
            growth, share, reason = str(row.growth), _percent(row.growth / row.wcet), row.reason
        lines.append((row.task, row.version, str(row.wcet), growth, share, *_found(row.searched), reason))
    output.table((*columns, "stopped by"), lines)
    if search:
        output.inform("found up to: a longer search may find more, up to what is proven")


def _found(searched: Searched | None) -> list[str]:
    if searched is None:
        return []
    return [str(wcet) if wcet is not None else "any" for wcet in (searched.found, searched.bound)]


def _percent(share: Fraction) -> str:
    """Print a share in tenths of a percent, rounded down."""
    tenths = int(share * 1000)
    return f"{tenths // 10}.{tenths % 10} %"
