"""Calls of the operating system that fail: the k-th that halpipe makes to open, write, sync or move files."""

from __future__ import annotations

import builtins
import errno
import os
import shutil
import sys
from contextlib import ExitStack, contextmanager
from unittest import mock

SITES = (
    "open",
    "fsync",
    "replace",
    "rename",
    "unlink",
    "mkdir",
    "makedirs",
    "listdir",
    "stat",
    "fchmod",
    "rmdir",
    "walk",
)


class Faults:
    """Counts the calls; `fatal` is the number of the one that fails, 0 for none."""

    def __init__(self, fatal=0, code=errno.EIO):
        self.fatal, self.code = fatal, code
        self.calls = []

    def meet(self, site):
        """Count a call; raise if it is the one."""
        self.calls.append(site)
        if len(self.calls) == self.fatal:
            raise OSError(self.code, os.strerror(self.code))


class Stream:
    """A file whose writes are counted."""

    def __init__(self, stream, faults):
        self._stream, self._faults = stream, faults

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._stream.close()

    def __getattr__(self, name):
        return getattr(self._stream, name)

    def write(self, content):
        """Write half of it where the call fails, as a full disk does."""
        try:
            self._faults.meet("write")
        except OSError:
            self._stream.write(content[: len(content) // 2])
            raise
        return self._stream.write(content)


@contextmanager
def failing(faults):
    """Have calls made from halpipe's own modules fail; those of Python's library are its own affair."""

    def is_ours(frame):
        return frame.f_globals.get("__name__", "").startswith("halpipe.core.files")

    def counted(site, real):
        def call(*arguments, **options):
            if is_ours(sys._getframe(1)):
                faults.meet(site)
            return real(*arguments, **options)

        return call

    real_open, real_fdopen = builtins.open, os.fdopen

    def opened(*arguments, **options):
        if not is_ours(sys._getframe(1)):
            return real_open(*arguments, **options)
        faults.meet("open")
        stream = real_open(*arguments, **options)
        return Stream(stream, faults) if "b" in str(arguments[1:]) and "r" not in str(arguments[1:2]) else stream

    def fdopened(*arguments, **options):
        return Stream(real_fdopen(*arguments, **options), faults)

    with ExitStack() as stack:
        for site in SITES:
            stack.enter_context(mock.patch.object(os, site, counted(site, getattr(os, site))))
        stack.enter_context(mock.patch.object(shutil, "rmtree", counted("rmtree", shutil.rmtree)))
        stack.enter_context(mock.patch.object(builtins, "open", opened))
        stack.enter_context(mock.patch.object(os, "fdopen", fdopened))
        yield
