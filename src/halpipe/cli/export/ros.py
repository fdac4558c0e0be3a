"""``halpipe export ros``."""

from __future__ import annotations

from typing import Annotated

import typer

from halpipe.cli import output
from halpipe.cli.export.writing import ModeName, write_export
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Output, Quiet, ScheduleFile, Verbose
from halpipe.diagnostics import Exit


def ros(
    model: ModelFile,
    schedule: ScheduleFile,
    output_file: Output,
    mode: ModeName = "",
    cpus: Annotated[
        str, typer.Option(metavar="UNIT=CPU,...", help="Linux CPU of each unit; otherwise in the model's order.")
    ] = "",
    priority: Annotated[int, typer.Option(min=1, max=99, help="Priority of the executors, SCHED_FIFO.")] = 80,
    package: Annotated[
        bool, typer.Option("--package", help="Write an ament package that plays the tables, as a folder.")
    ] = False,
    graph: Annotated[
        list[str] | None, typer.Option(metavar="PATH", help="Graph or trace that says which callback each task is.")
    ] = None,
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Write executors, callback groups and timers (YAML) that realise a schedule with ROS 2 on Linux."""
    from halpipe.exporters.ros import RosOptions
    from halpipe.exporters.ros.options import cpus_of
    from halpipe.exporters.ros.packaging import Binding
    from halpipe.exporters.ros.unrealised import unrealised
    from halpipe.exporters.selection import select
    from halpipe.flow.formats import export
    from halpipe.importers.native import read_model, read_schedule
    from halpipe.importers.ros.callbacks import callbacks_of

    output.choose(format, quiet=quiet, verbose=verbose)
    try:
        chosen = cpus_of(cpus) if cpus else None
    except ValueError as failure:
        raise typer.BadParameter(str(failure), param_hint="--cpus") from None
    bindings = {task: Binding(**vars(bound)) for task, bound in callbacks_of(graph).items()} if graph else {}
    options = RosOptions(mode=mode, cpus=chosen, priority=priority, package=package, bindings=bindings)
    system, tables = read_model(model), read_schedule(schedule)
    contents = export("ros", system, tables, options)
    if not package:
        output.report(unrealised(system, select(system, tables, mode, "ros"), options))
    write_export(contents, output_file)
    return Exit.OK
