"""How the kernel is compiled: machine code at the first call, kept on disk for the next."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from numba import njit
from numba.extending import register_jitable

if TYPE_CHECKING:
    from collections.abc import Callable

_FILES = [path.stat() for path in sorted(Path(__file__).parent.glob("*.py"))]
STAMP = (max(file.st_mtime for file in _FILES), sum(file.st_size for file in _FILES))

F = TypeVar("F", bound="Callable[..., object]")

_OPTIONS: dict[str, Any] = {"nogil": True, "_nrt": False, "no_cfunc_wrapper": True}
"""Without the interpreter's lock, so that Ctrl-C and threads work. The kernel allocates nothing, so it needs no
reference counts, which would be kept at every use of an array."""


def compiled(function: F) -> F:
    """Compile a function wherever an `entry_point` uses it; called from Python it stays Python.

    Wrappers for other callers, of which there are none, would be half of what there is to compile.
    """
    register: Any = register_jitable(no_cpython_wrapper=True, **_OPTIONS)
    return register(function)  # type: ignore[no-any-return]


def entry_point(function: F) -> F:
    """Compile a function that is called from Python, with all that it uses, and keep the outcome on disk."""
    jitted = njit(cache=True, **_OPTIONS)(function)
    _renew_with_any_file(jitted)
    return jitted  # type: ignore[no-any-return]


def _renew_with_any_file(jitted: Any) -> None:
    """Make the kept machine code of a function stale when any file of the kernel changes, not only its own.

    Functions of the kernel are compiled into their callers, of which numba's cache knows nothing.
    """
    kept: Any = getattr(getattr(jitted, "_cache", None), "_cache_file", None)
    if hasattr(kept, "_source_stamp"):
        kept._source_stamp = STAMP  # noqa: SLF001 - numba offers no public way
