"""Ament package for unmodified nodes: the Linux dispatcher with a component container."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe import __version__
from halpipe.core.bundles import seal
from halpipe.core.diagnostics import Findings, about, version_of
from halpipe.core.durations import Duration
from halpipe.core.records import record
from halpipe.exporters.linux.bundle import (
    RUNTIME,
    Program,
    check_texts,
    cpus_for,
    filled,
    rendered_tables,
    versions_used,
)
from halpipe.exporters.linux.codes import BAD_TEXT
from halpipe.exporters.linux.tables import is_followed, tables_of, thread_levels
from halpipe.exporters.native import paired
from halpipe.exporters.ros.codes import EQUAL_CALLBACKS, OLD_MESSAGES, SPLIT_CALLBACK, UNBOUND
from halpipe.exporters.ros.waits import refuse_waits

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from halpipe.exporters.ros import RosOptions
    from halpipe.models import Schedule, TaskModel

FOLDER = Path(__file__).parent / "package"
_RUNTIME = Path(__file__).parents[1] / "linux" / "runtime"
_PLACES = {
    "bindings.hpp": "src/bindings.hpp",
    "CMakeLists.txt": "CMakeLists.txt",
    "package.xml": "package.xml",
    "tables.launch.py.in": "launch/tables.launch.py",
    "components.yaml": "config/components.yaml",
    "README.md": "README.md",
}
_SHIM = ("table_executor.hpp", "threads.hpp", "container.cpp")
_ROS_NAME = re.compile(r"(?=.{2,250}$)(/[A-Za-z_][A-Za-z0-9_]*)+")


@record
class Row:
    """A program of the tables as the executor knows it; `wait` in ns, `missing` the number of a mode or -1."""

    task: str
    node: str
    kind: str
    subject: str
    period: int
    order: int
    wait: int
    missing: int


def build(model: TaskModel, schedule: Schedule, options: RosOptions) -> dict[str, bytes]:
    """Return the files of the package, sealed; raise `HalpipeError` with everything that prevents it."""
    findings = Findings()
    cpus = cpus_for(model, schedule, options.cpus, findings)
    keys = [(task.name, version.name) for task, version in versions_used(model, schedule)]
    modes = [mode.name for mode in schedule.modes]
    rows = [row for task, _ in keys if (row := _row(task, model, modes, options, findings)) is not None]
    refuse_waits(model, dict(keys), modes, options, findings)
    check_texts(model, schedule, (), findings)
    _refuse_equal(model, dict.fromkeys(task for task, _ in keys), options, findings)
    _refuse_old_messages(model, options, findings)
    services = _services(schedule, findings)
    gapped = {(job.task, job.version) for job in schedule.all_jobs() if job.parts}
    for task, version in keys:
        if (task, version) in gapped and model.task(task).version(version).split.points:
            help = "let the job be interrupted anywhere, or schedule it without gaps: a callback is one function"
            path = version_of(task, version)
            text = "jobs have gaps at split points; a callback cannot be held there until its next part begins"
            findings.add(SPLIT_CALLBACK(text, at=model.task(task).at, path=path, help=help))
    findings.stop_on_errors()
    levels = thread_levels(model, schedule, options.priority)
    programs = [Program(f"{task}/{name}", "callback", ("callback",), (), (), (), ()) for task, name in keys]
    functions = dict.fromkeys(keys, 1)
    tables = tables_of(model, schedule, cpus, levels, {key: i for i, key in enumerate(keys)}, functions, findings)
    package = re.sub(r"[^a-z0-9_]+", "_", model.name.lower()).strip("_") or "tables"
    values: dict[str, Any] = {
        "model": model.name,
        "package": package if package[0].isalpha() else f"p_{package}",
        "priority": options.priority,
        "rows": rows,
        "is_newest": options.messages == "newest",
        "mode_names": services,
        "nodes": sorted({row.node for row in rows}),
        "unrealised": [text for text, _ in sentences(model, schedule)],
    }
    files = {place: filled(name, values, FOLDER) for name, place in _PLACES.items()}
    files |= {f"src/{name}": (FOLDER / name).read_bytes() for name in _SHIM}
    files |= {f"runtime/{name}": (_RUNTIME / name).read_bytes() for name in RUNTIME}
    files["tables.c"] = rendered_tables(model, schedule, tables, programs, {}, levels)
    files |= paired(model, schedule)
    return seal("ros-package", files, {"model": model.name, "generator": f"halpipe {__version__}"})


def _row(task: str, model: TaskModel, modes: Sequence[str], options: RosOptions, findings: Findings) -> Row | None:
    """Return the callback of a task; report a task that has none, and names that are none of ROS."""
    at, path = model.task(task).at, about(task=task)
    binding = (options.bindings or {}).get(task)
    if binding is None:
        help = "name the graph or trace that the model was imported from with --graph"
        findings.add(UNBOUND("no callback of the graph is this task", at=at, path=path, help=help))
        return None
    for name in (binding.node, binding.topic):
        if name and _ROS_NAME.fullmatch(name) is None:
            help = "use the resolved names of nodes and topics"
            findings.add(BAD_TEXT(f"{name[:60]!r} is no name of ROS", at=at, path=path, help=help))
    wait = (options.wait or {}).get(task)
    mode = (options.missing or {}).get(task, "")
    missing = modes.index(mode) if mode in modes else -1
    nanoseconds = math.floor(wait.fraction) if wait else 0
    return Row(task, binding.node, binding.kind, binding.topic, binding.period, binding.order, nanoseconds, missing)


def _services(schedule: Schedule, findings: Findings) -> list[str]:
    """Return the names of the services that ask for modes; report modes of which ROS can have none, or not both."""
    first: dict[str, str] = {}
    for mode in schedule.modes:
        name = re.sub(r"\W", "_", mode.name, flags=re.ASCII)
        path = about(mode=mode.name)
        if not re.match("[A-Za-z]", name):
            text = f'"~/mode/{name}" is no name of a service: a token of ROS begins with a letter'
            findings.add(BAD_TEXT(text, at=mode.at, path=path, help=f'rename the mode, such as "mode_{name}"'))
        elif name in first:
            text = f'"~/mode/{name}" is the service of mode "{first[name]}" already'
            findings.add(BAD_TEXT(text, at=mode.at, path=path, help=f'rename the mode, such as "{mode.name}2"'))
        first.setdefault(name, mode.name)
    return list(first)


def _refuse_equal(model: TaskModel, tasks: Iterable[str], options: RosOptions, findings: Findings) -> None:
    """Report callbacks that a running node does not tell apart: equal ones in different callback groups."""
    bindings = options.bindings or {}
    known = [(task, bindings[task]) for task in tasks if task in bindings and bindings[task].group]
    for number, (task, binding) in enumerate(known):
        for other, same in known[:number]:
            # The executor takes both for the same callback: it finds the period that is nearest.
            keys = {(one.node, one.kind, one.topic, one.period) for one in (binding, same)}
            if binding.group == same.group or len(keys) > 1:
                continue
            what = f"topic {binding.topic}" if binding.topic else f"period {Duration(binding.period)}"
            text = (
                f'node {binding.node} has it and task "{other}" with {what} in groups {same.group} and {binding.group}'
            )
            help = "create both in one callback group, or give timers periods that differ by more than 0.1 %"
            findings.add(EQUAL_CALLBACKS(text, at=model.task(task).at, path=about(task=task), help=help))
    rows = {task: bindings[task] for task in tasks if task in bindings and bindings[task].kind == "timer"}
    periods = {(row.node, row.period) for row in rows.values()}
    for name, spare in bindings.items():
        if spare.kind != "timer" or name in rows or (spare.node, spare.period) in periods:
            continue
        for task, row in rows.items():
            if spare.node == row.node and abs(spare.period - row.period) <= row.period // 1000:
                text = f'node {row.node} has the timer "{name}" of {Duration(spare.period)} without a row beside it'
                help = "schedule both, or give the timers periods that differ by more than 0.1 %"
                findings.add(EQUAL_CALLBACKS(text, at=model.task(task).at, path=about(task=task), help=help))


def _refuse_old_messages(model: TaskModel, options: RosOptions, findings: Findings) -> None:
    """Report chains with limits through subscriptions whose jobs take the oldest message."""
    if options.messages == "newest":
        return
    bindings = options.bindings or {}
    for chain in model.chains:
        limited = chain.max_latency or chain.max_reaction or chain.max_age
        reading = [task for task in chain.tasks[1:] if task in bindings and bindings[task].kind == "subscription"]
        if limited and reading:
            text = f'task "{reading[0]}" takes the oldest message of its queue, so no limit of the chain holds'
            help = "export with --messages newest"
            findings.add(OLD_MESSAGES(text, at=chain.at, path=about(chain=chain.name), help=help))


def sentences(model: TaskModel, schedule: Schedule) -> Iterator[tuple[str, str]]:
    """Yield what the package leaves open of this very schedule, and what to do about it."""
    jobs = schedule.all_jobs()
    if left := dict.fromkeys(
        rule.task for rule in model.health if not is_followed(rule, schedule, catches_faults=True)
    ):
        names = ", ".join(f'"{name}"' for name in left)
        yield (
            f"health rules are not followed, but for switches after one overrun or exception: {names}",
            "let a node that reads /diagnostics ask for the mode that is meant",
        )
    if any(model.task(job.task).version(job.version).accesses for job in jobs):
        yield (
            "bounds of access phases are not enforced; callbacks of one group are kept apart by their instants",
            "let no callback run longer than its WCET",
        )
    if len({(job.task, job.version) for job in jobs}) > len({job.task for job in jobs}):
        yield ("all versions of a task are its one callback", "choose the version by a parameter of the node")
