"""Commands that have commands: their help shows each with its whole sentence."""

from __future__ import annotations

from typing import Any

from typer.core import TyperGroup


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
