"""Drivers: functions of the board with which the management core fills and empties buffers, within memory phases.

An input driver is called when a read phase begins that moves its buffer, before the transfers; an output driver when a
write phase is over that filled its buffer. So their instants are those of the schedule, and the resource of the phase
is reserved meanwhile. A request is an output whose driver is the runtime's own: it takes the number of a mode.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.core.durations import ZERO, Duration
from halpipe.core.files import YamlMap, parse_yaml, read_bytes, read_plain
from halpipe.core.quantities import quoted
from halpipe.core.records import record
from halpipe.core.settings import Fields, Stated
from halpipe.core.suggest import did_you_mean
from halpipe.exporters.riscv.codes import BAD_DRIVERS, BAD_INPUT, IDLE_DRIVER, MISSING_ENTRY
from halpipe.exporters.riscv.images import Part, compile_sources
from halpipe.exporters.riscv.toolchain import Compile, Workshop, read_elf
from halpipe.models import Access, AccessKind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.exporters.riscv.sources import SourceTree

VERSION = "1"
FILE = "drivers.yaml"
"""Where the file is in the bundle."""

REQUEST = "hp_request_mode"
WORD = 8
"""Bytes of a buffer by which a task asks for a mode."""

_KEYS = ("halpipe-drivers", "sources", "inputs", "outputs", "requests")
_DRIVER, _REQUEST = ("buffer", "function", "time", "task"), ("buffer", "task")
_FUNCTION = re.compile(r"(?!hp_)[A-Za-z_][A-Za-z0-9_]{0,200}")


@record
class Driver:
    """A function that is given a buffer, in phases of `kind` of all tasks or of one; `time` is the longest it takes."""

    buffer: str
    function: str
    time: Duration
    kind: AccessKind
    task: str
    at: Location


@record
class Drivers:
    """The drivers of a board in the order in which they are called, the files that define them, and the file itself."""

    drivers: tuple[Driver, ...] = ()
    sources: tuple[Stated[str], ...] = ()
    text: bytes = b""

    def __bool__(self) -> bool:
        return bool(self.drivers)

    @property
    def functions(self) -> tuple[str, ...]:
        """The functions by their numbers."""
        return tuple(dict.fromkeys(driver.function for driver in self.drivers))

    def of(self, task: str, access: Access) -> list[Driver]:
        """Return the drivers that are called in a phase of a task."""
        moved = {transfer.buffer for transfer in access.transfers}
        return [d for d in self.drivers if d.kind is access.kind and d.buffer in moved and d.task in ("", task)]

    @property
    def longest(self) -> Duration:
        """The time of the slowest."""
        return max((driver.time for driver in self.drivers), default=ZERO)

    def time(self, task: str, access: Access) -> Duration:
        """Return how long the drivers take before the transfers of a phase may begin."""
        return sum((d.time for d in self.of(task, access) if d.kind is AccessKind.READ), ZERO)


NONE = Drivers()


def read_drivers(path: str) -> Drivers:
    """Return the drivers that a file states, none without a `path`; raise `HalpipeError` with all that is wrong."""
    if not path:
        return NONE
    content = read_bytes(path)
    document = parse_yaml(content, path)
    if not isinstance(document, YamlMap) or document.get("halpipe-drivers") != VERSION:
        help = f'begin it with "halpipe-drivers: {VERSION}"'
        raise HalpipeError(BAD_DRIVERS(f"is no file of drivers of version {VERSION}", at=Location(path, 1), help=help))
    findings = Findings()
    found = _drivers(Fields(path, findings, document, "drivers", _KEYS))
    if not findings.has_errors and not found:
        help = "list inputs, outputs or requests, or leave --drivers out"
        findings.add(BAD_DRIVERS("states no driver", at=Location(path, 1), help=help))
    findings.stop_on_errors()
    return replace(found, text=content)


def _drivers(fields: Fields) -> Drivers:
    kinds = (("input", AccessKind.READ, _DRIVER), ("output", AccessKind.WRITE, _DRIVER))
    found = [
        _driver(each, kind, what, keys)
        for what, kind, keys in (*kinds, ("request", AccessKind.WRITE, _REQUEST))
        for each in fields.items(f"{what}s", keys, what)
    ]
    return Drivers(tuple(found), fields.texts("sources", str))


def _driver(fields: Fields, kind: AccessKind, what: str, keys: tuple[str, ...]) -> Driver:
    fields.path = f'{what} "{fields.text("buffer")}"'
    return Driver(
        buffer=fields.required("buffer", str),
        function=fields.required("function", _function) if "function" in keys else REQUEST,
        time=fields.required("time", _time) if "time" in keys else ZERO,
        kind=kind,
        task=fields.text("task"),
        at=fields.at(),
    )


def _function(text: str) -> str:
    if _FUNCTION.fullmatch(text) is None:
        raise ValueError(f"{quoted(text)} is no C identifier of your own; names that begin with hp_ are the runtime's")
    return text


def _time(text: str) -> Duration:
    time = Duration.parse(text)
    if time <= ZERO:
        raise ValueError(f"{text} is no time that a driver takes; write its longest, such as 20us")
    return time


def compile_drivers(shop: Workshop, drivers: Drivers, sources: Sequence[str], tree: SourceTree) -> tuple[str, ...]:
    """Compile the sources of drivers; return the objects. Raise `HalpipeError` with all that is refused or missing."""
    steps = [Compile(source, f"build/drivers/{number}.o") for number, source in enumerate(sources)]
    findings = Findings()
    compile_sources(shop, steps, ["drivers"] * len(steps), tree, findings)
    findings.stop_on_errors()
    objects = tuple(step.target for step in steps)
    defined = {name for each in objects for name in read_elf(shop.read(each)).symbols} | {REQUEST}
    for function, driver in {driver.function: driver for driver in reversed(drivers.drivers)}.items():
        if function not in defined:
            help = "define it in one of the files that sources lists: void f(void *data, uint64_t size)"
            findings.add(MISSING_ENTRY(f'no source defines the driver "{function}"', at=driver.at, help=help))
    findings.stop_on_errors()
    return objects


def check_drivers(drivers: Drivers, parts: Sequence[Part], sizes: dict[str, int], findings: Findings) -> None:
    """Collect what of the drivers does not fit the versions that are deployed; `sizes` are those of the buffers."""
    tasks = sorted({part.task for part in parts})
    for driver in drivers.drivers:
        is_input = driver.kind is AccessKind.READ
        path = f'buffer "{driver.buffer}"'
        if driver.buffer not in sizes:
            help = did_you_mean(driver.buffer, sizes, "there are " + (", ".join(sizes) or "none"))
            findings.add(BAD_DRIVERS(f'there is no buffer "{driver.buffer}"', at=driver.at, path=path, help=help))
        elif driver.task and driver.task not in tasks:
            help = did_you_mean(driver.task, tasks, "the tasks are " + ", ".join(tasks))
            message = f'no task "{driver.task}" is deployed'
            findings.add(BAD_DRIVERS(message, at=driver.at, path=path, help=help))
        elif driver.function == REQUEST and sizes[driver.buffer] != WORD:
            message = f"asks for a mode, and has {sizes[driver.buffer]} bytes"
            help = f"make its transfers {WORD}B: a uint64_t, the number of the mode counted from 1, or 0 for none"
            findings.add(BAD_DRIVERS(message, at=driver.at, path=path, help=help))
        elif not any(Drivers((driver,)).of(p.task, access) for p in parts for access in p.version.accesses):
            verb = "reads" if is_input else "writes"
            who = f'task "{driver.task}"' if driver.task else "no task"
            what = f"{who} never {verb} it" if driver.task else f"{who} {verb} it"
            help = f"a driver of {'inputs' if is_input else 'outputs'} is called in {driver.kind} phases of its buffer"
            findings.add(IDLE_DRIVER(f"{what}, so its driver is never called", at=driver.at, path=path, help=help))


INPUTS = "inputs/"


def read_inputs(folder: str, parts: Sequence[Part], sizes: dict[str, int], findings: Findings) -> dict[str, bytes]:
    """Return the files of recorded buffers by their names in the bundle, none without a `folder`; collect errors.

    `sizes` are those of the buffers.
    """
    if not folder:
        return {}
    accesses = [access for part in parts for access in part.version.accesses]
    written = {t.buffer for access in accesses if access.kind is AccessKind.WRITE for t in access.transfers}
    root, found = Path(folder), {}
    for file in sorted(path for path in root.rglob("*") if path.is_file()):
        name = file.relative_to(root).as_posix()
        buffer, at = name.removesuffix(".bin"), Location(str(file))
        if buffer == name or buffer not in sizes:
            help = did_you_mean(buffer, sizes, "there are " + (", ".join(sizes) or "none"))
            findings.add(BAD_INPUT(f'there is no buffer "{buffer}"', at=at, help=f"name a file BUFFER.bin; {help}"))
        elif buffer in written:
            help = "record what tasks read and none writes"
            findings.add(BAD_INPUT("its buffer is written by a task", at=at, help=help))
        else:
            found[f"{INPUTS}{name}"] = content = read_plain(str(file))
            if not content or len(content) % sizes[buffer]:
                message = f"has {len(content)} bytes, its buffer {sizes[buffer]}"
                help = f"write one or more contents of {sizes[buffer]} bytes each, one after the other"
                findings.add(BAD_INPUT(message, at=at, help=help))
    if not found and not findings.has_errors:
        findings.add(BAD_INPUT("has no recording", at=Location(folder), help="write a file BUFFER.bin for each buffer"))
    return found
