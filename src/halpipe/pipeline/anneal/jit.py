"""How the kernel is compiled: machine code at the first call, kept on disk for the next."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from numba import njit

if TYPE_CHECKING:
    from collections.abc import Callable

F = TypeVar("F", bound="Callable[..., object]")


def compiled(function: F) -> F:
    """Compile a function of the kernel; it runs without the interpreter's lock, so that Ctrl-C and threads work.

    The kernel allocates nothing. Without ``_nrt=False`` numba would count references on every use of an array
    of `Arrays` or `State`, which was measured to make the search six times slower.
    """
    options: dict[str, Any] = {"cache": True, "nogil": True, "_nrt": False}
    jitted: F = njit(**options)(function)
    return jitted
