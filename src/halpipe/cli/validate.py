"""``halpipe validate``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Quiet, Verbose
from halpipe.core.diagnostics import Exit, sort_diagnostics
from halpipe.core.options import positive_duration

if TYPE_CHECKING:
    from halpipe.core.durations import Duration


def validate(
    model: ModelFile,
    tick: Annotated[
        str, typer.Option(metavar="TIME", help="Grid of the start times; too coarse a one is an error.")
    ] = "",
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Check a task model: form, names, windows, loads, hyperperiods. Every finding is listed, with its line."""
    from halpipe.importers.native import read_what_is_well_formed
    from halpipe.pipeline.checked import validate_model

    output.choose(format, quiet=quiet, verbose=verbose)
    system, malformed = read_what_is_well_formed(model)
    found = sort_diagnostics([*malformed, *validate_model(system, _duration(tick) if tick else None)])
    output.report(found, as_result=True)
    if any(d.is_error for d in found):
        return Exit.FINDINGS
    if output.is_text():
        output.result(
            f"{model}: valid; {len(system.tasks)} tasks, {len(system.units)} units, "
            f"{len(system.resources)} resources, {len(system.modes)} modes"
        )
    return Exit.OK


def _duration(text: str) -> Duration:
    try:
        return positive_duration(text)
    except ValueError as wrong:
        raise typer.BadParameter(str(wrong), param_hint="--tick") from None
