"""The diagnostics of the report, the graph and the trace: HAL0801 to HAL0899."""

from halpipe.core.diagnostics import error

NEEDS_SCHEDULE = error(
    "HAL0801",
    "Export needs a schedule",
    "The format shows when jobs run, so the model alone is not enough. Make a schedule first.",
)
FOREIGN_SCHEDULE = error(
    "HAL0803",
    "Schedule does not fit the model",
    "The schedule names a task, version, unit or mode that the model lacks: it was made for another model, or the "
    "model changed since.",
)
UNDRAWABLE_TIME = error(
    "HAL0804",
    "Schedule has times that cannot be drawn",
    "A hyperperiod is zero, a job starts outside the hyperperiod, ends before it starts, or lasts longer than the "
    "hyperperiod. A schedule that verifies has none of these.",
)
BAD_CPU = error(
    "HAL0898",
    "CPU of a unit is wrong",
    "Each unit has a Linux CPU of its own, by its number; two units on one CPU would share what the schedule gives "
    "to each of them alone.",
)
DOT_MISSING = error(
    "HAL0805",
    "Graphviz is not installed",
    "The graph is written as DOT without any tool; drawing it as SVG needs the program `dot` of Graphviz.",
)
NO_IMPORT_REPORT = error(
    "HAL0807",
    "File is no import report",
    "The coverage report of an import is a JSON file that `halpipe import FORMAT --report` writes.",
)
DOT_FAILED = error(
    "HAL0806",
    "Graphviz cannot draw the graph",
    "The program `dot` was found but refused the graph or failed on it.",
)
NEEDS_HOLD = error(
    "HAL0808",
    "Target cannot interrupt jobs as the schedule does",
    "A job with gaps must be held at the end of each part until the next one begins; otherwise it is inside its next "
    "piece when another job of the unit comes, and that one is late. Not every target can do so.",
)
KEEPS_NO_LET = error(
    "HAL1097",
    "Target keeps no logical execution time",
    "With a logical execution time, data are read at the release and written at release + LET, whatever the schedule. "
    "A target without copies at these instants exchanges data earlier or later, so that latencies are others.",
)
PRIORITY_CYCLE = error(
    "HAL0809",
    "Target has no fixed priorities that play the schedule",
    "Jobs that may be interrupted anywhere need a target with preemptive fixed priorities, in which a task is above "
    "each one in whose gaps a job of it starts. On this unit the tasks are above one another in a circle.",
)
DANGLING_NAME = error(
    "HAL0873",
    "Export lacks a definition of a name",
    "ARXML and AMALTHEA refer from element to element, so a task, unit, resource, version or mode that the model "
    "names, but does not define, cannot be written. `halpipe validate` lists them, too.",
)
