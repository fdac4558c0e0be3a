"""The diagnostic codes of validate: HAL02xx."""

from halpipe.core.diagnostics import error, note, warning

# ---------------------------------------------------------------------------- names and structure

BAD_NAME = error(
    "HAL0201",
    "Name with characters that names cannot have",
    "Names are 1 to 1000 characters of A-Z a-z 0-9 _ . / : ~ + @ $ % -. White space would break the lists of names in "
    "the XML, and glob characters the patterns of the overlay.",
)
DUPLICATE_NAME = error(
    "HAL0202",
    "Name defined twice",
    "Units, resources, tasks, chains and modes are each told apart by their names, and so are the versions of a task.",
)
DUPLICATE_RUN = error(
    "HAL0203",
    "Task listed twice in a mode",
    "A mode says once for each task which of its versions are available. Merge the two lists.",
)
REPEATED_IN_LIST = error(
    "HAL0204",
    "Name repeated in a list",
    "The valid units of a version and the versions available in a mode are sets. A repeated name is probably a slip "
    "for another one.",
)
UNKNOWN_UNIT = error("HAL0205", "Unknown unit", "A version names a valid unit that the platform does not have.")
UNKNOWN_RESOURCE = error(
    "HAL0206", "Unknown resource", "An access phase names a resource that the platform does not have."
)
UNKNOWN_TASK = error(
    "HAL0207",
    "Unknown task",
    "A precedence constraint, a chain or a mode names a task that the model does not have.",
)
UNKNOWN_VERSION = error("HAL0208", "Unknown version", "A mode names a version that the task does not have.")
UNKNOWN_MODE = error("HAL0209", "Unknown mode", "A transition names a mode that the model does not have.")
NO_UNITS = error("HAL0210", "Model without units", "A schedule needs at least one execution unit.")
NO_TASKS = error("HAL0211", "Model without tasks", "There is nothing to schedule.")
NO_MODES = error(
    "HAL0212",
    "Model without modes",
    "A mode says which tasks run together, and in which versions. A model needs at least one.",
)
EMPTY_MODE = error("HAL0213", "Mode selects nothing", "A mode needs at least one task that runs in it.")
NOTHING_PERIODIC = error(
    "HAL0214",
    "Mode without a periodic task",
    "The hyperperiod is the least common multiple of the periods, and tasks without a period run only on demand of "
    "others. A mode in which no task has a period therefore has no schedule.",
)
NO_VERSIONS = error("HAL0215", "Task without versions", "A task runs as one of its versions, so it needs at least one.")
RUN_SELECTS_NOTHING = error(
    "HAL0216",
    "Mode lists a task but none of its versions",
    "A task that does not run in a mode is left out of it; a task that is listed needs at least one version.",
)
VERSION_WITHOUT_UNITS = error(
    "HAL0217", "Version without units", "A version must say on which units its jobs may execute."
)

# ---------------------------------------------------------------------------- tasks and versions

ZERO_PERIOD = error(
    "HAL0220",
    "Period is zero",
    "A period is positive. A task that runs only on demand of others has no period at all.",
)
BAD_SLACK = error(
    "HAL0221",
    "Slack is not a share of the period",
    "The allowed slack is a number from 0 to 1 (paper, Table I).",
)
NEEDS_PERIOD = error(
    "HAL0222",
    "Offset, deadline or LET without a period",
    "They count from the releases of a periodic task. A task on demand has no releases; bound it by the precedence "
    "constraints that demand it, or by a chain.",
)
SLACK_WITHOUT_PERIOD = warning(
    "HAL0223",
    "Slack without a period",
    "Slack is a share of the period, so it has no effect on a task that runs on demand.",
)
NEGATIVE_TIME = error("HAL0224", "Negative time", "Every duration of the model is zero or more.")
SPLIT_OUTSIDE = error(
    "HAL0225",
    "Split point outside the execution",
    "A split point is an execution time at which a job may be interrupted: after its start (0) and before its end (C).",
)
SPLIT_NOT_ASCENDING = error(
    "HAL0226", "Split points do not ascend", "The split points of a version are listed in order, each once."
)
LET_BEYOND_DEADLINE = error(
    "HAL0218",
    "LET beyond the deadline",
    "The data of a job with a logical execution time are written at its release + LET, which is at most the deadline "
    "of its task (the period, where no deadline is stated).",
)
ZERO_DISTANCE = error(
    "HAL0227",
    "Distance is zero",
    "What comes when it likes needs a least time between two of its kind; otherwise it takes all the time there is.",
)
INTERRUPT_TOO_LONG = error(
    "HAL0228", "Interrupt longer than its distance", "The next one comes before the unit is done with the one before."
)
POLLED_TOO_RARELY = error(
    "HAL0229",
    "Polled less often than arrivals come",
    "The period of a task that serves sporadic arrivals is that of polling. It is at most the distance, so that no "
    "second arrival waits.",
)
MISSING_WCET = error(
    "HAL0230",
    "WCET is missing",
    "A version whose worst-case execution time no source has stated can be stored, but not scheduled.",
)
WCET_BEYOND_DEADLINE = error(
    "HAL0231",
    "WCET beyond the deadline",
    "A job of this version can never end in time. The deadline of a task that states none is its period; a logical "
    "execution time bounds it, too. On units with interrupts the time reserved for the WCET counts. An error where a "
    "mode has no other version of the task; else a warning, and the version is not tried.",
)
WCET_BEYOND_PERIOD = warning(
    "HAL0232",
    "WCET beyond the period",
    "The deadline allows it, but successive jobs of the task then overlap, on different units; and no switch of modes "
    "that keeps the task running is possible, because across a switch a task never runs against itself.",
)
ZERO_WCET = error("HAL0233", "WCET is zero", "A job that takes no time cannot be placed on a unit.")
WCET_BEYOND_HYPERPERIOD = error(
    "HAL0234",
    "WCET beyond the hyperperiod",
    "The schedule repeats with the hyperperiod, so a job that is longer would overlap its own repetition on its unit.",
)
BAD_GANG = error(
    "HAL0235",
    "Gang does not fit its units",
    "A job occupies as many distinct units as its gang size, at least 1 and at most the number of valid units.",
)

SPLIT_IN_PHASE = error(
    "HAL0236",
    "Split point within an access phase",
    "An access phase lies within one part of a job, so no split point is strictly inside one.",
)
NO_MAX_GAPS = error(
    "HAL0237",
    "Split anywhere without a limit",
    "A version that may be split anywhere states max-gaps, the largest number of gaps of a job.",
)
SPLIT_WITHOUT_EFFECT = warning(
    "HAL0238",
    "Split setting without effect",
    "resume, max-gaps and min-part belong to a split, min-part to a split anywhere. A min-part above half of the WCET, "
    "or max-gaps 0, allows no gap at all.",
)
ARRIVAL_TOO_LATE = error(
    "HAL0239",
    "Polling cannot keep the deadline",
    "The worst arrival comes just after a job has started and waits for the next one. Starts are a period apart on "
    "average, so some arrival waits for period plus WCET at least (on a unit with interrupts, plus the time reserved "
    "for it).",
)

# ---------------------------------------------------------------------------- access phases

EMPTY_PHASE = error("HAL0240", "Access phase is empty", "A phase is in force on [start, end), so start < end.")
PHASE_BEYOND_WCET = error(
    "HAL0241", "Access phase beyond the WCET", "The phases of a version lie within the execution of its jobs."
)
UNLIKE_BOUNDS = error(
    "HAL0284",
    "Bounds without a usable common denominator",
    "Loads are added up exactly. Bounds on one resource whose common denominator has a thousand digits can be "
    "neither compared exactly nor executed.",
)
BAD_BOUND = error(
    "HAL0242",
    "Bound is not a share of the resource",
    "A bound is greater than 0 and at most 1, the whole resource (paper, Table I).",
)
PHASES_OVERLOAD = error(
    "HAL0243",
    "Access phases of one job overload a resource",
    "Phases of one version that overlap on a resource add up, and more than 1 can never be granted. Interrupts of the "
    "units stretch each phase over what follows in the same part.",
)
LOCK_WITH_SHARE = error(
    "HAL0245",
    "Lock access with a bound or data",
    "A lock is held by one job at a time, as a whole: an access to it has no bound below 1 and moves no data, and the "
    "lock itself has no bandwidth.",
)
EMPTY_TRANSFER = error("HAL0244", "Transfer of no data", "A transfer moves at least one byte.")

# ---------------------------------------------------------------------------- precedence constraints

EMPTY_WINDOW = error(
    "HAL0250", "Precedence window is empty", "No distance between two jobs is at least min and at most max."
)
SELF_PRECEDENCE = error(
    "HAL0251",
    "Task is its own predecessor",
    "Precedence constraints must not reference the task itself, directly or indirectly (paper, section III).",
)
PRECEDENCE_CYCLE = error(
    "HAL0252",
    "Precedence constraints form a cycle",
    "Among the tasks of a mode the predecessor relation must be acyclic, over all versions available there (paper, "
    "section III). Where data flows in a circle, leave out the constraint of the edge that may carry old data.",
)
PREDECESSOR_ABSENT = error(
    "HAL0253",
    "Predecessor does not run in the mode",
    "Every version of the task that is available in the mode is constrained by a task that does not run there.",
)
VERSION_UNUSABLE = warning(
    "HAL0254",
    "Version cannot be chosen in the mode",
    "The version is constrained by a task that does not run in the mode. Another available version is not, so the task "
    "can still be scheduled.",
)
NEVER_DEMANDED = warning(
    "HAL0255",
    "Task on demand without a demand",
    "A task without a period has one job for each precedence constraint that names it, so here it never runs.",
)

NOTHING_TO_BIND_TO = error(
    "HAL0256",
    "Bound task has no common units",
    "With the binding system a task uses the same set of units in all modes and tables, whatever the version. So there "
    "must be a set that some available version allows in every mode, with the same gang size.",
)

NO_SUCH_INSTANT = error(
    "HAL0257",
    "Instant that a job does not have",
    "Windows count from the start, the end, the release or a point of the predecessor to the start or the end of the "
    "job; latencies of chains from the release, the start or the end of the first task to the start or the end of the "
    "last. Only tasks with a period have releases, and a point lies within the WCET of every version.",
)
CYCLE_WITHOUT_PERIOD = error(
    "HAL0258",
    "Same cycle without a period",
    "A constraint with match=cycle pairs jobs by the numbers of their periods, so both tasks need a period.",
)
CONTRADICTION = error(
    "HAL0259",
    "Requirements contradict each other",
    "Two statements of the model exclude each other for every schedule: two windows to the job of the same cycle that "
    "do not meet, or releases and windows of one cycle.",
)

# ---------------------------------------------------------------------------- chains and transitions

EMPTY_CHAIN = error("HAL0260", "Chain without tasks", "A cause-effect chain is a sequence of tasks.")
REPEATED_IN_CHAIN = warning(
    "HAL0262",
    "Task twice in a chain",
    "The latency is followed through the task as often as it is listed. This is right for a loop; otherwise it is a "
    "slip.",
)
CHAIN_NOT_IN_MODE = note(
    "HAL0263",
    "Chain is not checked in a mode",
    "A chain has latencies only in the modes in which all its tasks run.",
)
CHAIN_NEVER_RUNS = warning(
    "HAL0264",
    "Chain is never checked",
    "In no mode do all tasks of the chain run, so its limits have no effect.",
)
CHAIN_LIMIT_TOO_LOW = error(
    "HAL0265",
    "Chain limit cannot be kept",
    "The jobs of a chain follow each other, so no latency is shorter than the sum of the smallest WCETs; a stimulus "
    "that just misses a job of the first task waits, at worst, a whole period longer.",
)
SELF_TRANSITION = error(
    "HAL0270", "Transition from a mode to itself", "A transition leads from one mode to another one."
)
DUPLICATE_TRANSITION = error("HAL0271", "Transition listed twice", "An ordered pair of modes has one transition.")

BAD_RULE = error(
    "HAL0272",
    "Health rule that says nothing definite",
    "A health rule counts from 1 to 255 events in 1 to 255 tables. A switch needs the mode that it leads to; a restart "
    "and a stop lead to none.",
)
RULE_WITHOUT_SWITCH = error(
    "HAL0273",
    "Health rule leads where no switch is allowed",
    "A health rule switches through the transition table, so the transition from every mode in which its task runs to "
    "the mode that it leads to must be allowed. Where it is not, the rule could not do what it says.",
)
RULE_NEVER_HOLDS = warning(
    "HAL0274",
    "Health rule that never holds",
    "The task of the rule runs in no mode but the one that the rule leads to, so nothing would ever follow from it.",
)

# ---------------------------------------------------------------------------- a whole mode

UNITS_OVERLOADED = error(
    "HAL0280",
    "Units overloaded",
    "In a mode, the tasks that can run only on these units need more time of them than there is, even in their "
    "shortest versions. Of a unit with interrupts only what they leave counts: 1 - sum c/T. No schedule exists.",
)
RESOURCE_OVERLOADED = error(
    "HAL0281",
    "Resource overloaded",
    "In a mode, the access phases of the least demanding versions need more of a resource than there is. No schedule "
    "exists.",
)
INTERRUPTS_FILL = error(
    "HAL0282",
    "Interrupts fill the unit",
    "The sum of c/T over the interrupts of a unit must be below 1, and not so close to it that jobs never end. The "
    "members of a gang wait for each other's interrupts, so there the sum over all its units counts.",
)
MANY_PARTS = warning(
    "HAL0283",
    "Jobs may have too many parts",
    "The limit of 10 000 000 counts the parts of jobs. If all gaps that the splits allow were used it would be passed; "
    "the search stops where a schedule passes it.",
)
TOO_MANY_JOBS = error(
    "HAL0290",
    "Hyperperiod has too many jobs",
    "The hyperperiod is the least common multiple of the periods of a mode. Periods that fit each other badly make it "
    "explode; 10 000 000 jobs is the limit. Often a rounded period is the cause: a 30 Hz camera has the period "
    "1/30s, not 33ms.",
)
TOO_MANY_TICKS = error(
    "HAL0291",
    "Hyperperiod has too many ticks",
    "The tick is the largest duration that divides every duration of a mode. The hyperperiod counted in ticks must "
    "stay below 2 to the power of 62; one needlessly exact duration is enough to break that.",
)
UNUSED_UNIT = note("HAL0295", "Unused unit", "No version may run on this unit.")
UNUSED_RESOURCE = note("HAL0296", "Unused resource", "No version accesses this resource.")
TASK_NEVER_RUNS = note("HAL0297", "Task runs in no mode", "The task is not scheduled at all.")
VERSION_NEVER_RUNS = note("HAL0298", "Version is available in no mode", "The version is never chosen.")
