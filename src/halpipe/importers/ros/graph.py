"""Graph of a ROS system: nodes, callbacks, topics and paths, with the names and periods that a model may have.

A `Callback` is what may become a task: a ROS callback, or, where the source knows no callbacks, a whole node. Its name
is that of the source, unique in the graph.

Periods are measured or typed with a slip: taken literally, timers of 19999999 ns and 100001000 ns have a hyperperiod
of 23 days. `snap` moves a period to the first grid that has a value within tolerance, from coarse to fine. All values
are exact: a 30 Hz source is 1/30 s.
"""

from __future__ import annotations

from collections import Counter
from enum import StrEnum
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import Duration, milliseconds, seconds
from halpipe.core.records import record
from halpipe.importers.ros import codes

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Findings, Location
    from halpipe.importers.common.names import Names


class Kind(StrEnum):
    """Trigger of a callback; the value is its kind in the coverage report."""

    TIMER = "timer_callback"
    SUBSCRIPTION = "subscription_callback"
    SERVICE = "service_callback"
    PROCESS = "process"
    NODE = "node"


class Certainty(StrEnum):
    """Certainty of the publishing callbacks of a publication."""

    STATED = "stated"
    INFERRED = "inferred"
    ASSUMED = "assumed"


@record(kw_only=True)
class Node:
    """A ROS node; `name` is absolute."""

    name: str
    at: Location


@record(kw_only=True)
class Callback:
    """A callback of `node`: a timer with its period, or triggered by `inputs`; `polled` topics it only reads."""

    name: str
    node: str
    kind: Kind
    at: Location
    period: Duration | None = None
    inputs: tuple[str, ...] = ()
    polled: tuple[str, ...] = ()


@record(kw_only=True)
class Publication:
    """A topic that `node` publishes, in one of `callbacks` (none: outside of every callback)."""

    node: str
    topic: str
    at: Location
    callbacks: tuple[str, ...] = ()
    certainty: Certainty = Certainty.STATED


@record(kw_only=True)
class Subscription:
    """A topic that `node` reads, in `callback`; None when no callback is known to read it."""

    node: str
    topic: str
    at: Location
    callback: str | None = None


@record(kw_only=True)
class Flow:
    """Data that one callback of a node leaves for another one of the same node."""

    writer: str
    reader: str


@record(kw_only=True)
class Group:
    """A callback group or an executor: callbacks that it runs, and whether they exclude each other."""

    kind: str
    name: str
    exclusive: bool
    callbacks: tuple[str, ...]
    at: Location


@record(kw_only=True)
class Step:
    """A node on a path, between the topic it subscribes and the one it publishes; None at the path's ends."""

    node: str
    subscribed: str | None
    published: str | None


@record(kw_only=True)
class Path:
    """A named path: the cause-effect chain that the user of CARET marked."""

    name: str
    steps: tuple[Step, ...]
    at: Location


@record(kw_only=True)
class Rate:
    """A period of a topic that a `source` other than a timer states: recording, statistics, QoS deadline."""

    topic: str
    period: Duration
    source: str
    at: Location


@record(kw_only=True)
class RosGraph:
    """A whole graph, as read from one file."""

    file: str
    nodes: tuple[Node, ...]
    callbacks: tuple[Callback, ...]
    publications: tuple[Publication, ...]
    subscriptions: tuple[Subscription, ...]
    flows: tuple[Flow, ...] = ()
    groups: tuple[Group, ...] = ()
    paths: tuple[Path, ...] = ()
    rates: tuple[Rate, ...] = ()
    topics: tuple[str, ...] = ()


def printable(text: str) -> str:
    """Return text from a file on one line and without control characters, fit for messages and for XML."""
    return "".join(c if c.isprintable() else "?" for c in " ".join(text.split()))


def task_names(graph: RosGraph, names: Names) -> dict[str, str]:
    """Return the task name of every callback: its node's name where it is the node's only one, else its own."""
    count = Counter(callback.node for callback in graph.callbacks)
    result = {}
    for callback in sorted(graph.callbacks, key=lambda callback: count[callback.node] > 1):
        kind = "node" if callback.kind is Kind.NODE else "callback"
        name = callback.node if count[callback.node] == 1 else callback.name
        result[callback.name] = names.unique(name, kind, callback.at, of=callback.name)
    return result


_SECOND = seconds(1)
_USUAL_RATES = (1, 2, 4, 5, 8, 10, 12, 15, 16, 20, 24, 25, 30, 40, 50, 60, 75, 80, 90, 100, 120, 125, 150, 200, 240)
_FAST_RATES = (250, 400, 500, 800, 1000)
_MILLISECOND_GRIDS = tuple(milliseconds(step) for step in (100, 10, 1))
_FINE_GRIDS = tuple(Duration(step) for step in (100_000, 10_000, 1_000))


@record
class Tolerance:
    """Tolerance of a period: a share of it, or an absolute amount (at most 1/1000 of it) if that is more."""

    relative: Fraction
    absolute: Duration
    rates_first: bool

    def of(self, period: Duration) -> Duration:
        """Return the largest deviation allowed for `period`."""
        return max(period * self.relative, min(self.absolute, period / 1000))


STATED = Tolerance(Fraction(1, 10_000), Duration(1_000), rates_first=False)
"""For timers and deadlines, whose values come from a clock: jitter only."""

MEASURED = Tolerance(Fraction(1, 50), Duration(0), rates_first=True)
"""For rates counted in a recording, where messages get lost and the ends are ragged."""


def snap(period: Duration, tolerance: Tolerance) -> Duration:
    """Return the roundest period within `tolerance` of `period`, or `period` itself; it may be 0 or less."""
    if period <= Duration(0):
        return period
    limit = tolerance.of(period)
    for candidate in _candidates(period, tolerance.rates_first):
        deviation = candidate - period if candidate > period else period - candidate
        if deviation <= limit:
            return candidate
    return period


def snapped(
    period: Duration, tolerance: Tolerance, at: Location, path: str, findings: Findings, what: str = ""
) -> Duration:
    """Return the roundest period within `tolerance`; report one that differs, as that of `what`."""
    found = snap(period, tolerance)
    if found != period:
        shown = Duration(round(period.fraction))  # recorded periods are ratios with many digits
        help = "state another period in the overlay if this one is wrong"
        findings.add(codes.SNAPPED(f"period {shown}{what} rounded to {found}", at=at, path=path, help=help))
    return found


def _candidates(period: Duration, rates_first: bool) -> Iterator[Duration]:
    if rates_first:
        usual = (_SECOND / rate for rate in _USUAL_RATES + _FAST_RATES)
        yield min(usual, key=lambda rate: abs((rate - period).fraction))
        yield _nearest_multiple(period, _SECOND)
    yield from (_nearest_multiple(period, grid) for grid in _MILLISECOND_GRIDS)
    rate = round(_SECOND / period)
    if 1 <= rate <= 1000:
        yield _SECOND / rate
    yield from (_nearest_multiple(period, grid) for grid in _FINE_GRIDS)


def _nearest_multiple(period: Duration, grid: Duration) -> Duration:
    return grid * max(1, round(period / grid))
