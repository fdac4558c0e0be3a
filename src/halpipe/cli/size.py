"""``halpipe size``."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

import typer

from halpipe.cli import answers, output
from halpipe.cli.answers import BUDGET, AnswerFormat, Answers, Budget, Step
from halpipe.cli.completing import modes
from halpipe.cli.parameters import ModelFile, Quiet, Seed, Verbose
from halpipe.core.diagnostics import Exit

if TYPE_CHECKING:
    from fractions import Fraction

    from halpipe.models import TaskModel
    from halpipe.pipeline.whatif.size import Answer, Question


def size(
    model: ModelFile,
    units: Annotated[str, typer.Option(metavar="TYPE", help="Ask for the fewest units of this type.")] = "",
    bandwidth: Annotated[
        str, typer.Option(metavar="RESOURCE", help="Ask for the lowest share of the bandwidth of this resource.")
    ] = "",
    wcet_factor: Annotated[bool, typer.Option("--wcet-factor", help="Ask by how much all WCETs can grow.")] = False,
    mode: Annotated[
        str, typer.Option(help="This mode only; otherwise the size is enough for each.", autocompletion=modes)
    ] = "",
    switches: Annotated[
        bool, typer.Option("--switches", help="Require the tables for the switches that the model lists, too.")
    ] = False,
    step: Step = "1/100",
    seed: Seed = 1,
    budget: Budget = BUDGET,
    tick: Annotated[str, typer.Option(help="Grid of the start times; otherwise the largest that loses nothing.")] = "",
    format: Answers = AnswerFormat.TEXT,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Find how small the platform can be, or how slow: the smallest size with a schedule, and what is proven.

    What is found has a schedule that passed the independent check. It is not called the optimum: a longer search may
    find a smaller size, down to the proven bound. Exit code 4 means that no size is enough, 3 that none was found.
    """
    from halpipe.cli.searching import Watch
    from halpipe.importers.native import read_model
    from halpipe.pipeline.whatif.size import ask, complaint
    from halpipe.pipeline.whatif.trial import Search

    answers.choose(format, quiet=quiet, verbose=verbose)
    grid = answers.parse_step(step)
    if sum((bool(units), bool(bandwidth), wcet_factor)) != 1:
        raise typer.BadParameter("ask for one of --units, --bandwidth and --wcet-factor")
    system = read_model(model)
    question = _question(system, units, bandwidth, mode, grid)
    output.report(question.warnings)
    with Watch() as watch:
        answer = ask(question, Search(_options(seed, budget, tick), watch.on_progress, switches))
    wrong = complaint(answer)
    if wrong is not None:
        output.report([wrong, *answer.witness])
    if format is AnswerFormat.JSON:
        answers.print_json(_as_json(answer))
    else:
        _show(answer, system, bandwidth)
    if wrong is not None:
        return Exit.INFEASIBLE if answer.bound is None else Exit.NOT_FOUND
    return Exit.OK


def _question(system: TaskModel, units: str, bandwidth: str, mode: str, step: Fraction) -> Question:
    from halpipe.pipeline.whatif.size import fewest_units, largest_factor, lowest_bandwidth, of_modes

    if mode:
        answers.check_name(mode, [m.name for m in system.modes], "mode", "--mode")
    if units:
        answers.check_name(units, {u.type for u in system.units if u.type}, "unit of type", "--units")
    if bandwidth:
        answers.check_name(bandwidth, [r.name for r in system.resources], "resource", "--bandwidth")
    system = of_modes(system, mode)
    if units:
        return fewest_units(system, units)
    return lowest_bandwidth(system, bandwidth, step) if bandwidth else largest_factor(system, step)


def _options(seed: int, budget: int, tick: str) -> Any:
    from halpipe.core.options import positive_duration
    from halpipe.pipeline.solve.schedule import SearchOptions

    try:
        grid = positive_duration(tick) if tick else None
    except ValueError as failure:
        raise typer.BadParameter(str(failure), param_hint="--tick") from None
    return SearchOptions(seed=seed, budget=budget, tick=grid)


def _text(value: Fraction | None) -> str | None:
    from halpipe.core.quantities import format_rational

    return None if value is None else format_rational(value)


def _as_json(answer: Answer) -> dict[str, Any]:
    question = answer.question
    return {
        "question": question.what,
        "now": _text(question.now),
        "found": _text(answer.found),
        "proven": _text(answer.bound),
        "proven-is": "at most" if question.largest else "at least",
        "witness": [{"code": d.code, "path": d.path, "message": d.message} for d in answer.witness],
        "failed": [_text(value) for value in answer.failed],
    }


def _show(answer: Answer, system: TaskModel, resource: str) -> None:
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
