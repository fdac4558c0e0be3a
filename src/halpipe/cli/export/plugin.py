"""The command of an exporter that another package brings: the options that every format has."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer

from halpipe.cli import output
from halpipe.cli.export.writing import ModeName, OptionalSchedule, Title, export_files
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Output, Quiet, Verbose

if TYPE_CHECKING:
    from halpipe.exporters.base import Exporter


def command_of(exporter: Exporter) -> Any:
    """Return the command, as typer makes it, that writes the format of `exporter`."""

    def export(
        model: ModelFile,
        output_file: Output,
        schedule: OptionalSchedule = "",
        mode: ModeName = "",
        title: Title = "",
        format: DiagnosticFormat = None,
        quiet: Quiet = False,
        verbose: Verbose = False,
    ) -> int:
        from halpipe.exporters.base import ExportOptions

        output.choose(format, quiet=quiet, verbose=verbose)
        return export_files(exporter.name, model, schedule, output_file, ExportOptions(title=title, mode=mode))

    single = typer.Typer(rich_markup_mode=None)
    single.command(exporter.name, help=f"Write: {exporter.summary}.")(export)
    return typer.main.get_command(single)
