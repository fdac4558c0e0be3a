"""Toolchain for RISC-V: compilers, the temporary folder of a build with its recipe, and the ELF files that come out."""

from __future__ import annotations

import io
import os
import re
import shutil
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.programs import run as program
from halpipe.core.records import record
from halpipe.exporters.riscv.codes import TOOLCHAIN_MISSING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

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


@record
class Segment:
    """Bytes to load: at `offset` in the file, stored at `source` in main memory, executed or used at `target`."""

    offset: int
    source: int
    target: int
    size: int


@record
class Symbol:
    """A symbol's address and size in bytes; `is_unique` is False where several have its name."""

    address: int
    size: int
    is_unique: bool = True


@record
class Elf:
    """Loadable segments that are not empty, as they lie in main memory, and the symbols by name."""

    segments: tuple[Segment, ...]
    symbols: dict[str, Symbol]
    reserving: tuple[int, ...] = ()
    """Addresses of lr and sc in the code."""

    def address(self, name: str) -> int:
        """Return the address of a symbol that the linker script defines."""
        return self.symbols[name].address

    @property
    def stored(self) -> int:
        """Bytes of main memory that the image takes, from its first to its last."""
        if not self.segments:
            return 0
        return max(s.source + s.size for s in self.segments) - min(s.source for s in self.segments)


def read_elf(data: bytes) -> Elf:
    """Read a file that our own linker wrote."""
    from elftools.elf.elffile import ELFFile

    file = ELFFile(io.BytesIO(data))
    found = (
        Segment(header["p_offset"], header["p_paddr"], header["p_vaddr"], header["p_filesz"])
        for header in file.iter_segments("PT_LOAD")
        if header["p_filesz"]
    )
    segments = tuple(sorted(found, key=lambda segment: segment.source))
    symbols: dict[str, Symbol] = {}
    table: Any = file.get_section_by_name(".symtab")
    named = [s for s in table.iter_symbols() if s.name and s["st_shndx"] != "SHN_UNDEF"] if table else []
    counts = Counter(s.name for s in named)
    for symbol in named:
        symbols[symbol.name] = Symbol(symbol["st_value"], symbol["st_size"], counts[symbol.name] == 1)
    text = file.get_section_by_name(".text")
    return Elf(segments, symbols, tuple(_reserving(text.data(), text["sh_addr"])) if text else ())


_ATOMIC, _FUNCTIONS = 0x2F, (2, 3)  # lr and sc among the atomic operations


def _reserving(code: bytes, base: int) -> Iterator[int]:
    at = 0
    while at < len(code):
        word = int.from_bytes(code[at : at + 4], "little")
        if word & 0x7F == _ATOMIC and word >> 27 in _FUNCTIONS:
            yield base + at
        at += 4 if word & 3 == 3 else 2


JOBS = 2
"""Commands at a time; more gain little, since each is short."""


@record
class Compile:
    """One object file from one source."""

    source: str
    target: str
    defines: tuple[str, ...] = ()


@record
class Link:
    """One ELF file from objects, by a linker script; `also` is what else it depends on."""

    script: str
    target: str
    objects: tuple[str, ...]


@dataclass(slots=True)
class Workshop:
    """Runs steps in `folder` and remembers those that lead to the bundle."""

    folder: Path
    toolchain: Toolchain
    compiles: list[Compile] = field(default_factory=list)
    links: list[Link] = field(default_factory=list)

    def write(self, name: str, content: bytes | str) -> None:
        """Put a file into the folder."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)

    def read(self, name: str) -> bytes:
        """Return a file of the folder."""
        return (self.folder / name).read_bytes()

    def compile(self, steps: list[Compile]) -> list[Failure]:
        """Compile; return what failed, by position."""
        self._make_room([step.target for step in steps])
        self.compiles += steps
        return run_all([self.toolchain.compile(s.source, s.target, s.defines) for s in steps], self.folder, JOBS)

    def link(self, steps: list[Link], *, is_final: bool = True) -> list[Failure]:
        """Link; return what failed, by position. A link that is not final is no part of the recipe."""
        self._make_room([step.target for step in steps])
        if is_final:
            self.links += steps
        return run_all([self.toolchain.link(s.script, s.target, s.objects) for s in steps], self.folder, JOBS)

    def _make_room(self, targets: list[str]) -> None:
        for folder in sorted({target.rpartition("/")[0] for target in targets}):
            (self.folder / folder).mkdir(parents=True, exist_ok=True)
