"""The diagnostics of the ARXML export: HAL0870 to HAL0889."""

from halpipe.core.diagnostics import error, warning

BAD_PREFIX = error(
    "HAL0872",
    "Prefix of ECU configuration definitions is unusable",
    "The prefix is the path of the package that holds the definitions of Os, Rte and EcuC, such as "
    "/AUTOSAR/EcucDefs or /MICROSAR. Tools ignore configurations of definitions that they do not know.",
)
DANGLING_NAME = error(
    "HAL0873",
    "ARXML export lacks a definition of a name",
    "ARXML refers from element to element, so a task, unit, resource, version or mode that the model names, but "
    "does not define, cannot be written. `halpipe validate` lists them, too.",
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
    "Task would be activated twice at one instant",
    "Jobs of one task that start on one core at one instant would need one OsTask to be activated twice "
    "(OsTaskActivation is 1). This happens only with execution times of zero.",
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
