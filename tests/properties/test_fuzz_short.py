"""A short run of what `make fuzz` does for long: every reader gets damaged inputs, and ends as it should."""

import subprocess
import sys
from pathlib import Path

import pytest

import fuzz
from worst_inputs import READERS

TESTS = Path(__file__).parents[1]


@pytest.mark.slow  # the readers' own tests are quicker: test_ros_never_fails.py, test_schemas.py
def test_some_hundred_inputs_of_every_reader(tmp_path):
    command = [sys.executable, str(TESTS / "fuzz.py"), "--inputs", "150", "--seed", "5"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=900)
    assert run.returncode == 0, run.stdout
    assert " 0 failures" in run.stdout


def test_what_goes_wrong_is_told(tmp_path, monkeypatch):
    class Ended:
        returncode, stdout, stderr = 70, "", "internal error"

    monkeypatch.setattr(fuzz, "run_here", lambda *_: Ended)
    assert "exit code 70" in fuzz.tried(tmp_path, ["validate", "FILE"], "m.xml", b"<a/>", 10)

    def leaves(place, *_):
        (place / "left").write_text("")
        return type("Fine", (), {"returncode": 1, "stdout": "", "stderr": ""})

    monkeypatch.setattr(fuzz, "run_here", leaves)
    assert fuzz.tried(tmp_path, ["validate", "FILE"], "m.xml", b"<a/>", 10) == "left ['left']"


def test_every_reader_has_seeds():
    readers = {name.partition(" ")[0] for name in fuzz.seeds()}
    assert readers >= READERS | {"profile", "xdm", "ctf-metadata", "ctf-channel_0"}
