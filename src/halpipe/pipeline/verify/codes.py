"""The diagnostic codes of verify: HAL03xx."""

from halpipe.core.diagnostics import error, note, warning

# ---------------------------------------------------------------------------- the file as a whole

WRONG_MODEL = error(
    "HAL0301",
    "Schedule of another model",
    "The schedule names a model other than the one it is checked against.",
)
MODEL_CHANGED = error(
    "HAL0302",
    "Model changed since the schedule was made",
    "The schedule carries the SHA-256 of the model file it was made from, and that is not the hash of this model. "
    "Schedule the model again; the old schedule may still be valid, but nothing says so.",
)
MODEL_FAULT = error(
    "HAL0303",
    "The model cannot be scheduled",
    "The model lacks something that the meaning of a schedule depends on: a WCET, a period, a name that is defined "
    "once, an acyclic predecessor relation. `halpipe validate` explains the model in full.",
)
TOO_FINE = error(
    "HAL0304",
    "Exact numbers out of reach",
    "The common denominator of the durations (or of the bounds of a resource, or the hyperperiod itself) has more than "
    "4096 bits. Such a schedule is refused, because it can be neither compared exactly nor executed.",
)
UNKNOWN_MODE = error(
    "HAL0305",
    "Table of an unknown mode",
    "The schedule has a table for a mode that the model does not have.",
)
REPEATED_TABLE = error(
    "HAL0306",
    "Table given twice",
    "The schedule has two tables for one mode, or for one switch of modes. Only the first is checked further.",
)
MISSING_MODE = error(
    "HAL0307",
    "Mode without a table",
    "Every mode of the model needs a table in the schedule.",
)
MODE_NOT_FOUND = error(
    "HAL0308",
    "No schedule was found for a mode",
    "The author of the schedule found no valid table for this mode; the jobs given are the best attempt, and the rules "
    "they break are reported as well.",
)
WRONG_HYPERPERIOD = error(
    "HAL0309",
    "Wrong hyperperiod",
    "The hyperperiod of a mode is the least common multiple of the periods of the tasks that run in it.",
)

# ---------------------------------------------------------------------------- what a job says

UNKNOWN_TASK = error("HAL0310", "Job of an unknown task", "The model has no task of this name.")
NOT_IN_MODE = error(
    "HAL0311",
    "Job of a task that does not run in the mode",
    "The task has no version available in this mode, so it must not be started in it.",
)
BAD_START = error(
    "HAL0312",
    "Start outside the table",
    "Starts lie in [0, hyperperiod) in the table of a mode and in [0, length) in the table of a switch.",
)
WRONG_END = error(
    "HAL0313",
    "End is not start plus WCET",
    "A job in one piece occupies its units from its start for the WCET of its version, also where that passes the "
    "hyperperiod. Where its units serve interrupts it is their reserved length: the least L with L = C + sum "
    "ceil(L / distance) * c over the interrupts of all its units.",
)

# ---------------------------------------------------------------------------- the rules of a mode

MISSING_JOB = error(
    "HAL0320",
    "Job is missing",
    "A periodic task has one job for each of its periods in the hyperperiod; a task on demand has one job for each "
    "demand that arises.",
)
SURPLUS_JOB = error(
    "HAL0321",
    "Job too many",
    "The index of a periodic job lies beyond the number of its jobs, or no demand arises for a job on demand.",
)
REPEATED_JOB = error("HAL0322", "Job given twice", "Two jobs of one task have the same index.")
WRONG_VERSION = error(
    "HAL0323",
    "Version is not available",
    "The job uses a version that its task does not have, or that is not available in the mode.",
)
WRONG_UNIT = error(
    "HAL0324",
    "Wrong execution units",
    "A job needs exactly as many distinct units as the gang size of its version, all of them valid for the version.",
)
NOT_PERIODIC = error(
    "HAL0325",
    "Job outside its slack",
    "No phase puts every job of the task between its release and its release plus slack times period.",
)
LATE = error(
    "HAL0326",
    "Deadline missed",
    "The job ends later after its release than its deadline allows.",
)
OVERLAP = error(
    "HAL0327",
    "Unit used twice at a time",
    "Two jobs occupy one unit at the same time, possibly round the end of the hyperperiod.",
)
OVERLOAD = error(
    "HAL0328",
    "Access bounds exceed a resource",
    "The bounds of the access phases in force on a resource sum to more than 1.",
)
OUT_OF_WINDOW = error(
    "HAL0329",
    "Precedence constraint broken",
    "No job of the predecessor starts (or ends) as long before the job as the constraint demands.",
)
CHAIN_LIMIT = error(
    "HAL0330",
    "Chain exceeds its limit",
    "The worst reaction time or data age of a cause-effect chain is longer than the model allows.",
)
PARTS_DIFFER = error(
    "HAL0331",
    "Parts do not make up the job",
    "The parts of a job execute its WCET from 0 to C, one after the other, with a gap between two of them. The first "
    "starts when the job starts, the last ends when the job ends.",
)
WRONG_GAP = error(
    "HAL0332",
    "Job is interrupted where it must not be",
    "Between two parts a job stands at a split point of its version or, where it may be split anywhere, at an instant "
    "that is not inside an access phase and leaves parts of at least min-part. It has at most max-gaps gaps.",
)
WRONG_LENGTH = error(
    "HAL0333",
    "Part has not its reserved length",
    "A part lasts L(x), the least L with L = x + sum ceil(L / distance) * c over the interrupts of all units of the "
    "job, where x is what it executes and, after a gap, the resume of the version. Without interrupts L(x) = x.",
)
NOT_NESTED = error(
    "HAL0334",
    "Jobs are not nested",
    "Of two jobs that share a unit one ends before the other starts, or lies in one gap of the other from start to "
    "end. Jobs of one task that share a unit do not lie in each other's gaps.",
)
NOT_BOUND = error(
    "HAL0335",
    "Job is on other units than its task is bound to",
    "The jobs of a task with binding mode use one set of units in all of the mode and in the tables into it; with "
    "binding system the same set in all modes and tables. The set that most of them use is taken as meant.",
)
ARRIVAL_LATE = error(
    "HAL0336",
    "Arrival is served too late",
    "An arrival may come just after a job of the task that polls has started. The next job must start within the "
    "distance after that start, so that no second arrival waits, and end within the deadline.",
)
NO_LENGTH = error(
    "HAL0337",
    "Interrupts leave no time for a job",
    "The interrupts of the job's units, together, take all of the time, or all but a sliver: no reserved length is "
    "found within 100 000 steps. So no length is enough for the job.",
)
OVER_THE_EDGE = error(
    "HAL0341",
    "Job in progress over a closed edge",
    "The mode has a closed edge: its table begins from idle, so every job, also of the mode or the table before, has "
    "ended by then.",
)
WRONG_FIGURE = error(
    "HAL0340",
    "Reported figure contradicts the jobs",
    "The schedule reports a cost, load or latency that does not follow from its own jobs.",
)

# ---------------------------------------------------------------------------- switches of modes

NOT_ALLOWED = error(
    "HAL0350",
    "Switch is not allowed",
    "The schedule has a table for a switch of modes that the model does not list.",
)
TOO_LONG = error(
    "HAL0351",
    "Switch takes too long",
    "The table of a switch must have a length of at least zero and at most the length that the model allows. No job "
    "that is split or takes a resource may last over so many cycles of the mode to come that they cannot be looked at "
    "(200 000 jobs), and constraints may not differ in so many of its cycles.",
)
NO_TABLE = note(
    "HAL0352",
    "No table for this switch",
    "The model allows the switch, the schedule has no table for it; the switch must not be performed.",
)
SWITCH_NOT_FOUND = warning(
    "HAL0353",
    "No table was found for a switch",
    "The author of the schedule found no table for this switch; it must not be performed. The modes themselves are "
    "unaffected.",
)
STARVED = error(
    "HAL0354",
    "Task starved across a switch",
    "Consecutive starts of a task that runs in both modes may be at most (1 + slack) periods apart.",
)
AGAINST_ITSELF = error(
    "HAL0355",
    "Task runs against itself across a switch",
    "A task that runs in both modes is started before its job from before has ended.",
)
STARTED_AFTER_LEAVING = error(
    "HAL0356",
    "Task started after leaving",
    "A task that does not run in the mode to come is started during the switch.",
)
STARTED_EARLY = error(
    "HAL0357",
    "Task started early without need",
    "A task that enters with the new mode is started during the switch, but no constraint needs that job.",
)

# ---------------------------------------------------------------------------- health

REACTION_MISSING = error(
    "HAL0360",
    "Health rule without reaction",
    "The model has a health rule for a task of the mode, and the schedule does not state what follows there, or there "
    "is no table for the switch that has to follow. A target would go on as if nothing had happened.",
)
WRONG_REACTION = error(
    "HAL0361",
    "Wrong reaction",
    "The schedule states a reaction that follows from no health rule of the model, or one that takes another time than "
    "its hyperperiod and its transition table: a switch takes up to both, a stop up to a hyperperiod.",
)

# ---------------------------------------------------------------------------- run time

PRIORITIES = note(
    "HAL0338",
    "Priorities that play the schedule",
    "Jobs that may be interrupted anywhere are over in time if each task that is named stands above the other one at "
    "run time: a job of it starts in a gap of the other's. Exports that need priorities derive them from this.",
)
PRIORITY_CIRCLE = warning(
    "HAL0339",
    "Preemptions on a unit form a cycle of priorities",
    "On a unit, tasks of which jobs start in gaps of jobs that may be interrupted anywhere are above one another in a "
    "circle. The schedule is valid: a target that suspends and resumes by the table plays it; one that needs "
    "priorities cannot, and its export refuses the schedule.",
)
