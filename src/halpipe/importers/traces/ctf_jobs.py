"""Jobs of a directory of CTF: the callbacks of ROS nodes, by the names of an import of the trace, or threads."""

from __future__ import annotations

from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.importers.ros.traced import short_names_of
from halpipe.importers.traces.ctf import CtfError, Damage, events, folders
from halpipe.importers.traces.ftrace import Switches, is_runnable
from halpipe.importers.traces.ros2 import read_ros_trace, report_damage
from halpipe.models.trace import Executions, Trace


def read_folder(root: str, findings: Findings) -> Trace:
    """Return the jobs of all callbacks but services and plumbing, or of all threads where no node is traced.

    Raise `HalpipeError` if it is no trace of either.
    """
    of_nodes = Findings()
    try:
        trace = read_ros_trace(root, of_nodes)
    except HalpipeError:
        threads = _threads(root, findings)
        if threads is None:
            raise
        return threads
    findings.extend(of_nodes.items)
    names, found = short_names_of(trace), Executions(root)
    for key, jobs in trace.jobs.items():
        for job in jobs if key in names else ():
            found.add(names[key], (), job.start, job.end, job.busy if trace.has_switches else None)
    found.sort()
    return Trace(name="", executions=found)


def _threads(root: str, findings: Findings) -> Trace | None:
    """Return the jobs of threads by the switches of the kernel; None where there are none."""
    switches, damage = Switches(root, findings), Damage()
    try:
        for event in events(folders(root), damage):
            fields = event.fields
            if event.name == "sched_switch" and {"prev_tid", "prev_state", "next_tid", "next_comm"} <= fields.keys():
                name = str(fields["next_comm"])
                goes_on = is_runnable(int(fields["prev_state"]))
                switches.switch(event.cpu, event.time, fields["prev_tid"], goes_on, fields["next_tid"], name, 0)
    except (CtfError, OSError, TypeError, ValueError):
        return None
    report_damage(damage, root, findings)
    found = switches.trace()
    return found if len(found.executions) else None
