"""The programs that play the regulator: Verilator where it is installed, Icarus Verilog as the second choice.

A bench that Verilator has compiled is kept in the user's cache, by the hash of everything it was made of, so that the
next check of a bundle with as many units starts at once.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.caches import cache_folder, is_ours, keep
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import sha256
from halpipe.core.programs import TimeoutExpired, run
from halpipe.core.records import record
from halpipe.deploy.regulator.codes import ENGINE_FAILED

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic

CACHE = "regulator"
"""What compiled benches are kept under."""

TOP = "bench"
BUILD_SECONDS = 600
RUN_SECONDS = 1800


@record(kw_only=True)
class Design:
    """What an engine compiles: Verilog files by name, what only Verilator and only Icarus need, and parameters."""

    sources: Mapping[str, bytes]
    for_verilator: Mapping[str, bytes]
    for_icarus: Mapping[str, bytes]
    parameters: Mapping[str, int]

    def digest(self, engine: str, *tools: str) -> str:
        """Return a name for what `engine` makes of this design with `tools`."""
        extra = self.for_verilator if engine == "verilator" else self.for_icarus
        parts = [engine, os.uname().machine, *tools, *(f"{name}={self.parameters[name]}" for name in self.parameters)]
        for name, content in sorted({**self.sources, **extra}.items()):
            parts += [name, sha256(content)]
        return sha256("\n".join(parts).encode())


@record
class Player:
    """A compiled bench: the command that runs it, in a folder that holds the files it reads."""

    command: tuple[str, ...]
    folder: str = ""
    environment: Mapping[str, str] = field(default_factory=dict)

    def run(self, folder: str, *arguments: str) -> None:
        """Run the bench in `folder`; raise `HalpipeError` when it does not come to its end."""
        _call([*self.command, *arguments], folder, RUN_SECONDS)


class Verilator:
    """Compiles the design to a native program: millions of cycles a second, after a build of some seconds."""

    name = "verilator"
    is_kept = True
    """Whether what it builds is kept for the next check."""

    def missing(self) -> str:
        """Return why this engine cannot be used here, empty if it can."""
        lacking = [tool for tool in ("verilator", "g++", "make") if shutil.which(tool) is None]
        return f"{', '.join(lacking)} not installed" if lacking else ""

    def build(self, design: Design, folder: str) -> Player:
        """Compile, or take what an earlier check compiled."""
        versions = [_version([tool, "--version"]) for tool in ("verilator", "g++")]
        name = design.digest(self.name, *versions, *_FLAGS)
        kept = cache_folder(CACHE)
        if kept is not None and is_ours(kept / name) and os.access(kept / name, os.X_OK):
            return Player((str(kept / name),))
        program = _verilate(design, folder)
        if kept is not None and keep(kept / name, program.read_bytes(), executable=True):
            program = kept / name
        return Player((str(program),))


class Icarus:
    """Interprets the design: starts at once, some ten thousand cycles a second."""

    name = "icarus"
    is_kept = False

    def missing(self) -> str:
        """Return why this engine cannot be used here, empty if it can."""
        lacking = [tool for tool in ("iverilog", "vvp") if shutil.which(tool) is None]
        return f"{', '.join(lacking)} not installed" if lacking else ""

    def build(self, design: Design, folder: str) -> Player:
        """Compile to the interpreter's form."""
        names = _write(folder, {**design.sources, **design.for_icarus})
        sources = [name for name in names if name.endswith(".v")]
        parameters = [f"-P{_ICARUS_TOP}.{name}={value}" for name, value in design.parameters.items()]
        command = ["iverilog", "-g2005-sv", "-s", _ICARUS_TOP, *parameters, "-o", "bench.vvp", *sources]
        _call(command, folder, BUILD_SECONDS)
        return Player(("vvp", "-n", os.path.join(folder, "bench.vvp")))


_ICARUS_TOP = "clocked"
Engine = Verilator | Icarus
ENGINES = (Verilator(), Icarus())


_FLAGS = (
    *("--cc", "--exe", "--build", "-j", "1", "-O3", "--x-assign", "fast", "--noassert"),
    *("-MAKEFLAGS", "OPT_GLOBAL=-O1"),  # Verilator's own library: most of the time of a build, little of a run
)


def _verilate(design: Design, folder: str) -> Path:
    names = _write(folder, {**design.sources, **design.for_verilator})
    parameters = [f"-G{name}={value}" for name, value in design.parameters.items()]
    quiet = ["-Wno-fatal", "-Wno-lint", "-Wno-style", "--top-module", TOP, "--Mdir", "made", "-o", TOP]
    _call(["verilator", *_FLAGS, *quiet, *parameters, *names], folder, BUILD_SECONDS)
    return Path(folder, "made", TOP)


def _write(folder: str, contents: Mapping[str, bytes]) -> list[str]:
    for name, content in contents.items():
        Path(folder, name).write_bytes(content)
    return [name for name in sorted(contents) if not name.endswith(".h")]


def _version(command: Sequence[str]) -> str:
    return run(command).stdout.partition("\n")[0]


def _call(command: Sequence[str], folder: str, seconds: int) -> None:
    """Run a tool; its own last words are the message when it fails."""
    tool = os.path.basename(command[0])
    try:
        done = run(command, folder, seconds=seconds)
    except TimeoutExpired:
        raise HalpipeError(_failed(f"{tool}: took more than {seconds} s")) from None
    if done.returncode != 0:
        said = [line.strip() for line in (done.stderr + done.stdout).splitlines() if line.strip()]
        telling = [line for line in said if "rror" in line] or said
        raise HalpipeError(_failed(f"{tool} ended with {done.returncode}: {' | '.join(telling[:3])[:400]}"))


def _failed(message: str) -> Diagnostic:
    help = "look at the message of the tool; --engine arithmetic checks without simulation, another --engine may work"
    return ENGINE_FAILED(message, help=help)
