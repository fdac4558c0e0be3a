"""Libraries written in C, each beside its sources; they are built when halpipe is (`build_native.py`), never by it."""

from __future__ import annotations

import ctypes
import sys
from functools import cache
from hashlib import sha256
from pathlib import Path

from halpipe.core.diagnostics import HalpipeError, error

NOT_BUILT = error(
    "HAL0941",
    "Native library is missing or out of date",
    "halpipe brings a small library in C, which is built when halpipe is installed. In a working copy whose C sources "
    "have changed it has to be built again.",
)

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
        raise _refusal(name, f"cannot be loaded ({failure})") from None
    if ctypes.string_at(ctypes.addressof(built_from)) != fingerprint(folder).encode():
        raise _refusal(name, "was built from other sources than those beside it")
    return loaded


def fingerprint(folder: Path) -> str:
    """Return what the C sources in a folder hash to, however their lines end; a library has it in it."""
    sources = sorted(path for path in folder.iterdir() if path.suffix in (".c", ".h"))
    content = b"\0".join(path.name.encode() + b"\0" + path.read_bytes() for path in sources)
    return sha256(content.replace(b"\r\n", b"\n")).hexdigest()[:32]


def _refusal(name: str, what: str) -> HalpipeError:
    help = f"run: python {BUILDER}" if BUILDER.is_file() else "install halpipe again"
    return HalpipeError(NOT_BUILT(f'the library "{name}" {what}', help=help))
