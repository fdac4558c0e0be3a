"""What the commands of ``halpipe export`` share: read, have the stage verify and write, and put the files in place."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output
from halpipe.diagnostics import Exit

if TYPE_CHECKING:
    from halpipe.exporters.base import ExportOptions

OptionalSchedule = Annotated[str, typer.Argument(metavar="SCHEDULE", help="Schedule XML; - is standard input.")]
Title = Annotated[str, typer.Option(help="Title; otherwise the model's name.")]
ModeName = Annotated[str, typer.Option(help="This mode only; otherwise all.")]
Folder = Annotated[str, typer.Option("--output", "-o", metavar="FOLDER", help="Folder to write, as a whole.")]


def export_files(format: str, model: str, schedule: str, target: str, options: ExportOptions) -> int:
    """Export the schedule file of a model file to `target`; return the exit code."""
    from halpipe.flow.formats import export
    from halpipe.importers.native import read_model, read_schedule

    system = read_model(model)
    tables = read_schedule(schedule) if schedule else None
    write_export(export(format, system, tables, options), target)
    return Exit.OK


def write_export(contents: dict[str, bytes], target: str) -> None:
    """Write an export to `target`: a file with further files beside it, or a whole folder.

    DOT is drawn where SVG is asked for.
    """
    from halpipe.files import (
        STDIO,
        begins_like,
        refuse_foreign,
        refuse_inputs,
        write_directory,
        write_output,
        write_outputs,
    )

    if "" not in contents:
        write_directory(target, contents)
    elif target == STDIO:
        write_output(STDIO, contents[""])
        return
    else:
        if Path(target).suffix == ".svg" and not contents[""].lstrip().startswith(b"<"):
            from halpipe.exporters.graph import render_svg

            contents = contents | {"": render_svg(contents[""].decode())}
        placed = {str(Path(target).parent / name) if name else target: content for name, content in contents.items()}
        for name, content in placed.items():
            if name != target:
                refuse_foreign(name, begins_like(content))
        refuse_inputs(*placed)
        write_outputs(placed)
    output.inform(f"{target}: written")
