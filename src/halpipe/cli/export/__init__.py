"""``halpipe export``: a command for each installed format, made from what the format says of itself."""

from __future__ import annotations

from typing import Any

import typer

from halpipe.cli.groups import Group


class ExportGroup(Group):
    """One command for each exporter that is installed, made when it is asked for.

    The types of contexts and commands are click's or typer's own, depending on the version of typer.
    """

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all formats."""
        from halpipe.flow.formats import EXPORTERS, formats

        return formats(EXPORTERS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command of a format; an unknown name is answered with the names that there are."""
        from halpipe.cli.export.command import command_of
        from halpipe.flow.formats import exporter

        single = typer.Typer(rich_markup_mode=None, add_completion=False)
        single.command(cmd_name)(command_of(exporter(cmd_name)))
        return typer.main.get_command(single)


app = typer.Typer(
    cls=ExportGroup,
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Write reports, diagrams and what targets load. A schedule that does not verify, or is of another model, "
    "is refused.",
)


@app.callback()
def _export() -> None: ...
