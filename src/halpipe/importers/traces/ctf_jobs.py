"""Jobs of a directory of CTF: the callbacks of ROS nodes, by the names of an import of the trace, or threads."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.importers.ros.traced import short_names_of
from halpipe.importers.traces import codes
from halpipe.importers.traces.ftrace import Switches, is_runnable
from halpipe.importers.traces.ros2 import read_ros_trace
from halpipe.models.trace import Executions, Trace

if TYPE_CHECKING:
    from halpipe.importers.traces.ctf import Event

_LOSSES = (codes.CUT_OFF.id, codes.LOST_EVENTS.id)


def read_folder(root: str, findings: Findings) -> Trace:
    """Return the jobs of all callbacks but services and plumbing, or of all threads where no node is traced.

    Raise `HalpipeError` if it is no trace of either.
    """
    of_nodes, threads = Findings(), _Threads(root, findings)
    try:
        trace = read_ros_trace(root, of_nodes, threads.take)
    except HalpipeError as refused:
        *others, last = refused.diagnostics
        if last.code != codes.NO_EXECUTIONS.id:
            raise
        if not (threads.running or threads.executions.task):
            help = "trace the events ros2:* from before the nodes start, or sched_switch of the kernel"
            text = "it has neither callbacks of nodes nor switches of threads"
            raise HalpipeError(*others, codes.NO_EXECUTIONS(text, at=last.at, help=help)) from None
        findings.extend(found for found in of_nodes.items if found.code in _LOSSES)
        return threads.trace()
    findings.extend(of_nodes.items)
    names, found = short_names_of(trace), Executions(root)
    for key, jobs in trace.jobs.items():
        for job in jobs if key in names else ():
            found.add(names[key], (), job.start, job.end, job.busy if trace.has_switches else None)
    found.sort()
    return Trace(name="", executions=found)


class _Threads(Switches):
    def take(self, event: Event) -> None:
        """Take an event, if it is a switch, as LTTng or perf names it."""
        at, name, cpu, _, fields = event
        if name not in ("sched_switch", "sched:sched_switch"):
            return
        key = "pid" if name.startswith("sched:") else "tid"
        try:
            left, entered, goes_on = fields[f"prev_{key}"], fields[f"next_{key}"], is_runnable(fields["prev_state"])
            self.switch(fields.get("perf_cpu", cpu), at, left, goes_on, entered, str(fields["next_comm"]))
        except (KeyError, TypeError):  # an event of the name, but not of the form
            return
