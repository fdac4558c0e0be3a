"""The border between Python and the compiled kernel: what is compiled, and how it is called.

An entry point is compiled at its first call and kept as machine code for the next run, which calls it as it would call
C. Only to compile is numba needed: its import and set-up take longer than most searches.
"""

from __future__ import annotations

from functools import wraps
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from halpipe.pipeline.solve.kernel.registry import ENTRIES, WORDS_PER_FIELD

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

F = TypeVar("F", bound="Callable[..., Any]")

_lock = Lock()


def entry_point(function: F) -> F:
    """Compile a function that is called from Python, with all that it uses.

    Arguments are tables, arrays of 64 bit integers and integers, of the same kinds in every call. The answer is an
    integer, 0 if the function returns nothing.
    """
    native: list[Callable[..., int]] = []

    @wraps(function)
    def call(*arguments: Any) -> int:
        if not native:
            with _lock:
                if not native:
                    native.append(_prepared(function, arguments))
        held: list[NDArray[np.int64]] = []
        return native[0](*_words(arguments, held))

    ENTRIES[call] = function
    return call  # type: ignore[return-value]


def _prepared(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Callable[..., int]:
    from halpipe.pipeline.solve.kernel.machine_code import kept_or_made, ready

    def make() -> tuple[str, bytes]:
        from halpipe.pipeline.solve.kernel.compiler import compile_entry

        return compile_entry(function, arguments)

    words = len(list(_words(arguments, [])))
    return ready(*kept_or_made(function, _layout(arguments), make), words)


def _layout(value: Any) -> str:
    """Return what compiled code takes for granted of its arguments: the fields of tables, the kinds of arrays."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype.str}*{value.ndim}"
    if not isinstance(value, tuple):
        return "integer"
    names = getattr(value, "_fields", range(len(value)))
    return "({})".format(", ".join(f"{name}: {_layout(field)}" for name, field in zip(names, value, strict=True)))


def _words(arguments: tuple[Any, ...], held: list[NDArray[np.int64]]) -> Iterator[int]:
    """Return the machine words of a call; tables made for it are `held` until it ends."""
    for argument in arguments:
        if isinstance(argument, tuple):
            held.append(addresses(argument))
            yield _address(held[-1])
        elif isinstance(argument, np.ndarray):
            yield from (_address(argument), *(*argument.shape, 0)[:2])
        else:
            yield int(argument)


def addresses(values: tuple[Any, ...]) -> NDArray[np.int64]:
    """Return the table of a NamedTuple; it is good as long as the arrays live."""
    table = np.zeros((len(values), WORDS_PER_FIELD), np.int64)
    for row, value in zip(table, values, strict=True):
        if isinstance(value, np.ndarray):
            row[0] = _address(value)
            row[1 : 1 + value.ndim] = value.shape
        else:
            row[0] = value
    return table


def _address(array: NDArray[Any]) -> int:
    address: int = array.__array_interface__["data"][0]
    return address
