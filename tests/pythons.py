"""Every Python from 3.11 to 3.14 that is found: the wheel, tests of readers and checkers, and the same bytes from all.

Looks for python3.11 .. python3.14 on the path and below PYTHONS (folders with versions, as pyenv has them).
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
VERSIONS = ("3.11", "3.12", "3.13", "3.14")
TESTS = (
    *("tests/unit/importers", "tests/unit/pipeline", "tests/unit/exporters", "tests/unit/core/test_durations.py"),
    *("tests/unit/core/test_files_xml.py", "tests/unit/core/test_files_yaml.py", "tests/unit/test_second_checker.py"),
)


def interpreters() -> dict[str, str]:
    """Return a program for each version that is there."""
    found = {}
    for version in VERSIONS:
        below = [path for folder in os.environ.get("PYTHONS", "").split(os.pathsep) if folder
                 for path in sorted(Path(folder).glob(f"{version}*/bin/python3"))]  # fmt: skip
        program = below[-1] if below else shutil.which(f"python{version}")
        if program:
            found[version] = str(program)
    return found


def outputs(python: Path, place: Path) -> str:
    """Return one hash of what a Python makes of the example: schedule, report, graph, traces, a bundle."""
    place.mkdir()
    model, schedule = str(ROOT / "src/halpipe/selftest/systems/modes.xml"), str(place / "s.xml")
    commands = [["schedule", model, "-o", schedule, "-q"]]
    formats = {"report": "html", "graph": "dot", "trace": "json", "btf": "btf", "arxml": "arxml", "amalthea": "amxmi"}
    commands += [
        ["export", name, model, schedule, "-o", str(place / f"x.{end}"), "-q"] for name, end in formats.items()
    ]
    commands.append(["export", "linux", model, schedule, "--busy", "50", "-o", str(place / "linux"), "-q"])
    for command in commands:
        subprocess.run([python, "-m", "halpipe", *command], check=True, cwd=place)
    made = {str(path.relative_to(place)): path.read_bytes() for path in place.rglob("*") if path.is_file()}
    return hashlib.sha256(b"".join(name.encode() + b"\0" + made[name] for name in sorted(made))).hexdigest()


def main() -> int:
    """Try each."""
    failed, made = [], {}
    with tempfile.TemporaryDirectory(prefix="halpipe-pythons-") as place:
        for version, program in interpreters().items():
            home = Path(place, version)
            subprocess.run([program, "-m", "venv", home], check=True)
            python = home / "bin" / "python"
            pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
            subprocess.run([*pip, str(ROOT), "pytest", "hypothesis"], check=True)
            made[version] = outputs(python, Path(place, f"outputs-{version}"))
            command = [python, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not slow", *TESTS]
            code = subprocess.run(command, cwd=ROOT, check=False).returncode
            failed += [version] if code else []
            print(f"Python {version}: {'FAILED' if code else 'ok'}, outputs {made[version][:16]}", flush=True)
    missing = [version for version in VERSIONS if version not in made]
    if missing:
        print(f"not found: {', '.join(missing)}")
    if len(set(made.values())) > 1:
        print(f"THE OUTPUTS DIFFER: {made}")
    return 1 if failed or len(set(made.values())) > 1 or not made else 0


if __name__ == "__main__":
    sys.exit(main())
