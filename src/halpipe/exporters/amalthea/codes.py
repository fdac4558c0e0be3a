"""The diagnostics of the AMALTHEA export: HAL0890 to HAL0896."""

from halpipe.core.diagnostics import error

DANGLING_NAME = error(
    "HAL0891",
    "AMALTHEA export lacks a definition of a name",
    "AMALTHEA refers from element to element, so a task, unit, resource, version or mode that the model names, but "
    "does not define, cannot be written. `halpipe validate` lists them, too.",
)
