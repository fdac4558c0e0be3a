"""``halpipe validate``."""

from __future__ import annotations

from halpipe.cli import output
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Quiet, Verbose
from halpipe.core.diagnostics import Exit, sort_diagnostics


def validate(model: ModelFile, format: DiagnosticFormat = None, quiet: Quiet = False, verbose: Verbose = False) -> int:
    """Check a task model: form, names, windows, loads, hyperperiods. Every finding is listed, with its line."""
    from halpipe.importers.native import read_what_is_well_formed
    from halpipe.pipeline.checked import validate_model

    output.choose(format, quiet=quiet, verbose=verbose)
    system, malformed = read_what_is_well_formed(model)
    found = sort_diagnostics([*malformed, *validate_model(system)])
    output.report(found, as_result=True)
    if any(d.is_error for d in found):
        return Exit.FINDINGS
    if output.is_text():
        output.result(
            f"{model}: valid; {len(system.tasks)} tasks, {len(system.units)} units, "
            f"{len(system.resources)} resources, {len(system.modes)} modes"
        )
    return Exit.OK
