"""``halpipe export arxml``."""

from __future__ import annotations

from typing import Annotated

import typer

from halpipe.cli import output
from halpipe.cli.export.writing import ModeName, OptionalSchedule, export_files
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Output, Quiet, Verbose


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
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Write the model as AUTOSAR Classic ARXML; a schedule gives OsScheduleTables and timing guarantees."""
    from halpipe.cli.schedule import parse_tick
    from halpipe.exporters.arxml import ArxmlOptions

    output.choose(format, quiet=quiet, verbose=verbose)
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
