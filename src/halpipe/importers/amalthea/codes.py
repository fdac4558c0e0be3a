"""The diagnostics of the AMALTHEA importer: HAL1201 to HAL1254, HAL1420, HAL1421, HAL1423 and HAL1520."""

from halpipe.core.diagnostics import error, note, warning

NOT_AMALTHEA = error(
    "HAL1201",
    "File is not an AMALTHEA model",
    "The importer reads the XML of Eclipse APP4MC (.amxmi) from ITEA 1.1.0 to 3.3.0. Other XML, metamodels "
    "(.ecore) and compressed models are not read; unpack a compressed model first.",
)
NO_INPUT = error(
    "HAL1202",
    "No AMALTHEA model in the input",
    "No file was named, or a named directory holds no usable .amxmi file.",
)
SKIPPED_FILE = warning(
    "HAL1203",
    "AMALTHEA file of a directory was skipped",
    "An .amxmi file found while searching a directory is malformed or no AMALTHEA model. Named directly, such a "
    "file is an error.",
)
MIXED_VERSIONS = error(
    "HAL1204",
    "Files of different AMALTHEA versions",
    "References between files name classes, and classes were renamed from version to version. Migrate all files to one "
    "version with APP4MC, or import them one by one.",
)
UNKNOWN_VERSION = warning(
    "HAL1205",
    "AMALTHEA version is unknown",
    "The version in the namespace is none that the importer was made for. The file is read as the nearest known one.",
)
BAD_VALUE = error(
    "HAL1210",
    "Value has the wrong form",
    "A time, frequency, size, data rate or count is no number, has an unknown unit, or is negative.",
)
DANGLING = warning(
    "HAL1211",
    "AMALTHEA reference has no target",
    "The element that is referred to is in none of the files given. What depends on it is left out.",
)
DUPLICATE = error(
    "HAL1212",
    "Element is defined in two files",
    "Elements are known by name and class, so the files are probably two models, or two states of one.",
)
REPEATED = warning(
    "HAL1213",
    "AMALTHEA name is used twice",
    "References by name reach the first of several elements of the same name and class.",
)
RECURSION = error(
    "HAL1214",
    "Runnables call each other without end",
    "A runnable that calls itself, directly or through others, has no execution time; neither have calls that nest "
    "deeper than 100.",
)
REACTION = warning(
    "HAL1215",
    "Mapping of a delay constraint is not wholly ensured",
    "Reaction wants a target within the window for each source, UniqueReaction and OneToOne a target of its own. The "
    "model ensures what the message says.",
)
NO_PARTNERS = error(
    "HAL1216",
    "Delay constraint that no schedule keeps",
    "UniqueReaction wants at least as many targets as sources, OneToOne as many. Tasks of these periods do not have "
    "them.",
)
CONTRADICTION = warning(
    "HAL1217",
    "Event chain contradicts its parts",
    "The parts of a sequence begin where the chain begins, follow on each other, and end where it ends. Data does not "
    "take the way of a chain that contradicts itself, so it is not imported.",
)
ACTIVE_WAIT = warning(
    "HAL1218",
    "Active wait leaves its unit to others",
    "A task that waits actively keeps its unit busy. The model cuts it at the wait, and a schedule may use the unit "
    "meanwhile for other tasks, which the running system would delay.",
)
NO_TASKS = error(
    "HAL1220",
    "No task in the model",
    "The files define no task, or none that is activated periodically or by one that is, so there is nothing to "
    "schedule.",
)
NO_PERIOD = warning(
    "HAL1221",
    "Tasks without a period are left out",
    "Nothing activates the task, or only stimuli without a period: single, variable rate, custom, an arrival curve "
    "without a shortest distance. State a period in an overlay, under tasks: or, for the stimulus, under sources:.",
)
SPORADIC = note(
    "HAL1222",
    "Sporadic activation is polled",
    "The task has the least distance of its arrivals, and a period at which it looks for them: short enough to serve "
    "the densest arrivals in time, and one that leaves the hyperperiod of the other tasks as it is.",
)
SEVERAL_ACTIVATIONS = note(
    "HAL1224",
    "Task with several activations became several",
    "A task of the model has one period and one offset, so a task with several makes one task for each.",
)
JITTER = warning(
    "HAL1225",
    "Jitter of an activation is not imported",
    "The schedule decides when a job starts, so the release has no jitter in the model.",
)
FEEDBACK = warning(
    "HAL1226",
    "Activation in a loop",
    "Precedence must be free of cycles. Where tasks activate each other in a loop, it is cut at the task whose "
    "period is known.",
)
WAITING = note(
    "HAL1227",
    "Task that waits became several tasks",
    "A task that starts work elsewhere and waits for its end is cut at the wait: each part is a task, with "
    "precedence between them, and the response time of the whole is the largest data age of a chain. While it "
    "waits, its unit is free for others; of active waits a warning says so.",
)
UNUSED_WAIT = warning(
    "HAL1228",
    "Wait has no effect",
    "No task sets an event that is waited for, or the wait stands inside of a branch or a runnable. The task is cut "
    "there for the other events at most.",
)
NO_WCET = warning(
    "HAL1230",
    "Tasks without an execution time",
    "Their runnables state no ticks or instructions, or a number of them without an upper bound. State WCETs in an "
    "overlay.",
)
NO_FREQUENCY = warning(
    "HAL1231",
    "Processing units without a frequency",
    "Ticks become time by the frequency of the unit (older models: of the quartz, through the prescaler). State "
    "WCETs in an overlay.",
)
BRANCHES = note(
    "HAL1232",
    "Longest branch is taken",
    "Branches that data or probability choose at run time cannot be known when the table is made. The longest one "
    "counts, for every kind of unit on its own.",
)
LOOP = warning(
    "HAL1233",
    "Loop is counted once",
    "The model does not say how often the loop runs; its body is taken once. State the WCET in an overlay.",
)
TOO_LONG_ACCESSES = warning(
    "HAL1234",
    "Accesses to memory take longer than the stated execution time",
    "With `--memory within` the stated time is taken to contain the accesses. Where it cannot, the WCET was raised to "
    "the time of the accesses.",
)
DEFAULT_BOUND = note(
    "HAL1235",
    "Share of a memory was assumed",
    "The peak data rate of the memory or of an access to it is not stated, so an access takes all of it.",
)
DEFAULT_UNIT = note(
    "HAL1240",
    "AMALTHEA execution unit was assumed",
    "The files define no processing unit. All tasks are put on one unit, core0, until an overlay names units.",
)
UNMAPPED = note(
    "HAL1241",
    "Tasks are bound to no unit",
    "No scheduler or affinity is stated for them, so they may run on every unit for which they state a time.",
)
AFFINITY = warning(
    "HAL1242",
    "Mapping of a task contradicts itself",
    "The cores of an affinity, a pairing, a separation or an allocated runnable are none of the others. The cores of "
    "the scheduler are taken, or all where there is none.",
)
IMPOSSIBLE_UNIT = warning(
    "HAL1243",
    "Task states no time for the units it is bound to",
    "Its runnables state ticks for other kinds of processing units only.",
)
NOT_IMPORTED = warning(
    "HAL1244",
    "Constraint is not imported",
    "The task model has nothing for it: pairing or separation without target cores, synchronisation, repetition, "
    "limits of other metrics than response time, lower limits of latencies.",
)
BAD_CHAIN = warning(
    "HAL1245",
    "Event chain or constraint names no tasks",
    "The events of a chain or constraint must be events of tasks, or of runnables that one task calls.",
)
TOO_MANY_MODES = warning(
    "HAL1246",
    "Mode labels are not imported as modes",
    "The combinations of the mode labels that nothing in the model sets are more than 64.",
)
EDITED = warning(
    "HAL1247",
    "Exported AMALTHEA model was edited",
    "An exported file holds the native model once, with a hash of the standard elements. Where these were changed "
    "since, they are imported, as of any other tool: what AMALTHEA rounds or lacks is then lost.",
)
DEFAULT_WINDOW = note(
    "HAL1248",
    "AMALTHEA precedence windows were assumed",
    "The model states an order, but no times. A task starts between 0 and the longer of both periods after its "
    "trigger, or the end of its predecessor.",
)
RENAMED = note(
    "HAL1249",
    "AMALTHEA name was adapted",
    "Names of model elements have no white space and no glob characters; other characters were replaced by _.",
)
UNKNOWN_INTERRUPT = warning(
    "HAL1250",
    "AMALTHEA interrupt routines are not accounted for",
    "An interrupt routine takes time from every job of its unit, which a schedule must reserve. Of these the execution "
    "time, the least distance of their arrivals or the unit is not stated, so that no time is reserved for them.",
)
CUT_RUNNABLES = note(
    "HAL1251",
    "AMALTHEA preemptive tasks are cut within runnables",
    "A preemptive task may be interrupted anywhere. Where a runnable is longer than the longest piece (--pieces), jobs "
    "may be interrupted at multiples of that, too: the target has to hold the job there, for example by a call of the "
    "scheduler.",
)
STARTS_APART = error(
    "HAL1420",
    "Limit between starts is shorter than the distance of activations",
    "Each activation starts one job, so starts on average follow on each other no faster than activations do. No "
    "schedule keeps a StartToStart limit below the average distance of two activations.",
)
STRICTER = warning(
    "HAL1421",
    "Limit is stricter than in AMALTHEA",
    "Each activation of a task is a task of the model. An age then counts from the data of each activation or writer "
    "alone, and a reaction to each activation of the last task, where AMALTHEA takes the newest or the next of all. "
    "Jobs start within a period of their activation, however long the limit of the response time is.",
)
WHOLE_JOB = warning(
    "HAL1520",
    "Limit of a runnable counts over its whole job",
    "The instants of a task model are the start and the end of jobs. A chain or order that begins or ends at a "
    "runnable within a job, or an upper delay at one, at an access of a label or at an event without a type, counts "
    "from the start, or to the end, of the job: it is stricter than in AMALTHEA, and may have no schedule where the "
    "runnable is in time. A lower delay alone counts between the jobs.",
)
RETURNS = warning(
    "HAL1423",
    "Event chain returns to an earlier event of its task",
    "From an event of a task the chain leads to one that is earlier in the jobs of that task, and so to the next job. "
    "Chains of the model pass each job from its begin to its end, so this one is not imported.",
)
NOT_READ = warning(
    "HAL1252",
    "Part of an AMALTHEA model is not imported",
    "An element, an attribute or a value of one is not read, and is not on the list of those without influence on "
    'timing. It may decide when work has to run, where, or for how long. The page "AMALTHEA: what is read" has the '
    "lists.",
)
NO_WAY = warning(
    "HAL1253",
    "Way of an access to a memory has no time",
    "A label lies in a memory, but the processing unit that accesses it states neither latencies nor a data rate, on "
    "the access element or along its access path. The accesses take no share of the memory.",
)
CALL_ORDER = warning(
    "HAL1254",
    "Sequencing constraint contradicts the order of calls",
    "A task calls the runnables in another order than the constraint states. The task runs them as it calls them.",
)
