"""``halpipe import``: a command for each installed format, made from its options."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output
from halpipe.cli.app import FormatGroup
from halpipe.cli.options import Output, command, parameter
from halpipe.core.diagnostics import Exit
from halpipe.core.suggest import counted

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from halpipe.core.options import Values
    from halpipe.importers.common.base import Coverage, Imported, Importer

_LARGE = 32 * 2**20
"""Bytes of an input from which on its progress is shown."""

Paths = Annotated[list[str], typer.Argument(help="Files and directories.")]
ListAll = Annotated[bool, typer.Option(help="List every element that was ignored or defaulted, with its line.")]
Report = Annotated[str, typer.Option(metavar="FILE", help="Write the coverage report of the import as JSON.")]


class ImportGroup(FormatGroup):
    """A command for each importer."""

    registry = "halpipe.importers"

    @staticmethod
    def command_of(importer: Importer) -> Callable[..., int]:
        """Return the function that typer makes the command of a format from."""

        def import_(paths: list[str], output_file: str, options: Values, coverage: bool, report: str) -> int:
            return _read(importer, paths, options, output_file, report, every=coverage)

        before = [parameter("paths", Paths), parameter("output_file", Output)]
        after = [parameter("coverage", ListAll, False), parameter("report", Report, "")]
        return command(import_, before, importer.options, after, help=f"Import {importer.summary}.")


app = typer.Typer(
    cls=ImportGroup,
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Read AMALTHEA, AUTOSAR ARXML or ROS graphs into a task model. Nothing is dropped silently: see the counts.",
)


@app.callback()
def _import() -> None: ...


def _read(importer: Importer, paths: list[str], options: Values, target: str, report: str, *, every: bool) -> int:
    from halpipe.core.files import refuse_inputs, refuse_name, write_output
    from halpipe.exporters.native import format_model
    from halpipe.flow.formats import import_model
    from halpipe.importers.common.base import format_account

    with _progress() as on_progress:
        imported = import_model(importer.name, paths, importer.options(**options, on_progress=on_progress))
    refuse_inputs(*filter(None, (target, report)))
    refuse_name(target, ".xml")
    refuse_name(report, ".json")
    write_output(target, format_model(imported.model))
    if report:
        write_output(report, format_account(imported))
    output.report(imported.diagnostics)
    summarise(imported, target, every=every)
    return Exit.OK


@contextmanager
def _progress() -> Iterator[Callable[[int, int], None] | None]:
    """Show how many bytes of a large input have been read, to people who look."""
    if output.Settings.quiet or not output.is_terminal(sys.stderr):
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeElapsedColumn

    columns = TextColumn("reading"), BarColumn(), DownloadColumn(), TimeElapsedColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        bar = progress.add_task("", total=None, visible=False)

        def show(done: int, total: int) -> None:
            progress.update(bar, completed=done, total=total, visible=total > _LARGE)

        yield show


def summarise(imported: Imported, written: str, *, every: bool) -> None:
    """Say what was read, mapped, ignored and defaulted."""
    model = imported.model
    elements = {"task": model.tasks, "unit": model.units, "mode": model.modes, "chain": model.chains}
    output.inform(f"{written}: {', '.join(counted(len(found), kind) for kind, found in elements.items())}")
    for line in _account(imported.coverage, every):
        output.inform(line)


def _account(coverage: Coverage, every: bool) -> list[str]:
    rows = [(kind, *map(str, counts)) for kind, *counts in coverage.rows() if every or counts[1]]
    lines = [f"  {line}" for line in output.columns(("element", "read", "mapped", "ignored"), rows, right=(1, 2, 3))]
    hidden = [(kind, read) for kind, read, mapped, _ in coverage.rows() if not mapped]
    if hidden and not every:
        total = sum(read for _, read in hidden)
        lines.append(f"  and {counted(total, 'element')} of {counted(len(hidden), 'kind')}, none mapped")
    defaults = coverage.defaulted_values
    if every:
        lines += [f"  ignored {e.kind} {e.name} ({e.at}): {e.reason}" for e in coverage.ignored_elements]
        lines += [f"  default {d.element}: {d.what} = {d.value}" + f" ({d.at})" * bool(d.at.file) for d in defaults]
    elif defaults:
        lines.append(f"  {counted(len(defaults), 'value')} defaulted; --coverage lists them and every ignored element")
    return lines
