"""What ``halpipe export arxml`` takes besides the options of the format: the project that the schedule is put onto."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output
from halpipe.cli.export.request import parameter
from halpipe.cli.export.writing import export_files
from halpipe.core.diagnostics import Exit

if TYPE_CHECKING:
    from halpipe.cli.export.request import Request
    from halpipe.exporters.arxml.onto import Onto
    from halpipe.importers.common.base import ImportOptions

Project = Annotated[
    str,
    typer.Option(
        "--onto",
        metavar="PROJECT_DIR",
        help="Put the schedule onto the project that the model was imported from; -o is a folder then.",
    ),
]
Ecu = Annotated[str, typer.Option(metavar="NAME", help="With --onto: the ECU that was imported.")]
Variant = Annotated[str, typer.Option(metavar="NAME", help="With --onto: the variant that was imported.")]
Condition = Annotated[
    list[str] | None, typer.Option(metavar="NAME=VALUE", help="With --onto: as it was given to the import.")
]
PARAMETERS = [
    parameter("onto", Project, ""),
    parameter("ecu", Ecu, ""),
    parameter("variant", Variant, ""),
    parameter("condition", Condition, None),
]


def export(request: Request) -> int:
    """Write files of their own, or put the schedule onto a project."""
    from halpipe.importers.common.base import ImportOptions

    given = request.given
    if not given["onto"]:
        return export_files(request)
    conditions = tuple(given["condition"] or ())
    chosen = ImportOptions(ecu=given["ecu"], variant=given["variant"], conditions=conditions)
    return _put_onto(request.model, request.schedule, given["onto"], request.target, chosen)


def _put_onto(model: str, schedule: str, project: str, target: str, options: ImportOptions) -> int:
    """Write what is added to a project, what changes in it, and the list of both."""
    from halpipe.flow.onto import export_onto
    from halpipe.importers.native import read_model, read_schedule

    if not schedule:
        raise typer.BadParameter("a project gets a schedule; name its file after the model", param_hint="--onto")
    write_onto(export_onto(read_model(model), read_schedule(schedule), project, options), target)
    return Exit.OK


def write_onto(onto: Onto, target: str) -> None:
    """Write the folder, and show the list of changes."""
    from halpipe.core.files import write_directory
    from halpipe.exporters.arxml.onto import CHANGES

    write_directory(target, onto.files)
    output.report(onto.findings)
    if output.is_text():
        for change in onto.summary:
            what = f" {change.name}" if change.name else ""
            value = f"{change.old} -> {change.new or '(nothing)'}" if change.old else f"+ {change.new}"
            output.inform(f"{change.file}: {change.path}{what}: {value}")
        output.inform(f"{target}: written")
    else:
        output.text(onto.files[CHANGES].decode().rstrip())
