"""Folders of large binary input: found without following links, and mapped instead of read."""

from __future__ import annotations

import mmap
import os
from contextlib import contextmanager
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.files.reading import CANNOT_READ, raise_it, reason, refuse_more_than

if TYPE_CHECKING:
    from collections.abc import Iterator

MOST_FOLDERS = 10_000


def folders_with(root: str, name: str) -> list[str]:
    """Return the folders in and below `root` that hold a file called `name`; none if `root` is no folder.

    Raise `HalpipeError` if one cannot be read, or if there are more than `MOST_FOLDERS` to look into.
    """
    found: list[str] = []
    try:
        for count, (folder, below, files) in enumerate(_walk(root), 1):
            refuse_more_than(MOST_FOLDERS, count, "folders", Location(root))
            below.sort()
            if name in files:
                found.append(folder)
    except OSError as failure:
        help = "let yourself read the folder, or name the one that the tracer wrote"
        raise HalpipeError(CANNOT_READ(reason(failure), at=Location(failure.filename or root), help=help)) from None
    return found


def _walk(root: str) -> Iterator[tuple[str, list[str], list[str]]]:
    return os.walk(root, onerror=raise_it) if os.path.isdir(root) else iter(())


def plain_files(folder: str) -> list[str]:
    """Return the paths of the files in a folder that are not empty, hidden, or links, by name."""
    paths = [os.path.join(folder, name) for name in sorted(os.listdir(folder)) if not name.startswith(".")]
    return [path for path in paths if os.path.isfile(path) and not os.path.islink(path) and os.path.getsize(path)]


@contextmanager
def mapped(path: str) -> Iterator[mmap.mmap]:
    """Give the bytes of a file that is not empty, without holding them in memory."""
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        yield data
