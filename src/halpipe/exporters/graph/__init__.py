"""The dependency graph as DOT: tasks, precedence windows and cause-effect chains."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.extent import Extent
from halpipe.core.options import Form, option
from halpipe.core.records import record
from halpipe.exporters.common.base import Exporter, TitledOptions

if TYPE_CHECKING:
    from halpipe.models import Schedule, TaskModel


@record(kw_only=True)
class GraphOptions(TitledOptions):
    """`cluster`: one box per mode instead of one graph of all tasks."""

    cluster: bool = option(False, "One box per mode.", form=Form.SWITCH)


class GraphExporter(Exporter):
    """Writes the tasks and what ties them as DOT text, for which no program is needed; see `render_svg`."""

    name = "graph"
    summary = "dependency graph (DOT): tasks, precedence windows, chains, coloured by unit"
    help = "Write the tasks and what ties them as DOT, or drawn as SVG; a schedule colours them by unit."
    extent = Extent(
        {
            "tasks": "boxes",
            "versions": "lines in the boxes",
            "precedence": "edges with their windows",
            "chains": "coloured edges",
            "modes": "one box each with --cluster",
            "schedule": "colours by unit",
        },
        ("It is a picture and is not read back.",),
    )
    suffix = ".dot"
    options = GraphOptions

    def write(self, model: TaskModel, schedule: Schedule | None, options: GraphOptions) -> dict[str, bytes]:
        """Return the graph as one DOT document; see `halpipe.exporters.common.base.Exporter`."""
        from halpipe.exporters.common.selection import select
        from halpipe.exporters.graph.dot import format_graph
        from halpipe.models.modes import require_mode

        if options.mode:
            require_mode(options.mode, model.modes)
        chosen = None if schedule is None else select(model, schedule, options.mode, self.name)
        return {"": format_graph(model, chosen, options).encode()}


FORMAT = GraphExporter()


def render_svg(dot: str) -> bytes:
    """Draw DOT text as SVG with Graphviz; raise `HalpipeError` when its program is missing or fails.

    This is the one function of the exporters that starts a program, so only the command line calls it.
    """
    import subprocess

    import graphviz

    from halpipe.core.diagnostics import HalpipeError
    from halpipe.core.programs import not_started
    from halpipe.exporters.common.codes import DOT_FAILED, DOT_MISSING

    try:
        drawn: bytes = graphviz.pipe("dot", "svg", dot.encode(), quiet=True)
    except graphviz.ExecutableNotFound:
        help = "install it (apt install graphviz, dnf install graphviz or brew install graphviz), or write .dot"
        raise HalpipeError(DOT_MISSING("drawing SVG needs the program `dot` of Graphviz", help=help)) from None
    except OSError as failure:
        raise not_started("dot", failure) from None
    except subprocess.CalledProcessError as failure:
        said = " ".join((failure.stderr or b"").decode("utf-8", "replace").split())
        message = f"`dot` stopped with status {failure.returncode}" + (f": {said[:300]}" if said else "")
        raise HalpipeError(DOT_FAILED(message, help="write .dot and try another Graphviz version on it")) from None
    return drawn
