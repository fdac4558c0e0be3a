"""``halpipe export graph``."""

from __future__ import annotations

from typing import Annotated

import typer

from halpipe.cli import output
from halpipe.cli.export.writing import ModeName, OptionalSchedule, Title, export_files
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Output, Quiet, Verbose


def graph(
    model: ModelFile,
    output_file: Output,
    schedule: OptionalSchedule = "",
    mode: ModeName = "",
    title: Title = "",
    cluster: Annotated[bool, typer.Option(help="One box per mode.")] = False,
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Write the tasks and what ties them as DOT, or drawn as SVG; a schedule colours them by unit."""
    from halpipe.exporters.graph import GraphOptions

    output.choose(format, quiet=quiet, verbose=verbose)
    return export_files("graph", model, schedule, output_file, GraphOptions(title=title, mode=mode, cluster=cluster))
