"""The diagnostics of the check of regulator bundles: HAL1010 to HAL1029, HAL1060 to HAL1079, and HAL1507."""

from halpipe.core.diagnostics import error, warning

UNUSABLE_TABLES = error(
    "HAL1010",
    "Tables of a regulator bundle cannot be used",
    "tables.json is missing, is no JSON, or lacks what the documented form demands; nothing else can be checked.",
)
OTHER_SCHEDULE = error(
    "HAL1011",
    "Tables belong to another schedule",
    "tables.json (or a form of it) states the hash of a schedule or model that is not the one in the bundle.",
)
WRONG_FACTS = error(
    "HAL1012",
    "Derived figures of the tables are wrong",
    "The length of a window, the bytes promised in it or its capacity do not follow from clock, window and bandwidth; "
    "the capacity is more than the bus can carry; or two units share a manager.",
)
UNREGULATED_UNIT = error(
    "HAL1013",
    "Unit uses the memory without a regulator",
    "Jobs of the schedule have access phases on the regulated resource on a unit for which there are no tables.",
)
WRONG_TABLE = error(
    "HAL1014",
    "Tables do not fit the modes and switches of the schedule",
    "A mode or a switch has no table, has it twice, or its table is not as long as the hyperperiod or the switch.",
)
WRONG_SUCCESSOR = error(
    "HAL1015",
    "Table is followed by the wrong one",
    "A mode is followed by itself until software requests a switch; a switch by the mode that it leads to.",
)
WRONG_SWITCH = error(
    "HAL1016",
    "Switch requests the wrong table",
    "To switch, software requests the table of the transition, or of the new mode where the transition needs none.",
)
WRONG_BUDGET = error(
    "HAL1017",
    "Budget of a window is not the one promised",
    "With whole bursts, each window has for every unit and direction the bytes promised in it, rounded up to bursts.",
)
NOT_KEPT_UP = error(
    "HAL1018",
    "Budgets run behind or ahead of the promise",
    "At the end of every window the bursts granted so far must be the promised volume, rounded down or up: then no "
    "unit is ever a whole burst behind, and a phase of whole bursts is served exactly.",
)
OVER_CAPACITY = error(
    "HAL1019",
    "Budgets of a window exceed the capacity",
    "The budgets of all units in one window, with the overshoot of the back-end, are more than the memory guarantees.",
)
UNSAFE_DEFAULT = error(
    "HAL1020",
    "Loaded default budgets are not safe",
    "The budgets that hold before the tables are played must fit the capacity together and let every unit that is "
    "used make progress, one burst at least.",
)
FORMS_DIFFER = error(
    "HAL1021",
    "Forms of the tables differ",
    "The memory images and the C header must say what tables.json says, entry by entry.",
)
TOO_DEEP = error(
    "HAL1022",
    "Tables do not fit the unit's memory",
    "A unit has more entries, with the terminator, than its table memory, or there are more than 255 tables.",
)
NO_ENGINE = error(
    "HAL1023",
    "Simulator is not installed",
    "The engine that was asked for is a program that this machine lacks.",
)
ENGINE_FAILED = error(
    "HAL1024",
    "Simulator failed",
    "The simulator did not accept the Verilog of the bundle, or did not come to its end.",
)
SPENT_TOO_MUCH = error(
    "HAL1025",
    "Unit got more than its budget in simulation",
    "The monitor behind the regulator counted more bytes in a window than its budget; a burst that was shown before "
    "the window began and taken in it is charged to both, and is accepted.",
)
GOT_TOO_LITTLE = error(
    "HAL1026",
    "Unit got less than its budget in simulation",
    "A manager that always asks must get the whole budget of every window.",
)
SHARED_TOO_MUCH = error(
    "HAL1027",
    "Units together got more than the capacity in simulation",
    "The bytes that all units got in one window are more than the memory guarantees.",
)
PLAYED_WRONG = error(
    "HAL1028",
    "Wrong table or window in simulation",
    "At every end of a table the units must go, all together, to the table requested in time, otherwise to the "
    "successor; and a table must not be left before its end.",
)
BROKE_PROTOCOL = error(
    "HAL1029",
    "Regulator broke a rule of the bus in simulation",
    "A burst was shown and withdrawn or changed, passed on one side only, data was shown before its address, or a "
    "register did not hold what it should.",
)
NOT_UNDERSTOOD = error(
    "HAL1060",
    "What is loaded has something that the device does not know",
    "A script, a list of register writes or a header has a line that is not in the documented form, lacks a part, or "
    "is of another schedule. Nothing is guessed: what is not understood is not executed.",
)
DEVICE_REFUSES = error(
    "HAL1061",
    "Device refuses what is loaded",
    "Executed on a model of the device, a register write or a line is refused: the device is not claimed, there is no "
    "such register, group or value, or the order is one that the device does not take.",
)
GRANTS_DIFFER = error(
    "HAL1062",
    "Device grants something else than was promised",
    "What was loaded has been executed on a model of the device. What it then grants a unit is not the least that the "
    "device can be set to for the schedule's promise.",
)
DEVICE_OVER_CAPACITY = error(
    "HAL1063",
    "Device lets more pass than the capacity",
    "What was loaded has been executed on a model of the device. What all units together are then granted, with what "
    "passes above a budget and while settings change, is more than the memory surely serves.",
)
USED_ABOVE_BUDGET = error(
    "HAL1065",
    "Unit used more than its budget",
    "A counter on the board has more bytes in an interval than the budgets of the windows that it touches, with one "
    "burst that was shown before them and with the overshoot of the back-end.",
)
USED_ABOVE_CAPACITY = error(
    "HAL1066",
    "Units together used more than the capacity",
    "Counters of the same interval have more bytes together than the memory is said to serve in its windows.",
)
BROKEN_COUNTERS = error(
    "HAL1067",
    "Bandwidth counters cannot be used",
    "The file has other columns than the documented ones, a row has a value that is none, or names a table, unit or "
    "direction that the bundle does not have.",
)
PLAYED_ELSEWHERE = error(
    "HAL1507",
    "Regulators play another table than the runtime",
    "The runtime has the regulators begin with its first table and requests their switches. At a table of the runtime "
    "they play another one, or began it at another instant, so that jobs run with the budgets of others.",
)
SHARED_ISOLATION = warning(
    "HAL1068",
    "Reads and writes of a unit depend on each other",
    "The device stops both directions of a manager when one has spent its budget. The capacity is kept, but a unit "
    "that reads and writes at once may get less than was promised in one direction. Give the writes a manager of their "
    "own.",
)
