"""``halpipe import``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output
from halpipe.cli.parameters import DiagnosticFormat, Output, Quiet, Verbose
from halpipe.diagnostics import Exit

if TYPE_CHECKING:
    from halpipe.importers.base import Coverage, Imported

SHOWN_REASONS = 12


def import_(
    source: Annotated[str, typer.Argument(metavar="FORMAT", help="arxml or ros.")],
    paths: Annotated[list[str], typer.Argument(help="Files and directories.")],
    output_file: Output,
    overlay: Annotated[
        list[str] | None, typer.Option(help="YAML file with what the source cannot say; repeatable, later wins.")
    ] = None,
    granularity: Annotated[str, typer.Option(help="ARXML: one task per runnable, event or ostask.")] = "runnable",
    name: Annotated[str, typer.Option(help="Name of the model; otherwise the source's own.")] = "",
    strict: Annotated[bool, typer.Option(help="Every loss is an error (exit code 5).")] = False,
    coverage: Annotated[
        bool, typer.Option(help="List every element that was ignored or defaulted, with its line.")
    ] = False,
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Read AUTOSAR ARXML or ROS graphs into a task model. Nothing is dropped silently: see the counts."""
    from halpipe.exporters.native import format_model
    from halpipe.files import write_output
    from halpipe.importers.base import ImportOptions
    from halpipe.pipeline.stages import import_model

    output.choose(format, quiet=quiet, verbose=verbose)
    options = ImportOptions(name=name, granularity=granularity, strict=strict)
    imported = import_model(source, paths, overlay or [], options)
    write_output(output_file, format_model(imported.model))
    output.report(imported.diagnostics)
    summarise(imported, output_file, every=coverage)
    return Exit.OK


def summarise(imported: Imported, written: str, *, every: bool) -> None:
    """Say what was read, mapped, ignored and defaulted."""
    model = imported.model
    output.inform(
        f"{written}: {len(model.tasks)} tasks, {len(model.units)} units, {len(model.modes)} modes, "
        f"{len(model.chains)} chains"
    )
    for line in _account(imported.coverage, every):
        output.inform(line)


def _account(coverage: Coverage, every: bool) -> list[str]:
    rows = [("element", "read", "mapped", "ignored"), *((k, str(r), str(m), str(i)) for k, r, m, i in coverage.rows())]
    if not every:
        rows = [row for row in rows if row[2] != "0"]
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    lines = [
        "  " + row[0].ljust(widths[0]) + "".join("  " + row[c].rjust(widths[c]) for c in (1, 2, 3)) for row in rows
    ]
    hidden = [(kind, read) for kind, read, mapped, _ in coverage.rows() if not mapped]
    if hidden and not every:
        total = sum(read for _, read in hidden)
        lines.append(f"  and {total} elements of {len(hidden)} kinds without influence on timing")
    defaults = coverage.defaulted_values
    if every:
        lines += [f"  ignored {e.kind} {e.name} ({e.at}): {e.reason}" for e in coverage.ignored_elements]
        lines += [f"  default {d.element}: {d.what} = {d.value} ({d.at})" for d in defaults]
    elif defaults:
        lines.append(f"  {len(defaults)} values were defaulted; --coverage lists them and every ignored element")
    return lines
