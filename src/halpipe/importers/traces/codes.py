"""Diagnostics of reading traces."""

from __future__ import annotations

from halpipe.core.diagnostics import error, note, warning

UNKNOWN_TRACE = error(
    "HAL1120",
    "File is no trace",
    "Traces are CSV with a header that has task, start and end; BTF; JSON in the Trace Event Format; protobuf of "
    "Perfetto; text of ftrace; trace.dat of version 6 or 7; MDF; or a directory of CTF.",
)
BROKEN_ROW = error(
    "HAL1121",
    "Row of a trace cannot be read",
    "A column is missing, or a time or a number is none. Nothing is compared while rows cannot be read.",
)
NO_EXECUTIONS = error(
    "HAL1122",
    "Trace has no executions",
    "The file is a trace, but nothing in it says that a task ran.",
)
ODD_SEQUENCE = warning(
    "HAL1123",
    "Events of a trace contradict each other",
    "A job ends that never began, or begins twice; most often the recorder lost events. These events are left out.",
)
UNDESCRIBED = warning(
    "HAL1457",
    "Trace has jobs of callbacks that it does not describe",
    "A callback is known by the events in which its node creates it. Where tracing began later, or these events were "
    "lost, its jobs belong to no task: they are neither in the model nor compared.",
)
UNFINISHED = note(
    "HAL1124",
    "Trace ends while a job runs",
    "Its end is not known, so only its start is compared.",
)
ALREADY_RUNNING = note(
    "HAL1500",
    "Trace begins within a job or a table",
    "Of a job that runs, neither the start nor the time before is known; of one before the first mark of a table, its "
    "table is not. Such jobs are left out.",
)
LEFT_OUT = note(
    "HAL1125",
    "Events of a trace are of no use for a comparison",
    "They tell of other things than tasks, or of pieces of jobs that lie across the edge of the picture.",
)
NO_MODE = warning(
    "HAL1540",
    "Trace numbers jobs without their mode",
    "The columns cycle and job count within the table of a mode or of a switch. Without a column mode they are not "
    "used: executions are compared with the nearest jobs.",
)
NO_CTF = error(
    "HAL1126",
    "Directory is no trace that can be read",
    "A trace of LTTng is a directory with a file called metadata in it or below it, in CTF 1.8, or in CTF 2 without "
    "optional fields and integers of variable length. LTTng 2.15 records in CTF 1.8 after "
    "`lttng create --trace-format=ctf-1.8`.",
)
CUT_OFF = warning(
    "HAL1127",
    "Trace is cut off",
    "A packet of a stream is incomplete or malformed, belongs to another stream or trace, or its instants contradict "
    "each other; most often the trace was copied while it was written. The events before it count; the rest of that "
    "stream does not.",
)
LOST_EVENTS = warning(
    "HAL1128",
    "Tracer discarded events",
    "The buffers of the tracer were full. Jobs, publishers and maxima of execution times may be missing, so nothing "
    "that rests on all events being there can be relied on.",
)
RESTARTED = note(
    "HAL1130",
    "Node started again while it was traced",
    "A process with the node began after the one before it had ended. Its callbacks are taken for the ones of before, "
    "so they are one task each, with the jobs of all runs. Processes that run at once are nodes of their own.",
)
FOREIGN_EVENTS = note(
    "HAL1129",
    "Events of other tracepoints are not used",
    "They are neither of ROS 2 (providers ros2 and ros2_caret) nor switches of the kernel between threads.",
)
NO_END = note(
    "HAL1470",
    "Text of a trace may be cut off",
    "The last line has no end, or a list of events no closing bracket. Some writers omit them; or the file was copied "
    "while it was written, so that events, or the last digits of a number, may be missing.",
)
