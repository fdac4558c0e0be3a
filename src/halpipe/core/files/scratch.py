"""Temporary folders for input of other programs; a full disk is reported as such."""

from __future__ import annotations

import atexit
import contextlib
import errno
import os
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files.reading import reason
from halpipe.core.files.writing import CANNOT_WRITE

if TYPE_CHECKING:
    from collections.abc import Iterator

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS)


@contextmanager
def scratch_folder() -> Iterator[str]:
    """Make a folder for temporary files and remove it in the end; raise `HalpipeError` where there is no room for them.

    Other files are read and written by this package, which tells their failures itself, so what fails for want of room
    meanwhile was to go into the folder.
    """
    import tempfile  # few commands need it

    try:
        folder = tempfile.mkdtemp(prefix="halpipe-")
    except OSError as failure:
        if failure.errno in (errno.EMFILE, errno.ENFILE):
            raise
        raise _no_room(failure) from None
    remove = partial(_remove, folder)
    atexit.register(remove)  # for a second time, where there is no memory left to do it now
    try:
        yield folder
    except OSError as failure:
        if failure.errno in _NO_ROOM:
            raise _no_room(failure) from None
        raise
    finally:
        remove()
        atexit.unregister(remove)


def _no_room(failure: OSError) -> HalpipeError:
    help = "make room for them, or set TMPDIR to a folder that has room and that you may write to"
    return HalpipeError(CANNOT_WRITE(f"temporary files cannot be written: {reason(failure)}", help=help))


def _remove(folder: str) -> None:
    """Remove a folder with one open file at a time, since there may be no more."""
    with contextlib.suppress(OSError):
        for within, folders, files in os.walk(folder, topdown=False):
            for name in files:
                _discard(os.path.join(within, name))
            for name in folders:
                _discard(os.path.join(within, name))
        os.rmdir(folder)


def _discard(path: str) -> None:
    with contextlib.suppress(OSError):
        if os.path.isdir(path) and not os.path.islink(path):
            os.rmdir(path)
        else:
            os.unlink(path)
