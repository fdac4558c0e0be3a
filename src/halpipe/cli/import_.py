"""``halpipe import``."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from halpipe.cli import output, streams
from halpipe.cli.parameters import DiagnosticFormat, Output, Quiet, Verbose
from halpipe.core.diagnostics import Exit

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from halpipe.importers.common.base import Coverage, Imported

T = TypeVar("T")
_LARGE = 32 * 2**20
"""Bytes of an input from which on its progress is shown."""


def import_(
    source: Annotated[str, typer.Argument(metavar="FORMAT", help="amalthea, arxml or ros.")],
    paths: Annotated[list[str], typer.Argument(help="Files and directories.")],
    output_file: Output,
    overlay: Annotated[
        list[str] | None, typer.Option(help="YAML file with what the source cannot say; repeatable, later wins.")
    ] = None,
    granularity: Annotated[str, typer.Option(help="ARXML: one task per runnable, event or ostask.")] = "runnable",
    ecu: Annotated[str, typer.Option(metavar="NAME", help="ARXML: the ECU of a system that has several.")] = "",
    variant: Annotated[
        str, typer.Option(metavar="NAME", help="ARXML: predefined or evaluated variant to import.")
    ] = "",
    condition: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="ARXML: value of a system constant or variant criterion; repeatable."),
    ] = None,
    wcet: Annotated[
        str, typer.Option(help="AMALTHEA: the WCET is the upper, average or lower of a stated execution time.")
    ] = "upper",
    memory: Annotated[
        str, typer.Option(help="AMALTHEA: accesses to memory are within the stated time, added to it, or none.")
    ] = "within",
    mapping: Annotated[
        str, typer.Option(help="AMALTHEA: tasks run where the mapping is stated, or free on all units.")
    ] = "stated",
    pieces: Annotated[
        str, typer.Option(help="AMALTHEA, ARXML: the longest piece of a runnable of a preemptive task; 0ms cuts none.")
    ] = "5ms",
    calibrate: Annotated[
        list[str] | None,
        typer.Option(metavar="FILE", help="ROS: CSV of measured callback durations, for WCETs; repeatable."),
    ] = None,
    quantile: Annotated[
        str, typer.Option(metavar="Q", help="ROS: which of the measured durations is the WCET; 1 is the maximum.")
    ] = "1",
    margin: Annotated[
        str, typer.Option(metavar="SHARE", help="ROS: what is added to it, as a share of it: 0.2 or 20% adds a fifth.")
    ] = "0",
    groups: Annotated[
        str,
        typer.Option(
            help="ROS: exclusive callback groups are resources that their tasks hold to their ends, or ignored."
        ),
    ] = "resources",
    name: Annotated[str, typer.Option(help="Name of the model; otherwise the source's own.")] = "",
    strict: Annotated[bool, typer.Option(help="Every loss is an error (exit code 5).")] = False,
    coverage: Annotated[
        bool, typer.Option(help="List every element that was ignored or defaulted, with its line.")
    ] = False,
    report: Annotated[str, typer.Option(metavar="FILE", help="Write the account of the import as JSON.")] = "",
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Read AMALTHEA, AUTOSAR ARXML or ROS graphs into a task model. Nothing is dropped silently: see the counts."""
    from halpipe.core.durations import Duration
    from halpipe.core.files import refuse_inputs, write_output
    from halpipe.core.quantities import parse_share
    from halpipe.exporters.native import format_model
    from halpipe.flow.formats import import_model
    from halpipe.importers.common.base import ImportOptions, group_rule, quantile_of
    from halpipe.importers.common.coverage import format_account

    output.choose(format, quiet=quiet, verbose=verbose)
    if calibrate and source != "ros":
        raise typer.BadParameter("only the ROS importer reads measurements", param_hint="--calibrate")
    options = ImportOptions(
        name=name,
        granularity=granularity,
        ecu=ecu,
        variant=variant,
        conditions=tuple(condition or ()),
        wcet=wcet,
        memory=memory,
        mapping=mapping,
        pieces=_read(pieces, Duration.parse, "--pieces"),
        calibrate=tuple(calibrate or ()),
        quantile=_read(quantile, quantile_of, "--quantile"),
        margin=_read(margin, parse_share, "--margin"),
        groups=_read(groups, group_rule, "--groups"),
        strict=strict,
    )
    with _progress() as on_progress:
        imported = import_model(source, paths, overlay or [], replace(options, on_progress=on_progress))
    refuse_inputs(*filter(None, (output_file, report)))
    write_output(output_file, format_model(imported.model))
    if report:
        write_output(report, format_account(imported))
    output.report(imported.diagnostics)
    summarise(imported, output_file, every=coverage)
    return Exit.OK


@contextmanager
def _progress() -> Iterator[Callable[[int, int], None] | None]:
    """Show how many bytes of a large input have been read, to people who look."""
    if output.Settings.quiet or not streams.is_terminal(sys.stderr):
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


def _read(text: str, read: Callable[[str], T], option: str) -> T:
    try:
        return read(text)
    except ValueError as failure:
        raise typer.BadParameter(str(failure), param_hint=option) from None


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
    rows = [(kind, *map(str, counts)) for kind, *counts in coverage.rows() if every or counts[1]]
    lines = [f"  {line}" for line in output.columns(("element", "read", "mapped", "ignored"), rows, right=(1, 2, 3))]
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
