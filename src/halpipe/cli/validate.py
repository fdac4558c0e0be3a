"""``halpipe validate``."""

from __future__ import annotations

from halpipe.cli import output
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Quiet, Verbose
from halpipe.diagnostics import Exit


def validate(model: ModelFile, format: DiagnosticFormat = None, quiet: Quiet = False, verbose: Verbose = False) -> int:
    """Check a task model: form, names, windows, loads, hyperperiods. Every finding is listed, with its line."""
    from halpipe.importers.native import read_model
    from halpipe.pipeline.checked import validate_model

    output.choose(format, quiet=quiet, verbose=verbose)
    system = read_model(model)
    found = validate_model(system)
    output.report(found, as_result=True)
    if any(d.is_error for d in found):
        return Exit.FINDINGS
    if output.is_text():
        output.result(
            f"{model}: valid; {len(system.tasks)} tasks, {len(system.units)} units, "
            f"{len(system.resources)} resources, {len(system.modes)} modes"
        )
    return Exit.OK
