"""How the kernel is compiled: machine code at the first call, kept on disk for the next."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from numba import njit

if TYPE_CHECKING:
    from collections.abc import Callable

_FILES = [path.stat() for path in sorted(Path(__file__).parent.glob("*.py"))]
STAMP = (max(file.st_mtime for file in _FILES), sum(file.st_size for file in _FILES))

F = TypeVar("F", bound="Callable[..., object]")


def compiled(function: F) -> F:
    """Compile a function of the kernel; it runs without the interpreter's lock, so that Ctrl-C and threads work.

    The kernel allocates nothing. Without ``_nrt=False`` numba would count references on every use of an array
    of `Arrays` or `State`, which was measured to make the search six times slower.
    """
    options: dict[str, Any] = {"cache": True, "nogil": True, "_nrt": False}
    jitted = njit(**options)(function)
    _renew_with_any_file(jitted)
    return jitted  # type: ignore[no-any-return]


def _renew_with_any_file(jitted: Any) -> None:
    """Make the kept machine code of a function stale when any file of the kernel changes, not only its own.

    Functions of the kernel are compiled into their callers, of which numba's cache knows nothing.
    """
    kept: Any = getattr(getattr(jitted, "_cache", None), "_cache_file", None)
    if hasattr(kept, "_source_stamp"):
        kept._source_stamp = STAMP  # noqa: SLF001 - numba offers no public way
