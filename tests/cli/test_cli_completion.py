"""What a shell is told of how a command line may go on; it asks in the way of `halpipe --show-completion`."""

import os
import subprocess
import sys

import pytest

from halpipe.cli.app import VERBS


def completed(line):
    words = line.split(" ")
    asked = {"_HALPIPE_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    done = subprocess.run(
        [sys.executable, "-m", "halpipe"],
        env=os.environ | asked,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.split()


def test_verbs():
    assert completed("halpipe ") == list(VERBS)
    assert completed("halpipe sch") == ["schedule"]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("halpipe schedule --qual", ["--quality"]),
        ("halpipe schedule --quality c", ["cost"]),
        ("halpipe export re", ["regulator", "report"]),
        ("halpipe export report --ti", ["--title"]),
    ],
)
def test_what_a_verb_takes(line, said):
    assert completed(line) == said
