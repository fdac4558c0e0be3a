"""``halpipe schedule``."""

from __future__ import annotations

import os
from contextlib import contextmanager
from dataclasses import replace
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output
from halpipe.cli.completing import modes
from halpipe.cli.parameters import DiagnosticFormat, Quiet, Seed, Verbose, WorkerCount
from halpipe.core.suggest import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Iterator
    from fractions import Fraction

    from halpipe.core.durations import Duration
    from halpipe.models import TaskModel
    from halpipe.pipeline.measure.objectives import Objective
    from halpipe.pipeline.solve.away import Away


class Engine(StrEnum):
    """Who looks for the schedule."""

    ANNEAL = "anneal"
    EXACT = "exact"


def schedule(
    model: Annotated[list[str], typer.Argument(metavar="MODEL...", help="Task models XML; - is standard input.")],
    output_file: Annotated[
        str, typer.Option("--output", "-o", metavar="FILE", help="Where to write, of several models a folder.")
    ],
    seed: Seed = 1,
    budget: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Moves per task before the search gives up.",
            show_default="20000, and a million in all; with a --time-limit, none",
        ),
    ] = None,
    time_limit: Annotated[
        float,
        typer.Option(min=0, help="Seconds before it gives up (0: none); the outcome then depends on the machine."),
    ] = 0,
    tick: Annotated[str, typer.Option(help="Grid of the start times; otherwise the largest that loses nothing.")] = "",
    mode: Annotated[
        list[str] | None, typer.Option(help="Schedule this mode only; repeatable.", autocompletion=modes)
    ] = None,
    engine: Annotated[
        Engine,
        typer.Option(help="anneal; or exact, for small systems: CP-SAT."),
    ] = Engine.ANNEAL,
    optimise: Annotated[
        str,
        typer.Option(
            metavar="LIST", help="Go on once valid, the most important first: chains,jitter,margin,preemptions,cost."
        ),
    ] = "",
    freeze: Annotated[
        str, typer.Option(metavar="FILE", help="Schedule that has shipped: its jobs keep start, version and units.")
    ] = "",
    near: Annotated[
        str, typer.Option(metavar="FILE", help="Earlier schedule: as many jobs as can keep start, version and units.")
    ] = "",
    share: Annotated[
        bool, typer.Option("--share", help="Of several models: be --near the schedule of the first that has one.")
    ] = False,
    cluster: Annotated[
        str,
        typer.Option(metavar="ADDRESS", help="Solve the models, or search one, on this dask.distributed scheduler."),
    ] = "",
    workers: WorkerCount = None,
    portfolio: Annotated[
        int, typer.Option(min=1, help="Searches of a mode that take turns when the first is not quick.")
    ] = 4,
    quantise: Annotated[
        str, typer.Option(metavar="FILE", help="Regulator platform: starts and bounds that it can serve exactly.")
    ] = "",
    resume: Annotated[bool, typer.Option(help="Go on with a search that was stopped; the result is the same.")] = False,
    target: Annotated[str, typer.Option(help="With --optimise cost: stop once the cost F is at most this.")] = "",
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Find a schedule for every mode and write it once it has passed the independent check.

    Several models, or a folder to write to: each is solved as if it were alone, and what is finished is kept.

    Ctrl-C, or a search that fails, saves the best placement so far beside the output, as NAME.best.xml.
    """
    from halpipe.cli.searching import find_schedule, workers_of
    from halpipe.importers.native import read_model, read_schedule
    from halpipe.pipeline.solve.schedule import SearchOptions

    output.choose(format, quiet=quiet, verbose=verbose)
    grid = parse_tick(tick)
    is_fleet = len(model) > 1 or share or output_file.endswith("/") or os.path.isdir(output_file)
    system = None
    if not is_fleet:
        system = read_model(model[0])
        _check_modes(system, mode or [])
    options = SearchOptions(seed=seed, budget=budget, tick=grid, modes=tuple(mode or ()), engine=engine.value)
    options = replace(options, optimise=_parse_objectives(optimise))
    options = replace(options, target=_parse_target(target, options.optimise))
    options = replace(options, portfolio=portfolio, workers=workers_of(workers))
    if time_limit:
        options = options.by_the_clock()
    if freeze:
        options = replace(options, shipped=read_schedule(freeze))
    if near:
        options = replace(options, near=read_schedule(near))
    if quantise:
        from halpipe.flow.formats import burst_grid

        options = replace(options, grid=burst_grid(quantise))
    if system is None:
        from halpipe.cli.fleet import schedule_fleet

        if resume:
            raise typer.BadParameter("several models go on by themselves; leave it away", param_hint="--resume")
        processes = workers or 1
        return schedule_fleet(
            model, options, output_file, time_limit=time_limit, processes=processes, cluster=cluster, share=share
        )
    with _on_cluster(cluster) as away:
        return find_schedule(system, replace(options, cluster=away), output_file, time_limit, resume=resume)


@contextmanager
def _on_cluster(address: str) -> Iterator[Away | None]:
    if not address:
        yield None
        return
    from halpipe.pipeline.solve.away import Away
    from halpipe.pipeline.solve.run import on_cluster

    with on_cluster(address) as cluster:
        yield Away(cluster)


def parse_tick(text: str) -> Duration | None:
    """Read the option --tick; None where it is not given."""
    from halpipe.core.durations import Duration

    if not text:
        return None
    try:
        tick = Duration.parse(text)
    except ValueError as failure:
        raise typer.BadParameter(str(failure), param_hint="--tick") from None
    if not tick:
        raise typer.BadParameter("must be longer than 0", param_hint="--tick")
    return tick


def _parse_target(text: str, objectives: tuple[Objective, ...]) -> Fraction | None:
    from halpipe.core.quantities import parse_rational
    from halpipe.pipeline.solve.goals import check_target

    if not text:
        return None
    sign = -1 if text.startswith("-") else 1
    try:
        target = sign * parse_rational(text.removeprefix("-"))
        check_target(target, objectives)
    except ValueError as failure:
        raise typer.BadParameter(str(failure), param_hint="--target") from None
    return target


def _parse_objectives(text: str) -> tuple[Objective, ...]:
    from halpipe.pipeline.solve.goals import objectives_of

    try:
        return objectives_of(text)
    except ValueError as failure:
        raise typer.BadParameter(str(failure), param_hint="--optimise") from None


def _check_modes(model: TaskModel, chosen: list[str]) -> None:
    known = [mode.name for mode in model.modes]
    for name in chosen:
        if name not in known:
            hint = did_you_mean(name, known, "the model has: " + ", ".join(known))
            raise typer.BadParameter(f'the model has no mode "{name}"; {hint}', param_hint="--mode")
