"""The diagnostics of what-if questions: HAL044x."""

from halpipe.core.diagnostics import error, warning

UNLIKE_UNITS = warning(
    "HAL0440",
    "Units of the type differ in what may run on them",
    "Some version may use one unit of the type but not another, so it matters which are left out: the last ones of the "
    "model are, and further ones are copies of the first. The proven bound holds for every choice.",
)
LAST_VERSION = error(
    "HAL0441",
    "Task loses its last version",
    "At the size in question no version that is available in the mode can run: it needs more units than there are, "
    "more of a resource than there is, or more time than its deadline allows.",
)
IMPOSSIBLE = error(
    "HAL0442",
    "No size is enough",
    "It is proven that the mode has no schedule, whatever the value in question; the witness is reported beside it.",
)
NONE_FOUND = error(
    "HAL0443",
    "No schedule was found at any size",
    "The search found no schedule for any value that was tried, up to the one beyond which a larger one cannot help. "
    "That is no proof: the budget may be too small. If it is not, something else is too scarce.",
)
TOO_MANY_JOBS = error(
    "HAL0444",
    "Schedule is too large for the growth of every version",
    "Where jobs are split or interrupted, and where modes are switched, the jobs that a version can run into and those "
    "tied to it are verified anew for each.",
)
NOT_COMPARABLE = error(
    "HAL0445",
    "Files of different kinds cannot be compared",
    "Two schedules can be compared, or two task models, but not one with the other.",
)
