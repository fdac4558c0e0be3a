"""Options that several verbs share, declared once."""

from __future__ import annotations

from typing import Annotated

import typer

from halpipe.cli.output import Format

ModelFile = Annotated[str, typer.Argument(metavar="MODEL", help="Task model XML; - is standard input.")]
ScheduleFile = Annotated[str, typer.Argument(metavar="SCHEDULE", help="Schedule XML; - is standard input.")]
Output = Annotated[str, typer.Option("--output", "-o", metavar="FILE", help="Where to write; - is standard output.")]
Seed = Annotated[int, typer.Option(min=0, help="Same model, options and seed: same bytes.")]
DiagnosticFormat = Annotated[
    Format | None, typer.Option("--format", help="Form of the diagnostics.", show_default="text")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show errors only.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Show every diagnostic, notes too.")]
WorkerCount = Annotated[
    int | None,
    typer.Option(
        "--workers",
        min=1,
        help="Threads and processes; the result is the same for any number.",
        show_default="one per processor",
    ),
]
