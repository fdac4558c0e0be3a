"""Make a system description as large as a vehicle's of copies of a project, import it, and say what that took.

    python benchmarks/vehicle.py PROJECT_DIR --copies 119 [--one-file]

Each copy is put into a package of its own, and every path in it, so that all elements are different ones. One list of
modules (ECUC-VALUE-COLLECTION), in place of those of the copies, makes their configurations those of one ECU.
"""

from __future__ import annotations

import argparse
import re
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from lxml import etree

from halpipe.importers.arxml.files.words import NS, path_of

_PATH = re.compile(rb">(\s*)/(?=[A-Za-z_])")
_COLLECTION = re.compile(rb"<ECUC-VALUE-COLLECTION\b.*?</ECUC-VALUE-COLLECTION>", re.DOTALL)
_MODULE = "ECUC-MODULE-CONFIGURATION-VALUES"
_LIST, _END = b"<AR-PACKAGES>", b"</AR-PACKAGES>"
_HEAD = b'<AUTOSAR xmlns="http://autosar.org/schema/r4.0">\n'


def main() -> None:
    """Make the copies in a temporary folder, and import them in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("project", type=Path, help="folder with .arxml files")
    parser.add_argument("--copies", type=int, default=119)
    parser.add_argument("--one-file", action="store_true", help="all copies in one file")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="halpipe-vehicle-") as folder:
        files, size = _make(chosen.project, Path(folder), chosen.copies, one_file=chosen.one_file)
        _import(Path(folder), files, size)


def _make(project: Path, folder: Path, copies: int, *, one_file: bool) -> tuple[int, int]:
    """Write the copies; return how many files and bytes they are."""
    contents = [(path.relative_to(project), path.read_bytes()) for path in sorted(project.rglob("*.arxml"))]
    if one_file:
        target = folder / "vehicle.arxml"
        with target.open("wb") as stream:
            stream.write(_HEAD + _LIST)
            for number in range(copies):
                for _, data in contents:
                    stream.write(_renamed(data, number)[1])
            stream.write(_one_ecu(contents, copies) + _END + b"\n</AUTOSAR>\n")
    else:
        for number in range(copies):
            for name, data in contents:
                head, inside, tail = _renamed(data, number)
                target = folder / f"copy{number}" / name
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(head + _LIST + inside + _END + tail)
        (folder / "ecu.arxml").write_bytes(_HEAD + _LIST + _one_ecu(contents, copies) + _END + b"\n</AUTOSAR>\n")
    written = [path.stat().st_size for path in folder.rglob("*.arxml")]
    return len(written), sum(written)


def _renamed(data: bytes, number: int) -> tuple[bytes, bytes, bytes]:
    """Return what is before, in and after the packages of a file, which are in a package of the copy."""
    begin, end = data.find(_LIST), data.rfind(_END) + len(_END)
    package = f"Copy{number}".encode()
    inside = _COLLECTION.sub(b"", _PATH.sub(rb">\1/" + package + b"/", data[begin:end]))
    return (
        data[:begin],
        b"<AR-PACKAGE><SHORT-NAME>" + package + b"</SHORT-NAME>" + inside + b"</AR-PACKAGE>",
        data[end:],
    )


def _one_ecu(contents: list[tuple[Path, bytes]], copies: int) -> bytes:
    """Return a package with the list of the module configurations of all copies."""
    roots = [etree.fromstring(data) for _, data in contents]
    modules = {path_of(module) for root in roots for module in root.iter(f"{NS}{_MODULE}")}
    paths = (f"/Copy{number}{path}" for number in range(copies) for path in sorted(modules))
    refs = "".join(
        f"<{_MODULE}-REF-CONDITIONAL><{_MODULE}-REF>{p}</{_MODULE}-REF></{_MODULE}-REF-CONDITIONAL>" for p in paths
    )
    inside = f"<SHORT-NAME>Modules</SHORT-NAME><ECUC-VALUES>{refs}</ECUC-VALUES>"
    collection = f"<ELEMENTS><ECUC-VALUE-COLLECTION>{inside}</ECUC-VALUE-COLLECTION></ELEMENTS>"
    return f"<AR-PACKAGE><SHORT-NAME>One</SHORT-NAME>{collection}</AR-PACKAGE>".encode()


def _import(folder: Path, files: int, size: int) -> None:
    command = [sys.executable, "-m", "halpipe", "import", "arxml", str(folder), "-o", str(folder / "model.xml"), "-q"]
    done = subprocess.run(command, check=False, stderr=subprocess.DEVNULL)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(
        f"{size / 1e6:.0f} MB in {files} files: exit code {done.returncode}, "
        f"{used.ru_utime + used.ru_stime:.1f} s of processor, {used.ru_maxrss / 1e3:.0f} MB of memory"
    )


if __name__ == "__main__":
    main()
