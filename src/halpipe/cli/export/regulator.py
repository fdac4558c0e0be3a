"""``halpipe export regulator``."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import PurePath
from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output
from halpipe.cli.export.writing import Folder, ModeName, write_export
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Quiet, ScheduleFile, Verbose
from halpipe.diagnostics import Diagnostic, Exit, Location, Severity

if TYPE_CHECKING:
    from collections.abc import Sequence

PlatformFile = Annotated[str, typer.Option(metavar="FILE", help="The regulators and the memory: YAML.")]
Backend = Annotated[
    str,
    typer.Option(
        help="table, axi-realm, qos400, memguard, resctrl or mpam; otherwise what the platform names.",
        show_default=False,
    ),
]
Rounding = Annotated[
    str, typer.Option(help="whole bursts for every phase, controlled (cumulative), or auto: whole where it fits.")
]


def regulator(
    model: ModelFile,
    schedule: ScheduleFile,
    output_folder: Folder,
    platform: PlatformFile,
    backend: Backend = "",
    rounding: Rounding = "auto",
    mode: ModeName = "",
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Write the budgets of memory-bandwidth regulators, window by window, for every mode and transition."""
    from halpipe.exporters.regulator import RegulatorOptions
    from halpipe.exporters.regulator.options import RULES
    from halpipe.flow.formats import export
    from halpipe.importers.native import read_model, read_schedule

    output.choose(format, quiet=quiet, verbose=verbose)
    if rounding not in RULES:
        raise typer.BadParameter(f"choose from {', '.join(RULES)}", param_hint="--rounding")
    options = RegulatorOptions(mode=mode, platform=platform, backend=backend, rounding=rounding)
    contents = export("regulator", read_model(model), read_schedule(schedule), options)
    output.report(_findings(contents["report.json"], (model, schedule, platform)))
    write_export(contents, output_folder)
    if not quiet:
        output.text(contents["report.txt"].decode().rstrip())
    return Exit.OK


def _findings(report: bytes, files: Sequence[str]) -> list[Diagnostic]:
    """Return the warnings of an export, which the report carries with the bare names of `files`."""
    given = {PurePath(file).name: file for file in files}
    found = json.loads(report)["findings"]
    plain = [
        Diagnostic(
            d["code"], Severity(d["severity"]), Location(d["file"], d["line"]), d["path"], d["message"], d["help"]
        )
        for d in found
    ]
    return [replace(d, at=replace(d.at, file=given.get(d.at.file, d.at.file))) for d in plain]
