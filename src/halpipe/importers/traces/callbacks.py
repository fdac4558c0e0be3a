"""The callbacks of a ROS trace as executions, by the names that an import of the same trace gives to their tasks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Location
from halpipe.core.durations import Duration
from halpipe.importers.ros.traced import short_names_of
from halpipe.importers.traces.ros2 import read_ros_trace
from halpipe.models.trace import Execution, Trace

if TYPE_CHECKING:
    from halpipe.core.diagnostics import Findings


def executions_of(root: str, findings: Findings) -> Trace:
    """Return the jobs of all callbacks but services and plumbing; raise `HalpipeError` if it is no such trace."""
    trace = read_ros_trace(root, findings)
    names, at = short_names_of(trace), Location(root)
    found = [
        Execution(
            task=names[key],
            start=Duration(job.start),
            end=Duration(job.end),
            busy=Duration(job.busy) if trace.has_switches else None,
            at=at,
        )
        for key, jobs in trace.jobs.items()
        if key in names
        for job in jobs
    ]
    return Trace(name="", executions=tuple(sorted(found, key=lambda execution: execution.start.ns)))
