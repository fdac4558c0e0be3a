"""Every diagnostic of the ROS importer."""

from __future__ import annotations

from halpipe.core.diagnostics import error, note, warning

UNRECOGNISED = error(
    "HAL0601",
    "File is no ROS graph description",
    "The importer reads CARET's architecture.yaml (keys nodes, executors, named_paths), the DOT files that rqt_graph "
    "saves, hand-written DOT task graphs, and rosbag2's metadata.yaml. Files are recognised by content, not by name.",
)
NO_GRAPH = error(
    "HAL0602",
    "No graph among the inputs",
    "A model needs exactly one graph: an architecture.yaml or a DOT file. rosbag2 metadata only adds periods.",
)
TWO_GRAPHS = error(
    "HAL0603",
    "More than one graph",
    "Two graphs cannot be merged: nothing says which of them is right where they differ. Name one of them; any "
    "number of rosbag2 metadata.yaml files may go with it.",
)
NOT_DOT = error(
    "HAL0604",
    "DOT is malformed",
    "The file does not follow the DOT grammar, or is an undirected graph or has an edge with dir=none, which state no "
    "direction of data flow.",
)
SKIPPED_FILE = note(
    "HAL0605",
    "ROS file of a directory was skipped",
    "A file found while searching a directory is none of the formats that the importer reads (a note), or is "
    "malformed (a warning). Named directly, such a file is an error.",
)
MALFORMED = error(
    "HAL0610",
    "Element is malformed",
    "A required key is missing, or a value has the wrong form.",
)
DUPLICATE = error(
    "HAL0611",
    "ROS name is used twice",
    "Nodes of a graph, and callbacks of a node, are known by their names; a second one cannot be told apart.",
)
DANGLING = error(
    "HAL0612",
    "ROS reference has no target",
    "A name refers to a callback, callback group or node that the file does not declare.",
)
BAD_PERIOD = error(
    "HAL0613",
    "Period is not a positive whole number of nanoseconds",
    "CARET states a timer's period as period_ns, rosbag2 the duration of a recording in nanoseconds.",
)
BAD_CALLBACK_TYPE = error(
    "HAL0614",
    "Callback type is unknown",
    "Callbacks are timer_callback, subscription_callback or service_callback.",
)
UNKNOWN_KEY = warning(
    "HAL0615",
    "Key is not read",
    "The key is no part of CARET's format as far as the importer knows it, or not with a callback of this type; its "
    "value has no effect.",
)
TWO_OWNERS = warning(
    "HAL1453",
    "Callback or callback group belongs to two",
    "In rclcpp a callback has one callback group, and a callback group one executor. The model keeps a callback apart "
    "from the others of both groups if they are mutually exclusive; a package looks for it in the last one.",
)
SNAPPED = note(
    "HAL0620",
    "Measured period was rounded to the stated one",
    "Traces measure periods such as 19999999 ns; taken literally they make hyperperiods of years. A timer's period "
    "is moved to a round value within 1/10000 or 1 us of it, a period from recorded rates within 1/50.",
)
UNKNOWN_PUBLISHER = warning(
    "HAL0621",
    "It is not known which callback publishes a topic",
    "The file names no callback for a publication of a node with several, or message contexts name several. The "
    "importer assumes a reader of the message that is carried on, else the fastest timer of the node, else the "
    "subscription callback that runs first; precedence and chains both go through it. A trace shows the real one.",
)
SEVERAL_PERIODS = warning(
    "HAL0622",
    "Sources of different periods",
    "A callback or node is fed at different rates. It takes the shortest period, which misses no message.",
)
NO_PERIOD = warning(
    "HAL0623",
    "Callbacks or nodes without a period are not tasks",
    "Nothing that has a period triggers them, in the graph, in the overlay or in a recording.",
)
FEEDBACK = warning(
    "HAL0624",
    "Data flows in a loop",
    "Precedence must be free of cycles. Where a loop of data is cut, the reader takes the value of the round before. "
    "No precedence is lost where the loop passes through a callback that something else triggers.",
)
EXCLUSION = warning(
    "HAL0625",
    "Mutual exclusion is given up",
    "Callbacks of a mutually exclusive group never overlap in ROS, so they share data without locks. Each group is "
    "a resource that its tasks hold to their ends; that takes their WCETs. Without them, or with --groups ignored, "
    "only tasks on one unit never overlap. A single-threaded executor is no part of the model (a note).",
)
DEFAULT_UNIT = note(
    "HAL0626",
    "ROS execution unit was assumed",
    "ROS graphs do not describe the computer. All tasks are put on one unit, core0, until an overlay names units.",
)
DEFAULT_WINDOW = note(
    "HAL0627",
    "ROS precedence windows were assumed",
    "A task starts between 0 and the longer of both periods after the end of the task that publishes its input. "
    "That is the smallest window that holds at every phase, so it never makes a model infeasible.",
)
RENAMED = note(
    "HAL0628",
    "ROS name was adapted",
    "Names of model elements have no white space and no glob characters; other characters were replaced by _.",
)
PATH_IGNORED = warning(
    "HAL0629",
    "Path is not a chain",
    "A named path needs at least two tasks, each once, without a gap between them.",
)
ONE_SHOT = warning(
    "HAL0638",
    "Timer ran once",
    "The trace has further periods of the timer, in which it did not run: a one-shot timer, cancelled in its own "
    "callback, is no periodic task. It becomes one where the overlay states a period.",
)
NO_TASKS = error(
    "HAL0630",
    "No task in the graph",
    "Not one node or callback has a period, so there is nothing to schedule.",
)
BAG_CONFLICT = warning(
    "HAL0631",
    "Recordings disagree",
    "Two recordings give different periods for a topic; the shorter one is taken.",
)
ODD_BAG = warning(
    "HAL1458",
    "Metadata of a recording contradicts itself or its format",
    "The total of messages is not the sum of those of the topics, so some counts, and periods from them, are wrong; "
    "or the version of the format is not one of 1 to 9, and a newer one may mean something else by the same keys.",
)
NO_MEASUREMENTS = error(
    "HAL0640",
    "File has no measured durations",
    "The file for --calibrate is no table with callbacks and their durations, and no trace.",
)
BAD_SAMPLE = error(
    "HAL0641",
    "Measured duration cannot be read",
    "A row lacks a callback or a duration, or the duration is no number or negative. A WCET must not rest on rows that "
    "were left out in silence.",
)
CALIBRATED = note(
    "HAL0642",
    "WCET was taken from measurements",
    "It is the maximum or a quantile of the measured durations, with the margin asked for. It is what was seen, and "
    "that may be less than the worst case.",
)
UNMEASURED = warning(
    "HAL0643",
    "Tasks without a measurement",
    "Nothing usable was measured for a task, so its WCET has to come from elsewhere.",
)
MEASURED_STRANGER = warning(
    "HAL0644",
    "Measured callback is no task",
    "The name of a measured callback is that of no task or callback of the graph; its durations are not used.",
)
FEW_SAMPLES = warning(
    "HAL0645",
    "WCET rests on few measurements",
    "Fewer than 10 executions were measured, or too few for the quantile to differ from the maximum.",
)
DESIGN_VERSION = warning(
    "HAL0632",
    "Version of the design format is not known",
    "Autoware System Design files are read up to version 0.4. A newer one may mean something else by the same keys.",
)
MISSING_ENTITY = warning(
    "HAL0633",
    "Entity is not among the files",
    "A design file refers to a node, module or system whose file was not given. What is made of it is left out.",
)
LOOSE_CONNECTION = warning(
    "HAL0634",
    "Connection of a design leads nowhere",
    "A connection, trigger or outcome names a port, instance or process that is not declared.",
)
NO_RATE = warning(
    "HAL0635",
    "Rate of a process cannot be read",
    "A periodic trigger states a rate in Hz, as a number above 0 or as a parameter with such a value. Without it, the "
    "process has only its other triggers.",
)
MODE_PERIOD = warning(
    "HAL0636",
    "Process runs at different rates in different modes",
    "A task has one period. In modes where a process has another one, it is a task of its own, called task@mode.",
)
COMPUTE_UNITS = note(
    "HAL0637",
    "Compute units were taken as execution units",
    "A compute unit of a design is a computer, which may have several cores; a design does not say how many. Each is "
    "one execution unit of the model until an overlay names cores.",
)
MISSED_PERIODS = warning(
    "HAL0650",
    "Timer missed periods",
    "A timer fired more seldom than its period says, or stopped before its node: its callback or the executor takes "
    "too long, or the program cancels it. The model has its stated period.",
)
WALL_TIME = note(
    "HAL0646",
    "Measured durations contain preemption",
    "Without the kernel's events sched_switch a trace shows when a callback began and ended, not when it had the CPU. "
    "The longest of such times is no less than the time on the CPU.",
)
CONTRADICTED = warning(
    "HAL0647",
    "Trace and graph contradict each other",
    "A callback is in one of them only, or another callback publishes a topic than the file states. What was seen to "
    "publish is taken.",
)
CONFIRMED = note(
    "HAL0648",
    "Trace confirms the graph",
    "So many callbacks and publishers of the file are in the trace as the file states them.",
)
OTHER_GRAPH = error(
    "HAL0649",
    "Trace of another system",
    "Callbacks are known by node, kind, and topic or period. Not one of the trace is in the graph.",
)
