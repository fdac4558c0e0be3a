"""``halpipe export amalthea``."""

from __future__ import annotations

from typing import Annotated

import typer

from halpipe.cli import output
from halpipe.cli.export.writing import ModeName, OptionalSchedule, export_files
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Output, Quiet, Verbose


def amalthea(
    model: ModelFile,
    output_file: Output,
    schedule: OptionalSchedule = "",
    mode: ModeName = "",
    release: Annotated[str, typer.Option(help="Release of APP4MC to write for, 1.2.0 to 3.3.0.")] = "3.3.0",
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Write the model as AMALTHEA (.amxmi); a schedule gives its offsets and its mapping."""
    from halpipe.exporters.amalthea import AmaltheaOptions

    output.choose(format, quiet=quiet, verbose=verbose)
    return export_files("amalthea", model, schedule, output_file, AmaltheaOptions(mode=mode, release=release))
