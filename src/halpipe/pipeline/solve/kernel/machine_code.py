"""Machine code of entry points: kept in the user's cache, and made ready to be called.

What is kept is an object file as a compiler writes it, without any reference to Python or numba. Its name has the hash
of all source files of the kernel, the layout of its arguments and the kind of processor in it, and its first line the
hash of what follows.
"""

from __future__ import annotations

import ctypes
import sys
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import llvmlite.binding as llvm

from halpipe.caches import cache_folder, is_ours, keep

if TYPE_CHECKING:
    from collections.abc import Callable

_DONE = 0
"""The status that a function compiled by numba returns, unless it failed."""

_HASH_DIGITS = 64

VERSIONS = 8
"""So many versions of a function are kept: those of several installations, and of kinds of processors."""

_engines: list[Any] = []
"""They own the machine code in memory, for as long as the process lives."""


def kept_or_made(function: Callable[..., Any], layout: str, make: Callable[[], tuple[str, bytes]]) -> tuple[str, bytes]:
    """Return symbol and object file of a function, from the cache if it is there; what `make` returned goes there.

    `layout` tells what it takes for granted of its arguments; sources, system and processor are looked up here.
    """
    folder = cache_folder("kernel")
    if folder is None:
        return make()
    place = folder / f"{function.__name__}-{_version(Path(function.__code__.co_filename), layout)}.o"
    found = _read(place)
    if found is None:
        found = make()
        symbol, code = found
        content = symbol.encode() + b"\n" + code
        keep(place, sha256(content).hexdigest().encode() + b"\n" + content)
        _forget_oldest(folder, function.__name__)
    return found


def _read(place: Path) -> tuple[str, bytes] | None:
    if not is_ours(place):
        return None
    try:
        content = place.read_bytes()
    except OSError:
        return None
    digest, rest = content[:_HASH_DIGITS], content[_HASH_DIGITS + 1 :]
    if sha256(rest).hexdigest().encode() != digest:
        return None
    symbol, _, code = rest.partition(b"\n")
    return symbol.decode(), code


def _forget_oldest(folder: Path, name: str) -> None:
    """Remove what a version of halpipe left behind that is no longer used."""
    with suppress(OSError):
        for old in sorted(folder.glob(f"{name}-*.o"), key=lambda place: place.stat().st_mtime_ns)[:-VERSIONS]:
            old.unlink()


@cache
def _version(source: Path, layout: str) -> str:
    """Return what the machine code of a function in `source` depends on, as a hash."""
    files = sorted({source, *Path(__file__).parent.glob("*.py")})
    parts = [sha256(file.read_bytes()).hexdigest() for file in files]
    parts += [
        layout,
        sys.platform,
        llvm.get_process_triple(),
        llvm.get_host_cpu_name(),
        llvm.get_host_cpu_features().flatten(),
    ]
    return sha256("\n".join(parts).encode()).hexdigest()[:32]


def ready(symbol: str, code: bytes, words: int) -> Callable[..., int]:
    """Load an object file; return the function at `symbol`, which takes so many 64 bit words, without Python's lock."""
    _initialise()
    machine = llvm.Target.from_default_triple().create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    kinds = [ctypes.c_void_p, ctypes.c_void_p, *[ctypes.c_int64] * words]
    native = ctypes.CFUNCTYPE(ctypes.c_int32, *kinds)(engine.get_function_address(symbol))

    def call(*arguments: int) -> int:
        answer, failure = ctypes.c_int64(), ctypes.c_void_p()
        status = native(ctypes.byref(answer), ctypes.byref(failure), *arguments)
        if status != _DONE:
            raise ArithmeticError(f"{symbol} ended with status {status}")
        return answer.value

    return call


@cache
def _initialise() -> None:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
