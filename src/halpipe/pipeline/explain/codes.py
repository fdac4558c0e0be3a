"""Diagnostic codes of explain (HAL043x, HAL1410)."""

from halpipe.core.diagnostics import error, note, warning

TASKS_MEET = error(
    "HAL0430",
    "Tasks need the same units at the same time",
    "Two strictly periodic tasks with the periods D1 and D2 stand in every phase to each other, up to multiples of "
    "gcd(D1, D2). If their WCETs C1 + C2 exceed it, some of their jobs run at the same time, however the phases are "
    "chosen, and so do further tasks that are longer than the gaps which that leaves. When they need more units than "
    "there are for them, no schedule exists. Of a task with slack only C - slack * D counts, the part of its time that "
    "does not depend on where its jobs start. Groups of tasks that are together for some time meet others in the same "
    "way. While a task has a unit for itself, jobs that might use it too cannot start there, and do without it.",
)
NO_GAP = error(
    "HAL0431",
    "Job does not fit between the jobs of another task",
    "Both tasks can run only on the same unit, and the longest time that the jobs of the one leave free, D + slack * D "
    "- C, is shorter than what the other needs in one go: its WCET, or its longest piece where its jobs may be split. "
    "So no schedule exists. Interrupts of the unit make C and the piece longer.",
)
PHASES_MEET = error(
    "HAL0432",
    "Access phases need more of a resource than there is at the same time",
    "As with HAL0430, strictly periodic access phases meet, however the phases of their tasks are chosen, when they "
    "are longer together than the greatest common divisor of their periods. The bounds of those that meet sum to more "
    "than 1.",
)
WINDOW_TOO_NARROW = error(
    "HAL0433",
    "Precedence window is too narrow for the periods",
    "Each job of the task needs a job of the predecessor in its window. Seen from the predecessor, the jobs of the "
    "task lie at all multiples of gcd(D1, D2) within the predecessor's period D2, so the window must be at least "
    "D2 - gcd(D1, D2) wide, less what the slacks of both tasks allow.",
)
WINDOWS_CONTRADICT = error(
    "HAL0434",
    "Windows contradict each other",
    "Followed along a path of tasks, precedence windows and offsets say how far two tasks are apart, up to multiples "
    "of the greatest common divisor of the periods on the path. Another window, an offset, or the fact that both tasks "
    "need the same unit, says something else, and no distance satisfies both.",
)
NO_SCHEDULE_FOR = error(
    "HAL0435",
    "These tasks cannot be scheduled together",
    "A conflicting set, found by leaving out what is not needed for the conflict: the exact engine finds no schedule "
    "for these tasks with these constraints, twice with different seeds. Where it is called minimal, it finds one as "
    "soon as any of them is left out.",
)
REMEDY = note(
    "HAL0436",
    "What would help",
    "A change of the model with which a valid schedule was found, the smallest of its kind that was tried. *Found "
    "sufficient* means: a schedule that passes verify exists with it; a smaller change may do as well. *Proven "
    "necessary* means: with less, the witness above still holds.",
)
NO_REMEDY = note(
    "HAL0437",
    "No single change was found that helps",
    "None of the single changes tried (another unit, slack, shorter WCETs, wider windows) led to a schedule within the "
    "effort. Several together may.",
)
VERSION_NEVER_FITS = warning(
    "HAL0438",
    "Version can never be chosen",
    "The version needs a unit on which another task leaves no gap that is long enough. What follows takes the version "
    "away.",
)
SCHEDULABLE = note(
    "HAL0439",
    "Mode has a schedule",
    "A valid schedule was found, so there is nothing to explain.",
)
CUT_SHORT = warning(
    "HAL0447",
    "Searches ended early",
    "The time was over, or the search was stopped. The answer is what was found by then, and what was proven by then.",
)
UNIT_HELD = error(
    "HAL0446",
    "Unit is held for longer than a chain can do without it",
    "A task holds the unit in one piece. A chain with a limit goes through jobs of another task there, because its "
    "other versions take longer than the limit leaves. Such a job lies before the piece or after it. The last job of "
    "the chain that reads what came before it starts at most limit - (WCETs of the chain up to its last job) after "
    "that, the first that reads what comes after it cannot start before it; and two starts of the last task are at "
    "most D + slack * D apart. If the piece is longer than that allows, no schedule exists. For a reaction time, the "
    "same holds for the first task and the data it missed.",
)
NO_ASSIGNMENT = error(
    "HAL0448",
    "Bound tasks do not fit on their units",
    "Each of these tasks keeps all its jobs on one unit. Every assignment of them to the units that they may use was "
    "tried: in each, some unit has more work than time, or two tasks share a unit on which their jobs must meet.",
)
TABLE_TOO_SHORT = error(
    "HAL1410",
    "Transition table is too short for an entering task",
    "A task of the new mode needs a predecessor that does not run in the mode before. Its first job cannot start later "
    "than its offset (or its period) and slack allow, so that the job of the predecessor starts before the new mode "
    "begins: in the transition table. A table of the stated max-length has no room for that. No schedule exists for "
    "this switch.",
)
