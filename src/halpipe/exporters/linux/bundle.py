"""Bundle for Linux: programs, buffers and tables as C, with the runtime and what builds, installs and explains it."""

from __future__ import annotations

import math
import re
import shlex
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe import __version__
from halpipe.core.bundles import seal
from halpipe.core.diagnostics import Findings, about, version_of
from halpipe.core.durations import ZERO
from halpipe.core.options import refuse_unused
from halpipe.core.records import record
from halpipe.core.suggest import few
from halpipe.exporters.common.cpus import placed
from halpipe.exporters.common.templates import environment
from halpipe.exporters.linux.codes import BAD_TEXT, NO_START, NOT_A_CPU, NOT_ALONE
from halpipe.exporters.linux.copies import Copy, copies_of
from halpipe.exporters.linux.tables import Tables, is_followed, tables_of, thread_levels
from halpipe.exporters.native import paired
from halpipe.exporters.regulator.embedded import embedded
from halpipe.exporters.riscv.codes import NO_SOURCE
from halpipe.exporters.riscv.sources import SourceTree
from halpipe.models import AccessKind, Schedule, Task, TaskModel, Version

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from halpipe.exporters.linux import LinuxOptions
    from halpipe.exporters.regulator.platform import Platform


FOLDER = Path(__file__).parent
_TEXT = re.compile(r"[A-Za-z0-9_./:~+@$%>-]{1,1000}")
_ACCELERATORS = ("gpu", "fpga", "npu", "dla", "dsp", "tpu", "accelerator")
RUNTIME = ("dispatch.c", "dispatch.h", "record.c")
_PROGRAM = ("programs.c", "main.c")
_DUMMY = "src/dummy.c"


@record
class Move:
    """Data of `size` bytes between buffer number `buffer` and a variable."""

    symbol: str
    buffer: int
    size: int


@record
class Program:
    """A version as a shared object: compiled from `files`, or, `is_ready`, one that is there already.

    With a logical execution time its moves are between variables and buffers of its own; `read` and `written` are the
    copies from and to those of the model: source, target and size.
    """

    name: str
    target: str
    entries: tuple[str, ...]
    files: tuple[str, ...]
    defines: tuple[str, ...]
    moved_in: tuple[Move, ...]
    moved_out: tuple[Move, ...]
    is_ready: bool = False
    read: tuple[tuple[int, int, int], ...] = ()
    written: tuple[tuple[int, int, int], ...] = ()

    @property
    def is_made_up(self) -> bool:
        """Whether it stands for a program that does not exist yet."""
        return self.files == (_DUMMY,)

    @property
    def library(self) -> str:
        """The file name of the shared object."""
        return f"{self.target}.so"

    @property
    def shell_defines(self) -> tuple[str, ...]:
        """The definitions as options of a compiler that a shell runs."""
        return tuple(shlex.quote(f"-D{define}") for define in self.defines)

    @property
    def plain_defines(self) -> tuple[str, ...]:
        """The definitions as CMake takes them."""
        return tuple('"{}"'.format(re.sub(r'([\\";$])', r"\\\1", define)) for define in self.defines)


def build(model: TaskModel, schedule: Schedule, options: LinuxOptions) -> dict[str, bytes]:
    """Return the files of the bundle, sealed; raise `HalpipeError` with everything that prevents it."""
    findings = Findings()
    tree = SourceTree(Path(options.sources or Path(model.at.file).parent), findings)
    cpus = cpus_for(model, schedule, options.cpus, findings)
    buffers = _buffers(model)
    used = versions_used(model, schedule)
    numbers = {(task.name, version.name): number for number, (task, version) in enumerate(used)}
    programs = [_program(*pair, number, buffers, options, tree) for number, pair in enumerate(used)]
    check_texts(model, schedule, buffers, findings)
    findings.stop_on_errors()
    if not tree.files:
        refuse_unused(options, "export linux of a model without sources", ("sources",))
    levels = thread_levels(model, schedule, options.priority)
    functions = {key: len(programs[number].entries) for key, number in numbers.items()}
    tables = tables_of(model, schedule, cpus, levels, numbers, functions, findings)
    copies = copies_of(model, schedule, programs, numbers, findings)
    regulators, platform = embedded(model, schedule, options.regulator)
    if platform is not None:
        _check_start(platform, findings)
    findings.stop_on_errors()
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", model.name).strip("-.") or "tasks"
    values: dict[str, Any] = {
        "name": name,
        "compiled": [p for p in programs if not p.is_ready],
        "ready": [p for p in programs if p.is_ready],
        "priority": options.priority,
        "cpus": sorted({worker.cpu for worker in tables.workers}),
        "places": [(unit, cpus[unit]) for unit in cpus if unit in {worker.unit for worker in tables.workers}],
        "unrealised": [text for text, _ in sentences(model, schedule, options)],
        "regulated": bool(regulators),
    }
    files = {
        **paired(model, schedule),
        "tables.c": rendered_tables(model, schedule, tables, programs, buffers, levels, copies, bool(regulators)),
        **_rendered(values, programs),
        **tree.files,
        **regulators,
    }
    runtime = (*RUNTIME, *_PROGRAM, *(["regulator.c"] if regulators else []))
    files |= {f"runtime/{file}": (FOLDER / "runtime" / file).read_bytes() for file in runtime}
    facts = {
        "model": model.name,
        "cpus": dict(cpus),
        "priority": options.priority,
        "generator": f"halpipe {__version__}",
    }
    return seal("linux", files, facts)


def rendered_tables(
    model: TaskModel,
    schedule: Schedule,
    tables: Tables,
    programs: list[Program],
    buffers: Mapping[str, int],
    levels: Mapping[str, int],
    copies: Sequence[Sequence[Copy]] = (),
    regulated: bool = False,
) -> bytes:
    """Return the tables as C."""
    values = {
        "model": model.name,
        "programs": programs,
        "buffers": [{"name": key, "size": size} for key, size in buffers.items()],
        "tables": tables.tables,
        "copies": dict(enumerate(copies)),
        "switches": tables.switches,
        "workers": tables.workers,
        "all_parts": tables.all_parts,
        "parts": tables.parts,
        "modes": len(schedule.modes),
        "levels": max(levels.values(), default=0) + 1,
        "regulated": regulated,
    }
    return filled("tables.c", values)


def _check_start(platform: Platform, findings: Findings) -> None:
    """Report regulators that the dispatcher cannot start at an instant of its clock."""
    text = path = help = ""
    if platform.backend != "table":
        text = f"{platform.backend} begins at no stated instant; the dispatcher starts the back-end table alone"
        path, help = "platform backend", 'export the regulator format for it, or state "backend: table"'
    elif not platform.settings["table"]["timebase"]:
        text = "the rate of the time base that the unit counts is not stated"
        path, help = "platform table", 'state "table: {timebase: 100MHz}", the rate of its input now'
    if text:
        findings.add(NO_START(text, at=platform.at, path=path, help=help))


def filled(name: str, values: Mapping[str, Any], folder: Path = FOLDER / "templates") -> bytes:
    """Return a template with its values; only XML is escaped: names are checked before they get into C or CMake."""
    text = environment(folder, autoescape=".xml" in name).get_template(name).render(**values)
    return text.encode()


def _rendered(values: dict[str, Any], programs: list[Program]) -> dict[str, bytes]:
    names = ["Makefile", "CMakeLists.txt", "dispatcher.service", "setup.sh", "README.md"]
    files = {name: filled(name, values) for name in names}
    if pieces := max((len(p.entries) for p in programs if p.is_made_up), default=0):
        files[_DUMMY] = filled("dummy.c", {"pieces": pieces})
    return files


def cpus_for(
    model: TaskModel, schedule: Schedule, stated: Mapping[str, int] | None, findings: Findings
) -> dict[str, int]:
    """Return the CPU of each unit; report units with jobs that have none."""
    used = {unit for job in schedule.all_jobs() for unit in job.units}
    cpus = placed(model, stated)
    for unit in model.units:
        is_other = any(word in unit.type.lower() for word in _ACCELERATORS)
        if unit.name in used and (unit.name not in cpus or (is_other and stated is None)):
            text = f'its type is "{unit.type}"' if is_other else "it has jobs, but no CPU"
            help = "state the CPU of every unit that is one: --cpus unit=number,...; move its jobs elsewhere otherwise"
            findings.add(NOT_A_CPU(text, at=unit.at, path=about(unit=unit.name), help=help))
            cpus.setdefault(unit.name, 0)
    return cpus


def _buffers(model: TaskModel) -> dict[str, int]:
    sizes: dict[str, int] = {}
    for task in model.tasks:
        for version in task.versions:
            for access in version.accesses:
                for transfer in access.transfers:
                    sizes[transfer.buffer] = max(transfer.size, sizes.get(transfer.buffer, 0))
    return dict(sorted(sizes.items()))


def versions_used(model: TaskModel, schedule: Schedule) -> list[tuple[Task, Version]]:
    """Return the versions that have jobs, in the order of the model."""
    used = {(job.task, job.version) for job in schedule.all_jobs()}
    return [(task, v) for task in model.tasks for v in task.versions if (task.name, v.name) in used]


def _program(
    task: Task, version: Version, number: int, buffers: dict[str, int], options: LinuxOptions, tree: SourceTree
) -> Program:
    name, target = f"{task.name}/{version.name}", f"program_{number}"
    if version.source is None and options.busy:
        return _made_up(name, target, version, options.busy)
    path = version_of(task.name, version.name)
    source = version.source
    if source is None:
        help = 'name them: <source files="task.c" entry="step"/>, or let --busy 50 stand in for programs'
        tree.findings.add(NO_SOURCE("the version has no sources", at=version.at, path=path, help=help))
        return Program(name, target, (), (), (), (), ())
    ready = any(file.endswith(".so") for file in source.files)
    compiled = tree.add(version, path)
    if ready and len(source.files) > 1:
        help = "name the shared object alone, or sources to be compiled"
        text = f"a shared object is played as it is, but {len(source.files)} files are named"
        tree.findings.add(NOT_ALONE(text, at=source.at, path=path, help=help))
    places = {buffer: place for place, buffer in enumerate(buffers)}
    moves: Mapping[bool, list[Move]] = {True: [], False: []}
    copies: Mapping[bool, list[tuple[int, int, int]]] = {True: [], False: []}
    for access in version.accesses:
        is_written = access.kind is AccessKind.WRITE
        for transfer in access.transfers:
            place, size = places[transfer.buffer], transfer.size
            if task.let is not None:
                own = len(buffers)
                buffers[f"{target}~{own}~{transfer.symbol}"] = size
                copies[is_written].append((own, place, size) if is_written else (place, own, size))
                place = own
            moves[is_written].append(Move(transfer.symbol, place, size))
    files = tuple(f"src/{file}" for file in source.files) if ready else tuple(compiled)
    entries = tuple(source.entry.split())
    moved, copied = (tuple(moves[False]), tuple(moves[True])), (tuple(copies[False]), tuple(copies[True]))
    return Program(name, target, entries, files, source.defines, *moved, ready, *copied)


def _made_up(name: str, target: str, version: Version, percent: int) -> Program:
    """Return a program that takes a share of the time of every piece between split points."""
    assert version.wcet is not None, "a schedule needs WCETs"
    bounds = [ZERO, *version.split.points, version.wcet]
    times = [math.floor((end - begin).fraction * percent / 100) for begin, end in pairwise(bounds)]
    entries = tuple(f"piece_{number}" for number in range(len(times)))
    listed = ",".join(map(str, times))
    return Program(name, target, entries, (_DUMMY,), (f"BUSY_NS={listed}",), (), ())


def check_texts(model: TaskModel, schedule: Schedule, buffers: Iterable[str], findings: Findings) -> None:
    """Report names that would not be what they are in a C string or a CSV file."""
    names = [("task", task.name, task.at) for task in model.tasks]
    names += [("unit", unit.name, unit.at) for unit in model.units]
    names += [("mode", mode.name, mode.at) for mode in schedule.modes]
    names += [("version", version.name, version.at) for task in model.tasks for version in task.versions]
    names += [("buffer", buffer, model.at) for buffer in buffers] + [("model", model.name, model.at)]
    for kind, name, at in names:
        if _TEXT.fullmatch(name) is None or "*/" in name:
            help = "rename it to letters, digits and _ . / : ~ + @ $ % -"
            findings.add(BAD_TEXT(f"{name[:60]!r} has other characters", at=at, path=kind, help=help))


def sentences(model: TaskModel, schedule: Schedule, options: LinuxOptions) -> Iterator[tuple[str, str]]:
    """Yield what is left open, and what to do about it."""
    jobs = schedule.all_jobs()
    versions = {(job.task, job.version): model.task(job.task).version(job.version) for job in jobs}
    if gangs := dict.fromkeys(job.task for job in jobs if len(job.units) > 1):
        yield (
            f"programs run on one CPU, though they occupy several units: {few(list(gangs))}",
            "let the program start helping threads on the CPUs of the units that are kept free for it",
        )
    if any(version.accesses for version in versions.values()):
        held = any(unit.interrupts for unit in model.units)
        held = held or any(version.split.is_allowed for task in model.tasks for version in task.versions)
        texts = [] if options.regulator else ["bounds of access phases are not enforced"]
        texts += [] if held else ["phases begin when the program comes to them"]
        if texts:
            yield ", and ".join(texts), "state --regulator, or export the regulator format, to enforce bounds"
    if made_up := [f"{task}/{name}" for (task, name), version in versions.items() if version.source is None]:
        yield (
            f"programs that only take {options.busy} % of their WCET stand for: {few(made_up)}",
            "name their sources in the model, or in an overlay",
        )
    if left := dict.fromkeys(rule.task for rule in model.health if not is_followed(rule, schedule)):
        yield (
            f"health rules are not followed, but for switches after one overrun: {few(list(left))}",
            "a program that faults ends the dispatcher; let its supervisor start it in the mode that is meant",
        )
    if options.cpus is None:
        yield "CPUs are numbered in the order of the units of the model", "state them with --cpus unit=number,..."
