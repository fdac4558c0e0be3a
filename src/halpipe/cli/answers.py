"""Common parts of the verbs that answer questions: the form of the answer, and the search behind it."""

from __future__ import annotations

import json
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from halpipe.cli import output

if TYPE_CHECKING:
    from collections.abc import Collection
    from fractions import Fraction


class AnswerFormat(StrEnum):
    """The forms of an answer; diagnostics take the same."""

    TEXT = "text"
    JSON = "json"


Answers = Annotated[AnswerFormat, typer.Option("--format", help="Form of the answer and of the diagnostics.")]
Budget = Annotated[int, typer.Option(min=1, help="Moves per task before one search gives up.")]
Step = Annotated[str, typer.Option(help="Grid of shares and factors.")]

BUDGET = 2_000
"""A tenth of what one schedule is worth: the searches that fail are many, and take the longest."""


def choose(format: AnswerFormat, *, quiet: bool, verbose: bool) -> None:
    """Take over the options."""
    output.choose(output.Format(format.value), quiet=quiet, verbose=verbose)


def print_json(value: Any) -> None:
    """Print an answer as JSON."""
    output.text(json.dumps(value, indent=2, ensure_ascii=True))


def parse_step(text: str) -> Fraction:
    """Read the grid of an answer: a share above 0 and up to 1."""
    from halpipe.core.quantities import parse_share

    try:
        step = parse_share(text)
    except ValueError as failure:
        raise typer.BadParameter(str(failure), param_hint="--step") from None
    if not 0 < step <= 1:
        raise typer.BadParameter("must be above 0 and at most 1", param_hint="--step")
    return step


def check_name(name: str, known: Collection[str], kind: str, option: str) -> None:
    """Refuse a name that the model does not have."""
    from halpipe.core.suggest import did_you_mean

    if name not in known:
        hint = did_you_mean(name, known, f"the model has: {', '.join(sorted(known)) or 'none'}")
        raise typer.BadParameter(f'the model has no {kind} "{name}"; {hint}', param_hint=option)
