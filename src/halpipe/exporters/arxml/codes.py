"""Diagnostics of the ARXML export, and of the export onto a project."""

from __future__ import annotations

from halpipe.core.diagnostics import error, warning

BAD_PREFIX = error(
    "HAL0872",
    "Prefix of ECU configuration definitions is unusable",
    "The prefix is the path of the package that holds the definitions of Os, Rte and EcuC, such as "
    "/AUTOSAR/EcucDefs or /MICROSAR. Tools ignore configurations of definitions that they do not know.",
)
BAD_COUNTER = error(
    "HAL0874",
    "Counter settings are impossible",
    "OsCounterMinCycle and OsCounterMaxAllowedValue are at least 1, the first at most the second; a tick is longer "
    "than nothing and at most one second (OsSecondsPerTick).",
)
NOT_ON_TICK = error(
    "HAL0875",
    "Instants are no multiples of the tick",
    "Expiry points and durations of schedule tables are whole ticks of their counter (SWS_Os_00409, SWS_Os_00411). "
    "The export does not round: a schedule that is right only before rounding would be no proof.",
)
COUNTER_RANGE = error(
    "HAL0876",
    "Schedule table is longer than its counter counts",
    "The duration of a table, and with it every gap between expiry points, must fit into the range of the counter "
    "(SWS_Os_00408, SWS_Os_00431).",
)
MIN_CYCLE = error(
    "HAL0877",
    "Expiry points are closer than OsCounterMinCycle",
    "The first offset of a schedule table (unless it is 0), each gap between expiry points, and the final delay "
    "must be at least OsCounterMinCycle (SWS_Os_00408, SWS_Os_00427).",
)
TOO_MANY_POINTS = error(
    "HAL0879",
    "Schedule table has more expiry points than the OS allows",
    "The number of expiry points of a table is limited by some operating systems (254 by TOPPERS/ATK2). It is the "
    "number of different instants at which jobs start on a core within the hyperperiod.",
)
ACTIVATED_TWICE = error(
    "HAL0878",
    "OsTask would be activated before it has terminated",
    "An OS drops the activation of an OsTask that runs already, unless OsTaskActivation lets it wait. Jobs of one task "
    "that start at one instant (with execution times of zero) need that, and a job that starts where the one before "
    "ends. An OsTask that waits for events has one activation only, and the values of a project are its own.",
)
TOO_MANY_EVENTS = error(
    "HAL0889",
    "OsTask would wait for too many events",
    "An OsTask waits for an event at each split point in use and at the beginning of each access phase. A mask of "
    "events has 64 bits.",
)
NO_LATENCY = warning(
    "HAL0890",
    "Limit of a reaction time cannot be stated in ARXML",
    "REACTION limits the time from an event of the first task to the response. A reaction time counts from a stimulus "
    "that just misses a job, which adds the longest time between two jobs of the first task; a limit below that leaves "
    "nothing. It stands in the native model only.",
)


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
CODE_STARTS = warning(
    "HAL1441",
    "Code of the project may start OsTasks of the schedule",
    "An alarm without autostart, or the schedule table of another mode of the project, is started by code alone. "
    "Nothing in the configuration tells when, so that it is left as it is. While it runs beside the tables of the "
    "schedule, it starts the same OsTasks once more.",
)
PHASE = warning(
    "HAL1442",
    "Code decides when tables of the schedule begin",
    "In a project of EB tresos, generated code starts the schedule tables (SchM_Init, Rte_Start). Their expiry points "
    "are replaced, and the code stays. The distance between the begins of two tables is in no configuration: the "
    "starts of one table are as scheduled, but those of two only if both begin at the same instant.",
)
STARTS_ONCE = warning(
    "HAL0888",
    "OsTask starts once before the schedule",
    "OsTaskAutostart activates an OsTask when the OS starts, beside the activations of the schedule. That is right for "
    "one that initialises something first, and takes its time before the first job.",
)
RUNS_BESIDE = warning(
    "HAL1445",
    "OsEvent is set beside the schedule",
    "An alarm or schedule table of the project sets an OsEvent for an OsTask of the schedule, and no task of the model "
    "waits for it: an overlay dropped what it wakes, or no runnable is known that it wakes. It stays, and takes time "
    "that the schedule does not know.",
)
OTHER_RATE = error(
    "HAL1446",
    "Runnable left out of the model would change its rate",
    "The generated RTE runs it at the same activation, or OsEvent, as a task of the schedule, and counts which of the "
    "two is due. With the activations of the schedule alone, that count is wrong.",
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
    "The OsTask of a job with a gap must be preemptive (FULL), and have a lower OsTaskPriority than each OsTask of a "
    "job that starts in the gap. Priorities of a project are not changed.",
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
WEAKER_WINDOW = warning(
    "HAL1430",
    "Precedence is weaker in ARXML",
    "OFFSET-TIMING-CONSTRAINT limits the time between two events. It does not say that jobs of the same cycle are "
    "meant, and no event is an instant within the execution of a runnable. The native model states both.",
)
TOO_LARGE_TO_WRITE = error(
    "HAL0891",
    "Model is too large for ARXML",
    "Each task and each job of a schedule stands in some ten places of an ARXML, which would take gigabytes to write.",
)
