"""Parameters of commands: those that verbs share, their completion, and those that formats and verbs state once."""

from __future__ import annotations

import inspect
import json
import re
from enum import StrEnum
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from halpipe.cli import output
from halpipe.cli.output import Format
from halpipe.core.options import Form, Option, OptionError, Values, from_command, options_of
from halpipe.core.quantities import whole

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    Run = Callable[..., int]


ModelFile = Annotated[str, typer.Argument(metavar="MODEL", help="Task model XML; - is standard input.")]
ScheduleFile = Annotated[str, typer.Argument(metavar="SCHEDULE", help="Schedule XML; - is standard input.")]
Output = Annotated[str, typer.Option("--output", "-o", metavar="FILE", help="Where to write; - is standard output.")]


def reads(read: Callable[[str], Any], *names: str, **stated: Any) -> Any:
    """Return an option that is read as in every other place: by a function that raises ``ValueError``."""

    def parse(text: str) -> Any:
        try:
            return read(str(text))
        except ValueError as failure:
            raise typer.BadParameter(str(failure)) from None

    return typer.Option(*names, parser=parse, **stated)


def number(least: int, most: int | None = None, *names: str, **stated: Any) -> Any:
    """Return an option that is a whole number."""
    return reads(whole(least, most), *names, metavar="N", **stated)


Seed = Annotated[int, number(0, help="Same model, options and seed: same bytes.")]
DiagnosticFormat = Annotated[
    Format | None, typer.Option("--format", help="Form of the diagnostics.", show_default="text")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show errors only.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Show every diagnostic, notes too.")]
WorkerCount = Annotated[
    int | None,
    number(
        1,
        None,
        "--workers",
        help="Threads and processes; the result is the same for any number.",
        show_default="one per processor",
    ),
]


def words(known: Sequence[str]) -> Callable[[str], list[str]]:
    """Return the completion of one of some words, or of the last word of a list with commas."""

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        return [before + comma + word for word in known if word.startswith(last)]

    return complete


def examples(incomplete: str) -> list[str]:
    """Return the examples that begin so."""
    from halpipe.starters import EXAMPLES

    return [name for name in EXAMPLES if name.startswith(incomplete)]


def codes(incomplete: str) -> list[str]:
    """Return the codes that begin so; files are completed by the shell."""
    if not incomplete.upper().startswith("HAL"):
        return []
    from halpipe.core.diagnostics import REGISTER

    load_codes()
    return sorted(code for code in REGISTER if code.startswith(incomplete.upper()))


def load_codes() -> None:
    """Load every module that declares codes: those of the kernel and of the command line have none, and load slowly."""
    import importlib
    import pkgutil

    import halpipe

    for module in pkgutil.walk_packages(halpipe.__path__, "halpipe."):
        if not re.search(r"__main__|\.kernel\.|\.cli(\.|$)", module.name):
            importlib.import_module(module.name)


def modes(context: typer.Context, incomplete: str) -> list[str]:
    """Return the modes of the model or schedule that stands on the command line; none while it cannot be read."""
    for file in _files(context):
        found = [name for name in _modes_of(file) if name.startswith(incomplete)]
        if found:
            return found
    return []


def _files(context: typer.Context) -> Iterator[str]:
    """Yield the XML files on the line; while an option lacks its value, arguments are not yet told apart."""
    for value in (context.args, *context.params.values()):
        yield from (each for each in (value if isinstance(value, list | tuple) else [value]) if _is_xml(each))


def _is_xml(value: object) -> bool:
    return isinstance(value, str) and value.endswith(".xml")


def _modes_of(file: str) -> list[str]:
    from halpipe.core.diagnostics import HalpipeError
    from halpipe.core.files import parse_xml, read_bytes

    try:
        root = parse_xml(read_bytes(file), file)
    except HalpipeError:
        return []
    return list(dict.fromkeys(name for name in root.xpath("//*[local-name() = 'mode']/@name") if isinstance(name, str)))


class AnswerFormat(StrEnum):
    """The forms of an answer; diagnostics take the same."""

    TEXT = "text"
    JSON = "json"


Answers = Annotated[AnswerFormat, typer.Option("--format", help="Form of the answer and of the diagnostics.")]


def print_json(value: Any) -> None:
    """Print an answer as JSON; durations are texts in it."""
    output.text(json.dumps(value, indent=2, default=str))


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
ANSWERS = (parameter("format", Answers, AnswerFormat.TEXT), *FORMS[1:])


class Verb:
    """A command whose options are added when it is needed: to describe all of them takes longer than most do."""

    def __init__(self, run: Run, kind: str, *, shows_all: bool, answers: bool) -> None:
        self._run, self._kind, self._shows_all, self._answers = run, kind, shows_all, answers
        self.__doc__ = run.__doc__

    def made(self) -> Run:
        """Return the function that typer makes the command from."""
        hints = get_type_hints(self._run, include_extras=True)
        own = [p.replace(annotation=hints[p.name]) for p in inspect.signature(self._run).parameters.values()]
        module, _, name = self._kind.partition(":")
        kind = getattr(import_module(module), name) if name else None
        place = [p.name for p in own].index("options") if kind else len(own)
        after = own[place + 1 :]
        return command(self._run, own[:place], kind, after, shows_all=self._shows_all, answers=self._answers)


def takes(kind: str = "", *, shows_all: bool = False, answers: bool = False) -> Callable[[Run], Verb]:
    """Give a command the form of its diagnostics, and options of a `kind`, whose values are its argument `options`.

    The kind is named by module and class, ``halpipe.module:Kind``, and loaded with the command that is asked for.

    A command that `shows_all` diagnostics has no ``--verbose``; one that `answers` prints text or JSON.
    """
    return lambda run: Verb(run, kind, shows_all=shows_all, answers=answers)


def command(
    run: Run,
    before: Iterable[inspect.Parameter],
    kind: type | None,
    after: Iterable[inspect.Parameter] = (),
    *,
    help: str = "",
    shows_all: bool = False,
    answers: bool = False,
) -> Run:
    """Return the function that typer makes a command of: further parameters around the options of a `kind`."""
    forms = ANSWERS if answers else FORMS[:-1] if shows_all else FORMS
    parameters = [*before, *map(_parameter, options_of(kind) if kind else ()), *after, *forms]

    def made(**given: Any) -> int:
        form = given.pop("format")
        output.choose(form and Format(form.value), quiet=given.pop("quiet"), verbose=given.pop("verbose", shows_all))
        options = {"options": _values(kind, given)} if kind else {}
        return run(**{p.name: given[p.name] for p in (*before, *after)}, **options)

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
        stated["autocompletion"] = words(each.words) if each.words else globals()[each.completes]
    metavar = each.metavar or "|".join(each.words)
    option = typer.Option(f"--{each.name}", metavar=metavar if len(metavar) <= LONGEST else None, **stated)
    if each.form is Form.LIST and not each.splits:
        return parameter(each.attribute, Annotated[list[str] | None, option], None)
    if each.required:
        return parameter(each.attribute, Annotated[str, option])
    default = None if each.default in (None, (), "") else str(each.default)
    return parameter(each.attribute, Annotated[str | None, option], default)


def _values(kind: type, given: dict[str, Any]) -> Values:
    try:
        return from_command(kind, given)
    except OptionError as failure:
        raise typer.BadParameter(str(failure), param_hint=f"--{failure.option.name}") from None
