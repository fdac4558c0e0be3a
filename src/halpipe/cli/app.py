"""Groups of commands: their help has whole sentences, and formats that are installed are commands."""

from __future__ import annotations

import os
from abc import abstractmethod
from importlib import import_module
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from halpipe import __version__

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable


class Group(TyperGroup):
    """A group whose help cuts no sentence.

    The types of contexts and formatters are click's or typer's own, depending on the version of typer.
    """

    def invoke(self, ctx: Any) -> Any:
        """Run the command; typer itself would answer Ctrl-C without a word."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stop:
            raise typer.Abort from stop

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that the arguments begin with; the error for an unknown one says what was meant."""
        if not ctx.resilient_parsing and self.get_command(ctx, args[0]) is None:
            from halpipe.core.suggest import did_you_mean

            known = did_you_mean(args[0], self.list_commands(ctx), f"`{ctx.command_path} -h` lists them")
            ctx.fail(f'there is no command "{args[0]}"; {known}')
        name, command, rest = super().resolve_command(ctx, args)
        if not ctx.resilient_parsing and not isinstance(command, TyperGroup):
            _refuse_swallowed(ctx, command, rest)
        return name, command, rest

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands with the first paragraph of their help."""
        commands = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl([(name, _sentence(command.help)) for name, command in commands if command])


def _refuse_swallowed(ctx: Any, command: Any, words: list[str]) -> None:
    """Refuse an option as the value of another one, as a forgotten value leaves it: it would be missed elsewhere."""
    options = {each: param for param in command.params for each in param.opts if each.startswith("-")}
    for before, word in pairwise(words):
        if before in options and not getattr(options[before], "is_flag", False) and word in options:
            ctx.fail(f'option "{before}" lacks its value: "{word}" is an option')


def _sentence(help: str | None) -> str:
    return " ".join((help or "").partition("\n\n")[0].split())


class FormatGroup(Group):
    """One command for each installed format of a `registry`, made on request."""

    registry = ""

    @staticmethod
    @abstractmethod
    def command_of(format: Any) -> Callable[..., int]:
        """Return the function that typer makes the command of a format from."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all formats."""
        from halpipe.flow.formats import formats

        return formats(self.registry)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command of a format; the error for an unknown one lists those that there are."""
        from halpipe.flow.formats import registered

        single = typer.Typer(rich_markup_mode=None, add_completion=False)
        single.command(cmd_name)(self.command_of(registered(self.registry, cmd_name)))
        return typer.main.get_command(single)


VERBS = {
    "new": "tools", "import": "import_", "validate": "checks", "schedule": "schedule", "serve": "serve",
    "verify": "checks", "explain": "checks", "size": "whatif", "sensitivity": "whatif", "show": "show", "diff": "show",
    "export": "export", "compare": "compare", "deploy": "deploy", "run": "schedule", "generate": "tools",
    "selftest": "tools", "doctor": "tools",
}  # fmt: skip
"""In the order of the help, each with its module."""

HELP = ("-h", "--help")

GROUPS = ("import", "export", "deploy")
"""Verbs that have commands of their own."""

COMPLETION = "_HALPIPE_COMPLETE"
"""Set by a shell that asks how a command line may go on."""


def app_for(arguments: list[str]) -> typer.Typer:
    """Return the command line that can answer these arguments: of one verb, else an overview of all."""
    asked = _words_to_complete() if COMPLETION in os.environ else arguments
    return build(asked[:1]) if asked and asked[0] in VERBS else build(VERBS, overview=True)


def _words_to_complete() -> list[str]:
    """Return what stands on the command line so far, as the completion of the user's shell says."""
    words = os.environ.get("_TYPER_COMPLETE_ARGS") or os.environ.get("COMP_WORDS", "")
    return words.split()[1:]


def build(verbs: Iterable[str], *, overview: bool = False) -> typer.Typer:
    """Return the command line of some verbs; for an overview of them, without their arguments and options."""
    app = typer.Typer(
        cls=Group,
        help="From vehicle software models to verified time-triggered schedules and what hardware loads.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": list(HELP)},
        epilog="Exit codes: 0 ok, 1 findings, 2 usage, 3 no schedule found, 4 proven infeasible, 5 unsupported under "
        "--strict, 70 internal error, 130 interrupted.",
    )
    app.callback()(_options)
    for verb in verbs:
        module = import_module(f"halpipe.cli.{VERBS[verb]}")
        if overview:
            app.command(verb)(_described(module.app.info.help if verb in GROUPS else getattr(module, verb).__doc__))
        elif verb in GROUPS:
            app.add_typer(module.app, name=verb)
        else:
            function = getattr(module, verb)
            app.command(verb)(function.made() if hasattr(function, "made") else function)
    return app


def _described(text: str) -> Callable[[], None]:
    def command() -> None: ...

    command.__doc__ = text
    return command


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"halpipe {__version__}")
        raise typer.Exit


def _options(
    version: Annotated[bool, typer.Option("--version", callback=_print_version, help="Print the version.")] = False,
) -> None:
    """Take the options before the verb."""
