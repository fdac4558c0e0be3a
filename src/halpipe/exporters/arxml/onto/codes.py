"""The diagnostics of putting a schedule onto a project: HAL0880 to HAL0888, HAL0895, HAL0896 and HAL0800."""

from halpipe.core.diagnostics import error, warning

COUNTER_NEEDED = warning(
    "HAL0880",
    "Project's counter cannot express the schedule",
    "Expiry points are whole ticks of their counter. None of the project's counters of a core has a tick, a range "
    "and a minimal cycle that all starts fit; one that does is added, and needs a timer of the hardware. A schedule "
    "made with --tick, or at the granularity of OsTasks, needs none.",
)
NOT_MAPPED = error(
    "HAL0881",
    "Task has no OsTask in the project",
    "Expiry points activate OsTasks. An event that the Rte configuration maps to no OsTask must be mapped first.",
)
WRONG_CORE = error(
    "HAL0882",
    "Schedule runs an OsTask on another core",
    "The OsApplication of an OsTask binds it to one core. Its jobs must be scheduled there, and an OsTask that is "
    "bound to none cannot be placed by an export.",
)
SHARED_EVENT = warning(
    "HAL0883",
    "Several tasks wait for one OS event",
    "The generated RTE lets one event start all runnables of a cycle. With an expiry point for each, which the "
    "mappings now name, the generator makes an event for each: run it before the system is built.",
)
IN_THE_WAY = error(
    "HAL0884",
    "Project already has what would be added",
    "A delta adds containers under names of its own. A container of such a name that is in the project, most often "
    "from an export before, would be changed by it.",
)
DOUBLE_START = error(
    "HAL0885",
    "Project would start what the schedule plays once more",
    "An alarm or schedule table of the project activates OsTasks of the schedule, or sets events for them. Where the "
    "OS or the Rte configuration starts it, that is taken away in place; where it does more than the schedule, or only "
    "code starts it (Rte_Start, BswM), it must be removed by hand, or each activation would come twice.",
)
STARTS_ONCE = warning(
    "HAL0888",
    "OsTask starts once before the schedule",
    "OsTaskAutostart activates an OsTask when the OS starts, beside the activations of the schedule. That is right for "
    "one that initialises something first, and takes its time before the first job.",
)
UNKNOWN_EVENT = error(
    "HAL0895",
    "It is not known what wakes an extended OsTask",
    "An extended OsTask runs for ever, and is woken by OsEvents: to activate it again has no effect. The mapping of "
    "the event to the OsTask names the OsEvent (RteUsedOsEventRef) after the RTE generator has run once.",
)
BASIC_SHARED = error(
    "HAL0896",
    "Several tasks share one activation of a basic OsTask",
    "A basic OsTask runs all its calls at each activation, so that an activation for each task of the model runs them "
    "all as often. A model at the granularity of OsTasks has one task for it.",
)
SPLIT_JOB = error(
    "HAL0887",
    "Nothing in the project plays a gap of a job",
    "A job with a gap is held if its OsTask waits for an OsEvent of its own before each of its runnables, which are "
    "then the pieces between the split points: an expiry point sets the events of a part when the part begins. "
    "Otherwise its OsTask must be preemptive (FULL), and have a lower OsTaskPriority than each OsTask of a job that "
    "starts in the gap. Priorities of a project are not changed.",
)
CANNOT_EDIT = error(
    "HAL0886",
    "File of the project cannot be edited in place",
    "The value to change is not where it was when the project was read, or the file is in an encoding of more than one "
    "byte for `<`.",
)
NEVER_STARTED = warning(
    "HAL0800",
    "Nothing starts the schedule tables",
    "The table of the first mode is started by the OS in one of its application modes (OsAppMode). The project has "
    "none, so that code must start the tables (StartScheduleTableAbs).",
)
