"""``halpipe export btf``."""

from __future__ import annotations

from typing import Annotated

import typer

from halpipe.cli import output
from halpipe.cli.export.writing import ModeName, OptionalSchedule, Title, export_files
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Output, Quiet, Verbose


def btf(
    model: ModelFile,
    output_file: Output,
    schedule: OptionalSchedule = "",
    mode: ModeName = "",
    title: Title = "",
    cycles: Annotated[int, typer.Option(min=1, max=1000, help="Hyperperiods of a mode before the next switch.")] = 2,
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Write a run through every mode and switch as a trace in the Best Trace Format (BTF)."""
    from halpipe.exporters.btf import BtfOptions

    output.choose(format, quiet=quiet, verbose=verbose)
    return export_files("btf", model, schedule, output_file, BtfOptions(title=title, mode=mode, cycles=cycles))
