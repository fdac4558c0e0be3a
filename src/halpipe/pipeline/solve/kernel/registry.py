"""What the compiler has to know of: functions that compiled code may call, and what is passed to it as a table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

WORDS_PER_FIELD = 3
"""Address, rows and columns of an array; or an integer."""

F = TypeVar("F", bound="Callable[..., Any]")
T = TypeVar("T", bound="type[tuple[Any, ...]]")

INNER: list[Callable[..., Any]] = []
"""Functions that compiled code may call."""

ENTRIES: dict[Callable[..., Any], Callable[..., Any]] = {}
"""Entry points, as they are called from Python, and the functions that they stand for."""

FIXED: dict[type, bool] = {}
"""The NamedTuples that are passed as tables of addresses, and whether compiled code only reads them."""


def compiled(function: F) -> F:
    """Let an `entry_point` use a function; called from Python it stays Python."""
    INNER.append(function)
    return function


def as_table(cls: T, *, fixed: bool = False) -> T:
    """Let compiled code take instances of a NamedTuple as tables; `fixed` if it never writes to their arrays.

    All instances must have arrays of the same dimensions and types.
    """
    FIXED[cls] = fixed
    return cls
