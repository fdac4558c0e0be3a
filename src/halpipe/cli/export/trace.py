"""``halpipe export trace``."""

from __future__ import annotations

from halpipe.cli import output
from halpipe.cli.export.writing import ModeName, OptionalSchedule, Title, export_files
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Output, Quiet, Verbose


def trace(
    model: ModelFile,
    output_file: Output,
    schedule: OptionalSchedule = "",
    mode: ModeName = "",
    title: Title = "",
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Write the schedule as a trace to zoom into with Perfetto or chrome://tracing."""
    from halpipe.exporters.base import ExportOptions

    output.choose(format, quiet=quiet, verbose=verbose)
    return export_files("trace", model, schedule, output_file, ExportOptions(title=title, mode=mode))
