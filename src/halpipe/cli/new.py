"""``halpipe new``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import completing, output
from halpipe.cli.parameters import DiagnosticFormat, Quiet, Verbose
from halpipe.core.diagnostics import Exit

if TYPE_CHECKING:
    from collections.abc import Collection


def new(
    folder: Annotated[str, typer.Argument(metavar="FOLDER", help="Folder to make; it must not be there, or be empty.")],
    example: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="An example instead of a first model: roboracer.",
            show_default=False,
            autocompletion=completing.examples,
        ),
    ] = "",
    table: Annotated[bool, typer.Option("--table", help="Tables for a spreadsheet instead of XML.")] = False,
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Make a folder with a first model to read and change, overlay, pipeline and schemas for editors; or an example."""
    from halpipe.core.files import write_new_folder
    from halpipe.core.suggest import did_you_mean
    from halpipe.starters import EXAMPLES, first_model, first_table
    from halpipe.starters import example as files_of

    output.choose(format, quiet=quiet, verbose=verbose)
    if example and example not in EXAMPLES:
        hint = did_you_mean(example, EXAMPLES, "there is: " + ", ".join(EXAMPLES))
        raise typer.BadParameter(f'there is no example "{example}"; {hint}', param_hint="--example")
    if example and table:
        raise typer.BadParameter("an example has its own files; omit --table or --example", param_hint="--table")
    written = files_of(example) if example else first_table() if table else first_model()
    write_new_folder(folder, written)
    output.inform(f"{folder}: {len(written)} files; begin with {_first(folder, example, written)}")
    return Exit.OK


def _first(folder: str, example: str, written: Collection[str]) -> str:
    if example:
        return f"{folder}/{example}/README.md"
    tables = [f"{folder}/{name}" for name in written if name.endswith(".csv")]
    if tables:
        return f"halpipe import table {' '.join(tables)} -o {folder}/model.xml"
    return f"halpipe schedule {folder}/model.xml -o {folder}/schedule.xml"
