"""The ament package: the Linux dispatcher with a component container, for nodes that stay as they are."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe import __version__
from halpipe.core.bundles import seal
from halpipe.core.diagnostics import Findings, about, version_of
from halpipe.core.records import record
from halpipe.exporters.linux import LinuxOptions
from halpipe.exporters.linux.bundle import RUNTIME, Program, check_texts, cpus_for, jobs_of, rendered_tables
from halpipe.exporters.linux.codes import BAD_TEXT
from halpipe.exporters.linux.priorities import thread_levels
from halpipe.exporters.linux.tables import tables_of
from halpipe.exporters.native import paired
from halpipe.exporters.ros.codes import SPLIT_CALLBACK, UNBOUND

if TYPE_CHECKING:
    from collections.abc import Iterator

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
_SHIM = ("table_executor.hpp", "container.cpp")
_ROS_NAME = re.compile(r"/[A-Za-z0-9_/]{1,250}")


@record(kw_only=True)
class Binding:
    """The callback of a task: `kind` timer or subscription, `topic` of a subscription, `period` of a timer in ns.

    `order` counts equal ones of the node in their order of construction.
    """

    node: str
    kind: str
    topic: str = ""
    period: int = 0
    order: int = 0


@record
class Row:
    """A program of the tables as the executor knows it."""

    task: str
    node: str
    kind: str
    subject: str
    period: int
    order: int


def build(model: TaskModel, schedule: Schedule, options: RosOptions) -> dict[str, bytes]:
    """Return the files of the package, sealed; raise `HalpipeError` with everything that prevents it."""
    findings = Findings()
    linux = LinuxOptions(cpus=options.cpus, priority=options.priority)
    cpus = cpus_for(model, schedule, linux, findings)
    used = {(job.task, job.version) for job in jobs_of(schedule)}
    keys = [(task.name, v.name) for task in model.tasks for v in task.versions if (task.name, v.name) in used]
    rows = [row for task, _ in keys if (row := _row(task, model, options, findings)) is not None]
    check_texts(model, schedule, (), findings)
    gapped = {(job.task, job.version) for job in jobs_of(schedule) if job.parts}
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
        "mode_names": [re.sub(r"\W", "_", mode.name, flags=re.ASCII) for mode in schedule.modes],
        "nodes": sorted({row.node for row in rows}),
        "unrealised": [text for text, _ in sentences(model, schedule)],
    }
    files = {place: _filled(name, values) for name, place in _PLACES.items()}
    files |= {f"src/{name}": (FOLDER / name).read_bytes() for name in _SHIM}
    files |= {f"runtime/{name}": (_RUNTIME / name).read_bytes() for name in RUNTIME}
    files["tables.c"] = rendered_tables(model, schedule, tables, programs, {}, levels)
    files |= paired(model, schedule)
    return seal("ros-package", files, {"model": model.name, "generator": f"halpipe {__version__}"})


def _filled(name: str, values: dict[str, Any]) -> bytes:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(FOLDER),
        undefined=jinja2.StrictUndefined,
        autoescape=".xml" in name,  # the others are C++ and CMake: names are checked before they get here
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    text: str = environment.get_template(name).render(**values)
    return text.encode()


def _row(task: str, model: TaskModel, options: RosOptions, findings: Findings) -> Row | None:
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
    return Row(task, binding.node, binding.kind, binding.topic, binding.period, binding.order)


def sentences(model: TaskModel, schedule: Schedule) -> Iterator[tuple[str, str]]:
    """Yield what the package leaves open, and what to do about it."""
    jobs = list(jobs_of(schedule))
    yield (
        "parameter services of the nodes are off: they share the callback group of the callbacks that the table runs",
        "set parameters at the start, in config/components.yaml",
    )
    yield (
        "services, clients and actions of the nodes are not served; without a message a job does nothing",
        "keep nodes with services in an ordinary container",
    )
    yield (
        "threads of the middleware run at normal priority on any CPU",
        "keep a CPU free for them that no unit has",
    )
    yield (
        "serialized and loaned messages are taken one by one, the oldest first, also with --messages newest",
        "keep a queue of one message for their subscriptions",
    )
    if any(model.task(job.task).version(job.version).accesses for job in jobs):
        yield (
            "bounds of access phases are not enforced; callbacks of one group are kept apart by their instants",
            "let no callback run longer than its WCET",
        )
    if len({(job.task, job.version) for job in jobs}) > len({job.task for job in jobs}):
        yield ("all versions of a task are its one callback", "choose the version by a parameter of the node")
