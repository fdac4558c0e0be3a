"""``halpipe export``: one command per format, one file per command; plug-ins bring theirs by entry point."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer
from typer.core import TyperGroup

from halpipe.cli.export import amalthea, arxml, btf, graph, linux, regulator, report, riscv, ros, trace

if TYPE_CHECKING:
    from collections.abc import Callable

COMMANDS: dict[str, Callable[..., int]] = {
    "amalthea": amalthea.amalthea,
    "arxml": arxml.arxml,
    "btf": btf.btf,
    "graph": graph.graph,
    "linux": linux.linux,
    "regulator": regulator.regulator,
    "report": report.report,
    "riscv": riscv.riscv,
    "ros": ros.ros,
    "trace": trace.trace,
}


class ExportGroup(TyperGroup):
    """The formats with a command of their own, then whatever exporters are installed besides.

    The types of contexts and commands are click's or typer's own, depending on the version of typer.
    """

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all formats."""
        from halpipe.flow.formats import EXPORTERS, formats

        return sorted({*super().list_commands(ctx), *formats(EXPORTERS)})

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command of a format; an unknown name is answered with the names that there are."""
        known = super().get_command(ctx, cmd_name)
        if known is not None:
            return known
        from halpipe.cli.export.plugin import command_of
        from halpipe.flow.formats import exporter

        return command_of(exporter(cmd_name))


app = typer.Typer(
    cls=ExportGroup,
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Write reports, diagrams and what targets load. A schedule that does not verify, or is of another model, "
    "is refused.",
)
for _name, _command in COMMANDS.items():
    app.command(_name)(_command)
