"""The commands and what they have in common.

A command line is built with the verb that it is asked for and no other: to describe all of them takes longer than most
of them do.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING, Annotated

import typer

from halpipe import __version__
from halpipe.cli.groups import Group

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

VERBS = (
    "new", "import", "validate", "schedule", "serve", "verify", "explain", "size", "sensitivity", "show", "diff",
    "export", "compare", "deploy", "run", "generate", "selftest", "doctor",
)  # fmt: skip
"""In the order of the help; each has a module of its name."""

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
        name = f"{verb}_" if verb == "import" else verb  # a word that Python keeps for itself
        module = import_module(f"halpipe.cli.{name}")
        if overview:
            app.command(verb)(_described(module.app.info.help if verb in GROUPS else getattr(module, name).__doc__))
        elif verb in GROUPS:
            app.add_typer(module.app, name=verb)
        else:
            function = getattr(module, name)
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
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Take the options before the verb."""
