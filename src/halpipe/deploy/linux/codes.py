"""The diagnostics of checking Linux bundles: HAL1080 to HAL1090, HAL1451 and HAL1456."""

from halpipe.core.diagnostics import error, warning

NO_COMPILER = error("HAL1080", "No C compiler", "A Linux bundle is built with make and a C compiler before it is run.")
NOT_BUILT = error(
    "HAL1081", "Bundle cannot be built", "The compiler refuses a program of the tasks, or the dispatcher."
)
NOT_RUN = error(
    "HAL1082",
    "Dispatcher did not play the tables",
    "It stopped with an error, did not end in time, or recorded nothing that can be read.",
)
MISSING_JOB = error(
    "HAL1083",
    "Job of the table did not run",
    "It was skipped, since its slot was over before it could start, or the machine lost whole tables.",
)
FOREIGN_JOB = error(
    "HAL1084",
    "Job ran that the tables do not have there",
    "The recording has a job twice, or one of another table, or tables in an order that the schedule does not allow.",
)
WRONG_ORDER = error(
    "HAL1085",
    "Jobs of a unit ran in another order than scheduled",
    "On each unit jobs start in the order of their instants.",
)
OVERLAP = error(
    "HAL1086",
    "Jobs that exclude each other ran at the same time",
    "They share a unit without lying in each other's gaps, or a resource that both need wholly.",
)
LATE_JOB = error(
    "HAL1087",
    "Job ended after its time",
    "It started late, or ran longer than its WCET on this machine.",
)
NOT_REAL_TIME = warning(
    "HAL1088",
    "Machine gives no real-time rights",
    "Without SCHED_FIFO, locked memory or a CPU for each unit, late starts say nothing about the bundle. Only order "
    "and completeness are judged.",
)
NO_DATA = error(
    "HAL1089",
    "Job of a run had no message",
    "The instant of the job came and there was no message for it: its publisher is missing, stopped or late.",
)
ENDLESS_JOB = error(
    "HAL1090",
    "Job never ended",
    "It still ran when the recording ended: the program waits for something or loops.",
)
EARLY_JOB = error(
    "HAL1451",
    "Job started before its instant",
    "The dispatcher starts a job by the clock. Earlier, the data of the jobs before it may not be there.",
)
FAULTS_NOTICED = warning(
    "HAL1456",
    "Dispatcher noticed a fault during its check",
    "A job was late or longer than its slot, or a health rule was followed. It stands beside what the recording shows: "
    "on a machine without real-time rights ends are not judged, and a switch of mode is allowed.",
)
