"""Meaning of traces of ros2_tracing and CARET: nodes, callbacks, publishers, jobs.

Addresses identify things within one process (vpid), and are used again for others. So a callback is what its address
meant when the job ran. Init events that CARET repeats may come late: they only fill what is not known yet.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.core.suggest import counted, few
from halpipe.importers.traces import codes
from halpipe.importers.traces.ctf import CtfError, Damage, Event, events, folders

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


TIMER, SUBSCRIPTION, SERVICE = "timer", "subscription", "service"
_KINDS = (TIMER, SUBSCRIPTION, SERVICE)
_PROVIDERS = ("ros2", "ros2_caret")
_GROUP = (
    ("group_type", "callback_group_addr", "group_type_name"),
    ("group_executor", "callback_group_addr", "executor_addr"),
)
_EXECUTOR = (("executor_type", "executor_addr", "executor_type_name"),)
_FACTS = {
    "rclcpp_subscription_init": (("of_rclcpp", "subscription", "subscription_handle"),),
    "rclcpp_timer_link_node": (("timer_node", "timer_handle", "node_handle"),),
    "rcl_timer_init": (("period", "timer_handle", "period"),),
    "rclcpp_callback_register": (("symbol", "callback", "symbol"),),
    **{f"callback_group_add_{kind}": ((kind + "_group", f"{kind}_handle", "callback_group_addr"),) for kind in _KINDS},
    **dict.fromkeys(("add_callback_group", "add_callback_group_static_executor"), _GROUP),
    **dict.fromkeys(("construct_executor", "construct_static_executor"), _EXECUTOR),
}
"""Events that say things of an address: what is known by it, and the fields of the address and of the value."""
_ENTITIES = {
    "rcl_publisher_init": ("publisher", "publisher_handle", "topic_name"),
    "rcl_subscription_init": ("subscription", "subscription_handle", "topic_name"),
    "rcl_service_init": ("service", "service_handle", "service_name"),
}
"""Events of what a node has: what is known by its address, and the fields of this and of its name."""
_ADDRESSES = ("subscription_handle", "node_handle", "callback_group_addr", "executor_addr")

Handle = tuple[int, int]
"""Process and address."""


class Key(NamedTuple):
    """Identity of a callback: node, kind, topic or service or period, and its place among equal ones."""

    node: str
    kind: str
    subject: str
    order: int


class Seen(NamedTuple):
    """One job: its span, the CPU on which it began, its thread, and the time in it that the thread really ran."""

    start: int
    end: int
    cpu: int
    thread: int
    busy: int


@dataclass(slots=True)
class RosTrace:
    """All that a trace says of a ROS system; times in nanoseconds."""

    file: str
    has_switches: bool
    nodes: list[str] = field(default_factory=list)
    callbacks: dict[Key, str] = field(default_factory=dict)
    jobs: dict[Key, list[Seen]] = field(default_factory=dict)
    publishers: dict[tuple[str, str], Counter[Key | None]] = field(default_factory=dict)
    groups: dict[str, tuple[str, list[Key]]] = field(default_factory=dict)
    executors: dict[str, tuple[str, list[str]]] = field(default_factory=dict)
    unswitched: int = 0
    """Jobs of threads that no switch of the kernel names, as those of containers, which number their own."""
    restarts: dict[str, list[int]] = field(default_factory=dict)
    """When the processes of a node ended that started again."""
    ends: dict[str, int] = field(default_factory=dict)
    """When a process of a node wrote its last event."""


def read_ros_trace(root: str, findings: Findings, beside: Callable[[Event], None] | None = None) -> RosTrace:
    """Read the trace in a directory; raise `HalpipeError` if there is none that can be read.

    `beside` is called with each event, for readers that need others than those of ROS.
    """
    damage = Damage()
    try:
        found = folders(root)
        if not found:
            raise CtfError("there is no file called metadata in it")
        join, event = _Join(root), None
        for event in events(found, damage):
            join.take(event)
            if beside is not None:
                beside(event)
        if event is None and damage.broken:
            raise CtfError(f"no event of it can be read: {damage.broken[0]}")
    except (CtfError, OSError) as failure:
        text = str(failure) if isinstance(failure, CtfError) else failure.strerror or "it cannot be read"
        help = "name the directory that lttng or `ros2 trace` wrote; of CTF 2, `lttng create --trace-format=ctf-1.8`"
        raise HalpipeError(codes.NO_CTF(text, at=Location(root), help=help)) from None
    trace = join.result(damage)
    _report(trace, join, damage, findings)
    return trace


def _report(trace: RosTrace, join: _Join, damage: Damage, findings: Findings) -> None:
    at, whole = Location(trace.file), "trace from before the nodes start, with the events ros2:*"
    if damage.broken:
        text = f"{counted(len(damage.broken), 'stream')} cut off early: {damage.broken[0]}"
        help = "stop the session with `lttng stop` and `lttng destroy` before copying the trace"
        findings.add(codes.CUT_OFF(text, at=at, help=help))
    if damage.discarded or damage.packets:
        packets = f" and {counted(damage.packets, 'packet')}" if damage.packets else ""
        lost = f"the tracer discarded {counted(damage.discarded, 'event')}{packets}"
        text = f"{lost}, so jobs and publishers may be missing, and jobs joined"
        help = "trace again with more or larger sub-buffers: lttng enable-channel --subbuf-size 8M --num-subbuf 4"
        findings.add(codes.LOST_EVENTS(text, at=at, help=help))
    if join.foreign:
        names = few(sorted(join.foreign), quote="")
        text = f"not used: {counted(sum(join.foreign.values()), 'event')} of other kinds: {names}"
        findings.add(codes.FOREIGN_EVENTS(text, at=at))
    if odd := join.unmatched + join.unended:
        text = (
            f"{counted(join.unended, 'callback')} without an end, {counted(join.unmatched, 'end')} without a beginning"
        )
        text += f"; {counted(odd, 'job')} left out"
        findings.add(codes.ODD_SEQUENCE(text, at=at, help="trace from start to shutdown"))
    if again := sorted(trace.restarts):
        text = f"{counted(len(again), 'node')} ended and started again: {few(again, quote='')}"
        findings.add(codes.RESTARTED(text, at=at, help="trace a single start if the runs are not alike"))
    if trace.callbacks and join.undescribed:
        jobs = sum(join.undescribed.values())
        callbacks = counted(len(join.undescribed), "callback")
        text = f"left out: {counted(jobs, 'job')} of {callbacks}, whose node or trigger the trace lacks"
        findings.add(codes.UNDESCRIBED(text, at=at, help=whole))
    if not trace.callbacks:
        text = "it describes no callback of a node"
        raise HalpipeError(*findings.items, codes.NO_EXECUTIONS(text, at=at, help=whole))


class _Join:
    def __init__(self, file: str) -> None:
        self._file = file
        self._known: defaultdict[str, dict[Handle, Any]] = defaultdict(dict)
        """Meaning of addresses."""
        self._open: dict[tuple[int, int], list[tuple[Handle, int, int, int]]] = {}
        self._ran: dict[Handle, list[Seen]] = {}
        self._published: dict[tuple[str, str], Counter[Handle | None]] = {}
        self._early: dict[Handle, Counter[Handle | None]] = {}
        self._announced: dict[tuple[str, str], None] = {}
        self._switched_in: dict[int, int] = {}
        self._cpu_time: dict[int, int] = {}
        self._has_switches = False
        self._created: list[Handle] = []
        self._started: dict[str, dict[int, int]] = {}
        self._last: dict[int, int] = {}
        self._switched: set[int] = set()
        self.foreign: Counter[str] = Counter()
        self.unmatched = 0
        self.undescribed: dict[Handle, int] = {}
        self._handlers: dict[str, Callable[[Event, int, dict[str, Any]], None]] = {
            **dict.fromkeys(_FACTS, self._fact),
            **dict.fromkeys(_ENTITIES, self._entity),
            **{f"rclcpp_{kind}_callback_added": self._added for kind in _KINDS},
            "rcl_node_init": self._node,
            "callback_start": self._start,
            "callback_end": self._end,
            "rcl_publish": self._publish,
            "rclcpp_intra_publish": self._publish,
        }

    @property
    def unended(self) -> int:
        """Return the number of jobs that still ran at the end, or lost their end."""
        return sum(map(len, self._open.values()))

    def take(self, event: Event) -> None:
        """Take one event."""
        if event.name == "sched_switch":
            left, entered = event.fields.get("prev_tid"), event.fields.get("next_tid")
            if left is not None and entered is not None:
                self._switch(event.time, left, entered)
            return
        provider, _, name = event.name.rpartition(":")
        handler = self._handlers.get(name) if provider in _PROVIDERS else None
        if handler is not None:
            self._last[event.context.get("vpid", 0)] = event.time
            try:
                handler(event, event.context.get("vpid", 0), event.fields)
            except (KeyError, TypeError, AttributeError):  # a tracepoint of the name, but not of the form
                self.foreign[event.name] += 1
        elif provider not in _PROVIDERS:
            self.foreign[event.name] += 1

    def _fact(self, event: Event, pid: int, fields: dict[str, Any]) -> None:
        for of, key, value in _FACTS[event.name.rpartition(":")[2]]:
            found = fields[value] if of != "executor_type" else fields.get(value, "static_single_threaded_executor")
            self._known[of][pid, fields[key]] = (pid, found) if value in _ADDRESSES else found

    def _entity(self, event: Event, pid: int, fields: dict[str, Any]) -> None:
        of, handle, name = _ENTITIES[event.name.rpartition(":")[2]]
        if node := self._known["node"].get((pid, fields["node_handle"])):
            self._known[of][pid, fields[handle]] = entity = node, fields[name]
            if of == "publisher":
                self._announced[entity] = None  # its address may be another one's later

    def _added(self, event: Event, pid: int, fields: dict[str, Any]) -> None:
        kind = event.name.rpartition(":")[2].split("_")[1]
        if kind == SUBSCRIPTION:
            handle = self._known["of_rclcpp"].get((pid, fields["subscription"]))
        else:
            handle = pid, fields[f"{kind}_handle"]
        if handle:
            callback = pid, fields["callback"]
            if callback not in self._known["trigger"]:
                self._created.append(callback)
            self._known["trigger"][callback] = kind, handle

    def _node(self, event: Event, pid: int, fields: dict[str, Any]) -> None:
        name = f"{fields['namespace'].rstrip('/')}/{fields['node_name']}"
        self._known["node"][pid, fields["node_handle"]] = name
        self._started.setdefault(name, {}).setdefault(pid, event.time)

    def _start(self, event: Event, pid: int, fields: dict[str, Any]) -> None:
        thread = event.context.get("vtid", 0)
        used = self._used(thread, event.time)
        self._open.setdefault((pid, thread), []).append(((pid, fields["callback"]), event.time, event.cpu, used))

    def _end(self, event: Event, pid: int, fields: dict[str, Any]) -> None:
        thread = event.context.get("vtid", 0)
        running = self._open.get((pid, thread))
        if not running or running[-1][0] != (pid, fields["callback"]):
            self.unmatched += 1
            return
        callback, start, cpu, used = running.pop()
        busy = self._used(thread, event.time) - used if self._has_switches else event.time - start
        self._ran.setdefault(callback, []).append(Seen(start, event.time, cpu, thread, busy))

    def _publish(self, event: Event, pid: int, fields: dict[str, Any]) -> None:
        running = self._open.get((pid, event.context.get("vtid", 0)))
        callback = running[-1][0] if running else None
        handle = pid, fields["publisher_handle"]
        of = self._known["publisher"].get(handle)
        counts = self._early.setdefault(handle, Counter()) if of is None else self._published.setdefault(of, Counter())
        counts[callback] += 1

    def _switch(self, now: int, left: int, entered: int) -> None:
        """Add up the time that each thread has the CPU; what runs now counts up to now."""
        self._has_switches = True
        self._switched.add(left)
        self._switched.add(entered)
        since = self._switched_in.pop(left, None)
        if since is not None:
            self._cpu_time[left] = self._cpu_time.get(left, 0) + now - since
        self._switched_in[entered] = now

    def _used(self, thread: int, now: int) -> int:
        since = self._switched_in.get(thread)
        if since is None and thread not in self._cpu_time:
            self._switched_in[thread] = since = now  # it runs, since it writes events: its switch came before the trace
        return self._cpu_time.get(thread, 0) + (now - since if since is not None else 0)

    def result(self, damage: Damage) -> RosTrace:
        """Return everything by name."""
        keys = dict(self._keys())
        trace = RosTrace(self._file, has_switches=self._has_switches)
        trace.nodes = sorted(set(self._known["node"].values()))
        trace.callbacks = {key: self._known["symbol"].get(callback, "") for callback, key in keys.items()}
        for callback, jobs in self._ran.items():
            if callback in keys:
                trace.jobs.setdefault(keys[callback], []).extend(jobs)
                trace.unswitched += sum(job.thread not in self._switched for job in jobs)
            else:
                self.undescribed[callback] = len(jobs)
        for handle, early in self._early.items():
            if handle in self._known["publisher"]:
                self._published.setdefault(self._known["publisher"][handle], Counter()).update(early)
        for of in self._announced:
            counts = trace.publishers.setdefault(of, Counter())
            for publishing, count in self._published.get(of, Counter()).items():
                counts[keys.get(publishing) if publishing else None] += count
        for node, lines in self._lines().items():
            trace.ends[node] = max(self._last[pid] for line in lines for pid in line)
            if again := [self._last[pid] for line in lines for pid in line[:-1]]:
                trace.restarts[node] = sorted(again)
        self._groups(trace, keys)
        return trace

    def _lines(self) -> dict[str, list[list[int]]]:
        """Return the processes of each node: those of which one starts after the other has ended are a line."""
        found: dict[str, list[list[int]]] = {}
        for node, started in self._started.items():
            lines = found.setdefault(node, [])
            for pid, start in started.items():
                before = next((line for line in lines if self._last[line[-1]] < start), None)
                if before is None:
                    lines.append([pid])
                else:
                    before.append(pid)
        return found

    def _keys(self) -> Iterator[tuple[Handle, Key]]:
        """Yield the callbacks; those of a node that started again are the ones of before."""
        line_of = {
            (pid, node): n for node, lines in self._lines().items() for n, line in enumerate(lines) for pid in line
        }
        count: Counter[tuple[int, str, str, str]] = Counter()
        known: dict[tuple[int, str, str, str], list[int]] = {}
        order: Counter[tuple[str, str, str]] = Counter()
        for callback in self._created:
            kind, handle = self._known["trigger"][callback]
            if kind == TIMER:
                node = self._known["node"].get(self._known["timer_node"].get(handle, (0, 0)), "")
                subject = str(self._known["period"].get(handle, 0))
            else:
                node, subject = self._known[kind].get(handle, ("", ""))
            if node:
                orders = known.setdefault((line_of[callback[0], node], node, kind, subject), [])
                place = count[callback[0], node, kind, subject]
                if place == len(orders):
                    orders.append(order[node, kind, subject])
                    order[node, kind, subject] += 1
                count[callback[0], node, kind, subject] += 1
                yield callback, Key(node, kind, subject, orders[place])

    def _groups(self, trace: RosTrace, keys: dict[Handle, Key]) -> None:
        members: dict[Handle, list[Key]] = {}
        last = {key: callback for callback, key in keys.items()}  # of a node that started again
        for key, callback in last.items():
            kind, handle = self._known["trigger"][callback]
            group = self._known[kind + "_group"].get(handle)
            if group is not None:
                members.setdefault(group, []).append(key)
        names: dict[Handle, str] = {}
        count: Counter[str] = Counter()
        for group, found in members.items():
            node = found[0].node
            names[group] = f"{node}/callback_group_{count[node]}"
            count[node] += 1
            trace.groups[names[group]] = self._known["group_type"].get(group, ""), found
        for number, (executor, kind) in enumerate(self._known["executor_type"].items()):
            held = [names[group] for group in names if self._known["group_executor"].get(group) == executor]
            trace.executors[f"executor_{number}"] = kind, held
