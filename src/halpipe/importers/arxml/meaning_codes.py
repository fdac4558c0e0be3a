"""The diagnostics of what elements mean for a schedule: HAL0515 to HAL0519, HAL0529 and HAL0533 to HAL0539."""

from halpipe.core.diagnostics import note, warning

ABSENT_MODULE = warning(
    "HAL0515",
    "Configuration of Os, Rte or EcuC is missing",
    "An ECUC-VALUE-COLLECTION names a module configuration that no file defines. Without the Rte, no function has an "
    "OsTask, an order or a core; without the Os, none has a priority, and nothing but events has a period.",
)
PERIOD_OF_MAPPING = note(
    "HAL0516",
    "Period comes from the Rte configuration",
    "The mapping of an event to an OsTask states a period of its own (RtePeriod, RteBswPeriod), which replaces that of "
    "the event.",
)
START_INTERVAL = warning(
    "HAL0517",
    "Runnable starts less often than its event",
    "MINIMUM-START-INTERVAL is longer than the period of the event: the RTE delays starts that come sooner, so that "
    "the runnable recurs with the interval. The phase of such starts depends on the RTE.",
)
UNSTARTED_TABLE = warning(
    "HAL0518",
    "Schedule table that the OS does not start",
    "Another table, which the OS starts, has the same counter or activates the same OsTasks. The table is what runs "
    "in another mode, after code has switched to it, and does not run beside that one. Its actions give no periods.",
)
TABLE_PHASE = warning(
    "HAL0519",
    "Phase of a schedule table is not known",
    "A table with the autostart SYNCHRON begins when code provides the value of a synchronisation counter, and an "
    "adjustable expiry point moves with it. Periods are read, and offsets as if the table began at 0.",
)
SEVERAL_RATES_OF_TASK = warning(
    "HAL0529",
    "One activation of an OsTask for several periods",
    "A basic OsTask runs all its calls at each activation, and the generated RTE counts which are due. The task of the "
    "model has the greatest common divisor of their periods as its own, and jobs as long as all calls: an upper bound. "
    "Limits of the timing extension that concern a slower call are left out.",
)
BUDGETS = note(
    "HAL0533",
    "Execution budgets are taken as execution times",
    "The timing protection of an OsTask states the longest time that the OS lets it run (OsTaskExecutionBudget). With "
    "`--wcet budget` that is the WCET of tasks without an execution time of their own: a bound, if protection is on.",
)
LOCKS_HELD = note(
    "HAL0534",
    "Locks are held by whole jobs",
    "Runnables that may enter one exclusive area, or OsTasks that share an OsResource, exclude each other. It is not "
    "stated when a job enters and leaves, so that it holds the lock from start to end.",
)
LOCK_LOST = warning(
    "HAL0535",
    "Exclusive area or OsResource is not kept",
    "A lock is held for a time, so that it needs the WCETs of its tasks. Without them, two jobs that exclude each "
    "other may be scheduled at once on two units, or one in a gap of the other.",
)
UNUSED_KIND = warning(
    "HAL0536",
    "Elements that may decide timing are not used",
    "The import knows what the kinds of elements mean that it uses, and has a list of those that cannot decide timing. "
    "Any other kind may: the schedule may not keep what these elements demand.",
)
