"""The diagnostics of the ROS export: HAL0897 to HAL0899, HAL0816 and HAL0817."""

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
