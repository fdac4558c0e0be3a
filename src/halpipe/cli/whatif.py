"""``halpipe size`` and ``halpipe sensitivity``: how small a platform can be, and how much a schedule bears."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import typer

from halpipe.cli import output
from halpipe.cli.options import ModelFile, ScheduleFile, print_json, takes
from halpipe.core.diagnostics import Exit, Findings
from halpipe.core.options import Values

if TYPE_CHECKING:
    from collections.abc import Sequence
    from fractions import Fraction

    from halpipe.models import TaskModel
    from halpipe.pipeline.whatif.sensitivity import Searched, Sensitivity
    from halpipe.pipeline.whatif.size import Answer


MORE_TIME = "raise --time-limit"


@takes("halpipe.pipeline.whatif.size:SizeOptions", answers=True)
def size(model: ModelFile, options: Values) -> int:
    """Find how small the platform can be, or how slow: the smallest size with a schedule, and what is proven.

    What is found has a schedule that passed the independent check. It is not called the optimum: a longer search may
    find a smaller size, down to the proven bound. Exit code 4 means that no size is enough, 3 that none was found.
    """
    from halpipe.cli.searching import Watch
    from halpipe.importers.native import read_model
    from halpipe.pipeline.explain.codes import CUT_SHORT
    from halpipe.pipeline.solve.limits import refuse_endless
    from halpipe.pipeline.whatif.size import SizeOptions, answer_of, complaint, question_of
    from halpipe.pipeline.whatif.trial import TRIES

    chosen = SizeOptions(**options)
    if not (chosen.units or chosen.bandwidth or chosen.wcet_factor):
        raise typer.BadParameter("ask for one of --units, --bandwidth and --wcet-factor")
    system = read_model(model)
    question = question_of(system, chosen)
    output.report(question.warnings)
    if chosen.is_open:
        now = question.at(question.now).model
        refuse_endless(now, switches=chosen.switches, searches=TRIES, is_checked=True)
    with Watch(chosen.time_limit) as watch:
        answer = answer_of(question, chosen, watch.on_progress, watch.go_on)
    if (wrong := complaint(answer)) is not None:
        output.report([wrong, *answer.witness])
    if answer.is_cut:
        output.report([CUT_SHORT("a longer search may find more", path=question.what, help=MORE_TIME)])
    if output.is_text():
        _show_size(answer, system, chosen.bandwidth)
    else:
        print_json(_size_json(answer))
    if wrong is not None:
        return Exit.INFEASIBLE if answer.bound is None else Exit.NOT_FOUND
    return Exit.OK


def _text(value: Fraction | None) -> str | None:
    from halpipe.core.quantities import format_rational

    return None if value is None else format_rational(value)


def _size_json(answer: Answer) -> dict[str, Any]:
    question = answer.question
    return {
        "question": question.what,
        "now": _text(question.now),
        "found": _text(answer.found),
        "proven": _text(answer.bound),
        "proven-is": "at most" if question.largest else "at least",
        "witness": [{"code": d.code, "path": d.path, "message": d.message} for d in answer.witness],
        "failed": [_text(value) for value in answer.failed],
        "cut-short": answer.is_cut,
    }


def _show_size(answer: Answer, system: TaskModel, resource: str) -> None:
    question = answer.question
    if answer.bound is None:
        output.result(f"{question.what}: no value is enough, which is proven")
        return
    found = "none found" if answer.found is None else f"found {_text(answer.found)}"
    side = "at most" if question.largest else "at least"
    output.result(
        f"{question.what}: {found} (proven: {side} {_text(answer.bound)}); the model has {_text(question.now)}"
    )
    peak = next((r.bandwidth for r in system.resources if r.name == resource), None)
    if answer.found is not None and peak is not None:
        from halpipe.core.quantities import format_bandwidth

        output.result(f"  that is {format_bandwidth(math.ceil(peak * answer.found))} of {format_bandwidth(peak)}")
    for witness in answer.witness[:3]:
        beyond = "more" if question.largest else "less"
        output.result(f"  {beyond} cannot be: {witness.path}: {witness.message}")
    if answer.failed:
        shown = ", ".join(filter(None, map(_text, answer.failed)))
        output.result(f"  tried without success, which proves nothing: {shown}")


@takes("halpipe.pipeline.whatif.sensitivity:SensitivityOptions", answers=True)
def sensitivity(model: ModelFile, schedule: ScheduleFile, options: Values) -> int:
    """Show for each version how much its WCET can grow before the schedule breaks, and what would break.

    All jobs keep their starts, and access phases stay where they are. With --search, also before no schedule is found
    for some mode, in steps of a share of the WCET; the switches between modes are then left aside.
    """
    from halpipe.cli.searching import Watch
    from halpipe.core.options import refuse_unused
    from halpipe.importers.native import read_model, read_schedule
    from halpipe.pipeline.checked import validate_model, verify_schedule
    from halpipe.pipeline.explain.codes import CUT_SHORT
    from halpipe.pipeline.solve.limits import refuse_endless
    from halpipe.pipeline.whatif.sensitivity import SensitivityOptions, sensitivities, with_searches

    chosen = SensitivityOptions(**options)
    refuse_unused(chosen, "sensitivity without --search")
    system, tables = read_model(model), read_schedule(schedule)
    findings = Findings(validate_model(system))
    findings.stop_on_errors()
    findings.extend(verify_schedule(system, tables))
    findings.stop_on_errors()
    rows = list(sensitivities(system, tables, frozenset(chosen.tasks)))
    if chosen.search:
        if chosen.is_open:
            refuse_endless(system, switches=False, searches=len(rows), is_checked=True)
        with Watch(chosen.time_limit) as watch:
            rows = with_searches(system, rows, chosen, watch.on_progress, watch.go_on)
        if cut := [row for row in rows if row.searched is not None and row.searched.is_cut]:
            text = f"time was over before {len(cut)} of {len(rows)} versions were looked at in full"
            output.report([CUT_SHORT(text, path="sensitivity", help=MORE_TIME)])
    if output.is_text():
        _show_growth(rows, search=chosen.search)
    else:
        print_json([_sensitivity_json(row) for row in rows])
    return Exit.OK


def _sensitivity_json(row: Sensitivity) -> dict[str, Any]:
    result: dict[str, Any] = {
        "task": row.task,
        "version": row.version,
        "wcet": row.wcet,
        "growth": row.growth,
        "limit": row.reason,
    }
    if row.searched is not None:
        found = row.searched
        result["found"] = {"wcet": found.found, "proven-at-most": found.bound, "failed": found.failed}
        result["found"]["cut-short"] = found.is_cut
    return result


def _show_growth(rows: Sequence[Sensitivity], *, search: bool) -> None:
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
    none = "not known" if searched.is_cut else "any"
    return [none if wcet is None else str(wcet) for wcet in (searched.found, searched.bound)]


def _percent(share: Fraction) -> str:
    """Print a share in tenths of a percent, rounded down."""
    tenths = int(share * 1000)
    return f"{tenths // 10}.{tenths % 10} %"
