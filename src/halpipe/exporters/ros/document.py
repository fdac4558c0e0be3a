"""Document of the ROS export: executors of each mode with callback groups and timers, and the native model.

A ROS timer has a period in whole nanoseconds. Where the hyperperiod is none, as 100/3 ms, the timers repeat with the
smallest multiple of it that is, so that nothing drifts however long the system runs.
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError, about
from halpipe.core.embedding import pieces
from halpipe.core.suggest import few
from halpipe.exporters.common.cpus import placed
from halpipe.exporters.native import format_model
from halpipe.exporters.ros.codes import TOO_FINE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.core.durations import Duration
    from halpipe.exporters.ros import RosOptions
    from halpipe.models import Job, ModeSchedule, Schedule, Task, TaskModel


_HEADER = """\
# Executors, callback groups and timers that realise a schedule with ROS 2 on Linux, written by halpipe.
# A timer first expires at the common start of all executors plus offset-ns, and then every period-ns.
"""
_WIDTH = 120
Row = dict[str, Any]


def format_executors(model: TaskModel, schedule: Schedule, options: RosOptions) -> bytes:
    """Return the document; raise `HalpipeError` for wrong CPUs and for a cycle that timers cannot have."""
    import yaml

    cpus = placed(model, options.cpus)
    document = {
        "halpipe-executors": 2,
        "model": model.name,
        "model-sha256": schedule.model_sha256,
        "scheduling": {"policy": "SCHED_FIFO", "priority": options.priority},
        "modes": [
            {
                "name": table.name,
                "cycle-ns": int(cycle_of(table).fraction),
                "executors": _executors(model, table, cpus),
            }
            for table in schedule.modes
        ],
        "not-realised": [text for text, _ in sentences(model, schedule, options)],
        "model-xml": _Block("".join(pieces(format_model(model)))),
    }
    text = yaml.dump(document, Dumper=_dumper(), sort_keys=False, default_flow_style=None, width=_WIDTH)
    return (_HEADER + text).encode()


class _Block(str):
    """A text that YAML shows line by line."""

    __slots__ = ()


@cache
def _dumper() -> Any:
    import yaml

    class Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
        pass

    Dumper.add_representer(_Block, lambda own, text: own.represent_scalar("tag:yaml.org,2002:str", str(text), "|"))
    return Dumper


def _stated(**values: Any) -> Row:
    """Return the mapping of what has a value; names with - for _."""
    return {key.replace("_", "-"): value for key, value in values.items() if value is not None}


def _executors(model: TaskModel, table: ModeSchedule, cpus: dict[str, int]) -> list[Row]:
    """Return an executor for each unit on which jobs start, with a callback group for each task that does so there.

    A group of its own for each pair of task and executor, since ROS assigns a group to one executor as a whole.
    """
    jobs = table.by_task()
    groups: dict[str, dict[str, list[Row]]] = {}
    for task in model.tasks:
        for unit, timer in _timers(task, jobs[task.name], table) if task.name in jobs else ():
            groups.setdefault(unit, {}).setdefault(task.name, []).append(timer)
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
                    "timers": timers,
                }
                for task, timers in groups[unit.name].items()
            ],
        )
        for unit in model.units
        if unit.name in groups
    ]


MOST_TIMERS = 100_000


def cycle_of(table: ModeSchedule) -> Duration:
    """Return the smallest multiple of the hyperperiod that is a whole number of nanoseconds.

    Raise `HalpipeError` if too many jobs would have to be written for it.
    """
    repeats = table.hyperperiod.fraction.denominator
    if repeats * len(table.jobs) > MOST_TIMERS:
        raise HalpipeError(
            TOO_FINE(
                f"hyperperiod {table.hyperperiod} repeats within whole nanoseconds only after {repeats} times, with "
                f"{repeats * len(table.jobs)} jobs",
                at=table.at,
                path=about(mode=table.name),
                help=f"choose periods for which at most {MOST_TIMERS} jobs come of it",
            )
        )
    return table.hyperperiod * repeats


def is_exact(table: ModeSchedule) -> bool:
    """Return whether every job starts at a whole nanosecond."""
    return all(job.start.fraction.denominator == 1 for job in table.jobs)


def _timers(task: Task, jobs: Sequence[Job], table: ModeSchedule) -> list[tuple[str, Row]]:
    """Return the timers of a task by offset, each with the unit on which it starts jobs."""
    cycle = cycle_of(table)
    if task.period is not None and _is_even(task.period, jobs, table.hyperperiod):
        return [_timer(jobs[0], None, task.period, jobs[0].start % task.period)]
    starts = [(job, table.hyperperiod * n) for n in range(cycle // table.hyperperiod) for job in jobs]
    found = [_timer(job, job.index, cycle, job.start + by) for job, by in starts]
    return sorted(found, key=lambda timer: (timer[1]["offset-ns"], timer[1]["job"]))


def _is_even(period: Duration, jobs: Sequence[Job], hyperperiod: Duration) -> bool:
    """Return whether one timer can start all jobs: same version and units, exactly one period apart."""
    phases = {job.start % period for job in jobs}
    ways = {(job.version, job.units) for job in jobs}
    whole = period.fraction.denominator == 1
    return whole and len(phases) == len(ways) == 1 and period * len(jobs) == hyperperiod


def _timer(job: Job, index: int | None, period: Duration, offset: Duration) -> tuple[str, Row]:
    """Return a timer that starts one job, or all of a task; times are in nanoseconds.

    What is no whole nanosecond starts up to one early and has a budget up to one longer.
    """
    return job.units[0], _stated(
        version=job.version,
        job=index,
        period_ns=int(period.fraction),
        offset_ns=math.floor(offset.fraction),
        budget_ns=math.ceil((job.end - job.start).fraction),
        keeps_free=list(job.units[1:]) or None,
    )


def sentences(model: TaskModel, schedule: Schedule, options: RosOptions) -> Iterator[tuple[str, str]]:
    """Yield what executors and timers cannot make happen, and what to do about it."""
    used = {job.task for table in schedule.modes for job in table.jobs}
    units = {unit for table in schedule.modes for job in table.jobs for unit in job.units}
    if len(schedule.modes) > 1:
        yield (
            f"{len(schedule.modes)} modes, each with executors of its own: executors do not switch between modes",
            "start the executors of one mode; switching needs a launcher that plays the transition tables",
        )
    if ruled := dict.fromkeys(rule.task for rule in model.health):
        yield (
            f"executors do not follow health rules: {few(list(ruled))}",
            "let a supervisor watch the callbacks, and start the executors of the mode that is meant",
        )
    if on_demand := [task.name for task in model.tasks if task.period is None and task.name in used]:
        yield (
            f"started by timers, not by their messages: {few(on_demand)}",
            "start them by time only; in a subscription, store the message for the timer's callback",
        )
    gangs = dict.fromkeys(job.task for table in schedule.modes for job in table.jobs if len(job.units) > 1)
    if gangs:
        yield (
            f"run on one CPU, though they occupy several units: {few(list(gangs))}",
            "let the callback start helping threads on the CPUs of the units that are kept free for it",
        )
    if apart := _apart_by_time(model, schedule):
        yield (
            f"kept apart by their instants only, since their executors differ: callbacks that share {few(apart)}",
            "let no callback run longer than its WCET, or give the tasks of a group one and the same unit",
        )
    if any(version.accesses for task in model.tasks if task.name in used for version in task.versions):
        yield (
            "bounds of access phases are not enforced",
            "export the regulator format (memguard or resctrl) to enforce them",
        )
    if rounded := [table.name for table in schedule.modes if not is_exact(table)]:
        yield (
            f"jobs start up to 1ns early, since timers count whole nanoseconds: mode {few(rounded)}",
            "nothing to do: the rounding does not add up",
        )
    if options.cpus is None:
        yield "CPUs are numbered in the order of the units of the model", "state them with --cpus unit=number,..."
    elif loose := [unit.name for unit in model.units if unit.name in units and unit.name not in options.cpus]:
        yield f"executors without affinity: {few(loose)}", "state their CPUs with --cpus unit=number,..."


def _apart_by_time(model: TaskModel, schedule: Schedule) -> list[str]:
    """Return the resources that tasks need wholly on more than one executor."""
    on: dict[str, set[str]] = {}
    for table in schedule.modes:
        for job in table.jobs:
            version = model.task(job.task).version(job.version)
            for access in version.accesses:
                if access.bound == 1 and not access.start and access.end == version.wcet:
                    on.setdefault(access.resource, set()).add(job.units[0])
    return [resource.name for resource in model.resources if len(on.get(resource.name, ())) > 1]
