"""Libraries written in C, each beside its sources; they are built when halpipe is (`build_native.py`), never by it."""

from __future__ import annotations

import ctypes
import sys
from array import array
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError, error

if TYPE_CHECKING:
    from collections.abc import Iterable

NOT_BUILT = error(
    "HAL0941",
    "Native library or schema is missing or out of date",
    "halpipe brings small libraries in C and JSON schemas for editors, which are built when halpipe is installed. In a "
    "working copy whose C sources have changed they have to be built again.",
)

INTEGER, POINTER = ctypes.c_int64, ctypes.c_void_p

SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")

PACKAGE = Path(__file__).parents[1]
BUILDER = PACKAGE.parents[1] / "build_native.py"
"""Builds the libraries in place; it is there in a working copy only."""


@cache
def library(folder: Path, name: str) -> ctypes.CDLL:
    """Return the library that was built from the sources in a folder; raise `HalpipeError` if it was not.

    Its functions are called without the interpreter's lock.
    """
    place = folder / f"{name}{SUFFIX}"
    try:
        loaded = ctypes.CDLL(str(place))
        built_from = ctypes.c_char.in_dll(loaded, "halpipe_fingerprint")
    except (OSError, ValueError) as failure:
        raise not_built(f'the library "{name}" cannot be loaded ({failure})') from None
    if ctypes.string_at(ctypes.addressof(built_from)) != fingerprint(folder).encode():
        raise not_built(f'the library "{name}" was built from other sources than those beside it')
    return loaded


def function(folder: Path, name: str, call: str) -> Any:
    """Return a function of a library; its answer, where there is one, is an integer."""
    native = library(folder, name)[call]
    native.restype = INTEGER
    return native


def words(members: Iterable[Any]) -> ctypes.Array[ctypes.c_int64]:
    """Return a struct: the addresses of arrays, and integers. It is good as long as the arrays live."""
    values = [member if isinstance(member, int) else address(member) for member in members]
    return (INTEGER * len(values))(*values)


def address(values: Any) -> int:
    """Return where an array, or the one of a table, begins; libraries take arrays of 64 bit integers only."""
    held = getattr(values, "flat", values)
    if not isinstance(held, array) or held.typecode not in "qQ":
        raise TypeError("libraries take arrays of 64 bit integers")
    return held.buffer_info()[0]


def fingerprint(folder: Path) -> str:
    """Return what the C sources in a folder hash to, however their lines end; a library has it in it."""
    sources = sorted(path for path in folder.iterdir() if path.suffix in (".c", ".h"))
    content = b"\0".join(path.name.encode() + b"\0" + path.read_bytes() for path in sources)
    return sha256(content.replace(b"\r\n", b"\n")).hexdigest()[:32]


def not_built(what: str) -> HalpipeError:
    """Return the refusal of what an installation builds."""
    help = f"run: python {BUILDER}" if BUILDER.is_file() else "install halpipe again"
    return HalpipeError(NOT_BUILT(what, help=help))
