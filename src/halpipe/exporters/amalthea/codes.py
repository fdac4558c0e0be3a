"""The diagnostics of the AMALTHEA export: HAL0890 to HAL0896."""

from halpipe.core.diagnostics import error

UNKNOWN_RELEASE = error(
    "HAL0890",
    "AMALTHEA release is unknown",
    "The export writes the releases of Eclipse APP4MC from 1.2.0 on.",
)
DANGLING_NAME = error(
    "HAL0891",
    "AMALTHEA export lacks a definition of a name",
    "AMALTHEA refers from element to element, so a task, unit, resource, version or mode that the model names, but "
    "does not define, cannot be written. `halpipe validate` lists them, too.",
)
