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

# ---------------------------------------------------------------------------- the exact engine

EXACT_MISSING = error(
    "HAL0420",
    "Exact engine is not installed",
    "The exact engine is OR-Tools' CP-SAT, an optional part: pip install 'halpipe[exact]'.",
)
EXACT_TOO_LARGE = error(
    "HAL0421",
    "Mode is too large for the exact engine",
    "The exact engine writes every job, unit and window down as variables, which only small systems allow. The "
    "annealer takes modes of any size.",
)
EXACT_WRONG = error(
    "HAL0422",
    "Exact engine and checker disagree",
    "The exact engine gave a schedule that verify does not accept. This is a bug of halpipe; please report it with the "
    "model. No schedule was written.",
)
EXACT_INFEASIBLE = error(
    "HAL0423",
    "Exact engine finds that there is no schedule",
    "CP-SAT searched the whole mode and says that it has no schedule. That is its own word, which nobody can check by "
    "hand; `halpipe explain` looks for the conflict behind it.",
)
EXACT_TICK = error(
    "HAL0424",
    "Exact engine takes no tick",
    "It computes on the grid that loses nothing. Leave --tick away, or use the annealer.",
)
CANNOT_STAY = warning(
    "HAL0412",
    "Shipped task cannot stay",
    "With --freeze, the jobs of the earlier schedule keep start, version and units. A task whose period, versions or "
    "units no longer allow that is placed anew.",
)
