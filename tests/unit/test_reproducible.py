"""Built twice, in two folders, the wheel and the source distribution have the same bytes."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NEEDED = (
    "src",
    "docs",
    "examples",
    "tests/README.md",
    "pyproject.toml",
    "hatch_build.py",
    "build_native.py",
    "README.md",
)
NEEDED += ("LICENSE",)


def built(place):
    place.mkdir()
    for name in NEEDED:
        source, target = ROOT / name, place / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__", "*.so", "out"))
        else:
            shutil.copy(source, target)
    environment = {key: value for key, value in os.environ.items() if key not in ("SOURCE_DATE_EPOCH", "PYTHONPATH")}
    command = [sys.executable, "-m", "hatchling", "build", "-d", "made"]
    subprocess.run(command, cwd=place, env=environment, check=True, capture_output=True)
    return {path.name: path.read_bytes() for path in (place / "made").iterdir()}


@pytest.mark.slow  # nothing quicker has the subject: both archives are built twice
def test_wheel_and_source_distribution_are_the_same_bytes(tmp_path):
    pytest.importorskip("hatchling")
    one, two = built(tmp_path / "a"), built(tmp_path / "a folder of another name")
    assert {Path(name).suffix for name in one} == {".whl", ".gz"}
    assert one == two
