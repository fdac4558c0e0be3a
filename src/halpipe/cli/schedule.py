"""``halpipe schedule``."""

from __future__ import annotations

import os
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli.options import takes
from halpipe.cli.parameters import WorkerCount
from halpipe.core.options import Values

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.pipeline.solve.away import Away


def _kind() -> type:
    from halpipe.pipeline.solve.schedule import SearchOptions

    return SearchOptions


@takes(_kind)
def schedule(
    model: Annotated[list[str], typer.Argument(metavar="MODEL...", help="Task models XML; - is standard input.")],
    output_file: Annotated[
        str, typer.Option("--output", "-o", metavar="FILE", help="Where to write, of several models a folder.")
    ],
    options: Values,
    share: Annotated[
        bool, typer.Option("--share", help="Of several models: be --near the schedule of the first that has one.")
    ] = False,
    cluster: Annotated[
        str,
        typer.Option(metavar="ADDRESS", help="Solve the models, or search one, on this dask.distributed scheduler."),
    ] = "",
    workers: WorkerCount = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue a stopped search; the result is the same.")
    ] = False,
) -> int:
    """Find a schedule for every mode and write it once it has passed the independent check.

    Several models, or a folder to write to: each is solved as if it were alone, and what is finished is kept.

    Ctrl-C, or a search that fails, saves the best placement so far beside the output, as NAME.best.xml.
    """
    from halpipe.cli.searching import find_schedule, workers_of
    from halpipe.flow.searching import search_options
    from halpipe.importers.native import read_model

    chosen = search_options(options, workers=workers_of(workers))
    if len(model) > 1 or share or output_file.endswith("/") or os.path.isdir(output_file):
        from halpipe.cli.fleet import schedule_fleet

        if resume:
            raise typer.BadParameter("several models are resumed without it; omit it", param_hint="--resume")
        return schedule_fleet(model, chosen, output_file, processes=workers or 1, cluster=cluster, share=share)
    system = read_model(model[0])
    with _on_cluster(cluster) as away:
        return find_schedule(system, replace(chosen, cluster=away), output_file, resume=resume)


@contextmanager
def _on_cluster(address: str) -> Iterator[Away | None]:
    if not address:
        yield None
        return
    from halpipe.pipeline.solve.away import Away
    from halpipe.pipeline.solve.run import on_cluster

    with on_cluster(address) as cluster:
        yield Away(cluster)
