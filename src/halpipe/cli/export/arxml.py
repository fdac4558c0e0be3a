"""``halpipe export arxml``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output
from halpipe.cli.export.writing import ModeName, OptionalSchedule, export_files
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Output, Quiet, Verbose
from halpipe.diagnostics import Exit

if TYPE_CHECKING:
    from halpipe.importers.base import ImportOptions


def arxml(
    model: ModelFile,
    output_file: Output,
    schedule: OptionalSchedule = "",
    mode: ModeName = "",
    release: Annotated[str, typer.Option(help="AUTOSAR release: 4.0.3, 4.2.2, R19-11 or R22-11.")] = "R22-11",
    part: Annotated[str, typer.Option(help="system, ecuc (cores, OS and RTE; needs a schedule), or all.")] = "all",
    ecuc_prefix: Annotated[
        str, typer.Option(metavar="PATH", help="Package of the ECUC definitions; vendors have their own.")
    ] = "/AUTOSAR/EcucDefs",
    tick: Annotated[str, typer.Option(metavar="TIME", help="Tick of the counters; otherwise the largest.")] = "",
    min_cycle: Annotated[int, typer.Option(metavar="TICKS", help="OsCounterMinCycle of the counters.")] = 1,
    max_value: Annotated[int, typer.Option(metavar="TICKS", help="OsCounterMaxAllowedValue of the counters.")] = 2**30
    - 1,
    max_points: Annotated[
        int, typer.Option(metavar="N", help="Expiry points that the OS allows in a table, 254 for ATK2; 0: any number.")
    ] = 0,
    onto: Annotated[
        str,
        typer.Option(
            metavar="PROJECT_DIR",
            help="Put the schedule onto the project that the model was imported from; -o is a folder then.",
        ),
    ] = "",
    ecu: Annotated[str, typer.Option(metavar="NAME", help="With --onto: the ECU that was imported.")] = "",
    variant: Annotated[str, typer.Option(metavar="NAME", help="With --onto: the variant that was imported.")] = "",
    condition: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="With --onto: as it was given to the import.")
    ] = None,
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Write the model as AUTOSAR Classic ARXML; a schedule gives OsScheduleTables and timing guarantees."""
    from halpipe.cli.schedule import parse_tick
    from halpipe.exporters.arxml import ArxmlOptions

    output.choose(format, quiet=quiet, verbose=verbose)
    if onto:
        from halpipe.importers.base import ImportOptions

        chosen = ImportOptions(ecu=ecu, variant=variant, conditions=tuple(condition or ()))
        return _put_onto(model, schedule, onto, output_file, chosen)
    options = ArxmlOptions(
        mode=mode,
        release=release,
        part=part,
        ecuc_prefix=ecuc_prefix,
        tick=parse_tick(tick),
        min_cycle=min_cycle,
        max_value=max_value,
        max_points=max_points or None,
    )
    return export_files("arxml", model, schedule, output_file, options)


def _put_onto(model: str, schedule: str, project: str, target: str, options: ImportOptions) -> int:
    """Write what is added to a project, what changes in it, and the list of both; show the list."""
    from halpipe.exporters.arxml.onto import CHANGES
    from halpipe.files import write_directory
    from halpipe.flow.onto import export_onto
    from halpipe.importers.native import read_model, read_schedule

    if not schedule:
        raise typer.BadParameter("a project gets a schedule; name its file after the model", param_hint="--onto")
    onto = export_onto(read_model(model), read_schedule(schedule), project, options)
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
    return Exit.OK
