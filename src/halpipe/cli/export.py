"""``halpipe export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from halpipe.cli import output
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Output, Quiet, Verbose
from halpipe.diagnostics import Exit


def export(
    target: Annotated[str, typer.Argument(metavar="FORMAT", help="report, graph or trace.")],
    model: ModelFile,
    output_file: Output,
    schedule: Annotated[
        str, typer.Argument(metavar="[SCHEDULE]", help="Schedule XML, where the format needs one.")
    ] = "",
    mode: Annotated[str, typer.Option(help="This mode only; otherwise all.")] = "",
    title: Annotated[str, typer.Option(help="Title of the report; otherwise the model's name.")] = "",
    cluster: Annotated[bool, typer.Option(help="Graph: one box per mode.")] = False,
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Write reports and diagrams. A schedule that does not verify, or is of another model, is refused."""
    from halpipe.exporters.base import ExportOptions
    from halpipe.importers.native import read_model, read_schedule
    from halpipe.pipeline.stages import export as export_stage

    output.choose(format, quiet=quiet, verbose=verbose)
    system = read_model(model)
    tables = read_schedule(schedule) if schedule else None
    contents = export_stage(target, system, tables, ExportOptions(title=title, mode=mode, cluster=cluster))
    write_export(contents, output_file)
    return Exit.OK


def write_export(contents: dict[str, bytes], target: str) -> None:
    """Write an export: its main output to `target`, further files beside it; DOT is drawn where SVG is asked for."""
    from halpipe.files import STDIO, write_output, write_outputs

    if target == STDIO:
        write_output(STDIO, contents[""])
        return
    if Path(target).suffix == ".svg":
        from halpipe.exporters.graph import render_svg

        contents = contents | {"": render_svg(contents[""].decode())}
    beside = Path(target).parent
    write_outputs({str(beside / name) if name else target: content for name, content in contents.items()})
    output.inform(f"{target}: written")
