"""Builds halpipe's libraries in C and its JSON schemas: ``python build_native.py`` puts them into a working copy.

The package does the same when it is installed or made into a wheel (`hatch_build.py`). The compiler is the machine's
own, if it has one that works, else that of the Python package ziglang, which needs nothing of the system. For other
systems it is always the latter: ``python build_native.py --target macos-arm64 FOLDER``.
"""

from __future__ import annotations

import argparse
import functools
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

SOURCE = Path(__file__).resolve().parent / "src"
sys.path.insert(0, str(SOURCE))

from halpipe.core.diagnostics import HalpipeError  # noqa: E402 - it is not installed yet
from halpipe.core.libraries import fingerprint, library  # noqa: E402

LIBRARIES = (
    "halpipe/pipeline/solve/kernel/native/kernel.c",
    "halpipe/pipeline/solve/edf/native/edf.c",
    "halpipe/deploy/riscv/board/native/block.c",
)
"""The one file of each library that is compiled; it includes the others."""

SCHEMAS = "halpipe/schemas"

WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wpedantic")
FLAGS = ("-std=c17", "-O2", "-fwrapv", "-shared", "-fPIC", "-fvisibility=hidden", "-s", *WARNINGS)

ZIG = "ziglang>=0.14"


@dataclass(frozen=True)
class Target:
    """A system that wheels are made for: what zig calls it, and what pip does."""

    triple: str
    tag: str


TARGETS = {
    "linux-x86_64": Target("x86_64-linux-gnu.2.17", "manylinux_2_17_x86_64.musllinux_1_1_x86_64"),
    "linux-aarch64": Target("aarch64-linux-gnu.2.17", "manylinux_2_17_aarch64.musllinux_1_1_aarch64"),
    "macos-x86_64": Target("x86_64-macos.11.0", "macosx_11_0_x86_64"),
    "macos-arm64": Target("aarch64-macos.11.0", "macosx_11_0_arm64"),
    "windows-x86_64": Target("x86_64-windows-gnu", "win_amd64"),
}


@dataclass(frozen=True)
class System:
    """How a family of systems calls a library, and what it is linked with.

    Of the C library, the sources use memmove alone, which every process on Linux has, whichever C library it uses: so
    nothing is linked, and one file serves all. On Windows it comes from the system without what mingw puts around it.
    """

    suffix: str
    flags: tuple[str, ...] = ()


SYSTEMS = {
    "linux": System(".so", ("-nostdlib",)),
    "macos": System(".dylib"),
    "windows": System(".dll", ("-nostdlib", "-Wl,--no-entry", "-lucrtbase")),
}


class BuildError(Exception):
    """A library cannot be built; the text says why."""


def build(folder: Path, target: str = "") -> dict[str, Path]:
    """Build all libraries into a folder, for this system or for a `target`; return them by their place in the package.

    Raise `BuildError` with what the compiler said.
    """
    folder.mkdir(parents=True, exist_ok=True)
    made = {}
    for place in LIBRARIES:
        name = Path(place).with_suffix(system(target).suffix)
        made[name.as_posix()] = folder / name.name
        _compile(SOURCE / place, folder / name.name, target)
    return made


def system(target: str) -> System:
    """Return the family of a target, or of this machine."""
    name = target.partition("-")[0] or {"win32": "windows", "darwin": "macos"}.get(sys.platform, "linux")
    return SYSTEMS[name]


def tag(target: str) -> str:
    """Return what pip calls wheels for a target, or for this machine."""
    if target:
        return TARGETS[target].tag
    own = sysconfig.get_platform().replace("universal2", platform.machine())  # one of the two halves is built
    return own.replace("-", "_").replace(".", "_")


def write_schemas(folder: Path) -> dict[str, Path]:
    """Write the JSON schemas into a folder, and return them by their place in the package.

    The readers of halpipe make them, with the words of the reference pages (docs/editor_schemas.py).
    """
    docs = str(SOURCE.parent / "docs")
    sys.path.insert(0, docs)
    try:
        from editor_schemas import texts
    finally:
        sys.path.remove(docs)
    made = {}
    for name, text in texts().items():
        made[f"{SCHEMAS}/{name}"] = folder / name
        (folder / name).write_bytes(text.encode())
    return made


def in_place() -> list[Path]:
    """Build the libraries beside their sources, and the schemas."""
    with tempfile.TemporaryDirectory() as folder:
        built = build(Path(folder)) | write_schemas(Path(folder))
        return [_replace(made, SOURCE / place) for place, made in built.items()]


def _replace(made: Path, place: Path) -> Path:
    """Put a file in its place in one step, because a process may have the old one open."""
    staged = place.with_name(f"{place.name}.{os.getpid()}")
    shutil.copyfile(made, staged)
    os.replace(staged, place)
    return place


@functools.cache
def own_compiler() -> str | None:
    """Return the machine's C compiler; None if there is none, or none that builds a library with the flags above."""
    if sys.platform == "win32":  # the flags are not those of its compilers
        return None
    candidates = (os.environ.get("CC", ""), "cc", "gcc", "clang")
    return next((path for path in map(shutil.which, filter(None, candidates)) if path and _works(path)), None)


def _works(compiler: str) -> bool:
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "trial.c")
        source.write_text("#include <stdint.h>\nint64_t answer(void) { return 42; }\n")
        command = [compiler, *FLAGS, str(source), "-o", str(source.with_suffix(".so")), *system("").flags]
        try:
            return subprocess.run(command, capture_output=True, check=False).returncode == 0
        except OSError:
            return False


def is_stale() -> bool:
    """Return whether a library is not there or was built from other sources, or there are no schemas."""
    try:
        for place in LIBRARIES:
            library((SOURCE / place).parent, Path(place).stem)
    except HalpipeError:
        return True
    return not any((SOURCE / SCHEMAS).glob("*.json"))


def _compile(source: Path, made: Path, target: str) -> None:
    own = None if target else own_compiler()
    command = [
        *([own] if own else _zig(target)),
        *FLAGS,
        f'-DFINGERPRINT="{fingerprint(source.parent)}"',
        *("-o", str(made), str(source)),
        *system(target).flags,
    ]
    with tempfile.TemporaryDirectory() as scratch:
        caches = {"ZIG_GLOBAL_CACHE_DIR": scratch, "ZIG_LOCAL_CACHE_DIR": scratch}
        done = subprocess.run(command, env={**os.environ, **caches}, capture_output=True, text=True, check=False)
    if done.returncode:
        raise BuildError(f"{source.name} cannot be built: {' '.join(command)}\n{done.stderr}")
    if done.stderr:
        print(done.stderr, file=sys.stderr)


def _zig(target: str) -> list[str]:
    """Return the command of zig's C compiler, for any processor of its kind: by itself, zig takes the one at hand."""
    if find_spec("ziglang") is None:
        raise BuildError(f"there is no C compiler that works; install one, or: pip install '{ZIG}'")
    machine = {"AMD64": "x86_64", "arm64": "arm64"}.get(platform.machine(), platform.machine())
    family = next(name for name, value in SYSTEMS.items() if value == system(target))
    known = TARGETS.get(target or f"{family}-{machine}")
    return [sys.executable, "-m", "ziglang", "cc", *(["-target", known.triple] if known else []), "-mcpu=baseline"]


def main() -> int:
    """Build in place, or for a target into a folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--targets", action="store_true", help="list the systems that can be built for")
    parser.add_argument("--stale", action="store_true", help="do nothing if what is in place is up to date")
    parser.add_argument("--target", choices=TARGETS, default="", help="with a FOLDER: build for this system")
    parser.add_argument("folder", type=Path, nargs="?", help="put the libraries there (default: beside their sources)")
    chosen = parser.parse_args()
    if chosen.target and not chosen.folder:
        parser.error("--target needs a FOLDER")
    if chosen.targets:
        print(*TARGETS, sep="\n")
        return 0
    if chosen.stale and not chosen.folder and not is_stale():
        write_schemas(SOURCE / SCHEMAS)  # their sources are all readers
        return 0
    try:
        made = list(build(chosen.folder, chosen.target).values()) if chosen.folder else in_place()
    except BuildError as failure:
        print(failure, file=sys.stderr)
        return 1
    for path in made:
        print(f"{path} ({path.stat().st_size} bytes)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
