"""The commands and what they have in common."""

from __future__ import annotations

from typing import Annotated

import typer

from halpipe import __version__
from halpipe.cli import (
    bench,
    compare,
    deploy,
    diff,
    doctor,
    explain,
    export,
    generate,
    import_,
    run,
    schedule,
    sensitivity,
    show,
    size,
    validate,
    verify,
)

app = typer.Typer(
    help="From vehicle software models to verified time-triggered schedules and what hardware loads.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit codes: 0 ok, 1 findings, 2 usage, 3 no schedule found, 4 proven infeasible, 5 unsupported under "
    "--strict, 70 internal error, 130 interrupted.",
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"halpipe {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Take the options before the verb."""


app.command("import")(import_.import_)
app.command("validate")(validate.validate)
app.command("schedule")(schedule.schedule)
app.command("verify")(verify.verify)
app.command("explain")(explain.explain)
app.command("size")(size.size)
app.command("sensitivity")(sensitivity.sensitivity)
app.command("show")(show.show)
app.command("diff")(diff.diff)
app.add_typer(export.app, name="export")
app.command("compare")(compare.compare)
app.add_typer(deploy.app, name="deploy")
app.command("run")(run.run)
app.command("generate")(generate.generate)
app.command("bench")(bench.bench)
app.command("doctor")(doctor.doctor)
