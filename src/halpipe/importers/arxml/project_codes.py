"""The diagnostics of finding a model again in the project that it was imported from: HAL0580 to HAL0584."""

from halpipe.core.diagnostics import error, warning

FOREIGN_PROJECT = error(
    "HAL0580",
    "Model is not of this project",
    "The tasks of the model are found again in the project by their names, at the granularity of the import. A task "
    "that the project does not have cannot be put onto it.",
)
CHANGED_PROJECT = error(
    "HAL0581",
    "Project changed since the import",
    "What the project says of a task is not what the model says: its period, order, core, or what its OsTask runs. "
    "Import the project again, and schedule it again.",
)
MORE_IN_PROJECT = warning(
    "HAL0582",
    "Project has tasks that the model has not",
    "They were left out by an overlay, or are new since the import. Nothing is written for them; they run beside the "
    "schedule, and disturb it.",
)
NO_CONFIGURATION = error(
    "HAL0583",
    "Project has no configuration to put a schedule onto",
    "A schedule is put onto the ECU configuration of Os, in AUTOSAR release 4, to which all OsTasks of the model "
    "belong.",
)
