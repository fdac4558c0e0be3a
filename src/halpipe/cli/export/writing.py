"""What the commands of ``halpipe export`` share: read, have the stage verify and write, and put the files in place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output
from halpipe.cli.completing import modes
from halpipe.core.diagnostics import Exit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.cli.export.request import Request
    from halpipe.core.diagnostics import Diagnostic
    from halpipe.exporters.common.base import ExportOptions

OptionalSchedule = Annotated[str, typer.Argument(metavar="SCHEDULE", help="Schedule XML; - is standard input.")]
Title = Annotated[str, typer.Option(help="Title; otherwise the model's name.")]
ModeName = Annotated[str, typer.Option(help="This mode only; otherwise all.", autocompletion=modes)]
Folder = Annotated[str, typer.Option("--output", "-o", metavar="FOLDER", help="Folder to write, as a whole.")]


def export_files(request: Request) -> int:
    """Export as requested, and show what the user should know of it; return the exit code."""
    from halpipe.flow.formats import export_with_remarks
    from halpipe.importers.native import read_model, read_schedule

    system = read_model(request.model)
    tables = read_schedule(request.schedule) if request.schedule else None
    exported = export_with_remarks(request.exporter.name, system, tables, request.options)
    output.report(_with_folders(exported.remarks, [request.model, request.schedule, *_paths(request.options)]))
    write_export(exported.contents, request.target)
    if request.exporter.shown and not output.is_quiet():
        output.text(exported.contents[request.exporter.shown].decode().rstrip())
    return Exit.OK


def _paths(options: ExportOptions) -> list[str]:
    from halpipe.exporters.common.choices import choices

    stated = ((each, getattr(options, each.attribute)) for each in choices(type(options)))
    return [value for each, value in stated if isinstance(value, str) and each.is_path(value)]


def _with_folders(remarks: Sequence[Diagnostic], files: Sequence[str]) -> list[Diagnostic]:
    """Return remarks that name a file without its folder with the name that the user gave."""
    given = {PurePath(file).name: file for file in files if file}
    return [replace(d, at=replace(d.at, file=given.get(d.at.file, d.at.file))) for d in remarks]


def write_export(contents: dict[str, bytes], target: str) -> None:
    """Write an export to `target`: a file with further files beside it, or a whole folder.

    DOT is drawn where SVG is asked for.
    """
    from halpipe.core.files import (
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
