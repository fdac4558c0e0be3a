"""The diagnostics of the generator."""

from __future__ import annotations

from halpipe.core.diagnostics import error

BAD_PARAMETER = error(
    "HAL0921",
    "Task set cannot have this parameter",
    "A count below its least value, a share outside [0, 1], or parameters that contradict each other.",
)
TOO_SHORT = error(
    "HAL0922",
    "Hyperperiod is too short for so many tasks",
    "Times of generated sets are whole microseconds; some task would be shorter than one. Give a longer hyperperiod "
    "or fewer tasks for each unit.",
)
