"""The diagnostics of scheduling."""

from __future__ import annotations

from halpipe.core.diagnostics import error, note, warning

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

ENDLESS = error(
    "HAL0417",
    "Large search without a stated end",
    "So many jobs can take longer than some ten seconds. Such a search begins where it is stated when to give up: with "
    "--time-limit, or with a --budget, which gives the same result on every machine.",
)
GROUP_NOT_FOUND = warning(
    "HAL0408",
    "Independent group of tasks has no schedule yet",
    "A large mode falls into groups that share no unit, resource, window or chain. Each is searched alone; the search "
    "of this one spent its budget, while others succeeded.",
)

# ---------------------------------------------------------------------------- the exact engine

EXACT_MISSING = error(
    "HAL0420",
    "Exact engine is not installed",
    "The exact engine is OR-Tools' CP-SAT, an optional part: pip install ortools.",
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
    "CP-SAT searched the whole mode and says that it has no schedule. That is its own word, which cannot be checked by "
    "hand; `halpipe explain` looks for the conflict behind it.",
)
EXACT_TICK = error(
    "HAL0424",
    "Exact engine takes no tick",
    "It computes on the grid that loses nothing. Leave --tick away, or use the annealer.",
)
EXACT_ELEMENT = error(
    "HAL0425",
    "Exact engine does not know an element of the model",
    "It places jobs in one piece. It does not know units that an earlier mode chose for a task, gangs over units with "
    "different interrupts, and points of tasks that interrupts move by the unit. The annealer does.",
)
EXACT_KEEPS_NOTHING = error(
    "HAL0429",
    "Exact engine keeps no job where it is",
    "It places every job anew, whatever has shipped or was near. The annealer keeps jobs (--freeze, --near).",
)
EXACT_ABSENT = note(
    "HAL0426",
    "Exact engine is not installed as second engine",
    "Small modes that the annealer does not solve are given to the exact engine, which finds what leaves nothing idle. "
    "It is an optional part: pip install ortools.",
)
OTHER_ANSWERED = note(
    "HAL0427",
    "Schedule does not come from the annealer",
    "The annealer had not found a schedule of the mode when the exact engine did. Where "
    "OR-Tools is missing, or of another version, the exact engine's schedule may be another one, or none is found.",
)
TOO_MANY_PARTS = error(
    "HAL0428",
    "Schedule has too many parts",
    "The jobs of a hyperperiod were cut into more than 10 000 000 parts. Allow fewer gaps or longer parts, or choose "
    "periods whose hyperperiod is shorter.",
)
GRID_WHOLE = error(
    "HAL0458",
    "Regulator grid is for whole jobs only",
    "--quantise moves access phases to whole windows of a bandwidth regulator. In a mode with preemptive jobs or "
    "interrupts the instants of phases depend on where jobs are split.",
)
CANNOT_STAY = warning(
    "HAL0412",
    "Shipped task cannot stay",
    "With --freeze, the jobs of the earlier schedule keep start, version, units and parts. A task whose period, "
    "slack, deadline, versions, split points or units no longer allow that, or that starts between the multiples of a "
    "--tick, is placed anew.",
)

# ---------------------------------------------------------------------------- the grid of regulators (--quantise)

GRID_PERIOD = error(
    "HAL0450",
    "Window of the regulators does not divide a period or an offset",
    "With --quantise jobs start at multiples of the window, which are the same in every period only if the window "
    "divides it. Periods and offsets are never rounded.",
)
GRID_WINDOW = error(
    "HAL0451",
    "Precedence window has no room on the grid",
    "With --quantise all starts are multiples of the regulators' window, so that a precedence window needs one such "
    "distance inside.",
)
GRID_BOUND = error(
    "HAL0452",
    "Access phase needs more bursts than a window has room for",
    "With --quantise a bound is rounded up to whole bursts per window, and room is kept for what regulators overshoot. "
    "A phase that has nearly all of the bandwidth may no longer fit.",
)
GRID_ROOM = error(
    "HAL0453",
    "Window has no room for a burst",
    "What is kept for the overshoot of all regulators is all that a window carries.",
)
GRID_TIGHT = error(
    "HAL0454",
    "No schedule on the grid of the regulators",
    "With --quantise the bounds are rounded up to whole bursts and all times to whole windows; with that the model has "
    "no schedule. Without --quantise it may have one, whose export is rounded.",
)
GRID_TICK = error(
    "HAL0455",
    "Tick is no multiple of the window",
    "With --quantise jobs start at multiples of the regulators' window; a tick given besides must be one, too.",
)
GRID_RESOURCE = error(
    "HAL0456",
    "Resource to put on the grid is not clear",
    "The platform names a resource that the model lacks, or names none where the model has several or none at all.",
)
GRID_BREAKS = error(
    "HAL0457",
    "Schedule on the grid does not hold off it",
    "The search kept every rule on the grid, but verify finds one broken with the exact times: most likely two jobs "
    "that end within the same window. Another --seed gives another schedule.",
)
TOO_MANY_STARTS = error(
    "HAL0415",
    "More jobs than ticks to start at",
    "With `--tick`, jobs start at multiples of the tick, so that one that is shorter still takes a whole tick of its "
    "unit. The jobs of these tasks are more than there are ticks. No schedule exists with this tick.",
)
