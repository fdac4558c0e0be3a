"""Runs tests with the libraries in C under the sanitizers: ``python tests/sanitized.py tests/properties``.

The libraries are built anew with gcc's address and undefined-behaviour sanitizers, which end the process at the first
finding. The address sanitizer has to be in the process before Python is, so that it is started again with it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDER = "HALPIPE_SANITIZED"
"""Names the folder of the libraries to the plug-in."""


def main() -> int:
    """Build the libraries, and run pytest with the arguments of this command."""
    sys.path.insert(0, str(ROOT))
    import build_native

    runtime = _runtime()
    if runtime is None:
        print("skipped: gcc with its sanitizers is not installed")  # noqa: T201 - this is a command
        return 0
    os.environ["CC"] = "gcc"
    # Wrapping is what -fwrapv asks for, and what the sanitizer is there to find.
    flags = [flag for flag in build_native.FLAGS if flag not in ("-fwrapv", "-s", "-O2")]
    build_native.FLAGS = (*flags, "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    for system in build_native.SYSTEMS.values():
        object.__setattr__(system, "flags", ())  # the sanitizers need the C library
    with tempfile.TemporaryDirectory() as folder:
        build_native.build(Path(folder))
        surroundings = {
            **os.environ,
            FOLDER: folder,
            "LD_PRELOAD": runtime,
            # Python leaves much to the end of the process; and what pytest captures is lost with the process.
            "ASAN_OPTIONS": f"detect_leaks=0:log_path={folder}/findings",
            "UBSAN_OPTIONS": f"print_stacktrace=1:log_path={folder}/findings",
            "PYTHONMALLOC": "malloc",
            "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT / "tests")]),
        }
        command = [sys.executable, "-m", "pytest", "-p", "sanitized", "-p", "no:xdist", *sys.argv[1:]]
        code = subprocess.run(command, cwd=ROOT, env=surroundings, check=False).returncode
        for report in Path(folder).glob("findings.*"):
            print(report.read_text())  # noqa: T201
        return code


def _runtime() -> str | None:
    """Return gcc's library of the address sanitizer."""
    try:
        done = subprocess.run(["gcc", "-print-file-name=libasan.so"], capture_output=True, text=True, check=False)
    except OSError:
        return None
    found = Path(done.stdout.strip())
    return str(found.resolve()) if found.is_absolute() and found.exists() else None


def pytest_configure() -> None:
    """Put the libraries with sanitizers in the place of those that were installed."""
    import ctypes
    from functools import cache

    from halpipe.core import libraries

    folder = Path(os.environ[FOLDER])
    libraries.library = cache(lambda _, name: ctypes.CDLL(str(folder / f"{name}{libraries.SUFFIX}")))


if __name__ == "__main__":
    sys.exit(main())
