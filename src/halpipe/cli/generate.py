"""``halpipe generate``."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from halpipe.cli import output
from halpipe.cli.parameters import DiagnosticFormat, Output, Quiet, Seed, Verbose
from halpipe.core.diagnostics import Exit

if TYPE_CHECKING:
    from collections.abc import Callable
    from fractions import Fraction

    from halpipe.pipeline.generate import Achieved

_Value = TypeVar("_Value")

_SHARE = "SHARE"
"""Shares are written as 0.7, 7/10 or 70%."""


def generate(
    output_file: Output,
    tasks: Annotated[int, typer.Option(help="Number of tasks.")] = 60,
    units: Annotated[int, typer.Option(help="Number of execution units.")] = 6,
    unit_types: Annotated[int, typer.Option(help="Number of types of units.")] = 2,
    resources: Annotated[int, typer.Option(help="Number of shared resources.")] = 2,
    access_windows: Annotated[int | None, typer.Option(help="Access windows; otherwise one for every task.")] = None,
    multi_version: Annotated[str, typer.Option(metavar=_SHARE, help="Tasks with an alternative version.")] = "0",
    precedence: Annotated[str, typer.Option(metavar=_SHARE, help="Tasks with a predecessor.")] = "0",
    utilisation: Annotated[str, typer.Option(metavar=_SHARE, help="Busy time of the units.")] = "60%",
    hyperperiod: Annotated[str, typer.Option(metavar="DURATION", help="Time after which all repeats.")] = "120ms",
    slack: Annotated[str, typer.Option(metavar=_SHARE, help="Slack of every task.")] = "0",
    fractional: Annotated[bool, typer.Option("--fractional", help="Let windows take parts of a resource.")] = False,
    resource_fill: Annotated[str, typer.Option(metavar=_SHARE, help="Add windows up to this use of resources.")] = "",
    gang: Annotated[str, typer.Option(metavar=_SHARE, help="Tasks that take two units at once.")] = "0",
    unlike_units: Annotated[bool, typer.Option("--unlike-units", help="Make no two units alike.")] = False,
    period: Annotated[
        list[str] | None,
        typer.Option(metavar="DURATION", help="One task of this period; repeatable; replaces --tasks."),
    ] = None,
    seed: Seed = 1,
    witness: Annotated[
        str, typer.Option(metavar="FILE", help="Also write the schedule that the set was cut from.")
    ] = "",
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Write a synthetic task set that is schedulable by construction, as in section VI-B of the paper.

    Shares are written as 0.7, 7/10 or 70%.
    """
    from halpipe.core.durations import Duration
    from halpipe.core.files import refuse_inputs, refuse_name, sha256, write_output
    from halpipe.exporters.native import format_model, format_schedule
    from halpipe.pipeline.generate import SetParameters, achieved, generate_with_witness

    output.choose(format, quiet=quiet, verbose=verbose)
    parameters = SetParameters(
        tasks=tasks,
        units=units,
        unit_types=unit_types,
        access_windows=access_windows,
        resources=resources,
        multi_version=_share("--multi-version", multi_version),
        precedence=_share("--precedence", precedence),
        utilisation=_share("--utilisation", utilisation),
        hyperperiod=_read("--hyperperiod", hyperperiod, Duration.parse),
        slack=_share("--slack", slack),
        fractional=fractional,
        resource_fill=_share("--resource-fill", resource_fill) if resource_fill else None,
        gang=_share("--gang", gang),
        unlike_units=unlike_units,
        periods=tuple(_read("--period", text, Duration.parse) for text in period or ()),
    )
    refuse_inputs(*filter(None, (output_file, witness)))
    for file in (output_file, witness):
        refuse_name(file, ".xml")
    model, schedule = generate_with_witness(parameters, seed)
    document = format_model(model)
    write_output(output_file, document)
    if witness:
        write_output(witness, format_schedule(replace(schedule, model_sha256=sha256(document))))
    _summarise(output_file, achieved(model), parameters.window_count if not resource_fill else 0)
    return Exit.OK


def _summarise(target: str, made: Achieved, windows: int) -> None:
    output.inform(
        f"{target}: {made.jobs} jobs, units {_percent(made.utilisation)} busy, resources "
        f"{_percent(made.resource_fill)} in use by {made.windows} windows"
    )
    if made.windows < windows:
        output.inform(f"{target}: only {made.windows} of {windows} windows have room")


def _percent(share: Fraction) -> str:
    return f"{int(share * 10000) / 100:g} %"


def _share(option: str, text: str) -> Fraction:
    from halpipe.core.quantities import parse_share

    return _read(option, text, parse_share)


def _read(option: str, text: str, reader: Callable[[str], _Value]) -> _Value:
    try:
        return reader(text)
    except ValueError as failure:
        raise typer.BadParameter(str(failure), param_hint=option) from None
