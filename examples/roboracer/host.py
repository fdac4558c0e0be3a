"""The stack on the computer at hand: its programs compiled for this machine, played in the order of the schedule.

Time is the schedule's: inputs are taken at the beginning of a read phase, results given at the beginning of a write
phase. How long a program really computes plays no part. What the target does must be the same, byte for byte.
"""

from __future__ import annotations

import ctypes
import heapq
import shutil
import subprocess
import tempfile
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from elftools.elf.elffile import ELFFile

from halpipe.models import AccessKind

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from halpipe.models import Job, Schedule, Source, TaskModel

FLAGS = ("-std=c11", "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-g0")


class Plant(Protocol):
    """What the stack drives: it meets the stack at the beginning of every cycle of a mode."""

    finished: bool

    def cycle(self, time: int, read: Callable[[str], bytes], write: Callable[[str, bytes], None]) -> str | None:
        """Exchange data at `time` in ns; return the mode that is requested, if any."""
        ...


def compiler() -> list[str]:
    """The C compiler: cc where there is one that works, else that of the package ziglang."""
    found = shutil.which("cc")
    if found is not None and _works(found):
        return [found]
    try:
        import ziglang
    except ImportError:
        raise SystemExit("no C compiler here: pip install ziglang") from None
    return [str(Path(ziglang.__file__).with_name("zig")), "cc", "-fno-sanitize=undefined"]


def _works(found: str) -> bool:
    """Return whether a compiler makes a library of an empty program; some machines have only its name."""
    with tempfile.TemporaryDirectory() as folder:
        command = [found, "-x", "c", "-shared", "-fPIC", "-o", f"{folder}/empty.so", "-"]
        return subprocess.run(command, input=b"int empty;", capture_output=True, check=False).returncode == 0


class Program:
    """A program of a task as a shared library; every run begins like one that was just loaded."""

    def __init__(self, source: Source, folder: Path, library: Path) -> None:
        files = [str(folder / name) for name in source.files]
        defines = [f"-D{define}" for define in source.defines]
        if subprocess.run([*compiler(), *FLAGS, *defines, "-o", str(library), *files], check=False).returncode:
            raise SystemExit(f"{source.entry} does not compile")
        self.loaded = ctypes.CDLL(str(library))
        self.entry = self.loaded[source.entry]
        self.entry.restype = None
        with library.open("rb") as stream:
            elf = ELFFile(stream)
            symbols = {s.name: s["st_value"] for s in elf.get_section_by_name(".dynsym").iter_symbols()}
            base = ctypes.cast(self.entry, ctypes.c_void_p).value - symbols[source.entry]
            places = [(s["sh_addr"], s["sh_size"]) for s in map(elf.get_section_by_name, (".data", ".bss")) if s]
        self.memory = [(ctypes.c_char * size).from_address(base + address) for address, size in places if size]
        self.initial = [bytes(part) for part in self.memory]

    def run(self, inputs: Mapping[str, bytes], outputs: Mapping[str, int]) -> dict[str, bytes]:
        """Put the inputs into the symbols that they name, call the entry, return the bytes of the outputs."""
        for part, content in zip(self.memory, self.initial, strict=True):
            part[:] = content
        for symbol, content in inputs.items():
            (ctypes.c_char * len(content)).in_dll(self.loaded, symbol)[:] = content
        self.entry()
        return {s: bytes((ctypes.c_char * size).in_dll(self.loaded, s)) for s, size in outputs.items()}


def programs(model: TaskModel, sources: Path, folder: Path) -> dict[tuple[str, str], Program]:
    """Compile every version that has a source into `folder`."""
    return {
        (task.name, version.name): Program(version.source, sources, folder / f"{task.name[1:]}-{version.name}.so")
        for task in model.tasks
        for version in task.versions
        if version.source is not None
    }


def buffers(model: TaskModel) -> dict[str, bytearray]:
    """Main memory: every buffer, as large as what is written to it, or read if nothing is; all zero."""
    sizes: dict[AccessKind | None, dict[str, int]] = {kind: {} for kind in AccessKind}
    for access in (a for task in model.tasks for version in task.versions for a in version.accesses):
        for transfer in access.transfers:
            known = sizes[access.kind]
            known[transfer.buffer] = max(known.get(transfer.buffer, 0), transfer.size)
    return {name: bytearray(size) for name, size in {**sizes[AccessKind.READ], **sizes[AccessKind.WRITE]}.items()}


class Host:
    """Plays a schedule with programs and main memory; `played` lists the tables, as the target's trace does."""

    def __init__(self, model: TaskModel, schedule: Schedule, programs: Mapping[tuple[str, str], Program]) -> None:
        self.model, self.schedule, self.programs = model, schedule, programs
        self.memory = buffers(model)
        self.played: list[str] = []
        self._events: list[tuple[int, int, Callable[[], None]]] = []
        self._order = count()

    def run(self, plant: Plant, most: int) -> None:
        """Play the first mode and those that the plant requests, until it has finished, at most so many cycles."""
        modes = {mode.name: mode for mode in self.schedule.modes}
        switches = {(t.source, t.target): t for t in self.schedule.transitions}
        now, mode = 0, self.schedule.modes[0]
        for _ in range(most):
            self._advance(now)
            request = plant.cycle(now, lambda name: bytes(self.memory[name]), self._write)
            self._release(mode.jobs, now)
            self.played.append(mode.name)
            if plant.finished:
                return
            now += int(mode.hyperperiod.ns)
            switch = switches.get((mode.name, request or ""))
            if switch is not None:
                self._release(switch.jobs, now)
                self.played.append(f"{switch.source}->{switch.target}")
                now += int(switch.length.ns)
                mode = modes[switch.target]

    def _write(self, name: str, content: bytes) -> None:
        self.memory[name][: len(content)] = content

    def _advance(self, until: int) -> None:
        while self._events and self._events[0][0] < until:
            heapq.heappop(self._events)[2]()

    def _release(self, jobs: tuple[Job, ...], begin: int) -> None:
        for job in jobs:
            for after, action in self._actions(job):
                heapq.heappush(self._events, (begin + int(job.start.ns) + after, next(self._order), action))

    def _actions(self, job: Job) -> Iterator[tuple[int, Callable[[], None]]]:
        """What a job does to main memory, and when after its start."""
        version = self.model.task(job.task).version(job.version)
        program = self.programs[job.task, job.version]
        reads = [a for a in version.accesses if a.kind is AccessKind.READ]
        writes = [a for a in version.accesses if a.kind is AccessKind.WRITE]
        inputs: dict[str, bytes] = {}
        results: dict[str, bytes] = {}

        def compute() -> None:
            results.update(program.run(inputs, {t.symbol: t.size for a in writes for t in a.transfers}))

        for access in reads:
            for t in access.transfers:
                yield (
                    int(access.start.ns),
                    lambda t=t: inputs.update({t.symbol: bytes(self.memory[t.buffer][: t.size])}),
                )
        yield max(int(access.start.ns) for access in reads), compute
        for access in writes:
            for t in access.transfers:
                yield int(access.start.ns), lambda t=t: self._write(t.buffer, results[t.symbol])
