"""``halpipe export riscv``."""

from __future__ import annotations

from typing import Annotated

import typer

from halpipe.cli import output
from halpipe.cli.export.writing import Folder, ModeName, export_files
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Quiet, ScheduleFile, Verbose

Profile = Annotated[str, typer.Option(help="Target: a profile's name, or a file that ends in .yaml.")]
Toolchain = Annotated[str, typer.Option(help="zig, gcc, or auto: zig where it is installed.")]
Sources = Annotated[
    str,
    typer.Option(
        metavar="FOLDER", help="Source files are relative to it; otherwise to the model file.", show_default=False
    ),
]


def riscv(
    model: ModelFile,
    schedule: ScheduleFile,
    output_folder: Folder,
    profile: Profile = "vcu118",
    toolchain: Toolchain = "auto",
    sources: Sources = "",
    mode: ModeName = "",
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Compile the tasks and write the bundle that plays the schedule on RISC-V cores with scratchpads."""
    from halpipe.exporters.riscv import RiscvOptions

    output.choose(format, quiet=quiet, verbose=verbose)
    options = RiscvOptions(mode=mode, profile=profile, toolchain=toolchain, sources=sources)
    return export_files("riscv", model, schedule, output_folder, options)
