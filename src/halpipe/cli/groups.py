"""Layout of the help: commands in groups, options of one format in a section."""

from __future__ import annotations

import re
from collections import defaultdict
from typing import Any

from typer.core import TyperCommand, TyperGroup

FORMATS = re.compile(r"([A-Z]{2,}(?:, [A-Z]{2,})*): (.)")
"""How the help of an option begins that only some formats have."""


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


class Command(TyperCommand):
    """A command whose options of some formats stand below the others, in a section for each."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments and options; those for all formats first."""
        sections: dict[str, list[tuple[str, str]]] = defaultdict(list)
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None:
                title = "Arguments" if parameter.param_type_name == "argument" else "Options"
                title, help = _section(title, record[1])
                sections[title].append((record[0], help))
        for title in sorted(sections, key=lambda title: (title not in ("Arguments", "Options"), title)):
            with formatter.section(title):
                formatter.write_dl(sections[title])


def _section(title: str, help: str) -> tuple[str, str]:
    """Return the section that an option belongs to, and its help there, which need not name the formats again."""
    named = FORMATS.match(help) if title == "Options" else None
    if named is None:
        return title, help
    return f"{title} for {named[1].replace(', ', ' and ')}", named[2].upper() + help[named.end() :]
