"""What ``halpipe export ros`` takes besides the options of the format: where the callbacks of the tasks are known."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli.export.request import parameter
from halpipe.cli.export.writing import export_files

if TYPE_CHECKING:
    from halpipe.cli.export.request import Request

Graph = Annotated[
    list[str] | None, typer.Option(metavar="PATH", help="Graph or trace that says which callback each task is.")
]
PARAMETERS = [parameter("graph", Graph, None)]


def export(request: Request) -> int:
    """Export with the callbacks that a graph or trace has."""
    from halpipe.exporters.ros import RosOptions
    from halpipe.exporters.ros.packaging import Binding
    from halpipe.importers.ros.callbacks import callbacks_of

    graph, options = request.given["graph"], request.options
    if graph and isinstance(options, RosOptions):
        bindings = {task: Binding(**vars(bound)) for task, bound in callbacks_of(graph).items()}
        request = replace(request, options=replace(options, bindings=bindings))
    return export_files(request)
