"""Diagnostics of the ARXML importer."""

from __future__ import annotations

from halpipe.core.diagnostics import error, note, warning

# ------------------------------------------------------------------------------------------------ files
NOT_ARXML = error(
    "HAL0501",
    "File is not AUTOSAR XML",
    "The root element must be AUTOSAR in the namespace http://autosar.org/schema/r4.0, which every Classic and "
    "Adaptive release since 4.0 uses, or in that of a release before. The schema file named in xsi:schemaLocation is "
    "not looked at.",
)
OLD_RELEASE = note(
    "HAL0502",
    "AUTOSAR release before 4.0",
    "Releases 2.x and 3.x name and nest their elements differently. They are read as the elements of release 4 that "
    "replaced them.",
)
ADAPTIVE_ONLY = error(
    "HAL0503",
    "Adaptive manifests without processes",
    "Tasks of the Adaptive Platform are its processes. Machines, function groups and designs alone have none.",
)
EB_XDM = error(
    "HAL0504",
    "EB tresos data without a module",
    "Of project data of EB tresos (.xdm), the configurations of modules are read. Components, modules and their events "
    "stand in ARXML files, which the tool can export.",
)
NO_INPUT = error(
    "HAL0505",
    "No ARXML file found",
    "Nothing was named, or the directories named hold no file that ends in .arxml.",
)
SKIPPED_FILE = warning(
    "HAL0506",
    "ARXML file of a directory was skipped",
    "A file found while searching a directory is broken, or no ARXML. Named directly, such a file is an error.",
)
PROCESS_WITHOUT_PERIOD = warning(
    "HAL0507",
    "Processes state no period",
    "Manifests of the Adaptive Platform have no periods but the cycle of a deterministic client. A process without one "
    "is imported as a task on demand, which is scheduled only if others demand it. State periods in the overlay.",
)
NO_TASKS = error(
    "HAL0508",
    "No periodic task in the input",
    "Neither a runnable, nor a BSW schedulable entity, nor an OS task has a period. Name the files that hold the "
    "component types with their events, and the ECU configuration of Os and Rte, or give periods in an overlay.",
)

# ---------------------------------------------------------------------------------------- elements and references
CONFLICT = error(
    "HAL0510",
    "Two parts of one element disagree",
    "Elements of the same path are one element, split over files. A value that two of its parts state differently "
    "cannot be merged, nor two references where one target is meant. Only what the importer reads is compared.",
)
OTHER_COPY = warning(
    "HAL1510",
    "Copy in a project differs from its source",
    "In a project of EB tresos, config/*.xdm configure the modules, the settings in .prefs name the files that "
    "describe the system, and what stands below output and generated is made by the tool. Where such files state an "
    "element differently, the first of these kinds counts.",
)
OLD_TIMES = warning(
    "HAL1511",
    "OS configuration counts seconds",
    "Alarms and schedule tables of release 2 state floating point seconds, where later releases state ticks of a "
    "counter. They give no task its period.",
)
DANGLING = warning(
    "HAL0511",
    "AUTOSAR reference has no target",
    "No file of the input defines the path that a reference names, so that what depends on it is left out.",
)
WRONG_DEST = warning(
    "HAL0512",
    "Reference states a wrong kind of target",
    "The attribute DEST names another kind of element than the one found at the path. The path counts.",
)
MALFORMED = warning(
    "HAL0513",
    "Element is incomplete",
    "A child that the element needs to have an effect is missing or empty; the element is left out.",
)
VARIANT = warning(
    "HAL0514",
    "Variant-dependent elements are imported unconditionally",
    "Elements with a VARIATION-POINT exist in some variants only. Conditions are evaluated for a variant that is "
    "chosen (--variant, --condition).",
)

# ------------------------------------------------------------------------------------------------ periods
BAD_PERIOD = warning(
    "HAL0520",
    "Period is not a positive time",
    "A period is a positive number of seconds. Zero is what some tools write for 'not periodic'. No schedule table or "
    "alarm gives the event a period either, so that it makes no task.",
)
SYMBOLIC_UNKNOWN = warning(
    "HAL0521",
    "Symbolic period is not defined",
    "The period is a name instead of a number, and no ECU configuration parameter of that name is in the input, or "
    "several with different values, and neither a schedule table nor an alarm gives the event a period.",
)
SYMBOLIC = note(
    "HAL0522",
    "Symbolic period was looked up",
    "The period is a name; its value is that of the ECU configuration parameter of the same name.",
)
FINE_PERIOD = warning(
    "HAL0523",
    "Time is not a whole number of nanoseconds",
    "The value is kept exactly, but a rounded 0.0333333333 in place of 1/30 makes hyperperiods of years. Correct it "
    "in the source.",
)
OS_PERIOD = note(
    "HAL0524",
    "Period comes from the OS configuration",
    "The event itself states no usable period; the schedule table or alarm that triggers it does.",
)
BAD_OFFSET = warning(
    "HAL0525",
    "Offset is not a time",
    "An offset is a non-negative number of seconds. The task is imported without an offset.",
)
BAD_NUMBER = warning(
    "HAL0526",
    "Parameter is not a number",
    "ECU configuration numbers are decimal, hexadecimal (0x), binary (0b), octal (leading 0) or have an exponent.",
)
NO_TICK = warning(
    "HAL0527",
    "Counter has no tick duration",
    "Cycle times of alarms and schedule tables count ticks; without OsSecondsPerTick of the counter they are no time.",
)
UNEVEN_TABLE = note(
    "HAL0528",
    "Schedule table triggers unevenly",
    "A task that a table triggers several times at unequal distances becomes one periodic task per expiry point.",
)
NO_PERIOD = warning(
    "HAL0530",
    "Events that the model cannot express",
    "Only what recurs with a period is scheduled in a time-triggered system. These events start work at unforeseen "
    "times: give their runnables a period in the overlay (sources), or accept that the schedule leaves them out.",
)
NOT_SCHEDULED = note(
    "HAL0531",
    "Events that need no schedule of their own",
    "Server runnables run within their clients, and initialisation before the schedule begins.",
)
SENDERS_DIFFER = warning(
    "HAL0532",
    "Data arrives at different rates",
    "A DATA-RECEIVED-EVENT inherits the period of the runnables that send its data only if they have one in common.",
)

# ------------------------------------------------------------------------------------------------ the model
DEFAULT_UNIT = note(
    "HAL0540",
    "AUTOSAR core was assumed",
    "The input configures no core (EcucCoreDefinition, OsApplicationCoreAssignment); one core is assumed.",
)
UNMAPPED = note(
    "HAL0541",
    "Tasks may run on every core",
    "No OsTask, or no core of its OsApplication, is configured for these tasks.",
)
NO_WCET = note(
    "HAL0542",
    "Execution times are missing",
    "ARXML files hardly ever state worst-case execution times. The model can be stored and completed by an overlay, "
    "but not scheduled before.",
)
DEFAULT_WINDOW = note(
    "HAL0543",
    "AUTOSAR precedence windows were assumed",
    "AUTOSAR states an order, not distances. A task starts between 0 and one period (the longer one, where two "
    "tasks differ) after the end of its predecessor.",
)
CYCLE = warning(
    "HAL0544",
    "Orders contradict each other",
    "Precedence must be free of cycles. The order of the weakest source that closes the cycle is left out: execution "
    "order constraints are stronger than positions in OS tasks, those stronger than data-received chains.",
)
SEVERAL_MACHINES = warning(
    "HAL1493",
    "Several providers switch the modes of one mode group",
    "Components that require one MODE-DECLARATION-GROUP at ports of different providers are switched independently, so "
    "that each combination of modes can occur. The model has one mode for each declaration, in which all are disabled "
    "that any of the providers disables.",
)
SEVERAL_GROUPS = note(
    "HAL0545",
    "Several mode groups switch tasks off",
    "Modes of different groups can be active together, and their product would be vast. The model has one mode per "
    "mode of every group (group.mode), in which only that group switches tasks off, and a mode default with all tasks.",
)
ORDER_LOST = warning(
    "HAL0546",
    "Part of an execution order was left out",
    "The constraint names something that is no task here, or states logical execution times or slots of a cycle.",
)
TIMING_IGNORED = warning(
    "HAL0547",
    "Timing constraints are not imported",
    "A synchronisation constraint of event chains bounds the distance of their ends for each stimulus, for which the "
    "model has no counterpart; one of events needs a tolerance, and two events. State an order and its window in the "
    "overlay.",
)
BAD_EXECUTION_TIME = warning(
    "HAL0548",
    "Execution time cannot be read",
    "An execution time is a positive factor of a CSE-CODE that counts time: 0 is a microsecond, 26 a nanosecond. Codes "
    "from 100 on count angles or events.",
)
RENAMED = note(
    "HAL0549",
    "AUTOSAR name was adapted",
    "Names of model elements have no white space and no glob characters, and are unique; a second task of the same "
    "name is called by its whole AUTOSAR path.",
)
COPY = note(
    "HAL0550",
    "Composition was taken for a copy",
    "Tools write the system twice, as it was designed and flattened for the ECU. The Rte configuration names the "
    "component instances that exist; compositions of which it names none are left out.",
)
SEVERAL_ROOTS = warning(
    "HAL0551",
    "Several root compositions are imported as one system",
    "SYSTEMs name them, or they use the same component type. Without an Rte configuration it is not known whether they "
    "are copies of one system or different systems. All are imported.",
)
DATA_FLOW = note(
    "HAL0552",
    "Data dependencies are not precedence",
    "Sender-receiver connections deliver the last value written; they order nothing. List them as chains in the "
    "overlay where data must be fresh.",
)
NOT_INSTANTIATED = warning(
    "HAL0554",
    "Component type is not part of the system",
    "The input has compositions, and none of those that are imported uses the type. Its runnables are left out.",
)
SAME_FUNCTION = note(
    "HAL0555",
    "Runnable and BSW entity are one call",
    "A runnable of a service component and an entity of its BSW module are the same C function, mapped to the same "
    "position of one OsTask with the same period. The generated RTE calls it once, and it becomes one task.",
)
NOT_CALLED = warning(
    "HAL0571",
    "Timing event that no OsTask calls",
    "Its mapping in the Rte configuration names no OsTask, or it has none, while other events have: the generated RTE "
    "never calls its runnable, which makes no task. Map it, or give it a period in the overlay (sources).",
)
INHERITED = note(
    "HAL0572",
    "Period was taken from the sender of data",
    "A DATA-RECEIVED-EVENT has no period. Without an Rte configuration that maps it, its runnable is taken to run as "
    "often as the runnable that sends the data, which is an upper bound if that sends once per job.",
)
SEVERAL_RATES = warning(
    "HAL0573",
    "One call with several periods",
    "Several events start one runnable in one OsTask, and the generated RTE calls it once where several are due. The "
    "model has a task for each period that contains none of the others.",
)
SAME_POSITION = note(
    "HAL0574",
    "Order within an OsTask is not stated",
    "Events of one OsTask have the same position in it, or none. Generators order them as they like, so that no "
    "precedence is derived.",
)
TOO_MANY = error(
    "HAL0553",
    "Compositions multiply beyond all reason",
    "Compositions nested into each other make more component instances than any vehicle has, nest deeper than 32 "
    "levels, or nest without end.",
)
TRIGGERING_DIFFERS = warning(
    "HAL0556",
    "Triggering contradicts the event",
    "A periodic event triggering of the timing extension states another period than the event of the runnable, or the "
    "OS configuration, which counts. Or the period of an event is no multiple of that of the alarm or table that its "
    "mapping names.",
)
SPORADIC = warning(
    "HAL0557",
    "Sporadic work is polled",
    "The task has the least time between two occurrences as its distance, and a period at which it looks for them: "
    "short enough to serve the densest occurrences in time, and one that leaves the hyperperiod of the others alone.",
)
TIMING_LOST = warning(
    "HAL0558",
    "Timing constraint was left out",
    "Its events belong to no task, or to several tasks of which none is distinguished, or it limits what the model has "
    "no limit for.",
)
TIMING_PART_LOST = warning(
    "HAL0559",
    "Part of a timing constraint was left out",
    "Least and nominal latencies have no counterpart, slack is at most a period, the jitter of a call within the jobs "
    "of an OsTask and a least distance to an activation bound starts alone, and conditions are not evaluated.",
)
BAD_TIME = warning(
    "HAL0560",
    "Time of a constraint cannot be read",
    "Times of the timing extension are a CSE-CODE, which names a unit (0 is a microsecond, 3 a millisecond, 26 a "
    "nanosecond), and a factor. Codes from 100 on count angles or events and are no time.",
)
NOT_ANALYSED = note(
    "HAL0561",
    "Execution times are no proven bounds",
    "They are measured, simulated or estimated, or required of the implementation. A schedule is as safe as they are.",
)
UNIT_WITHOUT_TIME = note(
    "HAL0562",
    "Execution time is stated for some hardware only",
    "A task runs only where its execution time is known. State the missing times in the overlay to "
    "let it run elsewhere.",
)
EMPTY_MODE = note(
    "HAL0563",
    "Mode without tasks was left out",
    "Nothing is scheduled in it, so it needs no schedule. Switches to it and from it are left out, too.",
)
TOO_MANY_WORKERS = warning(
    "HAL0564",
    "More workers than cores",
    "The workers of a deterministic client run side by side, each on a core of its own, but the process may use fewer.",
)
UNKNOWN_ELEMENT = warning(
    "HAL0567",
    "Element is misspelt",
    "The element is no element of AUTOSAR, but one letter away from one that matters here. It is not read.",
)
WRONG_CASE = warning(
    "HAL0568",
    "Reference differs in case",
    "Paths are case-sensitive, but no two elements may differ in case only, so that it is clear what was meant.",
)
SINGLE_SHOT = note(
    "HAL0569",
    "Schedule table does not repeat",
    "What a single-shot table activates runs once each time that the table is started, which is no period.",
)
NO_CORE = warning(
    "HAL0570",
    "Mapping leaves a process no core",
    "The cores that a process shall run on and those that it shall not run on leave none of its machine.",
)
MIXED_RELEASES = warning(
    "HAL0565",
    "Files of several releases",
    "Elements of release 3 and 4 have other paths, so that references between them often lead nowhere.",
)
UNKNOWN_INTERRUPT = warning(
    "HAL0594",
    "AUTOSAR interrupt routines are not accounted for",
    "An interrupt routine takes time from every job of its core, which a schedule must reserve. Of these the execution "
    "time, the least distance of their arrivals or the core is not stated, so that no time is reserved for them. Only "
    "a timing protection (OsIsrExecutionBudget, OsIsrTimeFrame) states them in ARXML.",
)
CUT_RUNNABLES = note(
    "HAL0595",
    "AUTOSAR preemptive tasks are cut within runnables",
    "An OsTask with OsTaskSchedule FULL may be interrupted anywhere. Where a runnable is longer than the longest piece "
    "(--pieces), jobs may be interrupted at multiples of that, too: the target has to hold the job there.",
)


SEVERAL_ECUS = error(
    "HAL0575",
    "System has several ECUs",
    "Components are mapped to more than one ECU, or several ECU configurations have an Os with OsTasks. A schedule is "
    "made for one: name it with --ecu, or its ECUC-VALUE-COLLECTION, or package, by the path.",
)
UNKNOWN_ECU = error(
    "HAL0576",
    "ECU is not in the system",
    "The name after --ecu is the short name, or the path, of an ECU-INSTANCE that components are mapped to, or the "
    "path of an ECUC-VALUE-COLLECTION, or of the package of an ECU configuration.",
)
UNMAPPED_COMPONENT = error(
    "HAL0578",
    "Component is mapped to no ECU",
    "In a system of several ECUs, each component instance, or a composition that holds it, is mapped to one of them "
    "(SWC-TO-ECU-MAPPING). It is not known whether this one belongs to the ECU that was chosen.",
)
UNLINKED = warning(
    "HAL0579",
    "ECU configuration belongs to no ECU",
    "The ECU of an ECU configuration is that of the SYSTEM which its ECUC-VALUE-COLLECTION names, of the instances "
    "that its Rte names, or the one it is called after. It is left out, or taken for the only ECU without one.",
)

UNKNOWN_VARIANT = error(
    "HAL0585",
    "Variant is not in the input",
    "The name after --variant is the short name, or the path, of a PREDEFINED-VARIANT, or of an EVALUATED-VARIANT-SET "
    "that names one of them. The name in a --condition is that of a system constant or variant criterion.",
)
BAD_FORMULA = error(
    "HAL0586",
    "Formula of a variation point cannot be evaluated",
    "Formulas have references to system constants, numbers, the operators of C and `defined(...)`.",
)
UNSET_CONSTANT = error(
    "HAL0587",
    "Variant does not set what a condition needs",
    "Whether the element exists depends on a system constant, or a variant criterion, that the variant gives no value. "
    "It is not taken to be 0.",
)
TWO_VALUES = error(
    "HAL0588",
    "Variant sets a constant twice",
    "Two value sets of one variant, or a value set and a --condition, give a system constant or variant criterion "
    "different values.",
)


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
ONE_VARIANT = warning(
    "HAL1447",
    "Schedule of one variant is put onto a project of several",
    "The delta and the changed files have no variation points, so that they count in each variant of the project. In "
    "another one, OsTasks would start as this variant needs it. A post-build variant is chosen when the ECU starts: "
    "there, each variant needs schedule tables of its own, started by code.",
)
NO_CONFIGURATION = error(
    "HAL0583",
    "Project has no configuration to put a schedule onto",
    "A schedule is put onto the ECU configuration of Os, in AUTOSAR release 4, to which all OsTasks of the model "
    "belong.",
)


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
PHASE_UNKNOWN = warning(
    "HAL0519",
    "Phase of an alarm or schedule table is not known",
    "A table with the autostart SYNCHRON begins when code provides the value of a synchronisation counter, and an "
    "adjustable expiry point moves with it. An absolute start at 0 is at once where an OS compares first (EB AutoCore) "
    "and after all values of the counter where it waits for the next time (Trampoline). Periods are read, and offsets "
    "as if the alarm or table began at 0.",
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


SECOND_MODEL = error(
    "HAL0590",
    "Several models of halpipe in one import",
    "A file that `halpipe export arxml` wrote holds a whole model. Models cannot be added to each other.",
)
BESIDE_MODEL = warning(
    "HAL0591",
    "Components beside a model of halpipe",
    "The input holds a whole model that halpipe wrote, which is imported, and component types that do not belong to "
    "it.",
)
EDITED = warning(
    "HAL0592",
    "Exported ARXML was edited",
    "An exported file holds the native model once, with a hash of the standard elements. Where these were changed "
    "since, they are imported, as of any other tool: what AUTOSAR rounds or lacks is then lost.",
)
SYNCHRONISED = warning(
    "HAL1431",
    "Synchronised tasks got an order",
    "SYNCHRONIZATION-TIMING-CONSTRAINT bounds the distance of events, whichever comes first. The model has "
    "windows after one task, so that the first in the order of the tasks is taken for the first event: the schedule "
    "keeps the constraint, but a schedule with another order would, too.",
)
OTHER_START = warning(
    "HAL1432",
    "Started in another application mode",
    "StartOS begins one application mode, and with it the alarms and schedule tables whose autostart names that mode. "
    "Those of OSDEFAULTAPPMODE are imported, or else of the mode that the most of them name.",
)
WHOLE_JOB = warning(
    "HAL1521",
    "Timing constraint within an OsTask counts over its jobs",
    "With --granularity ostask, the instants of a task are the start and the end of jobs. A constraint whose event is "
    "the start of a runnable that others precede in its OsTask, or the end of one that others follow, counts from the "
    "start, or to the end, of the job. It is stricter than in the source, and may have no schedule where the runnables "
    "are in time; --granularity runnable keeps its events.",
)
MAPS_NOTHING = warning(
    "HAL1433",
    "Rte configuration maps no event to an OsTask",
    "The generated RTE would call no function. As long as no event is mapped, functions with a period are tasks "
    "without an OsTask, an order or a core.",
)
SECOND_MAPPING = warning(
    "HAL1443",
    "Event is mapped to two OsTasks",
    "An event of a component instance has one mapping to an OsTask (SWS_Rte_07843). Of several, the first counts, and "
    "the other OsTasks do not call its runnable.",
)
BLUEPRINT = warning(
    "HAL1444",
    "Blueprints are no components",
    "A package of the category BLUEPRINT has patterns, from which a tool derives elements. Nothing in it runs.",
)
SEVERAL_BEHAVIORS = warning(
    "HAL1552",
    "Component type has several internal behaviours",
    "One of them runs in an ECU. Each makes tasks, unless an Rte configuration maps the events of one: the same work "
    "may be counted twice.",
)
