"""Diagnostics of comparing a trace with its schedule."""

from __future__ import annotations

from enum import Enum, auto
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Code, error, note

if TYPE_CHECKING:
    from collections.abc import Mapping


NEEDS_MODE = error(
    "HAL1101",
    "Trace does not say which mode ran",
    "The schedule has several modes and the trace names none, so --mode must; or it names several without counting "
    "the tables played, so that it is open where one ends.",
)
UNKNOWN_TABLE = error(
    "HAL1102",
    "Schedule has no such mode or transition",
    "The trace, or --mode, names a table that the schedule does not have.",
)
WRONG_SEQUENCE = error(
    "HAL1103",
    "Tables are played in an order that the schedule does not allow",
    "After a mode comes the same mode again, or the transition table to another one; after that, its target.",
)
UNKNOWN_TASK = error(
    "HAL1104",
    "Trace has a task that the schedule does not have",
    "Nothing can be said about such executions, except that they took time on a unit.",
)
WRONG_START = error(
    "HAL1105",
    "Job starts at another instant than scheduled",
    "A time-triggered job starts at its instant: later, and its data may be late; earlier, and its inputs may not be "
    "there. The amount beyond --tolerance is what counts.",
)
LATE_END = error(
    "HAL1106",
    "Job ends later than scheduled",
    "The end of a job in the schedule is that of its last part: for a job in one piece without interrupts, its start "
    "plus the WCET of its version.",
)
OVERRUN = error(
    "HAL1107",
    "Job runs longer than its WCET",
    "The time in which the job really ran is more than the schedule reserves: the WCET of the model is wrong.",
)
MISSING_JOB = error(
    "HAL1108", "Scheduled job did not run", "Within the time that the trace covers, nothing ran for this job."
)
EXTRA_JOB = error(
    "HAL1109",
    "Job ran that is not scheduled",
    "There is no job of the task at this time, or another execution is closer to it.",
)
WRONG_UNIT = error("HAL1110", "Job ran on another unit than scheduled", "The units are those of the schedule.")
WRONG_ORDER = error(
    "HAL1111",
    "Jobs of a unit ran in another order than scheduled, or at once",
    "On one unit, jobs run one after the other, in the order of the schedule.",
)
OUTSIDE_PARTS = error(
    "HAL1113",
    "Job ran outside its parts",
    "A job with gaps runs in its parts only. One that resumes earlier, or pauses later, is inside its next piece when "
    "another job of the unit comes: a target holds it at the end of a part until the next one begins.",
)
PAUSE = error(
    "HAL1114",
    "Nothing ran for many cycles",
    "Between two executions of the trace lie so many silent cycles of the schedule that their jobs are not counted one "
    "by one. The recording was interrupted, an instant in it is wrong, or its unit of time is another.",
)
ALIGNED = note(
    "HAL1112",
    "Trace and schedule were laid onto each other",
    "With --origin auto, the zero of the schedule is laid where no job starts early and one starts on time. A lateness "
    "that all jobs share cannot be seen then.",
)
NO_DATA = error(
    "HAL1115",
    "Job ran without data",
    "Its instant came and there was no message for it. It started in time, and yet its part of every chain is missing: "
    "the publisher is not there, has stopped, or publishes later than scheduled.",
)
DID_NOT_RUN = note(
    "HAL1116",
    "Task did not run in the recording",
    "No job of it was due within the time that the trace covers, which is less than a cycle of the schedule. So it is "
    "open whether the task keeps the schedule.",
)
CHAIN_EXCEEDED = error(
    "HAL1117",
    "Measured figure of a chain exceeds its bound",
    "A latency, reaction time or data age of what ran is more than the limit of the model, or (a warning) more than "
    "the verified worst case of the schedule; twice --tolerance is allowed, since both ends may be off. A job that is "
    "late by less than the tolerance may still miss the data of a whole period.",
)
NOT_MEASURED = note(
    "HAL1118",
    "Chain is not measured",
    "Its figures count from or to events that a recording does not have: releases, or of a task with a logical "
    "execution time a start or an end.",
)
UNSCHEDULED = note(
    "HAL1440",
    "Programs of the computer are not in the schedule",
    "A recording of the kernel has the threads of all programs. Those without a task in the schedule are no deviation, "
    "but take time on the same CPUs.",
)
OTHER_MODEL = error(
    "HAL1119",
    "Model is not that of the schedule",
    "The model given with --model has another name or content than the one from which the schedule was made, or lacks "
    "modes, tasks or versions of it.",
)
EXCLUSION = error(
    "HAL1450",
    "Jobs that need one resource ran at the same time",
    "Both need the resource wholly for all of their time, as a lock or with a bound of 1, so the schedule keeps them "
    "apart. Where one is late or runs too long, nothing else does on the target.",
)


class Kind(Enum):
    """Kinds of deviation of what ran from the schedule."""

    UNKNOWN_TABLE = auto()
    SEQUENCE = auto()
    UNKNOWN_TASK = auto()
    PLAN = auto()
    EARLY = auto()
    LATE = auto()
    LATE_END = auto()
    ENDLESS = auto()
    OVERRUN = auto()
    MISSING = auto()
    EXTRA = auto()
    UNIT = auto()
    ORDER = auto()
    OVERLAP = auto()
    EXCLUSION = auto()
    PARTS = auto()
    PAUSE = auto()
    NO_DATA = auto()


_START, _TOGETHER = "look at what ran before it on its unit", "one unit runs one job at a time, in order"
KINDS: Mapping[Kind, tuple[Code | None, str]] = {
    Kind.UNKNOWN_TABLE: (UNKNOWN_TABLE, ""),
    Kind.SEQUENCE: (WRONG_SEQUENCE, "check how the recorder counts cycles"),
    Kind.UNKNOWN_TASK: (UNKNOWN_TASK, ""),
    Kind.PLAN: (None, "load the tables of this schedule"),
    Kind.EARLY: (WRONG_START, _START),
    Kind.LATE: (WRONG_START, _START),
    Kind.LATE_END: (LATE_END, "look at its start, its preemptions and its run time"),
    Kind.ENDLESS: (LATE_END, "bound the loops and waits of the program"),
    Kind.OVERRUN: (OVERRUN, "correct the WCET, or the program"),
    Kind.MISSING: (MISSING_JOB, "check whether the trace lost events"),
    Kind.EXTRA: (EXTRA_JOB, "check who starts it"),
    Kind.UNIT: (WRONG_UNIT, "bind it to its unit"),
    Kind.ORDER: (WRONG_ORDER, _TOGETHER),
    Kind.OVERLAP: (WRONG_ORDER, _TOGETHER),
    Kind.EXCLUSION: (EXCLUSION, "look at their starts and run times: only the table keeps them apart"),
    Kind.PARTS: (OUTSIDE_PARTS, "hold it at the end of a part until the next"),
    Kind.PAUSE: (PAUSE, "compare the pieces before and after it, or correct the instants and their unit"),
    Kind.NO_DATA: (NO_DATA, "start its publisher before the tables, or schedule it later"),
}
"""Code and help of each kind; of those without help it depends. A check of a bundle has codes of its own."""
ROUNDED = "traces in whole nanoseconds round the instants of the schedule: state --tolerance 1ns"
TIMED = frozenset({Kind.EARLY, Kind.LATE, Kind.LATE_END, Kind.OVERRUN})
"""Kinds of which less than a nanosecond may come of what wrote the trace."""
CODES: Mapping[Kind, Code] = {kind: code for kind, (code, _) in KINDS.items() if code is not None}
