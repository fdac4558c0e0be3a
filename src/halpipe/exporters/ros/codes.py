"""The diagnostics of the ROS export: HAL0816, HAL0817, HAL0897, HAL0899, HAL1301 to HAL1304, HAL1454, HAL1455."""

from halpipe.core.diagnostics import error, warning

UNREALISED = warning(
    "HAL0897",
    "ROS executors cannot do what the schedule says",
    "Executors and timers start callbacks by time on the CPUs of their executors. What a schedule holds beyond that is "
    "listed in the exported file, too, and needs other means.",
)
TOO_FINE = error(
    "HAL0899",
    "Schedule does not repeat within whole nanoseconds",
    "ROS timers count whole nanoseconds. A hyperperiod that is no whole number of them is repeated until it is; this "
    "one would need too many timers.",
)
UNBOUND = error(
    "HAL0816",
    "Callback of a task is not known",
    "The executor of a package finds each callback by its node and its topic or timer. The graph or trace that --graph "
    "names says which one a task is.",
)
SPLIT_CALLBACK = error(
    "HAL0817",
    "Callback cannot be held at split points",
    "A callback is one function, which the executor can start, but not hold where a part ends.",
)
OLD_MESSAGES = error(
    "HAL1301",
    "Queue makes the age of a chain unbounded",
    "With --messages oldest a job takes one message of its queue. As many come as are taken, so what waits in the "
    "queue once stays there, and every datum is older than scheduled by the queue. Nothing proves the queue empty.",
)
EQUAL_CALLBACKS = error(
    "HAL1302",
    "Equal callbacks of a node cannot be told apart",
    "A callback is found by its node, its topic or period, and its place among equal ones. Within a callback group "
    "that place is the order of construction; between groups there is none.",
)
NO_EVENT = error(
    "HAL1304",
    "Task cannot wait for a message as stated",
    "Only jobs of subscriptions get messages. A job waits within the time that the schedule reserves for it, so the "
    "wait is shorter than the WCET of every version; and the mode for a missing message is one of the schedule.",
)
NO_TIME_LEFT = warning(
    "HAL1454",
    "WCET does not hold the wait and the measured time",
    "A job of --wait runs after its wait, and its WCET holds both. In the trace that --graph names, a job of the "
    "callback took longer than its WCET less the wait, so a job whose message comes late would end late.",
)
LATE_START = error(
    "HAL1455",
    "Schedule does not hold for a job that waits",
    "A job of --wait begins up to its wait after its instant. Verify accepts the schedule only if it holds for every "
    "such begin: windows from and to the start, chains to the start, and access phases from the earliest begin to the "
    "latest end. The end of the job is that of its WCET, which contains the wait.",
)
