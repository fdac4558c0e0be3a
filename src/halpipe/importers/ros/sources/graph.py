"""Graph of a ROS system common to CARET and DOT: nodes, callbacks, publications, subscriptions, paths.

A `Callback` is what may become a task: a ROS callback, or, where the source knows no callbacks, a whole node.
Names are those of the source; a callback's name is unique in the graph.
"""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING

from halpipe.core.records import record

if TYPE_CHECKING:
    from halpipe.core.diagnostics import Location
    from halpipe.core.durations import Duration


class Kind(StrEnum):
    """What makes a callback run; the value is its kind in the coverage report."""

    TIMER = "timer_callback"
    SUBSCRIPTION = "subscription_callback"
    SERVICE = "service_callback"
    PROCESS = "process"
    NODE = "node"


class Certainty(StrEnum):
    """How the publishing callbacks of a publication are known."""

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
    at: Location


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
