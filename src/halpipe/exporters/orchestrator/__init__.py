"""Exports to orchestrators: Eclipse TIMPANI, and the launch manager and the fixed cycle (FEO) of Eclipse S-CORE."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError, error, warning

if TYPE_CHECKING:
    from halpipe.models import Schedule

UNPLAYABLE = error(
    "HAL1494",
    "Orchestrator cannot play the schedule",
    "The orchestrator would start jobs at other instants, on other CPUs or in another order: its times are whole "
    "microseconds, it moves tasks off a CPU that is loaded to 90 %, or it runs each activity once in a cycle.",
)
BAD_NAME = error(
    "HAL1495",
    "Orchestrator cannot take a name",
    "The names of components and run targets are letters, digits, underscores and hyphens, and no two are equal.",
)
NOT_CARRIED = warning(
    "HAL1496",
    "Orchestrator does not keep a part of the model",
    "The target has no element for it, or a weaker one. What the model requires there needs other means.",
)


def only_mode(schedule: Schedule, target: str) -> Schedule:
    """Return a schedule of one mode; raise `HalpipeError` where there are several."""
    if len(schedule.modes) == 1:
        return schedule
    names = ", ".join(mode.name for mode in schedule.modes)
    help = f"choose one with --mode: {names}"
    raise HalpipeError(UNPLAYABLE(f"{target} plays one mode, and the schedule has {len(schedule.modes)}", help=help))


def json_bytes(value: Any) -> bytes:
    """Return JSON for people and tools, in the order in which it was built."""
    return (json.dumps(value, indent=2, ensure_ascii=False) + "\n").encode()
