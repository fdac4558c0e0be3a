"""Commands made from options that formats and verbs state once (`halpipe.core.options`)."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from halpipe.cli import completing, output
from halpipe.cli.parameters import DiagnosticFormat, Quiet, Verbose
from halpipe.core.options import Form, Option, OptionError, Values, from_command, options_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    Run = Callable[..., int]


def parameter(name: str, annotation: Any, default: Any = inspect.Parameter.empty) -> inspect.Parameter:
    """Return a parameter of a command."""
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


LONGEST = 40
"""Characters of the words that an option takes up to which the help lists them in its place for the value."""

FORMS = (
    parameter("format", DiagnosticFormat, None),
    parameter("quiet", Quiet, False),
    parameter("verbose", Verbose, False),
)


class Verb:
    """A command whose options are added when it is needed: to describe all of them takes longer than most do."""

    def __init__(self, run: Run, kind: Callable[[], type], shows_all: bool) -> None:
        self._run, self._kind, self._shows_all = run, kind, shows_all
        self.__doc__ = run.__doc__

    def made(self) -> Run:
        """Return the function that typer makes the command from."""
        hints = get_type_hints(self._run, include_extras=True)
        own = [p.replace(annotation=hints[p.name]) for p in inspect.signature(self._run).parameters.values()]
        place = [p.name for p in own].index("options")
        return command(self._run, own[:place], self._kind(), own[place + 1 :], shows_all=self._shows_all)


def takes(kind: Callable[[], type], *, shows_all: bool = False) -> Callable[[Run], Verb]:
    """Give a command the options of a `kind`, whose values are its argument `options`, and how diagnostics look.

    A command that `shows_all` diagnostics has no ``--verbose``.
    """
    return lambda run: Verb(run, kind, shows_all)


def command(
    run: Run,
    before: Iterable[inspect.Parameter],
    kind: type,
    after: Iterable[inspect.Parameter] = (),
    *,
    help: str = "",
    shows_all: bool = False,
) -> Run:
    """Return the function that typer makes a command of: further parameters around the options of a `kind`."""
    parameters = [*before, *map(_parameter, options_of(kind)), *after, *(FORMS[:-1] if shows_all else FORMS)]

    def made(**given: Any) -> int:
        output.choose(given.pop("format"), quiet=given.pop("quiet"), verbose=given.pop("verbose", shows_all))
        return run(**{p.name: given[p.name] for p in (*before, *after)}, options=_values(kind, given))

    signature = inspect.Signature([p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in parameters])
    made.__signature__ = signature  # type: ignore[attr-defined]
    made.__annotations__ = {p.name: p.annotation for p in parameters}
    made.__name__, made.__doc__ = run.__name__, help or run.__doc__
    return made


def _parameter(each: Option) -> inspect.Parameter:
    stated: dict[str, Any] = {"help": each.help}
    if each.form is Form.SWITCH:
        flags = () if each.default else (f"--{each.name}",)  # without one, typer makes --name and --no-name
        return parameter(each.attribute, Annotated[bool, typer.Option(*flags, **stated)], each.default)
    if each.otherwise:
        stated["show_default"] = each.otherwise
    if each.words or each.completes:
        stated["autocompletion"] = completing.words(each.words) if each.words else getattr(completing, each.completes)
    metavar = each.metavar or "|".join(each.words)
    option = typer.Option(f"--{each.name}", metavar=metavar if len(metavar) <= LONGEST else None, **stated)
    if each.form is Form.LIST and not each.splits:
        return parameter(each.attribute, Annotated[list[str] | None, option], None)
    if each.required:
        return parameter(each.attribute, Annotated[str, option])
    default = "" if each.default in (None, ()) else str(each.default)
    return parameter(each.attribute, Annotated[str, option], default)


def _values(kind: type, given: dict[str, Any]) -> Values:
    try:
        return from_command(kind, given)
    except OptionError as failure:
        raise typer.BadParameter(str(failure), param_hint=f"--{failure.option.name}") from None
