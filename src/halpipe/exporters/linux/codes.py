"""Diagnostics of the Linux export."""

from halpipe.core.diagnostics import error, warning

NOT_A_CPU = error(
    "HAL0811",
    "Unit with jobs is no CPU",
    "The dispatcher plays tables on CPUs. A unit that is something else, or that --cpus leaves out, cannot have jobs "
    "of its own there; start its work from a task on a CPU, and let that task's WCET contain the wait.",
)
NO_PIECES = error(
    "HAL0812",
    "Program cannot be held at its split points",
    "A job with a list of split points is held at the end of a part until the next one begins. So its entry names one "
    "function for each piece between split points.",
)
NO_ORDER = error(
    "HAL0813",
    "Priorities exceed those of Linux",
    "A task that starts in a gap of another one, which is fully preemptive, has the higher priority, and the conductor "
    "has the highest. From the lowest priority that is stated, these need more priorities than Linux has.",
)
UNREALISED = warning(
    "HAL0814",
    "Linux dispatcher does not do all that the schedule says",
    "What it leaves open is listed in the bundle's README.md, too, and needs other means.",
)
BAD_TEXT = error(
    "HAL0815",
    "Name does not go into a C string",
    "Names of tasks, units, modes and buffers are written into the tables as they are: ASCII letters, digits and "
    "punctuation but quotes, backslashes, commas and blanks.",
)
EARLY_PHASE = error(
    "HAL0818",
    "Access phase cannot be held until its instant",
    "Where jobs are split or units serve interrupts, no access phase may begin before its instant, also where the job "
    "is early. A program is held where one of its functions begins, so the phase must begin there.",
)
TOO_LARGE = error(
    "HAL1303",
    "Schedule does not fit the tables of the dispatcher",
    "Numbers of jobs, tables, programs and parts have 16 bits there, times in nanoseconds 64, and a Linux system has "
    "at most 1024 CPUs.",
)
NOT_ALONE = error(
    "HAL1412",
    "Shared object stands beside other sources",
    "A version that names a shared object is loaded from it as it is; nothing is compiled or linked to it. Further "
    "files of the version would be left out.",
)
NO_COPIES = error(
    "HAL1452",
    "Dispatcher cannot keep a logical execution time",
    "The dispatcher copies the data of a job from buffers at its release and back at release + LET. So the data must "
    "be stated as transfers, a job starts in the cycle of its release, and the next job of the task is released when "
    "the data of the one before are written.",
)
NO_START = error(
    "HAL1506",
    "Dispatcher cannot start the regulators",
    "The dispatcher loads, starts and switches regulators of the back-end table. It converts the first instant of the "
    "cores to the time base of the unit, of which the platform file states the rate.",
)
