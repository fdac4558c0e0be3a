"""The temporary folder in which a bundle is built, laid out as the bundle, and the recipe that its Makefile repeats."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.exporters.riscv.toolchain import run_all

if TYPE_CHECKING:
    from pathlib import Path

    from halpipe.exporters.riscv.toolchain import Failure, Toolchain

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
