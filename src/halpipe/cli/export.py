"""Exports from the command line: read, verify and write by the stage, and put the files in place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output
from halpipe.cli.app import FormatGroup
from halpipe.cli.options import ModelFile, Output, ScheduleFile, command, parameter
from halpipe.core.diagnostics import Diagnostic, Exit

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from halpipe.core.options import Values
    from halpipe.exporters.common.base import Exporter, ExportOptions
    from halpipe.flow.formats import Exported


def export_files(exporter: Exporter, model: str, schedule: str, target: str, options: ExportOptions) -> int:
    """Export files of the user, and report what the target cannot do; return the exit code."""
    from halpipe.core.files import refuse_inputs, refuse_name
    from halpipe.flow.formats import endings_of, export_with_remarks
    from halpipe.importers.native import read_model, read_schedule

    system, tables = read_model(model), read_schedule(schedule) if schedule else None
    endings = endings_of(exporter.name, options)
    if endings:
        refuse_inputs(target)
    refuse_name(target, *endings)
    exported = export_with_remarks(exporter.name, system, tables, options)
    remarks = _with_folders(exported.remarks, [model, schedule, *_paths(options)])
    write_export(replace(exported, remarks=tuple(remarks)), target)
    if exporter.shown and not output.Settings.quiet:
        output.text(exported.contents[exporter.shown].decode().rstrip())
    return Exit.OK


def _paths(options: ExportOptions) -> list[str]:
    from halpipe.core.options import options_of

    stated = ((each, getattr(options, each.attribute)) for each in options_of(type(options)))
    return [value for each, value in stated if isinstance(value, str) and each.is_path(value)]


def _with_folders(remarks: Sequence[Diagnostic], files: Sequence[str]) -> list[Diagnostic]:
    """Return remarks that name a file without its folder with the name that the user gave."""
    given = {PurePath(file).name: file for file in files if file}
    return [replace(d, at=replace(d.at, file=given.get(d.at.file, d.at.file))) for d in remarks]


def write_export(exported: Exported, target: str) -> None:
    """Write an export to `target`: a file with further files beside it, or a whole folder.

    DOT is drawn where SVG is asked for.
    """
    from halpipe.core.files import STDIO, write_beside, write_directory, write_output

    output.report(exported.remarks)
    contents = exported.contents
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
        write_beside(placed, target)
    _show_changes(exported)
    output.inform(f"{target}: written")


def _show_changes(exported: Exported) -> None:
    """Show what an export changes in files that are there, such as those of a project."""
    if not exported.changes:
        return
    if not output.is_text():
        output.text(exported.contents[exported.changes].decode().rstrip())
    for line in exported.summary:
        output.inform(line)


Folder = Annotated[str, typer.Option("--output", "-o", metavar="FOLDER", help="Folder to write, as a whole.")]


class ExportGroup(FormatGroup):
    """A command for each exporter."""

    registry = "halpipe.exporters"

    @staticmethod
    def command_of(exporter: Exporter) -> Callable[..., int]:
        """Return the function that typer makes the command of a format from."""

        def export(model: str, schedule: str, output_file: str, options: Values) -> int:
            return export_files(exporter, model, schedule, output_file, exporter.options(**options))

        # Where a model alone is not enough, the exporter says why.
        tables = parameter("schedule", ScheduleFile, "") if exporter.suffix else parameter("schedule", ScheduleFile)
        target = parameter("output_file", Output if exporter.suffix else Folder)
        before = [parameter("model", ModelFile), tables, target]
        return command(export, before, exporter.options, help=exporter.help or f"Write: {exporter.summary}.")


app = typer.Typer(
    cls=ExportGroup,
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Write reports, diagrams and what targets load. A schedule that does not verify, or is of another model, "
    "is refused.",
)


@app.callback()
def _export() -> None: ...
