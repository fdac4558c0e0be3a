"""The codes of RISC-V bundles: HAL0840 to HAL0869, HAL0892 to HAL0894, HAL0980, HAL1460, HAL1489, 1490, 1505, 1547."""

from halpipe.core.diagnostics import error, note, warning

UNKNOWN_PROFILE = error(
    "HAL0840",
    "Unknown target profile",
    "A profile is one that comes with halpipe, or a YAML file of the same form: memory map, clocks, DMA engine.",
)
BAD_PROFILE = error(
    "HAL0841",
    "Target profile contradicts itself",
    "Memories overlap or are misaligned, or a size leaves no room for what must be there.",
)
TOOLCHAIN_MISSING = error(
    "HAL0842",
    "Toolchain is not installed",
    "Task images are compiled with the zig wheel or with riscv64-unknown-elf-gcc, and read with pyelftools.",
)
NO_SOURCE = error(
    "HAL0843",
    "Version has no sources",
    "A version that the schedule uses must name its C sources and entry function to become an image.",
)
MISSING_FILE = error("HAL0844", "Source file is missing", "A source file that a version names cannot be read.")
OUTSIDE_FILE = error(
    "HAL0845",
    "Source file lies outside the source folder",
    "Sources and the files that they include with quotes lie below one folder, after links and .. are resolved, and "
    "have no .incbin. Sources are compiled with your rights: this is no protection from hostile ones.",
)
COMPILE_FAILED = error("HAL0846", "Compiler refuses a source", "The message is the compiler's own.")
LINK_FAILED = error(
    "HAL0847",
    "Linker refuses an image",
    "The message is the linker's own. Images are freestanding: there is no C library and no floating point.",
)
MISSING_ENTRY = error(
    "HAL0848", "Entry function is missing", "No source of the version defines the function that its entry names."
)
MISSING_SYMBOL = error(
    "HAL0849",
    "Symbol of a transfer is missing",
    "A transfer names a global variable that no source of the version defines.",
)
SYMBOL_TOO_SMALL = error(
    "HAL0850", "Transfer is larger than its symbol", "It would move bytes beyond the end of the task's variable."
)
IMAGE_TOO_LARGE = error(
    "HAL0851",
    "Image does not fit into a scratchpad",
    "The code must fit into the instruction scratchpad beside the monitor, and constants, data, .bss, transfer buffers "
    "and the stack into the data scratchpad.",
)
OUTSIDE_BUFFER = error(
    "HAL0852",
    "Transfer reaches beyond its main-memory buffer",
    "A buffer is as large as what is written into it at most, or, where it is never written, as what is read from it.",
)
MAIN_MEMORY_FULL = error(
    "HAL0853",
    "Main memory is full",
    "Runtime, images, buffers and the trace do not fit into the profile's main memory.",
)
OFF_GRID = error(
    "HAL0854",
    "Instant is not a multiple of the clock's tick",
    "Jobs are released by the timer, so their starts, hyperperiods and table lengths must be multiples of its tick. "
    "Boundaries of phases inside a job are rounded inwards and need not be.",
)
PHASE_TOO_SHORT = error(
    "HAL0855",
    "Phase is too short for what it moves",
    "Each transfer takes the set-up time and its bytes at the DMA engine's bandwidth, rounded up to ticks; one after "
    "the other they must end within the phase.",
)
NO_LOAD_PHASE = error(
    "HAL0856",
    "Version has no load phase",
    "The image must be brought into the scratchpads within each job, in a phase that begins with the job.",
)
SHARED_PHASE = error(
    "HAL0857",
    "Memory phase is not exclusive",
    "On this platform one transfer at a time uses a resource, so a phase that moves data must have bound 1.",
)
PHASE_ORDER = error(
    "HAL0858",
    "Phases leave no order of execution",
    "A job loads, reads, executes and writes. With several stretches of execution, the entry names a function for "
    "each.",
)
TOO_MANY_UNITS = error(
    "HAL0859", "More units than cores", "Each unit that the schedule uses is an application core of the profile."
)
TOO_MANY_RESOURCES = error(
    "HAL0860", "More resources than DMA channels", "Each resource whose phases move data has a channel of its own."
)
NAME_CLASH = error(
    "HAL0861",
    "Names clash",
    "A symbol is defined more than once in a version, so it is not clear which one is meant.",
)
KINDLESS_PHASE = error(
    "HAL0862",
    "Phase with transfers has no kind",
    "Only a phase of kind read or write says in which direction its transfers go.",
)
IDLE_PHASE = warning(
    "HAL0863",
    "Phase moves nothing",
    "The phase reserves a resource, but a deployed job reaches main memory only through transfers, and it has none.",
)
GREW = note(
    "HAL0864", "Phase was made to fit", "What was added or prolonged so that the image and transfers find their time."
)
WINDOW_FROM_START = warning(
    "HAL0865",
    "Window counts from the start of a version that grew",
    "The predecessor now ends later after its start than before; check whether the window should, too. Windows that "
    "count from its end need no change.",
)
UNDIVIDED = error(
    "HAL0867",
    "Gang cannot divide what it writes",
    "Each member of a gang writes its part of a variable into that part of the buffer. The parts must be whole words "
    "of eight bytes, so that no number is torn; up to eight bytes are written by the first member alone.",
)
FIRST_ALONE = note(
    "HAL0894",
    "First member of a gang writes alone",
    "Up to eight bytes are not divided among the members of a gang. What the others have in that variable is lost; a "
    "larger variable with a part for each member would keep it.",
)
INITIALISED = error(
    "HAL0868",
    "Transfer variable has an initial value",
    "A variable that a transfer names is filled in read phases and by the job; what its initial value would be for is "
    "not clear, and loading it would take time in every job.",
)
NO_RESERVATIONS = error(
    "HAL0980",
    "Code reserves memory where that does not work",
    "The data scratchpads of the target have no lr and sc (Rocket's DTIM: an access fault). Compilers make them of "
    "atomic operations on bytes and of compare-and-swap; amoadd, amoswap and the like work.",
)
OVERWRITTEN = error(
    "HAL0869",
    "Two transfers fill one variable",
    "A later transfer overwrites what an earlier one brought before any function of the job could use it.",
)
BAD_DRIVERS = error(
    "HAL0892",
    "Drivers do not fit the model",
    "A driver fills or empties a buffer of the model, in phases of tasks that are deployed. A buffer by which a task "
    "asks for a mode has eight bytes: the number of the mode, counted from 1, or 0.",
)
IDLE_DRIVER = error(
    "HAL0893",
    "Driver is never called",
    "Drivers of inputs are called in read phases, drivers of outputs in write phases that move their buffer.",
)
BAD_INPUT = error(
    "HAL1460",
    "Recorded input does not fit the model",
    "A recording is a file BUFFER.bin with one or more contents of a buffer that tasks read and none writes, each as "
    "large as the buffer. The check of the bundle puts them there, one for each hyperperiod.",
)
WATCHDOG_SHORT = error(
    "HAL1547",
    "Watchdog is shorter than a table",
    "The runtime writes to the watchdog when each table begins. Its time-out has to cover the longest table, with the "
    "lateness of the management core, or it resets a system that works.",
)
BAD_NAME = error(
    "HAL0866",
    "Name cannot be used in C, linker scripts or file names",
    "Entry functions and symbols are C identifiers; definitions have the form NAME or NAME=value; source files have "
    "plain relative names.",
)
BAD_HARDWARE = error(
    "HAL1490",
    "Hardware description makes no profile",
    "A profile is made from the device tree of a Rocket system, with a hart 0 that manages and an ITIM and a DTIM for "
    "each other one, or from the csr.json of a LiteX system with several Rocket cores.",
)
RULE_LEFT_OUT = warning(
    "HAL1551",
    "Health rule is not in the bundle",
    "With --mode, a bundle is a system of one mode. Rules that switch to another mode are left out; all others stay.",
)
REGULATORS_LEFT_ALONE = warning(
    "HAL1505",
    "Runtime does not start the regulators",
    "The runtime loads, starts and switches regulators of the back-end table whose registers have a stated address. "
    "Others must be started with the run and switched by something else, or their budgets do not fit the jobs.",
)
COPIES_UNFIT = error(
    "HAL1489",
    "Copies of a logical execution time do not fit",
    "At the release of a job and at release + LET the runtime copies its data between buffers. All copies of an "
    "instant are complete before the next such instant, before the job reads, and while no phase moves the buffer.",
)
