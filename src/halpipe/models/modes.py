"""Modes by their names, as options state them."""

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


def require_mode(name: str, modes: Iterable[Mode | ModeSchedule]) -> None:
    """Raise `HalpipeError` unless `name` is that of one of the modes of a model or schedule."""
    known = [mode.name for mode in modes]
    if name not in known:
        help = did_you_mean(name, known, "the modes are " + ", ".join(known))
        raise HalpipeError(UNKNOWN_MODE(f'there is no mode "{name}"', help=help), exit=Exit.USAGE)
