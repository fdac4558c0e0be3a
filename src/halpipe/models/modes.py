"""Modes and other elements by their names, as options state them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Exit, HalpipeError, error
from halpipe.core.suggest import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.models import Mode, ModeSchedule

UNKNOWN_MODE = error(
    "HAL0802",
    "Mode does not exist",
    "The mode named in the options is not one that the model (or the schedule) has.",
)
UNKNOWN_ELEMENT = error(
    "HAL1411",
    "Option names an element that the model lacks",
    "A task, unit type or resource in the options is none of the model: the answer would be about nothing.",
)


def require_names(names: Iterable[str], known: Iterable[str], kind: str) -> None:
    """Raise `HalpipeError` with each of the `names` that is not known as the name of an element of a `kind`."""
    known = list(known)
    there_are = f"the model has: {', '.join(known) or 'none'}"
    unknown = [name for name in names if name not in known]
    if unknown:
        text = 'the model has no {} "{}"'.format
        findings = (UNKNOWN_ELEMENT(text(kind, n), help=did_you_mean(n, known, there_are)) for n in unknown)
        raise HalpipeError(*findings, exit=Exit.USAGE)


def require_mode(name: str, modes: Iterable[Mode | ModeSchedule]) -> None:
    """Raise `HalpipeError` unless `name` is that of one of the modes of a model or schedule."""
    known = [mode.name for mode in modes]
    if name not in known:
        help = did_you_mean(name, known, "the modes are " + ", ".join(known))
        raise HalpipeError(UNKNOWN_MODE(f'there is no mode "{name}"', help=help), exit=Exit.USAGE)
