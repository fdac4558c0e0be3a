"""``halpipe export linux``."""

from __future__ import annotations

from typing import Annotated

import typer

from halpipe.cli import output
from halpipe.cli.export.riscv import Sources
from halpipe.cli.export.writing import Folder, ModeName, write_export
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Quiet, ScheduleFile, Verbose
from halpipe.diagnostics import Exit


def linux(
    model: ModelFile,
    schedule: ScheduleFile,
    output_folder: Folder,
    mode: ModeName = "",
    cpus: Annotated[
        str, typer.Option(metavar="UNIT=CPU,...", help="Linux CPU of each unit; otherwise in the model's order.")
    ] = "",
    priority: Annotated[int, typer.Option(min=1, max=98, help="SCHED_FIFO priority of the lowest thread.")] = 50,
    sources: Sources = "",
    busy: Annotated[
        int, typer.Option(min=0, max=100, help="Percent of its WCET that a version without sources takes; 0: refuse.")
    ] = 0,
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Write the bundle that plays the schedule on Linux: dispatcher, tables and programs in C, systemd unit."""
    from halpipe.exporters.linux import LinuxOptions
    from halpipe.exporters.linux.unrealised import unrealised
    from halpipe.exporters.ros.options import cpus_of
    from halpipe.exporters.selection import select
    from halpipe.flow.formats import export
    from halpipe.importers.native import read_model, read_schedule

    output.choose(format, quiet=quiet, verbose=verbose)
    try:
        chosen = cpus_of(cpus) if cpus else None
    except ValueError as failure:
        raise typer.BadParameter(str(failure), param_hint="--cpus") from None
    options = LinuxOptions(mode=mode, cpus=chosen, priority=priority, sources=sources, busy=busy)
    system, tables = read_model(model), read_schedule(schedule)
    contents = export("linux", system, tables, options)
    output.report(unrealised(system, select(system, tables, mode, "linux"), options))
    write_export(contents, output_folder)
    return Exit.OK
