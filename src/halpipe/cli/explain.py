"""``halpipe explain``."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import completing, output
from halpipe.cli.options import takes
from halpipe.cli.stopping import Stop
from halpipe.core.diagnostics import REGISTER, Exit
from halpipe.core.options import Values
from halpipe.core.suggest import did_you_mean

if TYPE_CHECKING:
    from halpipe.pipeline.explain.explanation import Explanation


def _kind() -> type:
    from halpipe.pipeline.explain.explanation import ExplainOptions

    return ExplainOptions


@takes(_kind, shows_all=True)
def explain(
    subject: Annotated[
        str,
        typer.Argument(
            metavar="MODEL|CODE", help="Task model XML, or a code such as HAL0231.", autocompletion=completing.codes
        ),
    ],
    options: Values,
) -> int:
    """Say why a model has no schedule, with a proof where there is one, and what would help; or explain a code.

    Exit code 4 means proven infeasible; 3, that no schedule was found; 0, that there is one.
    """
    if re.fullmatch(r"(?i)HAL\d{4}", subject):
        return _explain_code(subject.upper())
    from halpipe.flow.searching import explain_options
    from halpipe.importers.native import read_model
    from halpipe.pipeline.explain.explanation import explain as explain_model

    chosen = explain_options(options)
    stop = Stop("stopping; what was found so far follows", chosen.time_limit)
    with stop.listening():
        explanation = explain_model(read_model(subject), chosen, stop.clock())
    output.report(explanation.diagnostics, as_result=True)
    if output.is_text():
        _summarise(explanation)
    return explanation.exit


def _summarise(explanation: Explanation) -> None:
    for name, verdict in explanation.verdicts:
        output.result(f"mode {name}: {verdict}")
    for source, target in explanation.switches:
        output.result(f"switch from {source} to {target}: no table found")


def _explain_code(id: str) -> int:
    """Print the page of a diagnostic code."""
    completing.load_codes()
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
