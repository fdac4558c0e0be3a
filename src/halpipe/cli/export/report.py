"""``halpipe export report``."""

from __future__ import annotations

from typing import Annotated

import typer

from halpipe.cli import output
from halpipe.cli.export.writing import ModeName, OptionalSchedule, Title, export_files
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Output, Quiet, Verbose


def report(
    model: ModelFile,
    output_file: Output,
    schedule: OptionalSchedule = "",
    mode: ModeName = "",
    title: Title = "",
    import_report: Annotated[
        str, typer.Option(metavar="FILE", help="What `halpipe import --report` wrote; shown as a section.")
    ] = "",
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Write the schedule as one HTML page for people: Gantt charts, loads, chain latencies, tables."""
    from halpipe.exporters.report import ReportOptions

    output.choose(format, quiet=quiet, verbose=verbose)
    options = ReportOptions(title=title, mode=mode, import_report=import_report)
    return export_files("report", model, schedule, output_file, options)
