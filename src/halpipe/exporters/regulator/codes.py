"""Diagnostics of the regulator export: HAL0810 and HAL0819 to HAL0839."""

from halpipe.core.diagnostics import error, warning

SHORT_BURSTS = warning(
    "HAL0810",
    "AXI-REALM may refuse short bursts",
    "A unit of AXI-REALM splits bursts at its length limit, the longest burst of the platform. Shorter bursts that may "
    "not be split (WRAP, or non-modifiable by AxCACHE) are answered with SLVERR and never reach the memory.",
)
APPROXIMATE = warning(
    "HAL0819",
    "Rates of the regulator are approximate",
    "The regulator takes shares of a bandwidth that was neither measured nor stated. MBA of Intel delays each core, so "
    "that a percentage is no part of a bandwidth; MPAM takes parts of what its component has at most. State what was "
    "measured, or treat the shares as a preference and not as a bound.",
)
NOT_A_PLATFORM = error(
    "HAL0820",
    "File is no regulator platform",
    'A platform is a YAML mapping with the key "halpipe-regulator: 1", the version of the format.',
)
NUMBERS_CONTRADICT = error(
    "HAL0821",
    "Numbers of the platform contradict each other",
    "Bursts are whole beats of the bus and fit into a window, AXI bursts have at most 256 beats and 4 KiB, and no more "
    "bandwidth can be guaranteed than the bus carries.",
)
WINDOW_DOES_NOT_DIVIDE = error(
    "HAL0822",
    "Window does not divide the schedule",
    "Tables are switched at the ends of hyperperiods and transition tables only, so each must be a whole number of "
    "windows. The help names the nearest windows that are.",
)
NO_MANAGER = error(
    "HAL0823",
    "Unit has no manager",
    "The schedule lets the unit use the regulated resource, but the platform does not say which regulator, bus port or "
    "core belongs to it, or the back-end needs a setting of the unit that is not there.",
)
SHARED_MANAGER = error(
    "HAL0824",
    "Two units share a manager",
    "A regulator cannot tell apart what comes through the same port, so each unit needs one of its own.",
)
NO_RESOURCE = error(
    "HAL0825",
    "Resource to regulate is not clear",
    "The platform names a resource that the model lacks, or names none where the model has several or none at all.",
)
OVER_CAPACITY = error(
    "HAL0826",
    "Budgets exceed the capacity of a window",
    "Together with the overshoot that is reserved for the back-end, the budgets of some window are more than memory "
    "surely serves. Give the memory more capacity than is guaranteed, guarantee less, or schedule with --quantise, "
    "which reserves what the export needs.",
)
BELOW_BURST = warning(
    "HAL0827",
    "Bound is below one burst per window",
    "A regulator grants whole bursts. A phase with less than one burst per window gets one every few windows only, and "
    "waits in between.",
)
OFF_GRID = warning(
    "HAL0828",
    "Access phases do not begin and end with windows",
    "Budgets hold for whole windows, so bytes of such a phase can be used outside it, by up to one window. "
    "`halpipe schedule --quantise` puts starts on the grid.",
)
DOES_NOT_FIT = error(
    "HAL0829",
    "Tables do not fit the regulator",
    "The regulator has fewer table entries, tables or bits than the schedule needs.",
)
UNSAFE_DEFAULTS = error(
    "HAL0830",
    "Exported default budgets are not safe",
    "The defaults hold until regulation starts: with the overshoot they must not exceed the capacity of a window, and "
    "each must be at least one burst, or no unit could start.",
)
UNKNOWN_UNIT = warning(
    "HAL0831",
    "Platform names a unit that the model lacks",
    "Platform files may be shared by several models, so this is no error, but it may be a slip of the pen.",
)
NO_UNIT = error(
    "HAL1508",
    "Platform regulates no unit of the model",
    "Regulators limit the accesses of units. Without one there is nothing to load.",
)
BINDS_BOTH = warning(
    "HAL0832",
    "AXI-REALM keeps a promise only in part",
    "A manager that has spent the budget of one direction is stopped in both until the next window, so that the "
    "promises of reads and writes are not independent; and one with more pending transactions than its budget covers "
    "takes several windows to stop. The capacity is kept all the same.",
)
TOO_MANY_WRITES = error(
    "HAL0833",
    "Too many register writes in one window",
    "Software must write the budgets that change at a window's end within that window; the platform states how many "
    "its handler can do.",
)
UNKNOWN_BACKEND = error("HAL0834", "Unknown back-end", "There is no regulator back-end of that name.")
RATE_DOES_NOT_FIT = error(
    "HAL0835",
    "Rates do not fit the regulator",
    "This back-end holds one rate per unit for a whole mode or phase. The rates needed exceed the capacity together, "
    "or one is outside what a register can hold.",
)
COARSE_RATE = warning(
    "HAL0836",
    "Rate is not what was promised",
    "The steps of the regulator are coarse: what it can be set to is more, or less, than the schedule promises.",
)
SHORT_PHASE = warning(
    "HAL0837",
    "Phase is too short for its transfers",
    "The bandwidth promised over the phase is less than the sizes of the transfers that the model states for it.",
)
OVERSHOOT_TOO_LOW = error(
    "HAL0838",
    "Overshoot is less than the back-end's",
    "The platform states less overshoot than this back-end is known to have, so that less would be reserved than "
    "passes.",
)
ABOVE_RESOURCE = warning(
    "HAL0839",
    "Platform guarantees more than the model's resource has",
    "The model states the peak bandwidth of the resource; no more than that can be guaranteed.",
)
