"""Groups of commands: their help has whole sentences, and formats that are installed are commands."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Any

import typer
from typer.core import TyperGroup

if TYPE_CHECKING:
    from collections.abc import Callable


class Group(TyperGroup):
    """A group whose help cuts no sentence.

    The types of contexts and formatters are click's or typer's own, depending on the version of typer.
    """

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands with the first paragraph of their help."""
        commands = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl([(name, _sentence(command.help)) for name, command in commands if command])


def _sentence(help: str | None) -> str:
    return " ".join((help or "").partition("\n\n")[0].split())


class FormatGroup(Group):
    """One command for each installed format of a `registry`, made on request."""

    registry = ""

    @abstractmethod
    def command_of(self, name: str) -> Callable[..., int]:
        """Return the function that typer makes the command of a format from."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all formats."""
        from halpipe.flow.formats import formats

        return formats(self.registry)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command of a format; the error for an unknown one lists those that there are."""
        single = typer.Typer(rich_markup_mode=None, add_completion=False)
        single.command(cmd_name)(self.command_of(cmd_name))
        return typer.main.get_command(single)
