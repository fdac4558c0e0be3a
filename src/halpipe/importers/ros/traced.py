"""Trace as a source: the graph that was seen to run, measured durations, and what it says of a stated graph.

Names are CARET's: ``<node>/callback_<i>``, the timers of a node before its subscriptions, in order of construction.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, Location, named
from halpipe.core.durations import Duration
from halpipe.core.suggest import counted, few
from halpipe.importers.common.base import Coverage
from halpipe.importers.common.names import Names
from halpipe.importers.ros import codes
from halpipe.importers.ros.caret import read_caret
from halpipe.importers.ros.coverage import is_plumbing
from halpipe.importers.ros.graph import (
    STATED,
    Callback,
    Certainty,
    Group,
    Kind,
    Node,
    Publication,
    Rate,
    RosGraph,
    Subscription,
    printable,
    snap,
    snapped,
    task_names,
)
from halpipe.importers.ros.sniff import FileKind, find
from halpipe.importers.traces.ros2 import SERVICE, SUBSCRIPTION, TIMER, Key, RosTrace, read_ros_trace
from halpipe.models.trace import BoundCallback

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from halpipe.importers.ros.calibrate import Measurements


TRACE = "trace"
"""Where the rate of a topic comes from that nothing in the trace publishes."""

_KINDS = {TIMER: Kind.TIMER, SUBSCRIPTION: Kind.SUBSCRIPTION, SERVICE: Kind.SERVICE}
_FEWEST = 3
"""Jobs from which a rate is taken."""


def graph_of(trace: RosTrace, findings: Findings, coverage: Coverage) -> RosGraph:
    """Return the graph of a trace; publishers are those that were seen, so nothing about them is guessed."""
    at = Location(trace.file)
    names = names_of(trace)
    last = max((job.start for jobs in trace.jobs.values() for job in jobs), default=0)
    callbacks = []
    for key in trace.callbacks:
        if key in names:
            callbacks.append(_callback(key, names[key], at, findings, _runs_once(key, trace, last)))
        else:
            what = (
                "a service is called on demand" if key.kind == SERVICE else "is plumbing of ROS, not application data"
            )
            coverage.ignored(_KINDS[key.kind].value, f"{key.node} {printable(key.subject)}", what, at)
    callbacks.sort(key=lambda callback: (callback.node, callback.name))
    return RosGraph(
        file=trace.file,
        nodes=tuple(Node(name=printable(node), at=at) for node in trace.nodes),
        callbacks=tuple(callbacks),
        publications=tuple(_publications(trace, names, coverage)),
        subscriptions=tuple(
            Subscription(node=c.node, topic=c.inputs[0], callback=c.name, at=at) for c in callbacks if c.inputs
        ),
        groups=tuple(_groups(trace, names)),
        rates=tuple(_rates(trace)),
    )


def names_of(trace: RosTrace) -> dict[Key, str]:
    """Return the names of the callbacks that are no services and no plumbing."""
    names = {}
    count: Counter[str] = Counter()
    for kind in (TIMER, SUBSCRIPTION):
        for key in trace.callbacks:
            if key.kind == kind and not (kind == SUBSCRIPTION and is_plumbing(key.subject)):
                names[key] = f"{printable(key.node)}/callback_{count[key.node]}"
                count[key.node] += 1
    return names


def short_names_of(trace: RosTrace) -> dict[Key, str]:
    """Return the names of tasks that an import gives to callbacks: that of the node where it has only one."""
    names = names_of(trace)
    count = Counter(key.node for key in names)
    return {key: key.node if count[key.node] == 1 else name for key, name in names.items()}


def _runs_once(key: Key, trace: RosTrace, last: int) -> bool:
    """Return whether a timer ran a single time, though the trace has room for two more."""
    jobs = trace.jobs.get(key, ())
    return key.kind == TIMER and len(jobs) == 1 and jobs[0].start + _FEWEST * int(key.subject) <= last


def _callback(key: Key, name: str, at: Location, findings: Findings, is_one_shot: bool) -> Callback:
    node = printable(key.node)
    if key.kind == SUBSCRIPTION:
        return Callback(name=name, node=node, kind=Kind.SUBSCRIPTION, inputs=(printable(key.subject),), at=at)
    measured = Duration(int(key.subject))
    if is_one_shot:
        help = "state its period in the overlay if it is a periodic one"
        text = f"its timer of {measured} ran once and never again, so it is no periodic task"
        findings.add(codes.ONE_SHOT(text, at=at, path=named("callback", name), help=help))
        return Callback(name=name, node=node, kind=Kind.TIMER, period=None, at=at)
    period = snapped(measured, STATED, at, named("callback", name), findings) if measured else None
    if period is None:
        help = "trace from before the nodes start"
        findings.add(codes.BAD_PERIOD("its timer has no period", at=at, path=named("callback", name), help=help))
    return Callback(name=name, node=node, kind=Kind.TIMER, period=period, at=at)


def _publications(trace: RosTrace, names: Mapping[Key, str], coverage: Coverage) -> list[Publication]:
    at, found = Location(trace.file), []
    for (node, topic), counts in trace.publishers.items():
        shown = f"{printable(node)} {printable(topic)}"
        callbacks = tuple(names[key] for key in counts if key is not None and key in names)
        if counts:
            found.append(Publication(node=printable(node), topic=printable(topic), callbacks=callbacks, at=at))
        else:
            coverage.ignored("publisher", shown, "published nothing while it was traced", at)
    return found


def _groups(trace: RosTrace, names: Mapping[Key, str]) -> list[Group]:
    at = Location(trace.file)
    members = {name: tuple(names[k] for k in keys if k in names) for name, (_, keys) in trace.groups.items()}
    found = [
        Group(
            kind="executor",
            name=name,
            exclusive="single" in kind,
            callbacks=tuple(c for group in groups for c in members[group]),
            at=at,
        )
        for name, (kind, groups) in trace.executors.items()
    ]
    found += [
        Group(kind="callback_group", name=name, exclusive=kind != "reentrant", callbacks=members[name], at=at)
        for name, (kind, _) in trace.groups.items()
    ]
    return found


def _rates(trace: RosTrace) -> list[Rate]:
    """Return the rates at which messages came that nothing in the trace publishes."""
    published = {topic for (_, topic), counts in trace.publishers.items() if counts}
    found = []
    for key, jobs in trace.jobs.items():
        if key.kind != SUBSCRIPTION or key.subject in published or is_plumbing(key.subject) or len(jobs) < _FEWEST:
            continue
        starts = sorted(job.start for job in jobs)
        period = Duration(starts[-1] - starts[0]) / (len(starts) - 1)
        found.append(Rate(topic=printable(key.subject), period=period, source=TRACE, at=Location(trace.file)))
    return found


# ------------------------------------------------------------------------------------------ measurements


def measure(trace: RosTrace, callbacks: Sequence[Callback], into: Measurements, findings: Findings) -> None:
    """Add the times of all jobs, by the names of `callbacks` where they are the same, else by those of the trace."""
    at = Location(trace.file)
    names = {**short_names_of(trace), **matched(trace, callbacks)}
    for key, jobs in trace.jobs.items():
        if key in names:
            for job in jobs:
                into.add(names[key], job.busy, at)
    _report_missed(trace, names, findings)
    if not trace.has_switches or trace.unswitched:
        which = f" of {trace.unswitched} jobs whose threads no switch names" if trace.has_switches else ""
        text = f"durations{which} are from start to end, with whatever preempted the callbacks in between"
        help = "trace sched_switch of the kernel, too, and outside of containers, which number threads anew"
        findings.add(codes.WALL_TIME(text, at=at, help=help))


def _report_missed(trace: RosTrace, names: Mapping[Key, str], findings: Findings) -> None:
    """Report the timers that fired in fewer periods than the trace has between their first job and their node's end."""
    for key, jobs in trace.jobs.items():
        period = int(key.subject) if key.kind == TIMER else 0
        if key not in names or not period or len(jobs) < 2:
            continue
        starts = sorted(job.start for job in jobs)
        again = trace.restarts.get(key.node, [])
        gaps = [(b - a) for a, b in pairwise(starts) if not any(a < end < b for end in again)]
        # A late start makes a long gap and a short one, so only the sum of both is counted.
        missed = sum((2 * gap + period) // (2 * period) - 1 for gap in gaps)
        idle = (trace.ends.get(key.node, 0) - starts[-1]) // period - 1
        if missed > 0 or idle >= _FEWEST:
            stop = f", and its node lives on for {idle} periods after the last" if idle >= _FEWEST else ""
            lack = counted(max(0, missed), "period")
            text = f"its timer of {Duration(period)} fired {counted(len(jobs), 'time')} and missed {lack}{stop}"
            help = "correct the period in the overlay, or see what delays the timer"
            findings.add(
                codes.MISSED_PERIODS(text, at=Location(trace.file), path=named("callback", names[key]), help=help)
            )


def matched(trace: RosTrace, callbacks: Sequence[Callback]) -> dict[Key, str]:
    """Return the callbacks of a graph by those of a trace: same node, kind and topic or period, in their order."""
    waiting: dict[tuple[str, str, str], list[str]] = defaultdict(list)
    for callback in callbacks:
        if callback.kind is Kind.TIMER and callback.period is not None:
            waiting[callback.node, TIMER, str(callback.period)].append(callback.name)
        elif callback.kind is Kind.SUBSCRIPTION:
            for topic in callback.inputs:
                waiting[callback.node, SUBSCRIPTION, topic].append(callback.name)
    found = {}
    for key in names_of(trace):
        subject = str(snap(Duration(int(key.subject)), STATED)) if key.kind == TIMER else printable(key.subject)
        names = waiting[printable(key.node), key.kind, subject]
        if key.order < len(names):
            found[key] = names[key.order]
    return found


# ------------------------------------------------------------------------------------------ confrontation


def confront(graph: RosGraph, trace: RosTrace, findings: Findings) -> RosGraph:
    """Return a stated graph with the publishers that were seen; say what the trace confirms and contradicts.

    Raise `HalpipeError` if not one callback of the graph is in the trace.
    """
    at = Location(trace.file)
    names = matched(trace, graph.callbacks)
    if not names:
        help = "name the trace and the graph of one system"
        text = f"none of its {len(names_of(trace))} callbacks is one of {graph.file}"
        raise HalpipeError(*findings.items, codes.OTHER_GRAPH(text, at=at, help=help))
    _report_differences(graph, trace, names, findings)
    confirmed, publications = 0, []
    for publication in graph.publications:
        counts = trace.publishers.get((publication.node, publication.topic), Counter())
        seen = tuple(names[key] for key in counts if key is not None and key in names)
        agrees = set(seen) == set(publication.callbacks)
        confirmed += bool(seen) and agrees
        if seen and not agrees and publication.certainty is Certainty.STATED:
            text = f"the trace shows {few(seen)} publish, the file states {few(publication.callbacks)}"
            path = f'node "{publication.node}" publishing "{publication.topic}"'
            help = "export the graph again; the publishers that were seen are taken"
            findings.add(codes.CONTRADICTED(text, at=publication.at, path=path, help=help))
        publications.append(replace(publication, callbacks=seen, certainty=Certainty.STATED) if seen else publication)
    text = f"{len(names)} of {len(graph.callbacks)} callbacks and {confirmed} publishers are as {graph.file} says"
    findings.add(codes.CONFIRMED(text, at=at))
    return replace(graph, publications=tuple(publications))


def _report_differences(graph: RosGraph, trace: RosTrace, names: Mapping[Key, str], findings: Findings) -> None:
    known = set(names.values())
    lacking = [c.name for c in graph.callbacks if c.name not in known and c.kind is not Kind.SERVICE]
    own = names_of(trace)
    subjects = {key: Duration(int(key.subject)) if key.kind == TIMER else printable(key.subject) for key in own}
    new = [f"{own[key]} ({key.kind} of {subjects[key]})" for key in own if key not in names]
    if lacking:
        text = f"not in the trace, {counted(len(lacking), 'callback')} of the file: {few(lacking)}"
        help = "trace from before all nodes start, or export the graph again"
        findings.add(codes.CONTRADICTED(text, at=Location(trace.file), help=help))
    if new:
        text = f"not in the file, {counted(len(new), 'callback')} of the trace: {few(new)}"
        help = "export the graph again, or import the trace alone"
        findings.add(codes.CONTRADICTED(text, at=Location(trace.file), help=help))


def callbacks_of(paths: Sequence[str]) -> dict[str, BoundCallback]:
    """Return the callbacks of an architecture.yaml or a trace, by the names of their tasks."""
    inputs, findings = find(paths), Findings()
    trace = read_ros_trace(inputs.traces[0], findings) if inputs.traces else None
    longest: dict[str, int] = {}
    if inputs.graphs and inputs.graphs[0].kind is FileKind.CARET:
        graph = read_caret(inputs.graphs[0].content, inputs.graphs[0].name, findings, Coverage())
        measured = matched(trace, graph.callbacks) if trace else {}
    elif trace:
        graph = graph_of(trace, findings, Coverage())
        measured = names_of(trace)
    else:
        return {}
    findings.stop_on_errors()
    if trace:
        longest = {
            name: max((job.busy for job in trace.jobs.get(key, ())), default=0) for key, name in measured.items()
        }
    names = task_names(graph, Names(Findings(), codes.RENAMED, mark="_"))
    count: Counter[tuple[str, str, str, int]] = Counter()
    found = {}
    groups = {name: group.name for group in graph.groups if group.kind == "callback_group" for name in group.callbacks}
    for callback in graph.callbacks:
        if callback.kind is Kind.TIMER and callback.period is not None:
            key = (callback.node, "timer", "", round(callback.period.fraction))
        elif callback.kind is Kind.SUBSCRIPTION and callback.inputs:
            key = (callback.node, "subscription", callback.inputs[0], 0)
        else:
            continue
        found[names[callback.name]] = BoundCallback(
            *key, count[key], groups.get(callback.name, ""), longest.get(callback.name, 0)
        )
        count[key] += 1
    return found
