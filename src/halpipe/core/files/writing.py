"""Output files: written beside their target, synced, and renamed over it, so that a failed run leaves the old one."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
from functools import partial
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, Location, error
from halpipe.core.files.protection import STDIO, refuse_inputs
from halpipe.core.files.reading import beginning_of, reason, standard_bytes

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

CANNOT_WRITE = error(
    "HAL0003",
    "File cannot be written",
    "The system refused to write the output, or temporary files on the way to it; whatever stood there before is "
    "untouched.",
)


FOREIGN_FILE = error(
    "HAL0006",
    "Refusing to replace a file that halpipe did not create",
    "Beside an output, halpipe writes further files whose names follow from it, such as a checkpoint. Where a file of "
    "that name holds something else, nothing is written.",
)

_STANDARD_OUTPUT = (STDIO, "/dev/stdout")


def write_output(path: str | os.PathLike[str], data: bytes | str) -> None:
    """Write one output atomically, or to standard output for ``-``."""
    name = os.fspath(path)
    content = data.encode("utf-8", "backslashreplace") if isinstance(data, str) else data
    if name not in _STANDARD_OUTPUT:
        write_outputs({name: content})
        return
    try:
        stream = standard_bytes(sys.stdout)
        stream.write(content)
        stream.flush()
    except BrokenPipeError:  # the reader closed it; the command line ends quietly
        raise
    except OSError as failure:
        raise cannot_write(STDIO, failure) from None


def write_outputs(contents: Mapping[str, bytes]) -> None:
    """Write several files so that, up to the renames at the end, either none of them changes or all are ready."""
    refuse_inputs(*contents)
    staged: list[tuple[str, str]] = []
    target = ""
    try:
        for target, content in contents.items():
            if target.startswith(_DEVICES) or (os.path.exists(target) and not os.path.isfile(target)):
                _write_through(target, content)
            else:
                staged.append(_stage(os.path.realpath(target), content))
        while staged:
            temporary, target = staged[0]
            os.replace(temporary, target)
            staged.pop(0)
            sync_directory(os.path.dirname(target))
    except (OSError, ValueError) as failure:
        raise cannot_write(target, failure) from None
    finally:
        for temporary, _ in staged:
            remove_output(temporary)


def cannot_write(target: str, failure: Exception) -> HalpipeError:
    """Return the error of an output that the system refused."""
    help = "choose a place that exists, has room and that you may write to"
    return HalpipeError(CANNOT_WRITE(reason(failure), at=Location(target), help=help))


_DEVICES = ("/dev/std", "/dev/fd/", "/proc/self/fd/")
"""Names of open files: they stay what they are, whatever that is."""


def _write_through(target: str, content: bytes) -> None:
    """Write to a device or pipe, which cannot be renamed over; what an open file has already, it keeps."""
    descriptor = os.open(target, os.O_WRONLY | os.O_APPEND)
    with os.fdopen(descriptor, "wb") as stream:
        stream.write(content)


def _stage(target: str, content: bytes) -> tuple[str, str]:
    """Write `content` to a synced temporary file beside `target` and return both names."""
    directory, base = os.path.split(target)
    os.makedirs(directory, exist_ok=True)
    sweep(directory, base)
    temporary = temporary_beside(target)
    mode = os.stat(target).st_mode & 0o777 if os.path.exists(target) else None
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _BINARY, 0o666)
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content)
            stream.flush()
            if mode is not None:
                os.chmod(temporary, mode)
            os.fsync(stream.fileno())
    except BaseException:
        remove_output(temporary)
        raise
    return temporary, target


def sweep(directory: str, base: str) -> None:
    """Remove temporary files that a killed run left for the same target."""
    prefix = _prefix(base)
    for entry in os.listdir(directory):
        if entry.startswith(prefix) and entry.endswith(_SUFFIX):
            owner = entry[len(prefix) : -len(_SUFFIX)].partition("-")[0]
            if owner.isdecimal() and not _is_alive(int(owner)):
                left = os.path.join(directory, entry)
                if os.path.isdir(left):
                    shutil.rmtree(left, ignore_errors=True)
                else:
                    remove_output(left)


def temporary_beside(target: str) -> str:
    """Return a fresh name beside `target`, by which a later run knows what a killed one left."""
    directory, base = os.path.split(target)
    return os.path.join(directory, f"{_prefix(base)}{os.getpid()}-{os.urandom(4).hex()}{_SUFFIX}")


_SUFFIX = ".halpipe-tmp"
_BINARY: int = getattr(os, "O_BINARY", 0)
"""Has Windows leave the ends of lines alone; other systems know no such thing."""


def _prefix(base: str) -> str:
    """Return how the temporary files of a target begin; 50 characters are at most 200 of a name's 255 bytes."""
    return f".{base[:50]}."


def _is_alive(process: int) -> bool:
    """Return whether a process may still be at work; where the system cannot be asked without harm, it may."""
    if os.name == "nt":  # there, to send signal 0 ends a process
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def sync_directory(directory: str) -> None:
    """Have a rename reach the disk, where the system can."""
    with contextlib.suppress(OSError):
        descriptor = os.open(directory or ".", os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def refuse_foreign(path: str, is_ours: Callable[[bytes], bool]) -> None:
    """Stop if something lies at `path`, a name that the user did not give, that is not ours by its content."""
    if not os.path.lexists(path):
        return
    if not os.path.isfile(path) or not is_ours(beginning_of(path)):
        help = "name another output, or move that file elsewhere"
        raise HalpipeError(FOREIGN_FILE("holds what halpipe did not write there", at=Location(path), help=help))


def write_beside(contents: Mapping[str, bytes], *named: str) -> None:
    """Write outputs, of which only those that are `named` were named by the user.

    The others replace no file of another making, which is known by its first line.
    """
    for name, content in contents.items():
        if name not in named:
            refuse_foreign(name, partial(_begins_alike, content))
    write_outputs(contents)


def _begins_alike(one: bytes, other: bytes) -> bool:
    return one.partition(b"\n")[0] == other.partition(b"\n")[0]


def remove_output(path: str) -> None:
    """Remove a file that is no longer of use, if it is there and the system lets us."""
    with contextlib.suppress(OSError):
        os.unlink(path)
