"""Compilers for RISC-V: zig's wheel, or riscv64-unknown-elf-gcc. Found, asked for their version, and run.

Commands are relative to the folder they run in and name no path of the machine, so that equal sources give equal
bytes, and the bundle's Makefile can repeat them.
"""

from __future__ import annotations

import os
import re
import shutil
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.programs import run as program
from halpipe.core.records import record
from halpipe.exporters.riscv.codes import TOOLCHAIN_MISSING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

INSTALL_ZIG = "install it: pip install ziglang pyelftools unicorn"
INSTALL_GCC = "install it (apt install gcc-riscv64-unknown-elf), or leave --toolchain out to use zig"
GCC = "riscv64-unknown-elf-gcc"

# Freestanding, without floating point; sections of their own, so that the linker can place and drop symbols; no linker
# relaxation, so that an image has the same size wherever it is linked to.
_COMMON = (
    *("-mabi=lp64", "-mcmodel=medany", "-mno-relax", "-mstrict-align", "-std=gnu11", "-O2", "-g0", "-Wall"),
    *("-ffreestanding", "-fno-builtin", "-fno-common", "-ffunction-sections", "-fdata-sections"),
    *("-fno-stack-protector", "-fno-asynchronous-unwind-tables", "-fno-pic", "-Iruntime"),
)
_LINK = ("-nostdlib", "-static", "--no-relax", "--build-id=none", "-n", "--gc-sections")


@record
class Toolchain:
    """A compiler and a linker. `variables` are the names by which the Makefile knows the programs."""

    name: str
    version: str
    compiler: tuple[str, ...]
    linker: tuple[str, ...]
    flags: tuple[str, ...]
    link_flags: tuple[str, ...]
    variables: tuple[tuple[str, str], ...]

    @property
    def title(self) -> str:
        """Name and version, as the bundle states them."""
        return f"{self.name} {self.version}"

    def compile(self, source: str, target: str, defines: Iterable[str] = ()) -> list[str]:
        """Return the command that compiles one file."""
        return [*self.compiler, *self.flags, *(f"-D{d}" for d in defines), "-c", source, "-o", target]

    def link(self, script: str, target: str, objects: Iterable[str]) -> list[str]:
        """Return the command that links objects by a script."""
        return [*self.linker, *self.link_flags, "-T", script, "-o", target, *objects]


@record
class Failure:
    """A command that did not succeed, by its position, and what it said."""

    position: int
    said: str


def find_toolchain(name: str) -> Toolchain:
    """Return the toolchain called ``zig`` or ``gcc``; ``auto`` takes zig where it is installed, else gcc."""
    if find_spec("elftools") is None:
        raise HalpipeError(TOOLCHAIN_MISSING("pyelftools, which reads images, is not installed", help=INSTALL_ZIG))
    spec = find_spec("ziglang")
    if name == "zig" or (name == "auto" and (spec is not None or shutil.which(GCC) is None)):
        if spec is None or not spec.submodule_search_locations:
            raise HalpipeError(TOOLCHAIN_MISSING("the zig toolchain is not installed", help=INSTALL_ZIG))
        return _zig(Path(next(iter(spec.submodule_search_locations))))
    if shutil.which(GCC) is None:
        raise HalpipeError(TOOLCHAIN_MISSING(f"{GCC} is not installed", help=INSTALL_GCC))
    return _gcc()


def _zig(folder: Path) -> Toolchain:
    zig = str(folder / "zig")
    headers = str(folder / "lib" / "include")
    # zig's clang and ld.lld themselves: three times faster than `zig cc`, and without its caches. The object files do
    # not depend on where the headers are. Merged globals would lie in one section, transfer symbols among others.
    unmerged = ("-mllvm", "-enable-global-merge=false")
    return Toolchain(
        name="zig",
        version=_version([zig, "version"]),
        compiler=(zig, "clang", "-nostdinc", "-isystem", headers),
        linker=(zig, "ld.lld"),
        flags=("--target=riscv64-unknown-elf", "-march=rv64imac_zicsr_zifencei", *_COMMON, *unmerged),
        link_flags=(*_LINK, "--no-dependent-libraries"),
        variables=(
            ("ZIG", "$(shell python3 -c 'import os, ziglang; print(os.path.dirname(ziglang.__file__))')"),
            ("CC", "$(ZIG)/zig clang -nostdinc -isystem $(ZIG)/lib/include"),
            ("LD", "$(ZIG)/zig ld.lld"),
        ),
    )


def _gcc() -> Toolchain:
    prefix = GCC.removesuffix("gcc")
    # gcc would make memcpy out of the loop in memcpy. Tasks that want 64-bit libgcc functions do without.
    extra = ("-march=rv64imac_zicsr_zifencei", "-fno-tree-loop-distribute-patterns", "-fno-ident")
    return Toolchain(
        name="gcc",
        version=_version([GCC, "-dumpfullversion"]),
        compiler=(GCC,),
        linker=(f"{prefix}ld",),
        flags=(*extra, *_COMMON),
        link_flags=(*_LINK, "-z", "max-page-size=4096"),
        variables=(("CC", GCC), ("LD", f"{prefix}ld")),
    )


def _version(command: list[str]) -> str:
    done = program(command)
    if done.returncode:
        message = f"{Path(command[0]).name} stopped with status {done.returncode}"
        raise HalpipeError(TOOLCHAIN_MISSING(message, help="repair or reinstall it"))
    return done.stdout.strip()


# The environment decides nothing: search paths of compilers stay out of it.
_KEPT = ("PATH", "TMPDIR", "LD_LIBRARY_PATH", "SystemRoot")


def run_all(commands: Sequence[list[str]], folder: Path, jobs: int) -> list[Failure]:
    """Run independent commands in a folder, several at a time; return those that failed, in order."""
    environment = {key: os.environ[key] for key in _KEPT if key in os.environ} | {"LC_ALL": "C"}

    def run(position: int) -> Failure | None:
        done = program(commands[position], folder, environment=environment)
        said = done.stderr.strip()
        return Failure(position, said or f"status {done.returncode}") if done.returncode else None

    with ThreadPoolExecutor(jobs) as pool:
        return [failure for failure in pool.map(run, range(len(commands))) if failure is not None]


_MESSAGE = re.compile(r"(?P<file>[^:\n]+):(?P<line>[0-9]+):(?:[0-9]+:)? (?:fatal )?error: (?P<text>.*)")


def compiler_errors(said: str) -> list[tuple[str, int, str]]:
    """Return (file, line, message) of every error in a compiler's output."""
    return [(m["file"], int(m["line"]), m["text"]) for m in _MESSAGE.finditer(said)]
