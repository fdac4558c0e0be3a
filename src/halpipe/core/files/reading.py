"""Input files: read whole, within a size limit, and found in folders."""

from __future__ import annotations

import errno
import hashlib
import os
import sys
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from halpipe.core.diagnostics import Diagnostic, HalpipeError, Location, error
from halpipe.core.files.protection import STDIO, note_input, was_input
from halpipe.core.suggest import nearest, one_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


MAX_INPUT_BYTES = 256 * 2**20
MOST_BESIDE = 1000
"""Files of a folder among which one is sought that has a similar name."""
_MAX_SHOWN_BYTES = 32 * 2**20  # of files of which messages show lines

CANNOT_READ = error(
    "HAL0001",
    "File cannot be read",
    "The file does not exist, is a directory, or the system refuses to read it.",
)
TOO_LARGE = error(
    "HAL0002",
    "File is too large",
    f"Input files may have up to {MAX_INPUT_BYTES // 2**20} MiB. Split the file, or import only the parts needed.",
)
TOO_MUCH = error(
    "HAL0008",
    "File has more of something than is read",
    "So that every file is answered within seconds, there is an end to how many elements of a kind are read: "
    "docs/reference/limits.md. It is far beyond what systems have; split the file, or import only the parts needed.",
)


def refuse_more_than(limit: int, count: int, what: str, at: Location) -> None:
    """Refuse a file with more of something than there is time to look at."""
    if count > limit:
        help = "split the file, or import only the parts needed"
        raise HalpipeError(TOO_MUCH(f"has {count} {what}; at most {limit} are read", at=at, help=help))


def read_bytes(path: str | os.PathLike[str]) -> bytes:
    """Read a whole input file (``-`` is standard input), refusing what is too large or unreadable."""
    return _read(path, MAX_INPUT_BYTES, is_input=True)


def is_ended(path: str) -> bool:
    """Return whether a name is no pipe and no device, of which reading or writing might never end."""
    return not os.path.exists(path) or os.path.isfile(path) or os.path.isdir(path)


def read_plain(path: str) -> bytes:
    """Read a file of a folder that is read as a whole; refuse a pipe or a device there."""
    if not is_ended(path):
        help = "let every file of the folder be a plain one"
        raise HalpipeError(CANNOT_READ("is no plain file", at=Location(path), help=help))
    return read_bytes(path)


def is_folder_without(folder: str, name: str) -> bool:
    """Return whether a folder is there and has no entry of this name, not even a dangling link."""
    return os.path.isdir(folder) and not os.path.lexists(os.path.join(folder, name))


def input_size(path: str | os.PathLike[str]) -> int:
    """Return how many bytes an input file has; 0 for standard input, and for what cannot be asked."""
    name = os.fspath(path)
    try:
        return 0 if name == STDIO else os.path.getsize(name)
    except (OSError, ValueError):
        return 0


def open_input(path: str | os.PathLike[str]) -> BinaryIO:
    """Open an input file that is read in parts, so that its size does not matter to the memory."""
    name = os.fspath(path)
    try:
        stream = open(name, "rb")  # noqa: SIM115 the caller closes it
        note_input(stream.fileno(), name)
    except (OSError, ValueError) as failure:
        raise HalpipeError(_unreadable(name, failure)) from None
    return stream


def read_own(path: str | os.PathLike[str], most: int | None = MAX_INPUT_BYTES) -> bytes:
    """Read a file that halpipe keeps for itself and will write again, such as a checkpoint, a journal or a manifest."""
    return _read(path, most, is_input=False)


def _unreadable(name: str, failure: Exception) -> Diagnostic:
    """Return why a file cannot be read, with the files beside it that have a similar name."""
    help, folder, beside = "name a file that exists and that you may read", os.path.dirname(name), {}
    if isinstance(failure, FileNotFoundError):
        stem, ending = os.path.splitext(os.path.basename(name))  # files are not alike by their folder and their kind
        with suppress(OSError):
            names = sorted(os.listdir(folder or "."))[:MOST_BESIDE]
            beside = {each.removesuffix(ending): os.path.join(folder, each) for each in names}
        help = one_of(map(beside.__getitem__, nearest(stem, beside)), help)
    elif isinstance(failure, NotADirectoryError):
        help = f'name a folder, or a bundle, in the place of "{folder}"'
    return CANNOT_READ(reason(failure), at=Location(name), help=help)


def beginning_of(path: str | os.PathLike[str]) -> bytes:
    """Read a file, but no more of it than an input may have: enough to see what wrote it."""
    return _read(path, MAX_INPUT_BYTES, is_input=False, is_whole=False)


def _read(path: str | os.PathLike[str], most: int | None, *, is_input: bool, is_whole: bool = True) -> bytes:
    name = os.fspath(path)
    try:
        if name == STDIO:
            data = _read_stream(standard_bytes(sys.stdin), name, most, is_input)
        else:
            with open(name, "rb") as stream:
                data = _read_stream(stream, name, most, is_input)
    except (OSError, ValueError) as failure:
        raise HalpipeError(_unreadable(name, failure)) from None
    if most is not None and len(data) > most and is_whole:
        raise HalpipeError(TOO_LARGE(f"has more than {most // 2**20} MiB", at=Location(name), help="split the file"))
    return data


def _read_stream(stream: Any, name: str, most: int | None, is_input: bool) -> bytes:
    if is_input:
        with suppress(OSError, ValueError):  # a stream that is no file, as in tests and notebooks
            note_input(stream.fileno(), name)
    data: bytes = stream.read(-1 if most is None else most + 1)
    return data


def standard_bytes(stream: Any) -> Any:
    """Return the bytes side of a standard stream; Python has None for one that the shell closed."""
    if stream is None:
        raise OSError(errno.EBADF, os.strerror(errno.EBADF))
    return stream.buffer


def sha256(data: bytes) -> str:
    """Return the SHA-256 of `data` in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


@dataclass(slots=True)
class SourceLines:
    """Gives the text of a line of an input file, for messages; empty where it cannot be had, or was not read before."""

    _cache: dict[str, list[bytes]] = field(default_factory=dict)

    def __call__(self, at: Location) -> str:
        """Return the line that `at` points to, without its indentation and at most 160 characters of it."""
        if not at.line or at.file in ("", STDIO):
            return ""
        if at.file not in self._cache:
            self._cache[at.file] = self._read(at.file)
        lines = self._cache[at.file]
        if at.line > len(lines):
            return ""
        return lines[at.line - 1].decode("utf-8", "replace").strip()[:160]

    def _read(self, name: str) -> list[bytes]:
        """Read a file once more; a pipe has nothing left to give, and could be waited for without end."""
        try:
            is_short = was_input(name) and os.path.getsize(name) <= _MAX_SHOWN_BYTES
            data = read_bytes(name) if is_short else b""
            return [] if b"\0" in data[:1000] else data.splitlines()  # workbooks and recordings have no lines
        except (HalpipeError, OSError, ValueError):
            return []


def find_inputs(paths: Iterable[str], suffixes: tuple[str, ...]) -> Iterator[str]:
    """Yield files as given, and for every directory its files with one of `suffixes`, recursively, in name order."""
    for path in paths:
        if path != STDIO and os.path.isdir(path):
            found = (p for p in Path(path).rglob("*") if p.suffix.lower() in suffixes and p.is_file())
            yield from sorted(str(p) for p in found)
        else:
            yield path


def raise_it(failure: OSError) -> None:
    """Let a walk through folders fail where one cannot be read, which it would else leave out."""
    raise failure


def reason(failure: Exception) -> str:
    """Return in the system's words why it refused."""
    return (failure.strerror if isinstance(failure, OSError) else None) or str(failure)
