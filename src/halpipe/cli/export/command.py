"""Command of an exporter: the files of every format, and the options of this one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli.export.writing import export_files
from halpipe.cli.options import command, parameter
from halpipe.cli.parameters import ModelFile, Output, ScheduleFile

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.core.options import Values
    from halpipe.exporters.common.base import Exporter

Folder = Annotated[str, typer.Option("--output", "-o", metavar="FOLDER", help="Folder to write, as a whole.")]


def command_of(exporter: Exporter) -> Callable[..., int]:
    """Return the function that typer makes the command of a format from."""

    def export(model: str, schedule: str, output_file: str, options: Values) -> int:
        return export_files(exporter, model, schedule, output_file, exporter.options(**options))

    # Where a model alone is not enough, the exporter says why.
    tables = parameter("schedule", ScheduleFile, "") if exporter.suffix else parameter("schedule", ScheduleFile)
    before = [parameter("model", ModelFile), tables, parameter("output_file", Output if exporter.suffix else Folder)]
    return command(export, before, exporter.options, help=exporter.help or f"Write: {exporter.summary}.")
