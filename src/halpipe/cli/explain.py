"""``halpipe explain``."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output
from halpipe.cli.completing import modes
from halpipe.cli.parameters import DiagnosticFormat, Quiet, Seed
from halpipe.cli.stopping import Stop
from halpipe.core.diagnostics import REGISTER, Exit
from halpipe.core.suggest import did_you_mean

if TYPE_CHECKING:
    from halpipe.models import TaskModel
    from halpipe.pipeline.explain.explanation import Explanation


def explain(
    subject: Annotated[str, typer.Argument(metavar="MODEL|CODE", help="Task model XML, or a code such as HAL0231.")],
    schedule: Annotated[
        str,
        typer.Option(metavar="FILE", help="Best placement of a failed search, to explain instead of a new one."),
    ] = "",
    mode: Annotated[str, typer.Option(help="Explain this mode only.", autocompletion=modes)] = "",
    exact: Annotated[
        bool, typer.Option(help="Look for a minimal conflict with the exact engine, if installed.")
    ] = True,
    remedies: Annotated[bool, typer.Option(help="Look for the smallest changes that help.")] = True,
    seed: Seed = 1,
    time_limit: Annotated[float, typer.Option(min=0, help="Seconds after which no new search begins (0: none).")] = 0,
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
) -> int:
    """Say why a model has no schedule, with a proof where there is one, and what would help; or explain a code.

    Exit code 4 means proven infeasible; 3, that no schedule was found; 0, that there is one.
    """
    output.choose(format, quiet=quiet, verbose=True)
    if re.fullmatch(r"(?i)HAL\d{4}", subject):
        return _explain_code(subject.upper())
    from halpipe.importers.native import read_model, read_schedule
    from halpipe.pipeline.explain.explanation import explain as explain_model

    system = read_model(subject)
    _check_mode(system, mode)
    best = read_schedule(schedule) if schedule else None
    stop = Stop("stopping; what was found so far follows", time_limit)
    with stop.listening():
        explanation = explain_model(
            system, mode or None, best, use_exact=exact, remedies=remedies, seed=seed, go_on=stop.clock()
        )
    output.report(explanation.diagnostics, as_result=True)
    if output.is_text():
        _summarise(explanation)
    return explanation.exit


def _check_mode(model: TaskModel, name: str) -> None:
    known = [mode.name for mode in model.modes]
    if name and name not in known:
        hint = did_you_mean(name, known, "the model has: " + ", ".join(known))
        raise typer.BadParameter(f'the model has no mode "{name}"; {hint}', param_hint="--mode")


def _summarise(explanation: Explanation) -> None:
    for name, verdict in explanation.verdicts:
        output.result(f"mode {name}: {verdict}")


def _explain_code(id: str) -> int:
    """Print the page of a diagnostic code."""
    import importlib
    import pkgutil

    import halpipe

    for module in pkgutil.walk_packages(halpipe.__path__, "halpipe."):
        # Codes are declared in modules; those of the kernel and of this command line have none and load slowly.
        if not re.search(r"__main__|\.kernel\.|\.cli(\.|$)", module.name):
            importlib.import_module(module.name)
    code = REGISTER.get(id)
    if code is None:
        raise typer.BadParameter(f"there is no code {id}; {did_you_mean(id, REGISTER, 'see the reference')}")
    output.text(f"{code.id} ({code.severity}): {code.title}\n\n{_wrapped(code.explanation)}".rstrip())
    return Exit.OK


def _wrapped(text: str) -> str:
    """Return a paragraph in lines that the terminal need not break within words."""
    import shutil
    import textwrap

    return textwrap.fill(text, min(100, shutil.get_terminal_size().columns), break_on_hyphens=False)
