"""Programs that halpipe starts: what they print, how they end, and those that do not start."""

import sys

import pytest

from halpipe.core import programs
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files.reading import MAX_INPUT_BYTES, TOO_LARGE


def test_what_a_program_prints_and_its_status_are_returned(tmp_path, capfd):
    code = (
        "import os, sys; print(os.getcwd(), sys.stdin.read(), os.environ['X']); sys.stderr.write('\\xe9'); sys.exit(3)"
    )
    done = programs.run([sys.executable, "-X", "utf8", "-c", code], tmp_path, environment={"X": "7"})
    assert (done.returncode, done.stdout, done.stderr) == (3, f"{tmp_path}  7\n", "é")
    assert tuple(capfd.readouterr()) == ("", "")


def test_a_program_that_is_not_there(tmp_path):
    with pytest.raises(HalpipeError, match="missing cannot be started: No such file"):
        programs.run([str(tmp_path / "missing")])


def test_a_program_that_takes_too_long():
    with pytest.raises(programs.TimeoutExpired):
        programs.run([sys.executable, "-c", "import time; time.sleep(60)"], seconds=0.2)


def test_the_page_of_a_limit_states_it():
    assert f"up to {MAX_INPUT_BYTES >> 20} MiB" in TOO_LARGE.explanation
    assert "up to 256 MiB" in TOO_LARGE.explanation
