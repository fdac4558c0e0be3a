"""The document: what the model says, then for each mode the executors with their callback groups and timers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from halpipe.exporters.common.cpus import placed
from halpipe.exporters.ros.timers import Timer, cycle_of, timers_of
from halpipe.exporters.ros.unrealised import unrealised
from halpipe.models.attributes import texts

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.exporters.ros import RosOptions
    from halpipe.models import Chain, Mode, ModeSchedule, Schedule, Task, TaskModel, Version

_HEADER = """\
# Executors, callback groups and timers that realise a schedule with ROS 2 on Linux, written by halpipe.
# A timer first expires at the common start of all executors plus offset-ns, and then every period-ns.
"""
_WIDTH = 120


def format_executors(model: TaskModel, schedule: Schedule, options: RosOptions) -> bytes:
    """Return the document; raise `HalpipeError` for wrong CPUs and for a cycle that timers cannot have."""
    import yaml

    cpus = placed(model, options.cpus)
    scheduled = {table.name: table for table in schedule.modes}
    document = {
        "halpipe-executors": 1,
        "model": model.name,
        "model-sha256": schedule.model_sha256,
        "scheduling": {"policy": "SCHED_FIFO", "priority": options.priority},
        "units": [_stated(name=unit.name, type=unit.type or None, cpu=cpus.get(unit.name)) for unit in model.units],
        "tasks": [_task(task) for task in model.tasks],
        "chains": [_chain(chain) for chain in model.chains],
        "transitions": [texts(t) for t in model.transitions if {t.source, t.target} <= set(scheduled)],
        **_health(model, scheduled),
        "modes": [_mode(model, mode, scheduled[mode.name], cpus) for mode in model.modes if mode.name in scheduled],
        "not-realised": [finding.message for finding in unrealised(model, schedule, options)],
    }
    dumper: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    text = yaml.dump(document, Dumper=dumper, sort_keys=False, default_flow_style=None, width=_WIDTH)
    return (_HEADER + text).encode()


def _health(model: TaskModel, scheduled: Mapping[str, ModeSchedule]) -> dict[str, list[dict[str, Any]]]:
    """Return the health rules, if there are any, that lead to no other modes than those of the schedule."""
    rules = [
        _stated(task=r.task, on=str(r.event), count=r.count, cycles=r.cycles, action=str(r.action), mode=r.mode or None)
        for r in model.health
        if not r.mode or r.mode in scheduled
    ]
    return {"health": rules} if rules else {}


def _stated(**values: Any) -> dict[str, Any]:
    """Return the mapping of what has a value; names with - for _."""
    return {key.replace("_", "-"): value for key, value in values.items() if value is not None}


def _task(task: Task) -> dict[str, Any]:
    return {**texts(task, "distance", "binding"), "versions": [_version(version) for version in task.versions]}


def _version(version: Version) -> dict[str, Any]:
    more = {
        "units": list(version.units),
        "gang": version.gang if version.gang != 1 else None,
        "after": [texts(precedence) for precedence in version.precedences],
    }
    return {**texts(version), **{key: value for key, value in more.items() if value}}


def _chain(chain: Chain) -> dict[str, Any]:
    return {**texts(chain), "tasks": list(chain.tasks)}


def _mode(model: TaskModel, mode: Mode, table: ModeSchedule, cpus: dict[str, int]) -> dict[str, Any]:
    return {
        "name": mode.name,
        "runs": [{"task": run.task, "versions": list(run.versions)} for run in mode.runs],
        "cycle-ns": int(cycle_of(table).fraction),
        "executors": _executors(model, table, cpus),
    }


def _executors(model: TaskModel, table: ModeSchedule, cpus: dict[str, int]) -> list[dict[str, Any]]:
    """Return an executor for each unit on which jobs start, with a callback group for each task that does so there.

    A group of its own for each pair of task and executor, since ROS assigns a group to one executor as a whole.
    """
    groups: dict[str, dict[str, list[Timer]]] = {}
    for timer in timers_of(model, table):
        groups.setdefault(timer.units[0], {}).setdefault(timer.task, []).append(timer)
    return [
        _stated(
            name=unit.name,
            type="single_threaded_executor",
            cpu=cpus.get(unit.name),
            callback_groups=[
                {
                    "name": f"{task}@{unit.name}",
                    "type": "mutually_exclusive",
                    "task": task,
                    "timers": [_timer(timer) for timer in timers],
                }
                for task, timers in groups[unit.name].items()
            ],
        )
        for unit in model.units
        if unit.name in groups
    ]


def _timer(timer: Timer) -> dict[str, Any]:
    return _stated(
        version=timer.version,
        job=timer.job,
        period_ns=timer.period,
        offset_ns=timer.offset,
        budget_ns=timer.budget,
        keeps_free=list(timer.units[1:]) or None,
    )
