"""Callback of each imported task, as an executor finds it in a running system."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings
from halpipe.importers.common.base import Coverage
from halpipe.importers.ros.names import Names, task_names
from halpipe.importers.ros.sources.caret import read_caret
from halpipe.importers.ros.sources.graph import Kind
from halpipe.importers.ros.sources.sniff import FileKind, find
from halpipe.importers.ros.traced import graph_of
from halpipe.importers.traces.ros2 import read_ros_trace

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True)
class Bound:
    """A callback by node, kind (timer or subscription), topic or period in ns, and order among equal ones.

    `group` is its callback group, empty where the graph does not tell.
    """

    node: str
    kind: str
    topic: str
    period: int
    order: int
    group: str = ""


def callbacks_of(paths: Sequence[str]) -> dict[str, Bound]:
    """Return the callbacks of an architecture.yaml or a trace, by the names of their tasks."""
    inputs, findings = find(paths), Findings()
    if inputs.graphs and inputs.graphs[0].kind is FileKind.CARET:
        graph = read_caret(inputs.graphs[0].content, inputs.graphs[0].name, findings, Coverage())
    elif inputs.traces:
        graph = graph_of(read_ros_trace(inputs.traces[0], findings), findings, Coverage())
    else:
        return {}
    findings.stop_on_errors()
    names = task_names(graph, Names(Findings()))
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
        found[names[callback.name]] = Bound(*key, count[key], groups.get(callback.name, ""))
        count[key] += 1
    return found
