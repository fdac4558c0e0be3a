"""The diagnostics of scheduling."""

from __future__ import annotations

from halpipe.diagnostics import error, note, warning

NOT_FOUND = error(
    "HAL0401",
    "No schedule found within the budget",
    "The search spent its budget without a valid schedule. That is not a proof that none exists: raise the budget, "
    "try another seed, or relax what the report names.",
)
INTERRUPTED = warning(
    "HAL0402",
    "Search was interrupted",
    "The best placement so far is saved, marked as not found; it breaks the rules that are listed.",
)
TOO_LARGE = error(
    "HAL0403",
    "Numbers of the mode are too large",
    "The hyperperiod in ticks, times bounds and jobs, does not fit the solver's 64-bit integers. Choose a coarser "
    "--tick, or round periods, WCETs and bounds to fewer digits.",
)
TICK_DOES_NOT_DIVIDE = error(
    "HAL0404",
    "Tick does not divide a period or an offset",
    "With --tick, WCETs and access phases are rounded outward and windows inward, but periods and offsets must be "
    "multiples of the tick.",
)
NO_OPTION = error(
    "HAL0405",
    "Task cannot run in a mode",
    "None of the versions available in the mode can run at all: each is longer than its deadline or the "
    "hyperperiod, or needs a predecessor that the mode does not run.",
)
OPTIONS_CUT = note(
    "HAL0406",
    "Not all unit sets of a gang are tried",
    "A gang over many unlike units can be placed in more ways than the search considers; it tries the first ones.",
)
STILL_BROKEN = warning(
    "HAL0407",
    "Rule still broken by the best placement",
    "What verify finds in the best placement of a search that failed: where the conflict is.",
)
