"""The same bytes whatever the hash seed, the locale, the time zone, the order of folders, and the time of a build."""

import contextlib
import os
import shutil
import subprocess
import sys
from pathlib import Path
from unittest import mock

import pytest
from test_cli_regulator import PLATFORM

from command_line import run_here
from halpipe.exporters.native import format_model
from support import small_model

ROOT = Path(__file__).parents[2]
SYSTEM = ROOT / "src" / "halpipe" / "selftest" / "systems" / "modes.xml"
PAIR = "model.xml out/s.xml"
COMMANDS = (
    "schedule model.xml -o out/s.xml -q",
    *(f"export {kind} {PAIR} -o out/x.{kind} -q" for kind in ("report", "graph", "amalthea", "arxml", "trace", "btf")),
    f"export linux {PAIR} --busy 50 -o out/linux -q",
    "import arxml out -o out/m.xml --report out/i.json",
    f"sensitivity {PAIR}",
    "validate model.xml --format json",
)
"""What they say counts as well; test_cli_selftest.py has the evidence."""


def surroundings():
    """Return environments: other hashes, every locale that is installed, another time zone, another width."""
    installed = subprocess.run(["locale", "-a"], capture_output=True, text=True, check=False).stdout.split()
    others = [{"LC_ALL": name} for name in installed if name not in ("C", "POSIX")][:4]
    for number, more in enumerate([{"LC_ALL": "C"}, *others, {"TZ": "Asia/Kathmandu", "COLUMNS": "200"}]):
        yield {"PYTHONHASHSEED": str(number), **more}


def made(folder, environment):
    """Return all that commands write and say."""
    (folder / "out").mkdir(parents=True)
    shutil.copy(SYSTEM, folder / "model.xml")
    said = b""
    for command in COMMANDS:
        done = subprocess.run(
            [sys.executable, "-m", "halpipe", *command.split()],
            cwd=folder, env={**os.environ, **environment}, capture_output=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, (command, done.stderr)
        said += done.stdout + done.stderr
    return {"said": said, **contents(folder)}


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.slow
def test_surroundings_change_no_byte(tmp_path):
    one, *others = (made(tmp_path / str(n), around) for n, around in enumerate(surroundings()))
    assert len(one) > 20
    assert len(others) >= 2
    for other in others:
        assert other == one


# ------------------------------------------------------------------------------------------------ orders of folders


class Turned:
    """Entries of a folder, the last first."""

    def __init__(self, found):
        with found:
            self._entries = sorted(found, key=lambda entry: entry.name, reverse=True)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def __iter__(self):
        return iter(self._entries)

    def __next__(self):
        if not self._entries:
            raise StopIteration
        return self._entries.pop(0)

    def close(self):
        """Nothing is open."""


@contextlib.contextmanager
def turned(turn):
    """Have the entries of every folder come in order, or in the opposite one."""
    scandir, listdir = os.scandir, os.listdir
    with (
        mock.patch("os.scandir", (lambda path=".": Turned(scandir(path))) if turn else scandir),
        mock.patch("os.listdir", lambda path=".": sorted(listdir(path), reverse=turn)),
    ):
        yield


@pytest.fixture
def sources(tmp_path):
    """Folders with several files of each kind that is read by the folder."""
    place = tmp_path / "work"
    for name in ("arxml", "amalthea", "out"):
        (place / name).mkdir(parents=True)
    (place / "model.xml").write_bytes(format_model(small_model()))
    (place / "platform.yaml").write_text(PLATFORM)
    assert run_here(place, "schedule", "model.xml", "-o", "s.xml", "-q").returncode == 0
    for kind, end in (("arxml", "arxml"), ("amalthea", "amxmi")):
        exported = run_here(place, "export", kind, "model.xml", "s.xml", "-o", f"{kind}/one.{end}", "-q")
        assert exported.returncode == 0
        (place / kind / "deep").mkdir()
        for copy in ("deep/zero", "two", "three"):
            shutil.copy(place / kind / f"one.{end}", place / kind / f"{copy}.{end}")
    return place


def test_folders_are_turned(sources):
    with turned(True):
        assert [path.name for path in (sources / "arxml").iterdir()] == [
            "two.arxml",
            "three.arxml",
            "one.arxml",
            "deep",
        ]


@pytest.mark.parametrize("kind", ["arxml", "amalthea"])
def test_the_order_of_a_folder_changes_no_byte(sources, kind):
    """The files define the same things, so that it matters which is read first: it is told in order, too."""
    found = []
    for turn in (False, True):
        with turned(turn):
            done = run_here(sources, "import", kind, kind, "-o", "out/m.xml", "--report", "out/i.json")
        found.append((done.returncode, done.stdout, done.stderr, contents(sources / "out")))
    assert found[0] == found[1]
    assert "deep/zero" in found[0][1] + found[0][2] + str(found[0][3])


# ------------------------------------------------------------------------------------------------ bundles


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bundles")
    shutil.copytree(ROOT / "examples" / "roboracer", folder / "w", ignore=shutil.ignore_patterns("out"))
    shutil.copytree(ROOT / "examples" / "platforms", folder / "platforms")
    assert run_here(folder / "w", "run", "pipeline.yaml", "-q").returncode == 0
    return folder / "w"


def built(example, place, words, number):
    """Build a bundle in a copy of its sources, with folders turned every other time."""
    shutil.copytree(example, place / "w")
    shutil.copytree(example.parent / "platforms", place / "platforms")
    with turned(bool(number)):
        done = run_here(place / "w", "export", *words.split(), "-o", "bundle", "-q")
    assert done.returncode == 0, done.stderr
    return contents(place / "w" / "bundle")


PAIR_OF_EXAMPLE = "out/model.xml out/schedule.xml"
BUNDLES = {
    "linux": f"linux {PAIR_OF_EXAMPLE} --sources .",
    "regulator": f"regulator {PAIR_OF_EXAMPLE} --platform ../platforms/cores-table.yaml",
    "riscv": f"riscv {PAIR_OF_EXAMPLE} --sources .",
    "riscv with regulator": f"riscv {PAIR_OF_EXAMPLE} --sources . --regulator ../platforms/cores-table.yaml",
}


@pytest.mark.slow  # test_surroundings_change_no_byte builds a small one, test_regulator_backends.py every backend
@pytest.mark.parametrize("kind", BUNDLES)
def test_a_bundle_built_twice_in_two_places_has_the_same_bytes(example, tmp_path, kind):
    if "riscv" in kind:
        pytest.importorskip("ziglang", reason="pip install ziglang pyelftools unicorn")
    one, other = (built(example, tmp_path / name, BUNDLES[kind], n) for n, name in enumerate(("one", "a longer name")))
    assert "manifest.json" in one
    assert one == other
