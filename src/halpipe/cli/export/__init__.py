"""``halpipe export``: a command for each installed format, made from its options."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from halpipe.cli.groups import FormatGroup

if TYPE_CHECKING:
    from collections.abc import Callable


class ExportGroup(FormatGroup):
    """A command for each exporter."""

    registry = "halpipe.exporters"

    def command_of(self, name: str) -> Callable[..., int]:
        """Return the function that typer makes the command of a format from."""
        from halpipe.cli.export.command import command_of
        from halpipe.flow.formats import exporter

        return command_of(exporter(name))


app = typer.Typer(
    cls=ExportGroup,
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Write reports, diagrams and what targets load. A schedule that does not verify, or is of another model, "
    "is refused.",
)


@app.callback()
def _export() -> None: ...
