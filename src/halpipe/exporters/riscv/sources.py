"""The C sources of the versions that are deployed: found below one folder, with the headers that they include."""

from __future__ import annotations

import posixpath
import re
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.core.files import read_bytes
from halpipe.core.quantities import quoted
from halpipe.core.settings import Stated
from halpipe.exporters.riscv.codes import BAD_NAME, MISSING_FILE, NO_SOURCE, OUTSIDE_FILE

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from halpipe.models import Version

COMPILED = (".c", ".S", ".s")
_INCLUDE = re.compile(rb'^[ \t]*#[ \t]*include[ \t]*"([^"\n]+)"', re.MULTILINE)
_INCBIN = re.compile(rb"\.incbin\b", re.IGNORECASE)
_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,200}")
_DEFINE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(=[^\s$]*)?")
_FILE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+-]*(/[A-Za-z0-9_][A-Za-z0-9_.+-]*)*")
"""What make, shells and linker scripts take for a name and nothing else."""


@dataclass(slots=True)
class SourceTree:
    """Files by their name in the bundle (``src/...``), read from below `folder`, and nothing from elsewhere."""

    folder: Path
    findings: Findings
    files: dict[str, bytes] = field(default_factory=dict)
    complained: set[str] = field(default_factory=set)

    def add(self, version: Version, path: str) -> list[str]:
        """Take the files of a version; return those to compile, by their names in the bundle."""
        source = version.source
        if source is None:
            help = 'name them: <source files="task.c" entry="step"/>, or let `halpipe deploy prepare --dummy` make some'
            self.findings.add(NO_SOURCE("the version has no sources", at=version.at, path=path, help=help))
            return []
        for name in (*source.entry.split(), *(t.symbol for a in version.accesses for t in a.transfers)):
            if _IDENTIFIER.fullmatch(name) is None:
                help = "use a C identifier"
                self.findings.add(BAD_NAME(f"{quoted(name)} is no C identifier", at=source.at, path=path, help=help))
        for define in source.defines:
            if _DEFINE.fullmatch(define) is None:
                help = "write NAME or NAME=value, without blanks and $"
                self.findings.add(BAD_NAME(f"{quoted(define)} is no definition", at=source.at, path=path, help=help))
        names = Counter(define.partition("=")[0] for define in source.defines)
        for name in (name for name, stated in names.items() if stated > 1):
            text, help = f"{quoted(name)} is defined twice", "keep one definition; a compiler takes the last"
            self.findings.add(BAD_NAME(text, at=source.at, path=path, help=help))
        return self.take([Stated(name, source.at) for name in source.files], path)

    def take(self, files: Iterable[Stated[str]], path: str) -> list[str]:
        """Take files and what they include; return those to compile, by their names in the bundle."""
        taken = [self._take(file.value, file.at, path) for file in files]
        return [name for name in taken if name.endswith(COMPILED)]

    def _take(self, name: str, at: Location, path: str) -> str:
        """Read a file and what it includes; return its name in the bundle, empty if it cannot be had."""
        first, waiting = "", [posixpath.normpath(name)]
        while waiting:
            normal = waiting.pop()
            staged = f"src/{normal}"
            content = b"" if staged in self.files else self._content(normal, at, path)
            if content is None:
                continue
            if staged not in self.files:
                self.files[staged] = content
                self._confine(normal, content, path)
                waiting += self._included(normal, content)
            first = first or staged
        return first

    def _included(self, name: str, content: bytes) -> list[str]:
        """Return the files that a file includes with quotes, as far as they are there; the compiler misses others."""
        found = [self._resolved(name, stated[1]) for stated in _INCLUDE.finditer(content)]
        return [name for name in found if not _leaves(name) and (self.folder / name).is_file()]

    def _resolved(self, name: str, stated: bytes) -> str:
        return posixpath.normpath(posixpath.join(posixpath.dirname(name), stated.decode("utf-8", "replace")))

    def _content(self, normal: str, at: Location, path: str) -> bytes | None:
        if _leaves(normal):
            self._outside(normal, at, path)
            return None
        if _FILE.fullmatch(normal) is None:
            help = "rename it to letters, digits and _ . + -, beginning with one of the first three"
            self.findings.add(BAD_NAME(f"{quoted(normal)} is no usable file name", at=at, path=path, help=help))
            return None
        file = self.folder / normal
        if not file.resolve().is_relative_to(self.folder.resolve()):
            self._outside(normal, at, path)
            return None
        try:
            return read_bytes(file)
        except HalpipeError as failure:
            why = failure.diagnostics[0].message
            help = f"sources are sought in {self.folder}; --sources names another folder"
            self.findings.add(MISSING_FILE(f'source "{normal}": {why}', at=at, path=path, help=help))
            return None

    def _confine(self, name: str, content: bytes, path: str) -> None:
        """Report quoted includes that leave the folder, and `.incbin`: the image would hold files from elsewhere.

        That keeps a model's own sources together. It is no sandbox: sources are compiled with the user's rights.
        """
        for found in (*_INCLUDE.finditer(content), *_INCBIN.finditer(content)):
            if found.re is _INCLUDE and not _leaves(self._resolved(name, found[1])):
                continue
            at = Location(str(self.folder / name), content.count(b"\n", 0, found.start()) + 1)
            text = found[0].decode("utf-8", "replace").strip()
            help = f"include files below {self.folder} by their relative names, and state bytes in the source itself"
            self.findings.add(OUTSIDE_FILE(f"{quoted(text)} reads a file from elsewhere", at=at, path=path, help=help))

    def _outside(self, name: str, at: Location, path: str) -> None:
        help = f"move it below {self.folder}, or name a folder that holds it all with --sources"
        if name not in self.complained:
            self.complained.add(name)
            self.findings.add(OUTSIDE_FILE(f'source "{name}" lies outside', at=at, path=path, help=help))


def _leaves(normal: str) -> bool:
    return normal.startswith("/") or normal.split("/")[0] == ".."
